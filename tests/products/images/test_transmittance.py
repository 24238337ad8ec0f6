"""T is exp(-sigma_t r) of the range r of D, through a renderer, in files and back, and damage to it is named."""

import json
import shutil

import numpy as np
import OpenEXR
import pytest
import standins
from physics.rig import floor
from standins import make_scene, scene_dict

from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.dataset.write.pictures import preview
from varos_warp.products.images.protocol import FirstHits
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.water import optical_properties

SIGMA_S, SIGMA_A = [0.0, 0.02, 0.4], [0.1, 0.04, 0.0]
SIGMA_T = np.add(SIGMA_S, SIGMA_A)
PORTS = {"none": {}, "flat port": {"port": {"kind": "flat", "distance_m": 0.05, "thickness_m": 0.01}}}
FLOOR_M = 3.0


def scene_of(water, **camera):
    view = {"id": "M0", "look_at": [0, 1, 0], "resolution": [24, 16], "sensor_mm": [4.8, 3.2], "focal_mm": 4.0} | camera
    return Scene(water=water, vehicle={"cameras": [view]}, trajectory={"poses": [{"position": [0, 0, 0]}]})


WATER = {"coefficients": {"sigma_s": SIGMA_S, "sigma_a": SIGMA_A}}


@pytest.mark.parametrize("port", PORTS)
def test_it_is_the_closed_form_of_a_plate_across_the_axis(port):
    """The plate is at y = 3 m; rays in float64 start on the port, where the water begins.

    Float32 keeps a distance to a few 2^-24, which counts sigma_t r times.
    """
    renderer = FrameRenderer(scene_of(WATER, **PORTS[port]), "cpu", parts=[floor(FLOOR_M, 0.3)])
    rays = renderer.rays(np.eye(4))
    distance = (FLOOR_M - rays.origin[..., 1]) / rays.direction[..., 1]
    depth = SIGMA_T * distance[..., None]
    found = renderer.render(np.eye(4), outputs="T").T.transmittance
    assert found.dtype == np.float32
    assert (np.abs(found / np.exp(-depth) - 1.0) <= 2.0**-24 * (1.0 + 16.0 * depth)).all()


def test_where_nothing_is_hit_it_is_0_in_every_channel_and_1_without_water_where_something_is():
    plate = floor(FLOOR_M, 0.3, size=1.0)
    for water in (WATER, "none"):
        frame = FrameRenderer(scene_of(water), "cpu", parts=[plate]).render(np.eye(4), outputs="DT")
        hit = np.isfinite(frame.D.range)
        assert 0 < hit.sum() < hit.size
        assert not frame.T.transmittance[~hit].any()
    np.testing.assert_array_equal(frame.T.transmittance[hit], 1.0)


def test_what_was_not_asked_for_is_none_and_no_other_image_changes():
    renderer = FrameRenderer(scene_of(WATER), "cpu", parts=[floor(FLOOR_M, 0.3)])
    alone, both = (renderer.render(np.eye(4), outputs=letters) for letters in ("CD", "CDT"))
    assert alone.T is None
    np.testing.assert_array_equal(alone.D.range, both.D.range)
    np.testing.assert_array_equal(alone.C.normal, both.C.normal)


# -------------------------------------------------------------------------------------------------------- in datasets


class Renderer(standins.FlatFloorRenderer):
    """The stand-in, with T of its first hits."""

    def render(self, T_w_v, camera, outputs, **how):
        made = super().render(T_w_v, camera, [*outputs, "D"], **how)
        hits = FirstHits({"distance": made.D.range}, optical_properties(self.scene), np.zeros(1, np.int32))
        made.T = OUTPUTS["T"].of_hits(hits)
        return made


def dataset(out, outputs="DT", **render):
    left, right = scene_dict()["vehicle"]["cameras"]
    cameras = [left, right | {"port": {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.008}}]
    scene = make_scene(
        vehicle=scene_dict()["vehicle"] | {"cameras": cameras},
        water={"coefficients": {"sigma_s": SIGMA_S, "sigma_a": SIGMA_A}},
        render={"outputs": list(outputs), "depth_exr": True} | render,
    )
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(scene, out, quiet=True, renderer=Renderer(scene))
    return out


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A complete dataset; read it, do not change it."""
    return dataset(tmp_path_factory.mktemp("transmittance") / "out")


@pytest.fixture
def damaged(whole, tmp_path):
    """A copy without checksums, so that only what it holds tells of a change."""
    copy = shutil.copytree(whole, tmp_path / "copy")
    (copy / "checksums").unlink()
    return Dataset(copy)


def channels(path):
    """Float32 [H, W, 3] by the format's own library."""
    with OpenEXR.File(str(path)) as file:
        return file.channels()["RGB"].pixels


def test_the_files_hold_the_law_of_the_files_of_d(whole):
    """To the rounding of T to float32."""
    data = Dataset(whole)
    for camera in data.cameras:
        for frame in data.frames:
            found = channels(data.layout.image(camera, "T", frame))
            reach = files.read_exr(data.layout.exr(camera, "D", frame))["range"].astype(float)
            hit = np.isfinite(reach)
            assert found.dtype == np.float32
            assert hit.any()
            law = np.exp(-SIGMA_T * reach[hit][:, None])
            assert (np.abs(found[hit] - law) <= 2.0**-24 * law + 2.0**-150).all()
            assert not found[~hit].any()


def test_a_dataset_with_it_is_sound_and_read_back(whole):
    data = Dataset(whole)
    assert validate(whole, quiet=True).problems == []
    path = data.layout.image("L0", "T", 3)
    assert path.relative_to(whole).as_posix() == "vehicle0/cam0/T/seq01_veh0_camL0_T-00000003.exr"
    np.testing.assert_array_equal(data.frame(3).T, channels(path))
    np.testing.assert_array_equal(data.image("T", 3), channels(path))
    assert list(files.read_csv(data.layout.camera_file("L0", "_timestamps.csv"))["T"])[3] == path.name


def test_a_missing_one_is_made_again_alone(whole, tmp_path):
    copy = shutil.copytree(whole, tmp_path / "copy")
    path = Dataset(copy).layout.image("L0", "T", 3)
    before = path.read_bytes()
    path.unlink()
    dataset(copy)
    assert path.read_bytes() == before


def test_dataset_json_and_the_readme_tell_of_it_where_it_is(whole, tmp_path):
    other = dataset(tmp_path / "out", "D")
    for root, there in ((whole, True), (other, False)):
        assert ("T" in json.loads((root / "dataset.json").read_text())["conventions"]) is there
        assert ("IMAGES T" in (root / "README.txt").read_text()) is there
    assert "{" not in (whole / "README.txt").read_text().partition("IMAGES T")[2].partition("LIGHTS")[0]


def test_its_picture_is_white_where_all_light_gets_through():
    pixels = OUTPUTS["T"].colors(np.array([[[1.0, 0.0, 0.5]]], np.float32), {}, None)
    assert pixels.tolist() == [[[255, 0, 188]]]


def test_a_small_picture_has_the_proportions_of_the_image(whole):
    assert preview(Dataset(whole), "T", 0, "L0", 24).size == (24, 14)


def rewritten(data, change):
    path = data.layout.image("L0", "T", 3)
    pixels = channels(path).copy()
    change(pixels)
    files.write_image(path, pixels)


def halved(pixels):
    pixels[20:, :, 1] *= 0.5


def brighter(pixels):
    pixels[20, 5] = 1.5


def unknown(pixels):
    pixels[20, 5, 0] = np.nan


def black(pixels):
    pixels[:] = 0.0


def one_surface_less(pixels):
    pixels[np.unravel_index(pixels[..., 1].argmax(), pixels.shape[:2])] = 0.0


def one_surface_more(pixels):
    pixels[tuple(np.argwhere(pixels[..., 1] == 0.0)[0])] = np.exp(-SIGMA_T * 2.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (black, "pixels where D has a surface"),
        (one_surface_less, "is 0 in 1 pixels where D has a surface"),
        (one_surface_more, "has a surface in 1 pixels where D has none"),
        (halved, "no distance in this water makes"),
        (brighter, "not between 0 and 1"),
        (unknown, "not between 0 and 1"),
    ],
)
def test_damage_within_it_is_named(damaged, change, said):
    rewritten(damaged, change)
    problems = validate(damaged.root, quiet=True).problems
    assert any("_T-00000003.exr" in problem and said in problem for problem in problems), problems


def test_that_of_another_frame_is_told_by_d(damaged):
    one, other = (damaged.layout.image("L0", "T", frame) for frame in (3, 8))
    one.write_bytes(other.read_bytes())
    problems = validate(damaged.root, quiet=True).problems
    assert any(one.name in problem and "another distance than D" in problem for problem in problems), problems


def test_a_file_of_another_kind_is_an_error_that_names_it(damaged):
    path = damaged.layout.image("L0", "T", 3)
    files.write_exr(path, {"X": np.zeros((27, 48), np.float32)})
    problems = validate(damaged.root, quiet=True).problems
    assert any(path.name in problem and "has no channel R" in problem for problem in problems), problems
