"""Arrays on disk: made once, never half-written, made again where a file cannot be trusted."""

import numpy as np
import pytest

from varos_warp.render.cache import cache_folder, cached


def build():
    return {"a": np.arange(12.0).reshape(3, 4), "b": np.array([7], np.float32)}


def never():
    raise AssertionError("built again")


def same(arrays):
    return all(np.array_equal(arrays[name], value) for name, value in build().items()) and len(arrays) == 2


def test_what_was_built_once_is_read_back(tmp_path):
    folder = tmp_path / "new" / "folder"
    assert same(cached("lamp", {"g": 0.8}, build, folder))
    assert same(cached("lamp", {"g": 0.8}, never, folder))
    assert [path.suffix for path in folder.iterdir()] == [".npz"]


@pytest.mark.parametrize("other", [{"g": 0.80000001}, {"g": 0.8, "more": 1}, {}])
def test_whatever_the_numbers_depend_on_makes_another_file(tmp_path, other):
    cached("lamp", {"g": 0.8}, build, tmp_path)
    assert same(cached("lamp", other, build, tmp_path))
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("damage", ["cut", "flip", "empty", "foreign"])
def test_a_damaged_or_foreign_file_is_built_again(tmp_path, damage):
    cached("lamp", {}, build, tmp_path)
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    at = whole.index(np.arange(12.0).tobytes()) + 20
    wrong = {
        "cut": whole[:-100],
        "flip": whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :],
        "empty": b"",
        "foreign": b"PK something else",
    }
    path.write_bytes(wrong[damage])
    assert same(cached("lamp", {}, build, tmp_path))
    assert same(cached("lamp", {}, never, tmp_path))


def test_a_file_that_says_it_holds_something_else_is_built_again(tmp_path):
    cached("lamp", {"g": 0.5}, lambda: {"a": np.zeros(3)}, tmp_path)
    (other,) = tmp_path.iterdir()
    cached("lamp", {"g": 0.8}, build, tmp_path)
    (path,) = set(tmp_path.iterdir()) - {other}
    path.write_bytes(other.read_bytes())
    assert same(cached("lamp", {"g": 0.8}, build, tmp_path))


def test_a_folder_that_cannot_be_written_costs_a_warning(tmp_path):
    file = tmp_path / "file"
    file.write_text("not a folder")
    with pytest.warns(UserWarning, match="made again"):
        assert same(cached("lamp", {}, build, file / "below"))


def test_writing_that_is_broken_off_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(file, **_):
        file.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", interrupted)
    with pytest.raises(KeyboardInterrupt):
        cached("lamp", {}, build, tmp_path)
    assert not list(tmp_path.iterdir())


def test_the_folder_follows_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path / "own"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "own"
    monkeypatch.delenv("VAROS_WARP_CACHE")
    assert cache_folder() == tmp_path / "varos_warp"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder().parts[-2:] == (".cache", "varos_warp")
