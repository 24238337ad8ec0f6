"""Scenes with several vehicles: a dataset of each, which is read, checked and completed as any other."""

import json
import shutil

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from varos_warp import cli
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.fleet import produce_each
from varos_warp.dataset.validate import validate
from varos_warp.errors import InputError
from varos_warp.scene.file.load import load_scene, scene_from_dict, scene_to_dict
from varos_warp.sim.trajectory import simulate

ROD = {"kind": "pipe", "radius": 0.2, "length": 0.5, "wall": 1, "rotation_euler_deg": [90, 0, 0]}
CAMERA = {"id": "M0", "resolution": [96, 54]}
SCENE = {
    "terrain": {"kind": "procedural", "size_m": 20, "resolution": 33, "position": [0, 5, -1.8]},
    "objects": [{"kind": "boulder", "position": [0.5, 2.5, -0.4], "diameter": 0.5}],
    "scatter": [{"object": {"kind": "nut", "size": "M64"}, "count": 3, "circle": [0, 2, 1]}],
    "vehicles": [
        {
            "id": "1",
            "body": ROD,
            "cameras": [CAMERA],
            "trajectory": {"poses": [{"time_s": 0, "position": [0, 0, 0]}, {"time_s": 0.3, "position": [0.1, 0, 0]}]},
        },
        {
            "id": "b",
            "body": ROD,
            "cameras": [CAMERA],
            "trajectory": {
                "duration_s": 0.2,
                "waypoints": [
                    {"position": [0.1, 2.5, 0.2], "rotation_euler_deg": [0, 0, 180]},
                    {"position": [1, 2.5, 0.2]},
                ],
            },
        },
    ],
    "surface_depth_m": 50,
    "render": {"frame_rate_hz": 10, "outputs": ["D", "S", "F"]},
}


@pytest.fixture(autouse=True)
def stand_ins():
    """None here: courses and images are the package's own."""


def command(*arguments):
    return CliRunner().invoke(cli.app, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("fleet") / "scene.yaml"
    path.write_text(yaml.safe_dump(SCENE))
    return path


@pytest.fixture(scope="module")
def made(scene_file):
    out = scene_file.parent / "out"
    produce_each(load_scene(scene_file), out, device="cpu", quiet=True)
    return out


def test_each_has_a_dataset_with_names_by_its_id(made):
    assert sorted(path.name for path in made.iterdir()) == ["veh1", "vehb"]
    assert [len(Dataset(made / name)) for name in ("veh1", "vehb")] == [4, 2]
    assert (made / "vehb" / "vehicleb" / "cam0" / "D" / "seq01_vehb_camM0_D-00000001.png").exists()
    assert Dataset(made / "vehb").meta["scene"]["observer"] == "b"
    assert "OTHER VEHICLES" in (made / "veh1" / "README.txt").read_text()


def test_numbers_of_s_are_the_same_in_all(made):
    one, other = (Dataset(made / name) for name in ("veh1", "vehb"))
    keys = [row["key"] for row in one.segments()]
    assert keys == ["terrain", "objects.0", "vehicles.1", "vehicles.b", *(f"scatter.0.{i}" for i in range(3))]
    assert other.segments() == one.segments()
    assert [(entry["key"], entry["id"]) for entry in one.meta["moving"]] == [("vehicles.b", 4)]
    assert (one.pixels("S", 0) == 4).sum() > 50
    assert (other.pixels("S", 0) == 3).sum() > 50
    assert not (one.pixels("S", 0) == 3).any()


def test_poses_of_the_other_are_those_of_its_own_dataset_and_then_rest(made):
    (time_ns, T), own = Dataset(made / "veh1").poses("vehicles.b"), Dataset(made / "vehb")
    expected = own.trajectory().at(own.time_ns()).poses()
    np.testing.assert_allclose(T, expected[[0, 1, 1, 1]], atol=1e-9)
    assert np.array_equal(time_ns, Dataset(made / "veh1").time_ns())
    np.testing.assert_allclose(
        Dataset(made / "veh1").meta["moving"][0]["box_m"], [[-0.2, -0.25, -0.2], [0.2, 0.25, 0.2]], atol=1e-3
    )


def test_all_are_sound(made):
    assert [validate(made / name, quiet=True).problems for name in ("veh1", "vehb")] == [[], []]
    told = command("validate", made, "--json", "-q")
    assert told.exit_code == 0
    assert [entry["valid"] for entry in json.loads(told.output)["datasets"]] == [True, True]


def test_a_pose_that_is_not_on_the_course_is_found(made, tmp_path):
    shutil.copytree(made, tmp_path / "out")
    for path in (tmp_path / "out" / "veh1" / "objects" / "vehicles.b_poses").iterdir():
        lines = [line.split(",") for line in path.read_text().splitlines()]
        lines[2][lines[0].index("s_x_vw")] = "-0.25"
        path.write_text("\n".join(map(",".join, lines)) + "\n")
    told = command("validate", tmp_path / "out", "-q")
    assert told.exit_code == 2
    assert "vehicles.b_poses" in told.output
    assert "is not where its path has it" in told.output


def test_a_run_completes_what_is_there(made, scene_file, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(made, out)
    lost = out / "vehb" / "vehicleb" / "cam0" / "S" / "seq01_vehb_camM0_S-00000000.png"
    before = lost.read_bytes()
    lost.unlink()
    told = command("run", scene_file, "-o", out, "--device", "cpu", "-q", "--json")
    assert {each: (made["rendered"], made["kept"]) for each, made in json.loads(told.output)["vehicles"].items()} == {
        "1": (0, 12),
        "b": (1, 5),
    }
    assert lost.read_bytes() == before


def test_one_of_them_may_be_chosen(scene_file, made, tmp_path):
    told = command("simulate", scene_file, "-o", tmp_path, "--vehicle", "b", "-q")
    assert told.exit_code == 0
    assert [path.name for path in tmp_path.iterdir()] == ["vehb"]
    states = "vehb/vehicleb/ground_truth_vehicleb_poses/vehicleb_states.csv"
    assert (tmp_path / states).read_bytes() == (made / states).read_bytes()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "{scene}", "-o", "{made}", "--vehicle", "2"], "no vehicle has the id '2' (there are: 1, b)"),
        (["run", "{scene}", "-o", "{made}/veh1"], "holds a dataset, but each of the scene's vehicles"),
        (["report", "{made}"], "Several vehicles have a dataset each: give"),
    ],
)
def test_what_cannot_be_done_is_told(scene_file, made, arguments, words):
    told = command(*(text.format(scene=scene_file, made=made) for text in arguments))
    assert told.exit_code == 2
    assert words in told.output


def test_info_tells_of_each(scene_file):
    told = json.loads(command("info", scene_file, "--json", "-q", "--set", "render.outputs=[A]").output)
    assert {each: about["dataset"]["frames"] for each, about in told.items()} == {"1": 4, "b": 2}
    assert {each: about["meshes"][2]["name"] for each, about in told.items()} == {"1": "vehicles.b", "b": "vehicles.1"}
    assert any("vehicles.0.lights: there is no light" in text for text in told["1"]["warnings"])


ALONE = {"trajectory": {"poses": [{"position": [0, 0, 0]}]}}


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        ({"vehicles": [{"id": "1"} | ALONE, {"id": "1"} | ALONE]}, "vehicles.1.id: '1' is that of vehicles.0"),
        ({"vehicles": [{"id": "a"} | ALONE, {"id": "A"} | ALONE]}, "vehicles.1.id: 'A' is that of vehicles.0"),
        ({"vehicles": [ALONE], "vehicle": {}}, "vehicle: cannot be given beside vehicles"),
        ({"vehicles": [ALONE]} | ALONE, "trajectory: cannot be given beside vehicles"),
        ({"vehicles": [{"id": "1"}]}, "vehicles.0.trajectory: is missing"),
        ({"vehicles": [ALONE], "observer": "7"}, "observer: no vehicle has the id '7' (there are: 0)"),
        (ALONE | {"observer": "0"}, "observer: no vehicle has the id '0' (`vehicles` is absent)"),
        (
            {"vehicles": [{"body": ROD | {"material": "red"}} | ALONE]},
            "vehicles.0.body.material: no material named 'red'",
        ),
        (
            {"vehicles": [{"body": ROD | {"path": [{"position": [0, 0, i], "time_s": i} for i in range(2)]}} | ALONE]},
            "vehicles.0.body.path: the body goes where its vehicle does",
        ),
    ],
)
def test_bad_fleets_are_refused(scene, words):
    with pytest.raises(InputError) as refused:
        scene_from_dict(scene)
    assert words in refused.value.message


def test_what_is_wrong_with_a_course_is_told_with_its_key():
    backwards = {"poses": [{"time_s": t, "position": [0, 9, 0]} for t in (1, 0)]}
    scene = scene_from_dict({"vehicles": [{"id": "1"} | ALONE, {"id": "2", "trajectory": backwards}]})
    with pytest.raises(InputError) as refused:
        simulate(scene)
    assert refused.value.key == "vehicles.1.trajectory.poses.1.time_s"


def test_vehicles_that_meet_are_told():
    scene = scene_from_dict(
        {"vehicles": [{"id": "1"} | ALONE, {"id": "2", "trajectory": {"poses": [{"position": [0.1, 0, 0]}]}}]}
    )
    assert [text for text in simulate(scene).messages if "vehicles.2" in text] == [
        "vehicles.0.trajectory: at 0.00 s the vehicle is 0.10 m from vehicles.2, nearer than their radii of 0.42 m "
        "together"
    ]


def test_what_a_dataset_keeps_of_a_scene_is_the_same_scene():
    kept = scene_to_dict(scene_from_dict(SCENE).observed_by("b"))
    again = scene_from_dict(kept)
    assert scene_to_dict(again) == kept
    assert again.vehicle.id == "b"
    assert again.companions.keys() == {"vehicles.1"}
