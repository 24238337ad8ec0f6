"""Distorting lenses and ports in exports: as the format's own readers understand them, or one clear refusal."""

import warnings

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
from varos_warp.scene.calibration.read import read_calibration

BARREL = {"model": "brown_conrady", "k": [-0.25, 0.06, 0.001, -0.002, 0.0]}
BARREL_3 = BARREL | {"k": [-0.25, 0.06, 0.001, -0.002, 0.03]}
FISHEYE = {"model": "kannala_brandt", "k": [-0.02, 0.003, -0.001, 0.0002]}
FLAT = {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.008}
TILTED = FLAT | {"distance_m": 0.05, "normal": [0.1, -0.05, 1.0]}
RATIONAL = {"model": "rational", "k": [0.41, 0.27, 0.0001, -0.0002, 0.1, 0.45, 0.4, 0.09]}
SPHERE = {"model": "double_sphere", "xi": -0.1996307, "alpha": 0.5924590}
MEASURED = {"fx": 51.7352913, "fy": 49.1730017, "cx": 25.1093001, "cy": 11.9273307}
DOME = {"kind": "dome", "radius_m": 0.05, "thickness_m": 0.007, "n_glass": 1.473, "centre": [0.004, -0.003, 0.012]}
SEA = {"temperature_C": 10, "salinity": 35}


@pytest.fixture(scope="module")
def lenses(tmp_path_factory):
    """Four frames of cameras of each distortion, and of some behind ports."""
    optics = {
        "B0": {"distortion": BARREL},
        "F0": {"distortion": FISHEYE},
        "K0": {"distortion": BARREL_3},
        "R0": {"distortion": RATIONAL, "intrinsics": MEASURED},
        "M0": {"distortion": BARREL, "intrinsics": MEASURED},
        "S0": {"distortion": SPHERE, "intrinsics": MEASURED},
        "N0": {"intrinsics": MEASURED},
        "E0": {"distortion": FISHEYE, "intrinsics": MEASURED},
        "P0": {"port": FLAT, "n_water": 1.34},
        "T0": {"port": TILTED, "n_water": SEA},
        "D0": {"port": DOME, "distortion": BARREL},
    }
    cameras = [
        {"id": name, "rotation_euler_deg": [-15, 0, 0], "resolution": [48, 27]} | keys for name, keys in optics.items()
    ]
    vehicle = {"lights": [{"kind": "point", "position": [0, 0, 0.5]}], "cameras": cameras, "imu": {}, "depth_gauge": {}}
    out = tmp_path_factory.mktemp("lenses")
    with pytest.MonkeyPatch.context() as patch:
        import standins

        standins.install(patch)
        scene = make_scene(vehicle=vehicle, render={"outputs": ["A", "B", "D"]})
        produce(scene, out, frames=slice(0, 4), quiet=True)
    return out


def test_colmap_projects_every_point_to_its_pixel(lenses, tmp_path):
    export(lenses, "colmap", tmp_path / "out", cameras=["B0", "F0", "K0", "R0", "N0"])
    model = pycolmap.Reconstruction(tmp_path / "out/sparse/0")
    names = [model.cameras[i].model.name for i in sorted(model.cameras)]
    assert names == ["FULL_OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FULL_OPENCV", "PINHOLE"]
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
    numbers = np.array(rest[count + 1 :], float)
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
        found = {
            c.topic: reader.deserialize(raw, c.msgtype)
            for c, _, raw in reader.messages([c for c in reader.connections if c.topic.endswith("camera_info")])
        }
    info = found["/camK0/camera_info"]
    assert (info.distortion_model, info.d.tolist()) == ("plumb_bob", BARREL_3["k"])
    info = found["/camF0/camera_info"]
    assert (info.distortion_model, info.d.tolist()) == ("equidistant", FISHEYE["k"])


def described(lenses, camera):
    """fx, fy, cx, cy (OpenCV) and distortion of a camera of the dataset, as a scene has them."""
    about = Dataset(lenses).camera(camera)
    K = np.array(about["K_opencv"])
    lens = about["distortion"]
    return tuple(K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()), None if lens == "none" else lens


@pytest.mark.parametrize(
    "form", ["kalibr_camchain.yaml#cam0", "mav0/cam0/sensor.yaml", "openvins/kalibr_imucam_chain.yaml#cam0"]
)
@pytest.mark.parametrize("camera", ["M0", "E0", "N0", "S0", "F0"])
def test_our_exports_for_kalibr_read_back_to_the_last_digit(lenses, tmp_path, camera, form):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of what is left out for S0
        export(lenses, "euroc", tmp_path / "out", cameras=[camera])
    if camera == "S0" and form.startswith("openvins"):
        assert not (tmp_path / "out/openvins").exists()
        return
    found = read_calibration(f"out/{form}", tmp_path)
    assert (found.intrinsics, found.distortion) == described(lenses, camera)
    assert found.resolution == (48, 27)


def test_estimators_without_double_spheres_are_named(lenses, tmp_path):
    with pytest.warns(UserWarning, match=r"ORB-SLAM3 and OpenVINS cannot state a double sphere \(S0\)"):
        export(lenses, "euroc", tmp_path / "out", cameras=["M0", "S0"])
    assert not (tmp_path / "out/orb_slam3.yaml").exists()
    chain = yaml.safe_load((tmp_path / "out/kalibr_camchain.yaml").read_text())
    assert [chain[cam]["camera_model"] for cam in ("cam0", "cam1")] == ["pinhole", "ds"]
    assert chain["cam1"]["intrinsics"][:2] == [SPHERE["xi"], SPHERE["alpha"]]
    assert (chain["cam1"]["distortion_model"], chain["cam1"]["distortion_coeffs"]) == ("none", [])


@pytest.mark.parametrize("camera", ["K0", "R0", "E0", "N0"])
def test_camera_info_reads_back_to_the_last_digit(lenses, tmp_path, camera):
    """As ROS prints the message."""
    export(lenses, "mcap", tmp_path / "out", cameras=[camera])
    with AnyReader([tmp_path / "out/bag"]) as reader:
        info = next(
            reader.deserialize(raw, c.msgtype)
            for c, _, raw in reader.messages([c for c in reader.connections if c.topic.endswith("camera_info")])
        )
    (tmp_path / "info.yaml").write_text(
        yaml.safe_dump(
            {
                "height": info.height,
                "width": info.width,
                "distortion_model": info.distortion_model,
                "d": info.d.tolist(),
                "k": info.k.tolist(),
                "r": info.r.tolist(),
                "p": info.p.tolist(),
                "binning_x": info.binning_x,
            }
        )
    )
    found = read_calibration("info.yaml", tmp_path)
    assert (found.intrinsics, found.distortion) == described(lenses, camera)
    assert found.resolution == (48, 27)


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


@pytest.mark.parametrize(
    ("to", "cameras", "problem"),
    [
        *((to, ["P0"], "cannot state a port") for to in ("euroc", "tum", "kitti", "nerfstudio", "mcap")),
        ("tum", ["B0"], "TUM cannot state this distortion"),
        ("kitti", ["F0"], "KITTI cannot state this distortion"),
        ("euroc", ["K0"], "cannot state this distortion"),
        ("nerfstudio", ["B0", "F0"], "with and without fisheye"),
        *((to, ["R0"], "cannot state this distortion") for to in ("euroc", "nerfstudio", "tum", "kitti")),
        *((to, ["S0"], "cannot state this distortion") for to in ("colmap", "nerfstudio", "mcap", "tum", "kitti")),
    ],
)
def test_what_a_format_cannot_say_is_refused_and_nothing_is_left(lenses, tmp_path, to, cameras, problem):
    with pytest.raises(InputError, match=problem):
        export(lenses, to, tmp_path / "out", cameras=cameras)
    assert list(tmp_path.iterdir()) == []


def test_a_refused_camera_is_told_with_those_that_the_format_can_state(lenses, tmp_path):
    """Of all cameras of the dataset; TUM takes pinholes without a port."""
    data = Dataset(lenses)
    pinholes = [name for name in data.cameras if data.camera_model(name).is_pinhole]
    names = ", ".join(pinholes)
    with pytest.raises(InputError, match=f"can; it can state {names}: choose with --camera {pinholes[0]}"):
        export(lenses, "tum", tmp_path / "out", cameras=["F0"])


def test_dataset_json_says_how_to_rebuild_the_rays(lenses):
    """From the entry alone; points of D then lie on the floor, to half a step of D along the axis."""
    data = Dataset(lenses)
    assert data.camera("P0")["port"] == FLAT | {"n_glass": 1.49, "normal": [0.0, 0.0, 1.0]}
    assert data.camera("P0")["n_water"] == [1.34] * 3
    assert data.camera("F0")["camera_model"] == data.camera("S0")["camera_model"] == "fisheye"
    assert data.camera("S0")["distortion"] == SPHERE
    assert data.camera("R0")["distortion"] == RATIONAL
    assert data.camera("N0")["K_opencv"][0] == [MEASURED["fx"], 0.0, MEASURED["cx"]]
    assert not {"focal_length", "sensor_width"} & data.camera("N0").keys()
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
