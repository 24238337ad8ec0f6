"""A dataset from elsewhere is refused in one message where it lies, writes nowhere else, and runs nothing."""

import json
import os
import shutil
import sys
from pathlib import Path

import pytest
from PIL import Image
from standins import tree
from typer.testing import CliRunner

from varos_warp.cli import app
from varos_warp.dataset import report
from varos_warp.dataset.export import FORMATS
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.report import facts, write_report
from varos_warp.dataset.write import pictures
from varos_warp.errors import InputError

SCRIPT = "<script>alert(1)</script>"


@pytest.fixture
def copy(written, tmp_path):
    return shutil.copytree(written, tmp_path / "copy")


def change(root, path: tuple, value) -> None:
    """Set an entry of dataset.json, which may be no JSON that a careful writer makes."""
    meta = json.loads((root / "dataset.json").read_text())
    block = meta
    for part in path[:-1]:
        block = block[part]
    block[path[-1]] = value
    (root / "dataset.json").write_text(json.dumps(meta))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("cameras", 0, "id"), "M0/../../../x"),
        (("cameras", 0, "id"), "../"),
        (("cameras", 0, "id"), "R0"),
        (("sequence",), "a/"),
        (("sequence",), "01\n"),
        (("vehicle",), "/"),
        (("vehicle",), "."),
        (("frames", "ranges"), [[0, 10**12]]),
        (("frames", "ranges"), [[5, 2]]),
        (("frames", "ranges"), [[-5, 2]]),
        (("frames", "ranges"), [[0.0, 10]]),
        (("cameras", 0, "width"), 64.0),
        (("frames", "ranges"), [[0, 9], [3, 10]]),
        (("cameras", 0, "width"), 10**9),
        (("cameras", 0, "height"), 0),
        (("cameras", 0, "K_opencv", 0, 0), float("nan")),
        (("cameras", 0, "K_center_half", 1, 1), float("inf")),
        (("samples", "denoise"), SCRIPT),
        (("gravity", 2), float("nan")),
        (("surface_depth_m",), float("-inf")),
        (("water", "g"), float("nan")),
    ],
    ids=str,
)
def test_an_entry_that_no_dataset_has_is_refused(copy, path, value):
    change(copy, path, value)
    with pytest.raises(InputError, match=r"dataset\.json"):
        Dataset(copy)


def test_a_light_without_a_place_is_shown_without_one(copy):
    change(copy, ("lights", 0, "position"), None)
    assert "light 0" in str(facts.equipment(Dataset(copy)))


def test_more_frames_than_the_limit_are_refused_unless_it_is_raised(copy, monkeypatch):
    monkeypatch.setenv("VAROS_WARP_MAX_FRAMES", "9")
    with pytest.raises(InputError, match=r"10 frames are more than the limit of 9.*VAROS_WARP_MAX_FRAMES=10"):
        Dataset(copy)
    monkeypatch.setenv("VAROS_WARP_MAX_FRAMES", "1e1")
    assert len(Dataset(copy)) == 10


@pytest.mark.parametrize("verb", ["noise", *FORMATS])
def test_names_of_cameras_lead_nowhere(copy, tmp_path, verb):
    change(copy, ("cameras", 0, "id"), "M0/../../../x")
    before = tree(tmp_path)
    how = ["noise", copy, "--profile", "mpu6050"] if verb == "noise" else ["export", copy, "--to", verb]
    result = CliRunner().invoke(app, [*map(str, how), "-o", str(tmp_path / "out" / "deep")])
    assert result.exit_code == 2, result.output
    assert tree(tmp_path) == before


@pytest.mark.skipif(sys.platform == "win32", reason="symbolic links and pipes")
@pytest.mark.parametrize("place", ["secret.txt", "vehicle0/cam0/A_clean", "log", ".run.h.1-0.0of1.lock"])
@pytest.mark.parametrize("kind", ["file", "folder", "loop", "fifo"])
def test_links_out_of_a_dataset_and_what_is_no_file_are_refused(copy, tmp_path, place, kind):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "secret").write_text("secret")
    at = copy / place
    if at.is_dir():
        shutil.rmtree(at)
    if kind == "fifo":
        os.mkfifo(at)
    else:
        at.symlink_to({"file": outside / "secret", "folder": outside, "loop": at}[kind])
    with pytest.raises(InputError, match=r"is no file|is a link"):
        Dataset(copy)
    assert [path.read_text() for path in outside.iterdir()] == ["secret"]


def test_a_link_within_a_dataset_is_read(copy):
    text = copy / "README.txt"
    text.rename(copy / "real.txt")
    text.symlink_to("real.txt")
    assert len(Dataset(copy)) == 10


def strings(block, path=()):
    """Paths of all strings in a tree."""
    items = block.items() if isinstance(block, dict) else enumerate(block) if isinstance(block, list) else ()
    for key, value in items:
        if isinstance(value, str):
            yield (*path, key)
        yield from strings(value, (*path, key))


def test_no_string_of_a_dataset_becomes_a_script_of_the_report(copy, tmp_path, monkeypatch):
    """Each string that may be any text, in turn; and what the page itself holds is all that a browser may run.

    The course is drawn once, and frames are blank: their pictures are pixels, and no string of dataset.json is in them.
    """
    drawn = report.course_pictures(data := Dataset(copy), report.scene_parts(data))
    monkeypatch.setattr(report, "course_pictures", lambda *_: drawn)
    monkeypatch.setattr(pictures, "preview", lambda *_: Image.new("RGB", (8, 8)))
    meta = json.loads((copy / "dataset.json").read_text())
    whole = (copy / "dataset.json").read_text()
    loaded = []
    for path in strings(meta):
        (copy / "dataset.json").write_text(whole)
        change(copy, path, SCRIPT)
        try:
            data = Dataset(copy)
        except InputError:
            continue
        loaded.append(path)
        if path[0] in ("name", "device", "versions", "water", "samples", "lights", "cameras", "sources"):
            page = write_report(data, tmp_path / "report.html").read_text()
            assert SCRIPT not in page, path
    assert ("name",) in loaded
    assert "script-src 'sha256-" in page
    assert "script-src 'unsafe-inline'" not in page


def test_a_huge_image_is_refused_before_it_is_unpacked(copy, monkeypatch):
    monkeypatch.setenv("VAROS_WARP_MAX_TEXTURE_PIXELS", "1000")
    with pytest.raises(InputError, match=r"1296 texture pixels are more than the limit of 1000"):
        Dataset(copy).pixels("A", 0)


def test_an_exr_whose_table_begins_beyond_its_end_is_not_whole(copy):
    path = Path(Dataset(copy).layout.exr("L0", "A", 0))
    data = bytearray(path.read_bytes())
    end = data.index(b"screenWindowWidth")
    at = data.index(b"\0", data.index(b"float\0", end) + 10)
    data[at + 1 : at + 9] = (2**62).to_bytes(8, "little")
    path.write_bytes(data)
    with pytest.raises(InputError):
        Dataset(copy).linear("A", 0)
