"""A file appears under its name only when it is whole, and a damaged one is never taken for good."""

import itertools
import os

import numpy as np
import pytest

from varos_warp.dataset import files
from varos_warp.errors import InputError


def test_an_interrupted_write_leaves_neither_file_nor_remains(tmp_path):
    path = tmp_path / "a" / "x.bin"
    with pytest.raises(KeyboardInterrupt), files.atomic(path) as temp:  # noqa: PT012
        temp.write_bytes(b"half")
        assert temp.name.startswith(".")
        raise KeyboardInterrupt
    assert list(path.parent.iterdir()) == []


def test_an_interrupted_write_keeps_the_older_file(tmp_path):
    path = tmp_path / "x.bin"
    files.write_bytes(path, b"old")
    with pytest.raises(RuntimeError, match="broken off"), files.atomic(path) as temp:  # noqa: PT012
        temp.write_bytes(b"ne")
        raise RuntimeError("broken off")
    assert path.read_bytes() == b"old"


def test_the_same_bytes_are_not_written_again(tmp_path):
    path = tmp_path / "x.bin"
    assert files.write_bytes(path, b"abc")
    os.utime(path, ns=(1, 1))
    assert not files.write_bytes(path, b"abc")
    assert path.stat().st_mtime_ns == 1
    assert files.write_bytes(path, b"abd")


def test_a_folder_that_cannot_be_made_is_bad_input(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file/x.bin: cannot be written: .*A file is where a folder is needed"):
        files.write_bytes(tmp_path / "file" / "x.bin", b"")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize("name", ["x.png", "x.exr"])
def test_a_full_disk_is_bad_input_for_png_and_exr_alike(tmp_path, monkeypatch, name):
    """The hidden file is made a link to a device that is always full."""
    monkeypatch.setattr(files, "_counter", itertools.count())
    (tmp_path / f".{name}.{files.HOST}-{os.getpid()}-0.tmp").symlink_to("/dev/full")
    with pytest.raises(InputError, match=r"No space left on device.*Free some space"):  # noqa: PT012
        if name == "x.png":
            files.write_png(tmp_path / name, np.random.default_rng(0).integers(0, 255, (99, 99, 3)).astype(np.uint8))
        else:
            files.write_exr(tmp_path / name, {"RGB": np.zeros((4, 4, 3), np.float16)})
    assert list(tmp_path.iterdir()) == []


def test_csv_keeps_every_bit_of_floats_and_nanoseconds(tmp_path):
    rng = np.random.default_rng(0)
    time = 1_629_158_400_000_000_001 + np.arange(50, dtype=np.int64)
    values = rng.normal(size=(50, 3)) * 10.0 ** rng.integers(-12, 12, (50, 3))
    names = [f"f-{i}" for i in range(50)]
    files.write_csv(tmp_path / "t.csv", ["# timestamp [ns]", "x", "y", "z", "file"], time, values, names)
    table = files.read_csv(tmp_path / "t.csv")
    np.testing.assert_array_equal(table["# timestamp [ns]"], time)
    np.testing.assert_array_equal(np.column_stack([table[c] for c in "xyz"]), values)
    assert table["file"].tolist() == names
    assert table["# timestamp [ns]"].dtype == np.int64


def test_a_csv_with_a_short_row_is_refused(tmp_path):
    (tmp_path / "t.csv").write_text("a,b\n1,2\n3\n")
    with pytest.raises(InputError, match=r"t.csv:3: cannot be read"):
        files.read_csv(tmp_path / "t.csv")


@pytest.mark.parametrize(
    "pixels", [np.arange(60, dtype=np.uint8).reshape(4, 5, 3), np.array([[0, 1, 255, 256, 65535]], np.uint16)]
)
def test_png_gives_back_what_was_written(tmp_path, pixels):
    files.write_png(tmp_path / "x.png", pixels)
    again = files.read_png(tmp_path / "x.png")
    assert again.dtype == pixels.dtype
    np.testing.assert_array_equal(again, pixels)


def test_exr_gives_back_what_was_written(tmp_path):
    rng = np.random.default_rng(0)
    half = rng.random((9, 7, 3)).astype(np.float16)
    files.write_exr(tmp_path / "h.exr", {"RGB": half})
    channels = files.read_exr(tmp_path / "h.exr")
    np.testing.assert_array_equal(np.stack([channels[c] for c in "RGB"], -1), half)
    assert channels["R"].dtype == np.float16
    full = {name: rng.random((9, 7)).astype(np.float32) for name in ("R", "G", "B", "stderr.R", "direct.B", "Z")}
    files.write_exr(tmp_path / "f.exr", full)
    channels = files.read_exr(tmp_path / "f.exr")
    assert set(channels) == set(full)
    for name, values in full.items():
        np.testing.assert_array_equal(channels[name], values)


@pytest.mark.parametrize("suffix", ["png", "exr"])
def test_a_file_cut_anywhere_is_known_as_incomplete(tmp_path, suffix):
    whole, cut = tmp_path / f"whole.{suffix}", tmp_path / f"cut.{suffix}"
    pixels = np.random.default_rng(0).integers(0, 255, (40, 30, 3)).astype(np.uint8)
    if suffix == "png":
        files.write_png(whole, pixels)
    else:
        files.write_exr(whole, {"RGB": pixels.astype(np.float16), "stderr.R": pixels[..., 0].astype(np.float16)})
    data = whole.read_bytes()
    assert files.is_complete(whole)
    assert not files.is_complete(tmp_path / f"none.{suffix}")
    for length in (0, 1, 7, 8, 100, 400, len(data) // 2, len(data) - 1):
        cut.write_bytes(data[:length])
        assert not files.is_complete(cut), length
    with pytest.raises(InputError, match=r"cut.*cannot be read: .*delete it"):
        (files.read_png if suffix == "png" else files.read_exr)(cut)


def test_large_exr_files_are_known_as_complete(tmp_path):
    """Their table of offsets is longer than the first read."""
    path = tmp_path / "tall.exr"
    files.write_exr(path, {"Z": np.zeros((16 * 700, 2), np.float32)})
    assert files.is_complete(path)


def test_a_folder_made_again_removes_what_a_killed_attempt_left_beside_it_but_not_what_lives(tmp_path):
    """A killed attempt's lock is there and nobody holds it; a folder without one is not ours."""
    left, unknown = (tmp_path / f".euroc.otherhost-{i}-0.tmp" for i in (1, 2))
    for folder in (left, unknown):
        (folder / "mav0").mkdir(parents=True)
    (left / files.OWNER).touch()
    with files.new_folder(tmp_path / "euroc") as mine:
        assert not left.exists()
        assert unknown.exists()
        with pytest.raises(ZeroDivisionError), files.new_folder(tmp_path / "euroc"):  # noqa: PT012
            assert mine.exists()
            raise ZeroDivisionError
        assert mine.exists()
    assert list((tmp_path / "euroc").iterdir()) == []
