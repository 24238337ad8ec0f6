"""A sweep makes complete datasets, goes on where it stopped, and touches nothing that is not its own."""

import json
import os
import random
import shutil
import signal
import sys
import time

import pytest
import standins
import yaml
from standins import FlatFloorRenderer, tree
from typer.testing import CliRunner

from varos_warp import cli
from varos_warp.dataset.export import export
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.report import write_report
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.sweep.run import prepare
from varos_warp.dataset.validate import validate
from varos_warp.errors import InputError, RunFailed

WATERS = "water.jerlov.type=IB,II,1C"
posix = pytest.mark.skipif(sys.platform == "win32", reason="needs signals")


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(standins.scene_dict()))
    return path


def sweep(scene_file, out, over=WATERS, *overrides, frames=slice(0, 4), **how):
    job = prepare(scene_file, [over], out, ["render.outputs=[A,B,C,D,S,F]", *overrides], device="cpu", frames=frames)
    return job, job.run(quiet=True, **how)


def stamps(root):
    """What differs when a file was written: by path inode, time and size."""
    return {
        path.relative_to(root).as_posix(): (path.stat().st_ino, path.stat().st_mtime_ns, path.stat().st_size)
        for path in root.rglob("*")
        if path.is_file()
    }


def everything(root):
    """Bytes of all files but logs, hidden ones too."""
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and "log" not in path.relative_to(root).parts
    }


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """An uninterrupted sweep, and its scene file; not to be changed."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "scene.yaml").write_text(yaml.safe_dump(standins.scene_dict()))
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        sweep(folder / "scene.yaml", folder / "out")
    return folder


def told(out):
    return {entry["name"]: entry for entry in json.loads((out / "sweep.json").read_text())["versions"]}


# ------------------------------------------------------------------------------------------------------- what is made


def test_each_version_moves_alone_and_every_reader_takes_it(scene_file, tmp_path):
    sweep(scene_file, tmp_path / "out", WATERS, "render.outputs=[A,B,C,D]", frames=slice(None))
    moved = shutil.move(tmp_path / "out/1C", tmp_path / "elsewhere")
    shutil.rmtree(tmp_path / "out")
    assert validate(moved, quiet=True).problems == []
    assert write_report(Dataset(moved), tmp_path / "report.html", quiet=True).is_file()
    assert len(export(moved, "tum", tmp_path / "tum", quiet=True).data) == 10
    assert (
        call(
            "run", scene_file, "-o", moved, "--device", "cpu", "--set", "water={jerlov: {type: 1C}}", "--json", "-q"
        ).stdout.count('"rendered": 0')
        == 1
    )


def test_what_is_the_same_is_once_on_the_disk(whole):
    """All but what tells of the water, dataset.json and with it the checksums: the stand-in's A sees no water."""
    first = stamps(whole / "out/IB")
    for name in ("II", "1C"):
        own = {
            path
            for path, (inode, *_) in stamps(whole / "out" / name).items()
            if inode != first.get(path, (None,))[0] and not path.startswith("log/")
        }
        assert own == {"dataset.json", "checksums"}


def test_where_the_disk_has_no_links_versions_are_copies_with_the_same_bytes(whole, scene_file, tmp_path, monkeypatch):
    def refused(*_, **__):
        raise OSError("no links here")

    monkeypatch.setattr(os, "link", refused)
    sweep(scene_file, tmp_path / "out")
    assert everything(tmp_path / "out") == everything(whole / "out")
    assert {path.stat().st_nlink for path in (tmp_path / "out").rglob("*") if path.is_file()} == {1}


def test_only_what_the_water_decides_is_rendered_again(scene_file, tmp_path, monkeypatch):
    calls = []
    render = FlatFloorRenderer.render

    def counted(self, T_w_v, camera, outputs, **how):
        calls.append((self.scene.water.jerlov.type, how["frame"], outputs))
        return render(self, T_w_v, camera, outputs, **how)

    monkeypatch.setattr(FlatFloorRenderer, "render", counted)
    simulated = []
    monkeypatch.setattr(
        "varos_warp.sim.trajectory.simulate",
        lambda *args, **how: simulated.append(1) or standins.simulate(*args, **how),
    )
    sweep(scene_file, tmp_path / "out")
    rendered = {name: sorted({call[1:] for call in calls if call[0] == name}) for name in ("IB", "II", "1C")}
    assert rendered["IB"] == [(frame, "ABCDSF") for frame in range(4)]
    assert rendered["II"] == rendered["1C"] == [(0, "ABCDSF"), *((frame, "A") for frame in (1, 2, 3))]
    assert len(simulated) == 1


def test_the_list_tells_what_is_changed_shared_and_complete(whole):
    entries = told(whole / "out")
    assert [*entries] == ["IB", "II", "1C"]
    assert {entry["datasets"][0]["state"] for entry in entries.values()} == {"complete"}
    assert entries["1C"]["overrides"] == {"water.jerlov.type": "1C"}
    assert entries["1C"]["datasets"][0]["shared"] == dict.fromkeys("BCDSF", "IB")
    assert entries["1C"]["datasets"][0]["course"] == "IB"


def test_shards_together_make_the_bytes_of_one_process(whole, scene_file, tmp_path):
    for index in (1, 0):
        sweep(scene_file, tmp_path / "out", shard=(index, 2))
    assert {entry["datasets"][0]["state"] for entry in told(tmp_path / "out").values()} == {"complete"}
    assert everything(tmp_path / "out") == everything(whole / "out")


# ------------------------------------------------------------------------------------------------------------ going on


def test_a_complete_sweep_is_left_as_it_is(whole, scene_file, tmp_path):
    out = shutil.copytree(whole / "out", tmp_path / "out")
    before = stamps(out)
    _, done = sweep(scene_file, out)
    assert done == {"IB": None, "II": None, "1C": None}
    assert stamps(out) == before


def test_an_interrupted_sweep_goes_on_and_leaves_what_was_complete(whole, scene_file, tmp_path, monkeypatch):
    out, render = tmp_path / "out", FlatFloorRenderer.render

    def interrupted(self, T_w_v, camera, outputs, **how):
        if self.scene.water.jerlov.type == "II" and how["frame"] == 2:
            raise KeyboardInterrupt
        return render(self, T_w_v, camera, outputs, **how)

    monkeypatch.setattr(FlatFloorRenderer, "render", interrupted)
    with pytest.raises(KeyboardInterrupt):
        sweep(scene_file, out)
    assert {name: entry["datasets"][0]["state"] for name, entry in told(out).items()} == {
        "IB": "complete",
        "II": "begun",
        "1C": "missing",
    }
    monkeypatch.setattr(FlatFloorRenderer, "render", render)
    before = stamps(out / "IB")
    _, done = sweep(scene_file, out)
    assert done["IB"] is None
    assert stamps(out / "IB") == before
    assert everything(out) == everything(whole / "out")


def killed_sweep(scene_file, out):
    """The body of a process."""
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        sweep(scene_file, out)


@posix
def test_a_sweep_killed_at_random_moments_ends_with_the_bytes_of_an_uninterrupted_one(
    processes, whole, scene_file, tmp_path
):
    """And no file has its name that is not what it will be in the end."""
    final, rng, kills, out = everything(whole / "out"), random.Random(5), 0, tmp_path / "out"
    while True:
        process = processes.Process(target=killed_sweep, args=(scene_file, out))
        process.start()
        count = len(stamps(out)) if out.exists() else 0
        until = count + rng.randrange(1, 90)
        while process.is_alive() and (not out.exists() or sum(len(names) for *_, names in os.walk(out)) < until):
            time.sleep(0.001)
        process.kill()
        process.join()
        left = {
            name: data
            for name, data in everything(out).items()
            if not os.path.basename(name).startswith(".")
            and os.path.basename(name) not in ("sweep.json", "dataset.json", "README.txt")
        }
        assert left.keys() <= final.keys()
        assert all(data == final[name] for name, data in left.items() if name.endswith((".png", ".exr")))
        if process.exitcode != -signal.SIGKILL:
            break
        kills += 1
    assert process.exitcode == 0
    assert kills >= 3
    assert everything(out) == final


def test_versions_may_be_added_and_take_what_is_there(whole, scene_file, tmp_path):
    out = shutil.copytree(whole / "out", tmp_path / "out")
    before = {name: stamps(out / name) for name in ("IB", "II", "1C")}
    _, done = sweep(scene_file, out, "water.jerlov.type=3C,IB,II,1C")
    assert [name for name, summary in done.items() if summary] == ["3C"]
    assert {name: stamps(out / name) for name in before} == before
    assert (done["3C"].kept, done["3C"].rendered) == (2 * 3 * 5, 2 * (6 + 3))


def test_versions_of_which_nothing_was_made_may_change_and_go(whole, scene_file, tmp_path):
    out = shutil.copytree(whole / "out", tmp_path / "out")
    for name in ("II", "1C"):
        shutil.rmtree(out / name)
    _, done = sweep(scene_file, out, "water.jerlov.type=IB,III")
    assert [*told(out)] == ["IB", "III"]
    assert [name for name, summary in done.items() if summary] == ["III"]


def test_a_version_that_is_gone_takes_what_others_have(whole, scene_file, tmp_path):
    out = shutil.copytree(whole / "out", tmp_path / "out")
    shutil.rmtree(out / "IB")
    _, done = sweep(scene_file, out)
    assert done["IB"].kept == 2 * 3 * 5
    assert everything(out) == everything(whole / "out")


def test_more_outputs_and_more_frames_may_be_asked_for_as_of_a_run(whole, scene_file, tmp_path):
    out = shutil.copytree(whole / "out", tmp_path / "out")
    job = prepare(
        scene_file,
        [WATERS],
        out,
        ["render.outputs=[A,B,C,D,S,F]", "render.depth_exr=true"],
        device="cpu",
        frames=slice(0, 6),
    )
    job.run(quiet=True)
    for unit in job.units:
        assert Dataset(unit.root).frames == [*range(6)]
        produce(unit.scene, tmp_path / unit.version.name, device="cpu", frames=slice(0, 6), quiet=True)
        assert tree(unit.root) == tree(tmp_path / unit.version.name)


def test_a_damaged_file_is_not_handed_on(whole, scene_file, tmp_path):
    out = shutil.copytree(whole / "out", tmp_path / "out")
    damaged = next(path for path in sorted((out / "IB").rglob("D/*.png")) if "00000002" in path.name)
    data = bytearray(damaged.read_bytes())
    data[len(data) // 2] ^= 0xFF
    damaged.write_bytes(data)
    shutil.rmtree(out / "II")
    sweep(scene_file, out)
    assert tree(out / "II") == tree(whole / "out/II")


def test_a_version_that_fails_stops_no_other_and_is_tried_again(whole, scene_file, tmp_path, monkeypatch):
    out, render = tmp_path / "out", FlatFloorRenderer.render

    def failing(self, T_w_v, camera, outputs, **how):
        if self.scene.water.jerlov.type == "II" and how["frame"] == 2:
            raise RuntimeError("an illegal memory access")
        return render(self, T_w_v, camera, outputs, **how)

    monkeypatch.setattr(FlatFloorRenderer, "render", failing)
    with pytest.raises(RunFailed, match="II: frame 2, camera L0 could not be made"):
        sweep(scene_file, out)
    assert {name: entry["datasets"][0]["state"] for name, entry in told(out).items()} == {
        "IB": "complete",
        "II": "begun",
        "1C": "complete",
    }
    monkeypatch.setattr(FlatFloorRenderer, "render", render)
    sweep(scene_file, out)
    assert everything(out) == everything(whole / "out")


# ----------------------------------------------------------------------------------------------------------- bad input


def refused(scene_file, out, over, *overrides, words, **how):
    """A sweep that is refused and changes nothing."""
    before = stamps(out) if out.exists() else None
    with pytest.raises(InputError) as caught:
        sweep(scene_file, out, over, *overrides, **how)
    assert words in caught.value.message, caught.value.message
    assert (stamps(out) if out.exists() else None) == before


@pytest.mark.parametrize(
    ("over", "words"),
    [
        ("water.jerlov.typ=IB,II", "--over water.jerlov.typ: water.jerlov.typ: unknown key"),
        ("water.jerlov.type=IB,2X", "--over water.jerlov.type: water.jerlov.type = '2X'"),
        ("vehicle.lights.3.blend=0.1,0.2", "vehicle.lights: is a list of 1"),
        ("render.spp=4,0", "--over render.spp: render.spp = 0"),
        ("nothing.there=1", "unknown key"),
        ("seed=1,-1", "--over seed: seed = -1"),
        ("vehicle.lights=[],[{kind: profile, file: no.ies}]", "no.ies"),
    ],
)
def test_a_version_that_the_scene_refuses_is_refused_before_anything_is_made(scene_file, tmp_path, over, words):
    refused(scene_file, tmp_path / "out", over, words=words)


def test_what_the_scene_refuses_of_one_version_alone_is_told_with_its_name(scene_file, tmp_path):
    over, share = "water={jerlov: {type: IB}},none", "particles=[{share: 0.01, radius_m: [0.0001, 0.004], slope: 3.2}]"
    refused(scene_file, tmp_path / "out", over, share, words="particles: in version none: the water does not scatter")
    field = "render.integrator=field"
    refused(scene_file, tmp_path / "out", over, field, words="in version none: the field cannot be used")


def test_frames_that_are_not_there_leave_nothing(scene_file, tmp_path):
    refused(scene_file, tmp_path / "out", WATERS, words="names no frame", frames=slice(1000, None))


def test_messages_name_the_file_and_the_line(scene_file, tmp_path):
    waters = tmp_path / "waters.yaml"
    waters.write_text("versions:\n  IB: {water.jerlov.type: IB}\n  odd:\n    water.jerlov.type: 2X\n")
    refused(scene_file, tmp_path / "out", str(waters), words=f"{waters}:4: water.jerlov.type = '2X'")
    waters.write_text("seed: 1\ncount: 3\nover:\n  render.spp: {choice: [-7]}\n")
    refused(scene_file, tmp_path / "out", str(waters), words=f"{waters}:4, version 0000: render.spp = -7")


def test_a_file_of_a_version_that_is_missing_is_told_of_before_anything_is_made(scene_file, tmp_path):
    refused(scene_file, tmp_path / "out", "terrain={file: no_such.ply}", words="no_such.ply")


def test_a_folder_with_something_else_is_refused(whole, scene_file, tmp_path):
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign/notes.txt").write_text("mine")
    refused(scene_file, tmp_path / "foreign", WATERS, words="holds no sweep")
    (tmp_path / "file").write_text("mine")
    refused(scene_file, tmp_path / "file", WATERS, words="file")
    dataset = shutil.copytree(whole / "out/IB", tmp_path / "dataset")
    refused(scene_file, dataset, WATERS, words="is a dataset")
    refused(scene_file, dataset / "inside", WATERS, words="is a dataset")
    out = shutil.copytree(whole / "out", tmp_path / "out")
    (out / "3C").mkdir()
    (out / "3C/notes.txt").write_text("mine")
    refused(scene_file, out, "water.jerlov.type=IB,II,1C,3C", words="3C: the folder is not empty")


def test_a_folder_with_another_sweep_is_refused(whole, scene_file, tmp_path):
    out = shutil.copytree(whole / "out", tmp_path / "out")
    refused(scene_file, out, "water.jerlov.type=IB,II", words="versions.1C: is a version of the sweep in this folder")
    refused(scene_file, out, WATERS, "seed=8", words="IB/dataset.json: seed")
    for name in ("IB", "II", "1C"):
        shutil.rmtree(out / name)
        (out / name).mkdir()
    refused(scene_file, out, WATERS, "seed=8", words="versions.IB: the scene, a file that it names, an option")
    waters = tmp_path / "waters.yaml"
    waters.write_text("versions: {IB: {water.jerlov.type: II}, II: {}, 1C: {}}")
    refused(scene_file, out, str(waters), words="versions.IB.water.jerlov.type: is 'IB' in the sweep in this folder")
    for entry in ('{"name": "IB"}', "1", '{"name": "IB", "overrides": {"water.jerlov.type": "IB"}, "scene": 1}'):
        (out / "sweep.json").write_text(f'{{"format": "varos_warp sweep", "versions": [{entry}]}}')
        refused(scene_file, out, WATERS, words="sweep.json")
    (out / "sweep.json").write_text("{}")
    refused(scene_file, out, WATERS, words="sweep.json")
    (out / "sweep.json").write_text("{")
    refused(scene_file, out, WATERS, words="sweep.json")


# ------------------------------------------------------------------------------------------------------ command line


def call(*arguments):
    return CliRunner().invoke(cli.app, [str(a) for a in arguments])


def test_the_command_makes_a_sweep_and_its_versions_are_valid(scene_file, tmp_path):
    out, options = tmp_path / "out", ("--device", "cpu", "--outputs", "A,D", "--spp", 4, "--frames", "0:2", "-q")
    result = call("sweep", scene_file, "-o", out, "--over", "water.jerlov.type=IB,3C", "--over", "seed=1,2", *options)
    assert result.exit_code == 0, result.output
    assert "3C-2: 2 frames, 6 images rendered, 2 kept" in result.output
    for name in ("IB-1", "IB-2", "3C-1", "3C-2"):
        assert call("validate", out / name, "-q").exit_code == 0
    again = call("sweep", scene_file, "-o", out, "--over", "water.jerlov.type=IB,3C", "--over", "seed=1,2", *options)
    assert again.output.count("complete, left as it is") == 4
    found = json.loads(
        call(
            "sweep",
            scene_file,
            "-o",
            out,
            "--over",
            "water.jerlov.type=IB,3C",
            "--over",
            "seed=1,2",
            *options,
            "--json",
        ).stdout
    )
    assert found["datasets"] == dict.fromkeys(("IB-1", "3C-1", "IB-2", "3C-2"))


def test_a_dry_run_tells_what_is_made_and_makes_nothing(scene_file, tmp_path):
    options = ("--over", WATERS, "--device", "cpu", "--outputs", "A,B,D", "--frames", "0:5", "-q", "--dry-run")
    assert "IB: B, D" in call("sweep", scene_file, "-o", tmp_path / "out", *options).output
    found = json.loads(call("sweep", scene_file, "-o", tmp_path / "out", *options, "--json").stdout)["datasets"]
    assert [(each["folder"], each["images"], each["renders"], each["from"]) for each in found] == [
        ("IB", 30, ["A", "B", "D"], {}),
        ("II", 14, ["A"], {"IB": ["B", "D"]}),
        ("1C", 14, ["A"], {"IB": ["B", "D"]}),
    ]
    assert not (tmp_path / "out").exists()


def test_the_command_refuses_in_one_line(scene_file, tmp_path):
    for over in ("water.jerlov.type=IB,2X", "no_such.yaml", "seed=1,1"):
        result = call("sweep", scene_file, "-o", tmp_path / "out", "--over", over, "--device", "cpu")
        assert result.exit_code == 2
        assert len(result.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
