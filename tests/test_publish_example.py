"""examples/publish makes a data set that others read, with the numbers of the datasets, and the same bytes again."""

import hashlib
import importlib
import json
import os
import subprocess
import sys
import tarfile
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import pytest
import yaml
from typer.testing import CliRunner

import varos_warp as vw
from varos_warp.cli import app

EXAMPLE = Path(__file__).parents[1] / "examples" / "publish"
FEW_THINGS = [
    word
    for change in (
        "growth=[]",
        "terrain.resolution=65",
        *(f"scatter.{i}.{few}" for i in (0, 1) for few in ("count=3", "shapes=1")),
    )
    for word in ("--set", change)
]
"""The scene with little to form: what is published of it are files all the same."""
TINY = [
    "sample",
    "--waters",
    "clear,coast",
    "--frames",
    "0:2",
    "--device",
    "cpu",
    *(
        word
        for change in (
            "vehicle.cameras.0.resolution=[48,32]",
            "vehicle.cameras.1.resolution=[48,32]",
            "render.spp=1",
            "render.max_triangles=20000",
            "render.denoise=none",
            "render.integrator=path",
            "render.spp_b=1",
        )
        for word in ("--set", change)
    ),
    *FEW_THINGS,
]


def run_here(line, stdout=None, text=True, capture_output=False):
    """As subprocess.run a verb of varos-warp, without the seconds in which a process starts."""
    assert line[:3] == [sys.executable, "-m", "varos_warp"]
    result = CliRunner().invoke(app, line[3:])
    if not capture_output:
        print(result.stderr, end="", file=sys.stderr)
        print(result.stdout if stdout is None else "", end="")
    return subprocess.CompletedProcess(line, result.exit_code, result.stdout, result.stderr)


@pytest.fixture(scope="module")
def publish():
    """The command, whose verbs run in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(EXAMPLE))
        module = importlib.import_module("publish")
        patch.setattr(module, "subprocess", SimpleNamespace(**vars(subprocess) | {"run": run_here}))
        yield module


@pytest.fixture
def by_processes(publish, monkeypatch):
    """Its verbs run as users have them."""
    monkeypatch.setattr(publish, "subprocess", subprocess)


@pytest.fixture(scope="module")
def made(publish, tmp_path_factory):
    out = tmp_path_factory.mktemp("made") / "out"
    assert publish.main([*TINY, "-o", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def unpacked(made, tmp_path_factory):
    place = tmp_path_factory.mktemp("unpacked")
    with tarfile.open(next((made / "upload").glob("*.tar"))) as tar:
        tar.extractall(place, filter="data")
    return place


def test_the_archive_holds_whole_datasets_and_what_they_share_once(made, unpacked):
    (folder,) = unpacked.iterdir()
    for water in ("clear", "coast"):
        assert CliRunner().invoke(app, ["validate", str(folder / water), "-q"]).exit_code == 0
    clear, coast = (vw.Dataset(folder / water) for water in ("clear", "coast"))
    with tarfile.open(next((made / "upload").glob("*.tar"))) as tar:
        links = {member.name.split("/", 1)[1] for member in tar if member.islnk()}
    for letter, shared in (("A", False), *((letter, True) for letter in "BCDSF")):
        images = [data.layout.image("L0", letter, 0) for data in (clear, coast)]
        assert (images[0].read_bytes() == images[1].read_bytes()) is shared
        assert (images[1].relative_to(folder).as_posix() in links) is shared


def test_bytes_follow_from_the_files_alone(publish, made, by_processes):
    before = {path.name: path.read_bytes() for path in (made / "upload").iterdir()}
    for path in (made / "datasets").rglob("*.png"):
        os.utime(path, (1e9, 1e9))
    assert publish.main([*TINY, "-o", str(made)]) == 0
    assert {path.name: path.read_bytes() for path in (made / "upload").iterdir()} == before


def test_what_was_found_valid_is_not_validated_again(publish, made, monkeypatch):
    verbs, call = [], publish.call
    monkeypatch.setattr(publish, "call", lambda *words, **how: (verbs.append(words[0]), call(*words, **how)))
    os.utime(made / "datasets" / "coast" / "checksums")
    for expected in (["sweep", "validate"], ["sweep"]):
        verbs.clear()
        assert publish.main([*TINY, "-o", str(made)]) == 0
        assert verbs == expected


def test_a_file_that_has_changed_is_not_packed(publish, made, tmp_path):
    facts = publish.Facts.of("sample", [made / "datasets" / "coast"], publish.ROOT, "cc0-1.0", None, "")
    name = next(iter(facts.sums[0]))
    facts.sums[0][name] = "0" * 64
    with pytest.raises(ValueError, match="checksum differs"):
        publish.pack(facts, made / "datasets" / "sweep.json", tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_checksums_are_those_of_the_files(made):
    place = made / "upload"
    listed = dict(line.split("  ")[::-1] for line in (place / "SHA256SUMS").read_text().splitlines())
    there = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in place.iterdir()}
    assert listed == {name: value for name, value in there.items() if name != "SHA256SUMS"}


def test_the_card_has_a_header_and_the_numbers_of_the_datasets(made):
    text = (made / "upload" / "README.md").read_text(encoding="utf-8")
    assert "1 sample per pixel;" in " ".join(text.split())
    _, header, body = text.split("---\n", 2)
    assert yaml.safe_load(header)["license"] == "cc-by-4.0"
    assert yaml.safe_load(header)["configs"][0]["data_files"] == "frames.csv"
    for water in ("clear", "coast"):
        about = vw.Dataset(made / "datasets" / water).meta["water"]
        row = next(line for line in body.splitlines() if line.startswith(f"| `{water}` |"))
        cells = [", ".join(f"{value:.4g}" for value in about[key]) for key in ("sigma_s", "sigma_a", "sigma_t")]
        assert f"| {' | '.join(cells)} |" in row
    assert "| `L0` | 48 x 32 |" in body
    assert "48 images in 2 waters: 2 frames through 2 cameras in each." in body
    assert all(
        value in body
        for value in (
            vw.Dataset(made / "datasets" / "clear").meta["versions"]["varos_warp"],
            *(hashlib.sha256(path.read_bytes()).hexdigest() for path in (made / "upload").glob("*.tar")),
        )
    )


def test_mlcroissant_reads_every_view_and_the_paths_lead_to_images(made, unpacked):
    """In a process of its own: mlcroissant keeps what it unpacks."""
    mlcroissant = pytest.importorskip("mlcroissant")
    metadata = mlcroissant.Dataset(made / "upload" / "croissant.json").metadata
    assert not metadata.issues.errors
    records = [
        {key.partition("/")[2]: value for key, value in record.items()}
        for record in mlcroissant.Dataset(made / "upload" / "croissant.json").records("frames")
    ]
    assert len(records) == 8
    for record in records:
        assert all((unpacked / record[letter].decode()).is_file() for letter in "ABCDSF")
    data = vw.Dataset(next(unpacked.iterdir()) / "coast")
    times = [record["time_ns"] for record in records if (record["water"], record["camera"]) == (b"coast", b"R0")]
    assert times == [frame.time_ns for frame in data]
    plain = json.loads((made / "upload" / "croissant.json").read_text())
    sets = [each for each in plain["distribution"] if each["@type"] == "cr:FileSet"]
    assert all(len(list(unpacked.glob(each["includes"]))) == 8 for each in sets)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (["--waters", "clear"], "waters: is ['clear'] here"),
        (["--frames", "0:1"], "frames: is '0:1' here"),
        (["--waters", "mud"], "--waters = 'mud': there is no such water"),
    ],
)
def test_another_request_for_the_same_folder_is_refused(publish, made, capfd, change, words):
    before = sorted(made.rglob("*"))
    assert publish.main([*TINY, "-o", str(made), *change]) == 2
    assert words in capfd.readouterr().err
    assert sorted(made.rglob("*")) == before


@pytest.mark.parametrize("place", ["", "upload"])
def test_a_folder_that_holds_something_else_is_refused_and_left(publish, made, tmp_path, capfd, place):
    (tmp_path / "mine.txt").write_text("mine")
    assert publish.main([*TINY, "-o", str(tmp_path)]) == 2
    assert "holds no publication" in capfd.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    mine = made / place / "mine.txt"
    mine.write_text("mine")
    try:
        assert publish.main([*TINY, "-o", str(made)]) == 2
        assert "is nothing of a publication" in capfd.readouterr().err
        assert mine.read_text() == "mine"
    finally:
        mine.unlink()


def test_what_would_be_too_large_is_refused_before_anything_is_made(publish, tmp_path, capfd):
    out = tmp_path / "out"
    large = [word for i in range(2) for word in ("--set", f"vehicle.cameras.{i}.resolution=[4000,4000]")]
    assert publish.main(["sample", "-o", str(out), *large, *FEW_THINGS, "--set", "render.max_triangles=20000"]) == 2
    told = capfd.readouterr()
    assert "more than 50 MB" in told.err
    assert "in 3 waters" in told.out
    assert not out.exists()


def test_what_was_begun_goes_on_however_little_room_is_left(publish, made, monkeypatch, capfd):
    """Its own files have taken the room; a new one is refused."""
    monkeypatch.setattr(publish.shutil, "disk_usage", lambda _: Usage(free=10))
    assert publish.main([*TINY, "-o", str(made)]) == 0
    assert publish.main([*TINY, "-o", str(made.parent / "new")]) == 2
    assert "MB are free" in capfd.readouterr().err
    assert not (made.parent / "new").exists()


class Usage(NamedTuple):
    """What is left of a disk."""

    free: int


@pytest.mark.parametrize("by", ["validate", "pack"])
def test_a_damaged_file_is_named_and_made_anew_once_it_is_deleted(publish, made, capfd, by):
    path = sorted((made / "datasets" / "coast").rglob("A/*.png"))[0]
    content, archive = path.read_bytes(), next((made / "upload").glob("*.tar")).read_bytes()
    path.write_bytes(content[:-20])
    if by == "validate":
        (made / "datasets" / "coast" / "log" / "validation.json").unlink()
    assert publish.main([*TINY, "-o", str(made)]) != 0
    assert f"{path.relative_to(made / 'datasets' / 'coast')}: is not as it was written" in capfd.readouterr().err
    path.unlink()
    assert publish.main([*TINY, "-o", str(made)]) == 0
    assert path.read_bytes() == content
    assert next((made / "upload").glob("*.tar")).read_bytes() == archive


def test_without_git_the_commit_is_what_the_environment_says(publish, tmp_path, monkeypatch):
    monkeypatch.setenv("VAROS_WARP_COMMIT", "c0ffee")
    assert publish.sys.modules["facts"].git(tmp_path) == ("c0ffee", None)
