"""Arrays on disk: made once, never half-written, made again where a file cannot be trusted, and not without end."""

import ast
import os
import shutil
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import varos_warp
from varos_warp import cache
from varos_warp.cache import cache_folder, cached, clear, code_hash, contents, size_limit
from varos_warp.errors import InputError
from varos_warp.render.field import open_water
from varos_warp.scene.description import Scene


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


# ------------------------------------------------------------------------------------------------------- a size limit


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """A cache of this test's own, of which this process uses nothing yet; it holds half a megabyte."""
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path))
    monkeypatch.setenv("VAROS_WARP_CACHE_MB", "0.5")
    monkeypatch.setattr(cache, "_in_use", set())
    return tmp_path


def keep(number, size=25_000, days_ago=0.0):
    """An entry of 0.2 MB, used so long ago by a process that is gone."""
    before = set(cache_folder().iterdir())
    cached("light", {"number": number}, lambda: {"a": np.full(size, float(number))})
    (path,) = set(cache_folder().iterdir()) - before
    os.utime(path, (time.time() - 86_400 * days_ago,) * 2)
    cache._in_use.discard(path)
    return path


def test_what_was_used_least_recently_goes_first(folder):
    first, second = keep(1, days_ago=2), keep(2, days_ago=1)
    cached("light", {"number": 1}, never)  # which makes it the last used
    cache._in_use.clear()
    third = keep(3)
    assert sorted(folder.iterdir()) == sorted([first, third])
    assert second not in [first, third]
    assert contents().bytes <= contents().limit == 500_000


def test_what_this_process_uses_stays_whatever_the_limit(folder):
    mine = {cached("light", {"number": n}, lambda n=n: {"a": np.full(50_000, float(n))})["a"][0] for n in range(3)}
    assert mine == {0.0, 1.0, 2.0}
    assert len(list(folder.iterdir())) == 3


def test_nothing_that_is_not_ours_is_ever_deleted(folder):
    names = (
        "notes.txt",
        "light.npz",
        f"light-{'0' * 31}.npz",
        f"light-{'g' * 32}.npz",
        f"light-{'0' * 32}.npz.bak",
        "tmpabc.partial",
    )
    for name in names:
        (folder / name).write_bytes(bytes(1_000_000))
    inside = folder / f"light-{'0' * 32}.npz"
    inside.mkdir()
    (folder / "elsewhere").mkdir()
    target = folder / "elsewhere" / "data"
    target.write_bytes(b"mine")
    (folder / f"light-{'1' * 32}.npz").symlink_to(target)
    for number in range(5):
        keep(number, days_ago=9 - number)
    clear()
    assert {path.name for path in folder.iterdir()} == {*names, inside.name, "elsewhere", f"light-{'1' * 32}.npz"}
    assert target.read_bytes() == b"mine"


def test_what_a_killed_process_left_goes_and_what_another_writes_now_stays(folder):
    old, young = (folder / f"light-{'0' * 32}-{name}.partial" for name in ("old", "young"))
    for path, days in ((old, 2), (young, 0)):
        path.write_bytes(b"half")
        os.utime(path, (time.time() - 86_400 * days,) * 2)
    keep(1)
    assert not old.exists()
    assert young.exists()


def test_contents_name_what_is_kept_and_clear_says_what_was_freed(folder):
    older, newer = keep(1, days_ago=1), keep(2, 10)
    found = contents()
    assert found.folder == folder
    assert found.entries == [(path.name, path.stat().st_size) for path in (newer, older)]
    assert clear() == found.bytes > 200_000
    assert contents().entries == []
    assert clear() == 0


def test_a_cache_that_is_not_there_is_empty(monkeypatch, tmp_path):
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path / "none"))
    assert contents().entries == []
    assert clear() == 0


@pytest.mark.parametrize("limit", ["much", "-1", "nan", "inf"])
def test_a_limit_that_is_no_number_of_megabytes_is_bad_input(monkeypatch, limit):
    monkeypatch.setenv("VAROS_WARP_CACHE_MB", limit)
    with pytest.raises(InputError, match="VAROS_WARP_CACHE_MB = "):
        size_limit()


def test_an_entry_that_vanishes_while_it_is_wanted_is_built_again(folder, monkeypatch):
    """Another process makes room between the look at the folder and the reading."""
    path = keep(1)
    load = np.load
    monkeypatch.setattr(np, "load", lambda *args, **how: (path.unlink(), load(*args, **how))[1])
    assert cached("light", {"number": 1}, lambda: {"a": np.ones(1)})["a"] == [1.0]


# ------------------------------------------------------------------------------------------------- the code as a key


@pytest.fixture
def package(tmp_path):
    """A copy of the code that the field follows from."""
    source = Path(varos_warp.__file__).parent
    for name in ("kernels", "render", "scene"):
        shutil.copytree(source / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def hash_of(package):
    cache._code_of.cache_clear()  # files change here as they do not while a program runs
    return code_hash.__wrapped__(open_water.__name__, open_water.CODE, package)


@pytest.mark.parametrize(
    ("file", "before", "after"),
    [
        ("kernels/field/single_scattering.py", "wp.constant(10)", "wp.constant(11)"),
        ("kernels/field/tabulate.py", "PANEL, PANEL_NODES = wp.constant(3.0)", "PANEL, PANEL_NODES = wp.constant(3.5)"),
        ("kernels/conventions.py", "NEAR = ", "NEAR = 2.0 * "),
        ("render/field/solver.py", "FINE = (64,", "FINE = (65,"),
        ("render/field/scattering.py", "BETWEEN = 2", "BETWEEN = 3"),
        ("render/field/along_camera.py", "(64, 19, 33)", "(65, 19, 33)"),
        ("scene/water/phase/fournier_forand.py", "import numpy", "import numpy as other\nimport numpy"),
    ],
)
def test_changing_a_constant_that_decides_the_field_changes_its_key(package, file, before, after):
    key, path = hash_of(package), package / file
    assert path.read_text().count(before)
    path.write_text(path.read_text().replace(before, after, 1))
    assert hash_of(package) != key


def test_code_that_the_field_does_not_follow_from_leaves_its_key(package):
    before = hash_of(package)
    (package / "kernels/transport/path.py").write_text("X = 1\n")
    assert hash_of(package) == before == code_hash(open_water.__name__, open_water.CODE)


def test_no_import_of_ours_is_overlooked():
    """Whatever a parser finds in any file of the package, the hash of code finds too."""
    for path in Path(varos_warp.__file__).parent.rglob("*.py"):
        imported = set(cache._code_of(path)[1])
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.Import):
                assert {a.name for a in node.names if a.name.startswith("varos_warp")} <= imported, path
            elif isinstance(node, ast.ImportFrom) and node.module.startswith("varos_warp"):
                assert {f"{node.module}.{alias.name}" for alias in node.names} <= imported, path


def test_the_field_is_kept_under_the_hash_of_its_code():
    scene = Scene(water={"jerlov": {"type": "IB"}}, trajectory={"poses": [{"position": [0, 0, 0]}]})
    water = open_water.OpenWater(scene, SimpleNamespace(device="cpu"))
    assert water._depends_on()["code"] == code_hash(open_water.__name__, open_water.CODE)
