"""The file of a camera's rays: those of its lens and port to the rounding of float32."""

import json
import shutil

import numpy as np
import pytest
import standins
from standins import make_scene, scene_dict

from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.report import facts
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.dataset.write.texts import describe_camera
from varos_warp.errors import InputError
from varos_warp.scene.frames import camera_pose
from varos_warp.scene.optics.camera import CHANNELS, camera_model, pixel_centres

FLAT = {
    "port": {"kind": "flat", "distance_m": 0.005, "thickness_m": 0.01, "normal": [0.6, 0.1, 1.0]},
    "n_water": {"temperature_C": 10, "salinity": 35},
    "distortion": {"model": "kannala_brandt"},
}
BARREL = {"distortion": {"model": "brown_conrady", "k": [-0.25, 0.06, 0.001, -0.002, 0.0]}}
SIZE = [48, 27]


@pytest.fixture(scope="module")
def scene():
    view = {"rotation_euler_deg": [-30, 0, 0], "resolution": SIZE}
    cameras = [view | {"id": "F0", "focal_mm": 1.6} | FLAT, view | {"id": "B0"} | BARREL, view | {"id": "M0"}]
    return make_scene(vehicle=scene_dict()["vehicle"] | {"cameras": cameras}, render={"outputs": ["D"]})


@pytest.fixture(scope="module")
def made(scene, tmp_path_factory):
    """A complete dataset; read it, do not change it."""
    out = tmp_path_factory.mktemp("rays")
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(scene, out, quiet=True, frames=slice(2))
    return out


@pytest.fixture
def copy(made, unchecked):
    return unchecked(made)


def test_they_are_those_of_the_model_to_rounding(scene, made):
    data = Dataset(made)
    for camera in scene.vehicle.cameras[:2]:
        for number, channel in enumerate(CHANNELS):
            rays = camera_model(camera).rays(pixel_centres(*SIZE), number)
            for exact, found in zip(rays, data.rays(camera.id, channel), strict=True):
                assert found.dtype == np.float32
                np.testing.assert_allclose(found, exact, rtol=2.0**-24, atol=0)
    unseen = data.rays("F0").weight == 0.0
    assert 0 < unseen.sum() < unseen.size / 2  # the fisheye looks past the pane
    assert np.isnan(data.rays("F0").direction[unseen]).all()


def test_they_lead_to_what_the_pixels_see(scene, made):
    """Origin, direction and D alone, as a program without the package uses them: every pixel of the floor."""
    data = Dataset(made)
    frame, planes = data[1, "F0"], files.read_exr(data.root / data.camera("F0")["rays"])
    origin, direction = (np.stack([planes[f"green.{kind}{axis}"] for axis in "xyz"], -1) for kind in "od")
    along = (frame.D - origin[..., 2]) / direction[..., 2]
    hit = np.isfinite(along) & np.isfinite(frame.D)
    assert hit.sum() > 300
    points = (origin + along[..., None] * direction)[hit] @ frame.T_w_c[:3, :3].T + frame.T_w_c[:3, 3]
    step = data.meta["depth"]["scale_m"] / direction[..., 2][hit]
    assert (np.abs(points[:, 2] - standins.FLOOR_Z) < 0.51 * step + 1e-6).all()  # half a step of D along z


def test_only_cameras_with_a_port_or_distortion_have_one(scene, made):
    data = Dataset(made)
    assert [("rays" in data.camera(name), data.layout.rays(name).exists()) for name in data.cameras] == [
        (True, True),
        (True, True),
        (False, False),
    ]
    assert "rays" not in describe_camera(data.layout, scene.vehicle.cameras[2])
    exact = camera_model(scene.vehicle.cameras[2]).rays(pixel_centres(*SIZE))
    assert np.array_equal(data.rays("M0").direction, exact.direction)
    assert {name.partition(".")[0] for name in files.read_exr(data.layout.rays("B0"))} == {"green"}
    with pytest.raises(InputError, match="red, green, blue"):
        data.rays("F0", "cyan")


def test_colours_are_apart_by_what_the_rays_of_each_say(scene, made):
    """The image point of red is that whose red ray meets what green sees: found by projecting world points."""
    data = Dataset(made)
    frame, camera = data[1, "F0"], scene.vehicle.cameras[0]
    offsets = {channel: frame.colour_offsets(channel) for channel in CHANNELS}
    hit = np.isfinite(offsets["red"]).all(-1)
    assert np.array_equal(hit, np.isfinite(frame.D))
    assert np.abs(offsets["green"][hit]).max() < 1e-9
    T_w_c = camera_pose(camera, frame.T_w_v)
    np.testing.assert_allclose(T_w_c, frame.T_w_c, atol=1e-12)
    model = camera_model(camera)
    for number, channel in ((0, "red"), (2, "blue")):
        rays = model.rays((pixel_centres(*SIZE) + offsets[channel])[hit], number)
        green = model.rays(pixel_centres(*SIZE)[hit])
        z = frame.D[hit].astype(float)
        point, seen = (
            ray.origin + ((z - ray.origin[:, 2]) / ray.direction[:, 2])[:, None] * ray.direction
            for ray in (green, rays)
        )
        np.testing.assert_allclose(seen, point, atol=1e-9)
    assert np.abs(offsets["blue"][hit]).max() > 0.02  # of 17 px a radian
    assert not np.any(data[1, "B0"].colour_offsets("red")[hit] > 1e-9)


def test_the_report_names_them(made):
    text = str(facts.cameras(Dataset(made)))
    assert "vehicle0/cam0/camF0_rays.exr, vehicle0/cam1/camB0_rays.exr" in text
    assert "camM0_rays" not in text


def one_ray(channels):
    channels["blue.dx"][20, 24] += 1e-6


def no_channel(channels):
    del channels["red.oy"]


def one_row_less(channels):
    channels |= {name: np.ascontiguousarray(plane[1:]) for name, plane in channels.items()}


@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        (one_ray, "1 pixels have other rays than lens and port give them"),
        (no_channel, "channel red.oy is missing"),
        (one_row_less, "is not of 48 x 27 pixels"),
    ],
)
def test_damage_is_found(copy, damage, problem):
    path = Dataset(copy).layout.rays("F0")
    channels = files.read_exr(path)
    damage(channels)
    files.write_exr(path, channels)
    assert f"vehicle0/cam0/camF0_rays.exr: {problem}" in validate(copy, quiet=True).problems


def test_a_port_that_the_rays_are_not_of_is_found(copy):
    meta = json.loads((copy / "dataset.json").read_text())
    meta["cameras"][0]["port"]["n_glass"] = 1.5
    files.write_json(copy / "dataset.json", meta)
    assert any(
        "camF0_rays.exr: " in problem and "other rays" in problem for problem in validate(copy, quiet=True).problems
    )


def test_a_missing_file_is_found_and_made_again(scene, made, tmp_path):
    copy = shutil.copytree(made, tmp_path / "copy")
    path = Dataset(copy).layout.rays("F0")
    before = path.read_bytes()
    path.unlink()
    assert "vehicle0/cam0/camF0_rays.exr: there is no such file" in validate(copy, quiet=True).problems
    produce(scene, copy, quiet=True, frames=slice(2))
    assert path.read_bytes() == before
    path.write_bytes(before[:-100])
    produce(scene, copy, quiet=True, frames=slice(2))
    assert path.read_bytes() == before
    assert validate(copy, quiet=True).problems == []
