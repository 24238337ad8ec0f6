"""Datasets of recorded courses: made, continued, checked, shown and refused from the command line, as any other."""

import json
import shutil

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from varos_warp import cli
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.report.course import scene_parts
from varos_warp.dataset.validate import validate

CAMERA = {"id": "M0", "resolution": [48, 27], "rotation_euler_deg": [-30, 0, 0]}
WORLD = {
    "terrain": {"kind": "procedural", "size_m": 20, "resolution": 17, "position": [0, 3, -1.8], "relief_m": 0.3},
    "surface_depth_m": 50,
    "render": {"frame_rate_hz": 5, "outputs": ["D", "S"]},
}


def course(height=0.0):
    """Northwards, of ROS, with the clock of a robot."""
    return "".join(
        f"16000000{20 + k / 10:.9f} 0.3 {0.03 * k!r} {height!r} 0 0 {float(np.sqrt(0.5))!r} {float(np.sqrt(0.5))!r}\n"
        for k in range(9)
    )


@pytest.fixture(autouse=True)
def stand_ins():
    """None here: courses and images are the package's own."""


def command(*arguments):
    return CliRunner().invoke(cli.app, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Folder of a scene with one vehicle, of its course and its dataset."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "course.txt").write_text(course())
    scene = WORLD | {"vehicle": {"cameras": [CAMERA], "lights": []}, "trajectory": {"file": "course.txt"}}
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene))
    assert command("run", folder / "scene.yaml", "-o", folder / "out", "--device", "cpu", "-q").exit_code == 0
    return folder


def test_a_dataset_of_a_recorded_course_is_valid_and_names_its_file(alone):
    data = Dataset(alone / "out")
    assert len(data) == 5
    np.testing.assert_allclose(
        data.poses("vehicle")[1][::20, :3, 3], [[0.3, 0.03 * k, 0.0] for k in range(9)], atol=1e-12
    )
    assert data.meta["sources"].keys() == {"course.txt"}
    assert data.meta["scene"]["trajectory"]["file"] == "course.txt"
    assert validate(alone / "out", quiet=True).problems == []


def test_validate_and_report_do_not_need_the_file(alone, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert validate(alone / "out", quiet=True).problems == []
    found = scene_parts(Dataset(alone / "out"))
    assert (len(found.parts), found.missing) == (1, None)


def test_a_run_goes_on_and_refuses_another_course(alone, tmp_path):
    copy = shutil.copytree(alone, tmp_path / "copy")
    done = command("run", copy / "scene.yaml", "-o", copy / "out", "--device", "cpu", "--json", "-q")
    assert (done.exit_code, json.loads(done.stdout)["rendered"]) == (0, 0)
    (copy / "course.txt").write_text(course(0.5))
    done = command("run", copy / "scene.yaml", "-o", copy / "out", "--device", "cpu", "-q")
    assert done.exit_code == 2
    assert "contents of.course.txt" in done.stderr


def test_info_says_what_was_read_and_what_is_felt(alone):
    done = command("info", alone / "scene.yaml", "-q")
    assert done.exit_code == 0
    assert (
        "recorded course: course.txt (TUM), poses of the vehicle, one in 0.1 s, frame enu, body axes flu\n"
        "acceleration: "
    ) in done.stdout
    facts = json.loads(command("info", alone / "scene.yaml", "-q", "--json").stdout)["trajectory"]
    assert facts["count"] == 9
    assert facts["acceleration"]["peak"] < 1e-9


@pytest.mark.parametrize(
    ("text", "set_", "says"),
    [
        (course() + "1600000021 nan 0 0 0 0 0 1\n", (), "course.txt:10: trajectory.file: tx 'nan' is missing"),
        ("", (), ": trajectory.file = 'course.txt': is empty ("),
        (course(), ("trajectory.of=X0",), "trajectory.of: no camera has the id 'X0' (there are: M0"),
        (course(), ("trajectory.file=none.txt",), "trajectory.file = 'none.txt': there is no such course file"),
        (course(), ("trajectory.columns={time: t, position: [x, y, z]}",), "has no header with the name 't'"),
    ],
)
@pytest.mark.parametrize("verb", ["info", "run", "simulate", "plan"])
def test_bad_input_is_one_message_and_status_2(alone, tmp_path, verb, text, set_, says):
    shutil.copy(alone / "scene.yaml", tmp_path)
    (tmp_path / "course.txt").write_text(text)
    out = () if verb in ("info", "plan") else ("-o", tmp_path / "out")
    done = command(verb, tmp_path / "scene.yaml", *out, "-q", *(word for each in set_ for word in ("--set", each)))
    assert done.exit_code == 2
    assert says in done.stderr
    assert not (tmp_path / "out").exists()


def test_of_another_vehicle_whose_file_is_gone_the_poses_of_the_dataset_tell(tmp_path, monkeypatch):
    (tmp_path / "course.txt").write_text(course())
    body = {"kind": "pipe", "radius": 0.2, "length": 0.5, "wall": 1, "rotation_euler_deg": [90, 0, 0]}
    vehicles = [
        {"id": "0", "cameras": [CAMERA], "trajectory": {"poses": [{"position": [0, -1.5, 0.5]}], "duration_s": 0.8}},
        {"id": "1", "cameras": [CAMERA], "trajectory": {"file": "course.txt"}, "body": body},
    ]
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(WORLD | {"vehicles": vehicles}))
    done = command("run", tmp_path / "scene.yaml", "-o", tmp_path / "out", "--device", "cpu", "--vehicle", "0", "-q")
    assert done.exit_code == 0, done.output
    data = tmp_path / "out/veh0"
    assert (Dataset(data).pixels("S", 0) == 2).any()
    monkeypatch.chdir(tmp_path)
    assert validate(data, quiet=True).problems == []
    (tmp_path / "course.txt").write_text(course(0.5))
    assert validate(data, quiet=True).problems == []
    (tmp_path / "course.txt").unlink()
    assert validate(data, quiet=True).problems == []
    csv = data / "objects/vehicles.1_poses/vehicles.1_poses_transformation_matrix.csv"
    csv.write_text(csv.read_text().replace("0.3,", "0.8,"))
    assert validate(data, quiet=True).problems
