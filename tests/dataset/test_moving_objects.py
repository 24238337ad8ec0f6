"""Datasets with objects that move: what is written, read back and checked."""

import os
import shutil

import numpy as np
import pytest
from evo.tools import file_interface
from rosbags.highlevel import AnyReader

from varos_warp.dataset.export import FORMATS, export
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import objects, validate, views
from varos_warp.dataset.view import view
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.sim.poses import poses_along

PATH = [
    {"time_s": 0, "position": [-0.5, 1.5, 0], "rotation_euler_deg": [0, 90, 0]},
    {"time_s": 0.4, "position": [0.1, 1.7, 0.2], "rotation_euler_deg": [0, 90, 40]},
]
SCENE = {
    "terrain": {"kind": "procedural", "size_m": 20, "resolution": 65, "position": [0, 5, -1.8]},
    "objects": [
        {"kind": "pipe", "radius": 0.5, "length": 1.5, "path": PATH},
        {"kind": "boulder", "position": [0.5, 2.5, -0.4], "diameter": 0.5},
    ],
    "surface_depth_m": 50,
    "vehicle": {
        "lights": [
            {
                "kind": "spot",
                "position": [0.3, 0, 0.2],
                "direction": [0, 1, 0],
                "cone_deg": 80,
                "intensity": [20, 20, 20],
            }
        ],
        "cameras": [{"id": "M0", "resolution": [96, 54]}],
    },
    "trajectory": {
        "poses": [{"time_s": 0, "position": [0, 0, 0]}, {"time_s": 1, "position": [0.1, 0, 0]}],
        "duration_s": 0.4,
    },
    "render": {"frame_rate_hz": 10, "outputs": ["B", "D", "S", "F"], "spp_b": 2, "denoise_b": "none"},
}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("moving") / "out"
    produce(scene_from_dict(SCENE), out, device="cpu", quiet=True)
    return out


def test_poses_and_box_are_on_record(made):
    data, scene = Dataset(made), scene_from_dict(SCENE)
    time_ns, T = data.poses("objects.0")
    assert data.moving == ["objects.0"]
    assert np.array_equal(time_ns, data.time_ns())
    np.testing.assert_allclose(T, poses_along(scene.objects[0].stops, time_ns), atol=1e-12)
    (entry,) = data.meta["moving"]
    assert entry["id"] == next(row["id"] for row in data.segments() if row["key"] == "objects.0")
    np.testing.assert_allclose(entry["box_m"], [[-0.5, -0.5, -0.75], [0.5, 0.5, 0.75]], atol=1e-3)
    assert "OBJECTS THAT MOVE" in (made / "README.txt").read_text()


def test_the_viewer_shows_where_it_goes_and_its_box(made, tmp_path):
    if not os.environ.get("CI"):
        pytest.importorskip("rerun.dataframe")
    from rerun.dataframe import load_recording

    recording = load_recording(view(made, tmp_path / "moving.rrd", quiet=True))

    def found(entity, name, select="select"):
        table = getattr(recording.view(index="time", contents=entity), select)().read_all().to_pylist()
        return [value for row in table for key, value in row.items() if key.endswith(name) and value is not None]

    places = found("/world/moving/objects.0", "translation")
    np.testing.assert_allclose([place for (place,) in places], Dataset(made).poses("objects.0")[1][:, :3, 3], atol=1e-6)
    (half,) = found("/world/moving/objects.0/box", "half_sizes", "select_static")
    np.testing.assert_allclose(half, [[0.5, 0.5, 0.75]], atol=1e-3)


def test_points_of_the_object_lie_in_its_box_at_every_frame(made):
    data = Dataset(made)
    entry, model = data.meta["moving"][0], data.camera_model()
    for k, frame in enumerate(data.frames):
        row, col = np.nonzero(data.pixels("S", frame) == entry["id"])
        z = data.planar_depth(frame)[row, col]
        rays = model.rays(np.stack([col + 0.5, row + 0.5], -1))
        points = rays.direction / rays.direction[:, 2:] * z[:, None]
        T = np.linalg.inv(data.poses("objects.0")[1][k]) @ data.T_w_c(frame)
        own = points @ T[:3, :3].T + T[:3, 3]
        low, high = np.array(entry["box_m"]) + [[-1e-3], [1e-3]]
        assert len(row) > 100
        assert ((own >= low) & (own <= high)).all()


def test_a_sound_dataset_is_sound_since_pixels_that_move_are_left_out(made, monkeypatch):
    assert validate(made, quiet=True).problems == []
    monkeypatch.setattr(views, "of_still", lambda data, depth, *_: depth)
    assert any("neighbours" in problem for problem in validate(made, quiet=True).problems)


@pytest.mark.parametrize(
    ("what", "told"),
    [
        ("pose", "is not where its path has it"),
        ("file", "there is no such file"),
        ("flow", "does not follow from D"),
        ("id", "but the scene lets"),
    ],
)
def test_damage_is_found(made, tmp_path, monkeypatch, what, told):
    out = tmp_path / "out"
    shutil.copytree(made, out)
    folder = out / "objects" / "objects.0_poses"
    if what == "file":
        (folder / "objects.0_poses_euler.csv").unlink()
    elif what == "pose":
        for path in folder.iterdir():
            lines = [line.split(",") for line in path.read_text().splitlines()]
            lines[2][lines[0].index("s_x_vw")] = "-0.25"
            path.write_text("\n".join(map(",".join, lines)) + "\n")
    elif what == "id":
        path, entry = out / "dataset.json", '"key": "objects.0",\n      "id": '
        path.write_text(path.read_text().replace(f"{entry}2", f"{entry}3"))
    else:  # as if it stood still
        from varos_warp.dataset.validate import flows

        monkeypatch.setattr(flows, "moving_parts", lambda *_: [])
    assert any(told in problem for problem in validate(out, quiet=True).problems)


@pytest.mark.parametrize("form", [form for form in FORMATS if form != "corners"])  # which needs a board
def test_every_export_has_their_poses(made, tmp_path, form):
    """Beside what the format has, as evo reads them; a bag has them as transforms, too."""
    out, start_ns = tmp_path / "out", 3_000_000_001
    export(made, form, out, images="B", start_ns=start_ns)
    time_ns, T = Dataset(made).poses("objects.0")
    read = file_interface.read_tum_trajectory_file(out / "moving" / "objects.0.txt")
    np.testing.assert_allclose(read.timestamps, 1e-9 * (time_ns + start_ns), rtol=1e-15)
    np.testing.assert_allclose(read.poses_se3, T, atol=1e-12)
    told = (out / "moving" / "README.txt").read_text()
    assert "objects.0: number 2 in S; its box in its own axes [m]: low -0.5 -0.5 -0.75" in told
    if form == "mcap":
        with AnyReader([out / "bag"]) as bag:
            topics = [of for of in bag.connections if of.topic == "/tf"]
            found = [bag.deserialize(raw, of.msgtype).transforms[0] for of, _, raw in bag.messages(topics)]
        found = [message for message in found if message.child_frame_id == "objects.0"]
        assert {message.header.frame_id for message in found} == {"map"}
        np.testing.assert_allclose(
            [[t.transform.translation.x, t.transform.translation.y, t.transform.translation.z] for t in found],
            T[:, :3, 3],
            atol=1e-12,
        )


@pytest.fixture(scope="module")
def passed_through(tmp_path_factory):
    """A boulder that comes from behind, through the camera, whose shutter is open for long."""
    path = [{"time_s": t, "position": [0.3, -1.0 + 3.0 * t, 1.2]} for t in (0, 1)]
    camera = {
        "id": "M0",
        "resolution": [48, 27],
        "sensor_mm": [4.8, 2.7],
        "focal_mm": 3.0,
        "rotation_euler_deg": [-15, 0, 0],
        "exposure": {"time_s": 0.08},
    }
    scene = scene_from_dict(
        {
            "terrain": {"kind": "procedural", "size_m": 20, "resolution": 33, "relief_m": 0.6, "seed": 2},
            "objects": [{"kind": "boulder", "diameter": 0.6, "path": path}],
            "surface_depth_m": 50,
            "vehicle": {"cameras": [camera]},
            "trajectory": {
                "poses": [
                    {"position": [0, 0, 1.2]},
                    {"time_s": 1, "position": [0.6, 0.2, 1.2], "rotation_euler_deg": [0, 0, 20]},
                ]
            },
            "render": {"frame_rate_hz": 10, "outputs": ["B", "C", "D", "S"], "spp_b": 4, "denoise_b": "none"},
        }
    )
    out = tmp_path_factory.mktemp("passing") / "out"
    produce(scene, out, device="cpu", quiet=True)
    return out


def test_what_passes_while_a_shutter_is_open_fails_no_check(passed_through):
    """It blurs B of what S has beside it."""
    assert validate(passed_through, quiet=True).problems == []
    data, shape = Dataset(passed_through), (27, 48)
    assert 0.2 < objects.swept(data, 7, "M0", shape).mean() < 0.9
    assert objects.swept(data, 4, "M0", shape).all()  # it is about the camera
    assert not objects.swept(data, 0, "M0", shape).any()  # behind it
