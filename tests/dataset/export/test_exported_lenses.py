"""Distorting lenses and ports in exports: as the format's own readers understand them, or one clear refusal."""

import cv2
import numpy as np
import pycolmap
import pytest
import yaml
from readback import rows
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation
from standins import make_scene

from varos_warp.dataset.export import export
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.errors import InputError

BARREL = {"model": "brown_conrady", "k": [-0.25, 0.06, 0.001, -0.002, 0.0]}
BARREL_3 = BARREL | {"k": [-0.25, 0.06, 0.001, -0.002, 0.03]}
FISHEYE = {"model": "kannala_brandt", "k": [-0.02, 0.003, -0.001, 0.0002]}
FLAT = {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.008}
TILTED = FLAT | {"distance_m": 0.05, "normal": [0.1, -0.05, 1.0]}
DOME = {"kind": "dome", "radius_m": 0.05, "thickness_m": 0.007, "n_glass": 1.473, "centre": [0.004, -0.003, 0.012]}
SEA = {"temperature_C": 10, "salinity": 35}


@pytest.fixture(scope="module")
def lenses(tmp_path_factory):
    """A dataset with cameras of each distortion, and some behind ports."""
    optics = {"B0": {"distortion": BARREL}, "F0": {"distortion": FISHEYE}, "K0": {"distortion": BARREL_3},
              "P0": {"port": FLAT, "n_water": 1.34}, "T0": {"port": TILTED, "n_water": SEA},
              "D0": {"port": DOME, "distortion": BARREL}}
    cameras = [{"id": name, "rotation_euler_deg": [-15, 0, 0], "resolution": [48, 27]} | keys
               for name, keys in optics.items()]
    vehicle = {"lights": [{"kind": "point", "position": [0, 0, 0.5]}], "cameras": cameras, "imu": {}, "depth_gauge": {}}
    out = tmp_path_factory.mktemp("lenses")
    with pytest.MonkeyPatch.context() as patch:
        import standins

        standins.install(patch)
        produce(make_scene(vehicle=vehicle, render={"outputs": ["A", "B", "D"]}), out, quiet=True)
    return out


def test_colmap_projects_every_point_to_its_pixel(lenses, tmp_path):
    export(lenses, "colmap", tmp_path / "out", cameras=["B0", "F0", "K0"])
    model = pycolmap.Reconstruction(tmp_path / "out/sparse/0")
    names = [model.cameras[i].model.name for i in sorted(model.cameras)]
    assert names == ["FULL_OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV"]
    assert len(model.points3D) > 10_000
    model.update_point_3d_errors()
    assert max(point.error for point in model.points3D.values()) < 1e-9


PARAMETERS = {"PINHOLE": 4, "FULL_OPENCV": 12}


def snell(d, n, before, after):
    """Unit vectors [N, 3] behind a surface with normals [N, 3] or [3] along their way."""
    r, c = before / after, (d * n).sum(-1, keepdims=True)
    return r * d - (r * c - np.sqrt(1.0 - r * r * (1.0 - c * c))) * n


def refracted_rays(d, kind, numbers):
    """Of unit vectors [N, 3] from the lens: places on the glass's outer surface, and directions in the water.

    COLMAP Underwater: FLATPORT Nx Ny Nz int_dist int_thick na ng nw, DOMEPORT Cx Cy Cz int_radius int_thick na ng nw,
    both with the surface towards the lens.
    """
    where, (start, thickness), indices, p = numbers[:3], numbers[3:5], numbers[5:], np.zeros_like(d)
    for at, before, after in zip((start, start + thickness), indices, indices[1:], strict=False):
        if kind == "FLATPORT":
            n = where
            p = p + ((at - p @ n) / (d @ n))[:, None] * d
        else:
            along = ((where - p) * d).sum(-1)
            p = p + (along + np.sqrt(along**2 + at**2 - ((where - p) ** 2).sum(-1)))[:, None] * d
            n = (p - where) / at
        d = snell(d, n, before, after)
    return p, d


@pytest.mark.parametrize(("camera", "kind"), [("P0", "FLATPORT"), ("T0", "FLATPORT"), ("D0", "DOMEPORT")])
def test_colmap_underwater_gets_the_port_through_which_pixels_see_their_points(lenses, tmp_path, camera, kind):
    """Lens by pycolmap, port by Snell's law; without the port the points are off by pixels of an image of 48 x 27."""
    export(lenses, "colmap", tmp_path / "out", cameras=[camera])
    folder = tmp_path / "out/sparse/0"
    _, model, width, height, *rest = rows(folder / "cameras.txt")[0]
    count = PARAMETERS[model]
    lens = pycolmap.Camera(model=model, width=int(width), height=int(height), params=[float(x) for x in rest[:count]])
    numbers = np.array(rest[count + 1:], float)
    assert (rest[count], len(numbers)) == (kind, 8)
    head, track = [line for line in (folder / "images.txt").read_text().split("\n") if not line.startswith("#")][:2]
    pose = np.array(head.split()[1:8], float)
    track = np.array(track.split(), float).reshape(-1, 3)
    world = {int(row[0]): row[1:4] for row in rows(folder / "points3D.txt")}
    p = np.array([world[int(i)] for i in track[:, 2]])
    p = Rotation.from_quat(pose[:4], scalar_first=True).apply(p) + pose[4:]
    assert len(p) > 500
    d = np.column_stack([lens.cam_from_img(track[:, :2]), np.ones(len(track))])
    start, ray = refracted_rays(d / np.linalg.norm(d, axis=-1, keepdims=True), kind, numbers)
    missed = np.linalg.norm(np.cross(p - start, ray), axis=-1) / p[:, 2]
    assert lens.params[0] * numbers[7] * missed.max() < 1e-6
    assert np.abs(lens.img_from_cam(p) - track[:, :2]).max() > 1.0


def test_kalibr_and_orb_slam3_get_four_coefficients(lenses, tmp_path):
    export(lenses, "euroc", tmp_path / "out", cameras=["B0", "F0"])
    chain = yaml.safe_load((tmp_path / "out/kalibr_camchain.yaml").read_text())
    assert [chain[cam]["distortion_model"] for cam in ("cam0", "cam1")] == ["radtan", "equidistant"]
    assert [chain[cam]["distortion_coeffs"] for cam in ("cam0", "cam1")] == [BARREL["k"][:4], FISHEYE["k"]]
    sensor = yaml.safe_load((tmp_path / "out/mav0/cam0/sensor.yaml").read_text())
    assert (sensor["distortion_model"], sensor["distortion_coefficients"]) == ("radial-tangential", BARREL["k"][:4])
    settings = cv2.FileStorage(str(tmp_path / "out/orb_slam3.yaml"), cv2.FILE_STORAGE_READ)
    assert settings.getNode("Camera1.p1").real() == BARREL["k"][2]
    assert settings.getNode("Camera2.k3").real() == FISHEYE["k"][2]
    export(lenses, "euroc", tmp_path / "fisheye", cameras=["F0"])
    assert 'Camera.type: "KannalaBrandt8"' in (tmp_path / "fisheye/orb_slam3.yaml").read_text()


def test_ros_gets_plumb_bob_and_equidistant(lenses, tmp_path):
    export(lenses, "mcap", tmp_path / "out", cameras=["K0", "F0"])
    with AnyReader([tmp_path / "out/bag"]) as reader:
        found = {c.topic: reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(
            [c for c in reader.connections if c.topic.endswith("camera_info")])}
    info = found["/camK0/camera_info"]
    assert (info.distortion_model, info.d.tolist()) == ("plumb_bob", BARREL_3["k"])
    info = found["/camF0/camera_info"]
    assert (info.distortion_model, info.d.tolist()) == ("equidistant", FISHEYE["k"])


def test_nerfstudio_gets_either_model(lenses, tmp_path):
    import json

    export(lenses, "nerfstudio", tmp_path / "out", cameras=["K0"])
    head = json.loads((tmp_path / "out/transforms.json").read_text())
    assert head["camera_model"] == "OPENCV"
    assert [head[key] for key in ("k1", "k2", "p1", "p2", "k3")] == BARREL_3["k"]
    export(lenses, "nerfstudio", tmp_path / "fisheye", cameras=["F0"])
    head = json.loads((tmp_path / "fisheye/transforms.json").read_text())
    assert head["camera_model"] == "OPENCV_FISHEYE"
    assert [head[key] for key in ("k1", "k2", "k3", "k4")] == FISHEYE["k"]


@pytest.mark.parametrize(("to", "cameras", "problem"), [
    *((to, ["P0"], "cannot state a port") for to in ("euroc", "tum", "kitti", "nerfstudio", "mcap")),
    ("tum", ["B0"], "TUM cannot state this distortion"), ("kitti", ["F0"], "KITTI cannot state this distortion"),
    ("euroc", ["K0"], "cannot state this distortion"), ("nerfstudio", ["B0", "F0"], "with and without fisheye")])
def test_what_a_format_cannot_say_is_refused_and_nothing_is_left(lenses, tmp_path, to, cameras, problem):
    with pytest.raises(InputError, match=problem):
        export(lenses, to, tmp_path / "out", cameras=cameras)
    assert list(tmp_path.iterdir()) == []


def test_dataset_json_says_how_to_rebuild_the_rays(lenses):
    """From the entry alone; points of D then lie on the floor, to half a step of D along the axis."""
    data = Dataset(lenses)
    assert data.camera("P0")["port"] == FLAT | {"n_glass": 1.49, "normal": [0.0, 0.0, 1.0]}
    assert data.camera("P0")["n_water"] == [1.34] * 3
    assert data.camera("F0")["camera_model"] == "fisheye"
    for camera in data.cameras:
        frame = data[0, camera]
        row, col = np.nonzero(np.isfinite(frame.D))
        rays = data.camera_model(camera).rays(np.column_stack([col, row]) + 0.5)
        t = (frame.D[row, col] - rays.origin[:, 2]) / rays.direction[:, 2]
        world = rays.moved(frame.T_w_c)
        z = world.origin[:, 2] + t * world.direction[:, 2]
        slope = np.abs(world.direction[:, 2] / rays.direction[:, 2])
        assert len(row) > 300
        assert (np.abs(z + 3.0) <= slope * 25 / 65535 / 2 + 25 * 2.0**-23).all()
