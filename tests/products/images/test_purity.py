"""U is the share of a pixel that shows the object of its centre: edges and blur in closed form, files, and damage.

Shares are of 32 rays that are stratified: an edge along rows or columns is known to 1/32, and any other no worse than
with independent rays, whose standard error is sqrt(p (1 - p) / 32).
"""

import shutil

import numpy as np
import pytest
import standins
from standins import make_scene

from tests.physics.rig import floor
from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.kernels.transport.purity import PURITY_RAYS
from varos_warp.products.images import purity
from varos_warp.products.images.protocol import FirstHits
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.water import optical_properties

WIDTH, HEIGHT, FOCAL = 24, 16, 20.0
"""Of the image [pixels]; a plate at 2 m has 10 pixels a metre."""


def scene_of(**camera):
    view = {
        "id": "M0",
        "look_at": [0, 1, 0],
        "resolution": [WIDTH, HEIGHT],
        "sensor_mm": [4.8, 3.2],
        "focal_mm": 4.0,
    } | camera
    return Scene(water="none", vehicle={"cameras": [view]}, trajectory={"poses": [{"position": [0, 0, 0]}]})


def half_plate(edge_px, angle_deg=0.0):
    """A plate at 2 m on the right of a line through the image point (edge_px, middle), turned about the axis."""
    plate = floor(2.0, 0.3)
    corners = plate.vertices.copy()
    corners[:, 0] = np.where(corners[:, 0] < 0, 0.0, 400.0)
    a = np.radians(angle_deg)
    turned = np.column_stack(
        [
            np.cos(a) * corners[:, 0] + np.sin(a) * corners[:, 2],
            corners[:, 1],
            -np.sin(a) * corners[:, 0] + np.cos(a) * corners[:, 2],
        ]
    )
    turned[:, 0] += (edge_px - WIDTH / 2) / FOCAL * 2.0
    return Part("plate", turned, plate.faces, plate.material)


def rendered(part, **how):
    frame = FrameRenderer(scene_of(**how.pop("camera", {})), "cpu", parts=[part]).render(np.eye(4), outputs="SU", **how)
    return frame.U.purity, frame.S.instance


def areas(edge_px, angle_deg, side=200):
    """Share of every pixel on the right of the line, by the midpoint rule."""
    fine = (np.arange(side) + 0.5) / side
    x = np.arange(WIDTH)[None, :, None, None] + fine[None, None, None, :] - edge_px
    y = np.arange(HEIGHT)[:, None, None, None] + fine[None, None, :, None] - HEIGHT / 2
    a = np.radians(angle_deg)
    return (np.cos(a) * x + np.sin(a) * y > 0).mean(axis=(2, 3))


@pytest.mark.parametrize("offset", [0.1, 0.3, 0.45, 0.7, 0.98])
def test_an_edge_along_a_column_covers_the_area_that_it_cuts_off_to_one_ray(offset):
    found, _ = rendered(half_plate(9.0 + offset))
    expected = max(offset, 1.0 - offset)
    np.testing.assert_allclose(found[:, 9], expected, atol=1 / 32)
    assert (np.delete(found, 9, axis=1) == 1.0).all()


def test_a_slanted_edge_covers_the_area_that_it_cuts_off():
    """Of every pixel within 5 standard errors, and of their mean."""
    found, number = rendered(half_plate(11.3, 21.0))
    right = areas(11.3, 21.0)
    expected = np.where(number == 1, right, 1.0 - right)
    cut = (right > 0.0) & (right < 1.0)
    assert 10 < cut.sum() < 60
    assert (found[~cut] == 1.0).all()
    error = np.sqrt(np.maximum(expected * (1 - expected), 1 / 32) / 32)
    assert (np.abs(found - expected)[cut] < 5 * error[cut]).all()
    assert abs((found - expected)[cut].mean()) < 5 * np.sqrt(np.square(error[cut]).sum()) / cut.sum()


def test_without_anything_in_sight_and_inside_of_a_plate_it_is_1():
    for part in (floor(2.0, 0.3), floor(-2.0, 0.3)):
        found, _ = rendered(part)
        assert (found == 1.0).all()
        assert (OUTPUTS["U"].pixels(purity.PurityImage(found), None) == 255).all()
    plain = FrameRenderer(scene_of(), "cpu", parts=[]).render(np.eye(4), outputs="U")
    assert (plain.U.purity == 1.0).all()


def test_what_is_out_of_focus_is_mixed_as_far_as_its_disk_reaches():
    """A lens of 0.5 m radius, focused at 1 m, sees a plate at 2 m in disks of 0.5 f (1/1 - 1/2) = 5 pixels' radius."""
    found, _ = rendered(half_plate(12.0), camera={"f_stop": 4e-3, "focus_m": 1.0})
    distance = np.abs(np.arange(WIDTH) + 0.5 - 12.0)
    assert (found[:, distance > 6.0] == 1.0).all()
    # share of a disk on one side of a line at d radii from its centre, mean over a pixel by the midpoint rule
    d = np.clip(np.abs(distance[:, None] + (np.arange(50) + 0.5) / 50 - 0.5) / 5.0, 0.0, 1.0)
    expected = (0.5 + (d * np.sqrt(1 - d**2) + np.arcsin(d)) / np.pi).mean(1)
    assert np.abs(found.mean(0) - expected).max() < 5 * 0.5 / np.sqrt(32 * HEIGHT)
    assert abs((found.mean(0) - expected)[distance < 6.0].mean()) < 5 * 0.5 / np.sqrt(32 * HEIGHT * 12)


def test_motion_blurs_an_edge_over_the_pixels_that_it_passes():
    """4 pixels to the right and left of where it is at the frame's time: shares rise linearly over 8 pixels."""

    def motion(offset_ns):
        T = np.repeat(np.eye(4)[None], len(offset_ns), 0)
        T[:, 0, 3] = offset_ns * 1e-9 * 0.8 / 0.1
        return T

    found, _ = rendered(half_plate(12.0), camera={"exposure": {"time_s": 0.1}}, motion=motion)
    distance = np.abs(np.arange(WIDTH) + 0.5 - 12.0)
    expected = np.minimum(0.5 + distance / 8.0, 1.0)
    np.testing.assert_allclose(found.mean(0), expected, atol=5 * 0.5 / np.sqrt(32 * HEIGHT))
    assert (found[:, distance > 4.6] == 1.0).all()


def test_a_frame_and_a_seed_give_the_same_and_others_other_rays():
    part = half_plate(11.3, 21.0)
    one, again, other = (rendered(part, frame=frame)[0] for frame in (0, 0, 1))
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()


def test_the_image_type_and_the_kernel_agree_on_the_number_of_rays():
    assert PURITY_RAYS == purity.RAYS


def test_no_other_image_changes_for_it():
    renderer = FrameRenderer(scene_of(), "cpu", parts=[half_plate(11.3, 21.0)])
    alone, both = (renderer.render(np.eye(4), outputs=letters) for letters in ("DS", "DSU"))
    assert alone.U is None
    np.testing.assert_array_equal(alone.D.range, both.D.range)
    np.testing.assert_array_equal(alone.S.instance, both.S.instance)


# -------------------------------------------------------------------------------------------------------- in datasets


class Renderer(standins.FlatFloorRenderer):
    """The stand-in, with U as a plain horizon makes it: half of the pixels at the border of S are mixed."""

    segments = ({"id": 1, "key": "terrain", "kind": "terrain", "material": None, "material_id": 0},)

    def render(self, T_w_v, camera, outputs, **how):
        made = super().render(T_w_v, camera, [*outputs, "S"], **how)
        number = made.S.instance
        share = np.ones(number.shape, np.float32)
        rows, columns = np.nonzero(number[1:] != number[:-1])
        share[rows, columns] = 0.75
        hits = FirstHits({"purity": share}, optical_properties(self.scene), np.zeros(2, np.int32))
        made.U = OUTPUTS["U"].of_hits(hits)
        return made


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A complete dataset; read it, do not change it."""
    out = tmp_path_factory.mktemp("purity") / "out"
    vehicle = make_scene().vehicle.model_dump(mode="json")
    for camera in vehicle["cameras"]:
        camera["rotation_euler_deg"] = [5, 12, 0]  # the horizon has steps
    scene = make_scene(render={"outputs": ["D", "S", "U"]}, vehicle=vehicle)
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(scene, out, quiet=True, renderer=Renderer(scene))
    return out


def test_a_dataset_with_it_is_sound_and_read_back(whole):
    data = Dataset(whole)
    assert validate(whole, quiet=True).problems == []
    path = data.layout.image("L0", "U", 3)
    assert path.relative_to(whole).as_posix() == "vehicle0/cam0/U/seq01_veh0_camL0_U-00000003.png"
    assert set(np.unique(data.pixels("U", 3))) == {191, 255}
    np.testing.assert_allclose(np.unique(data.frame(3).U), [191 / 255, 1.0], rtol=1e-6)
    assert "IMAGES U" in (whole / "README.txt").read_text()
    assert "U" in data.meta["conventions"]


def inside(pixels):
    pixels[-6:] = 0


def pure(pixels):
    pixels[:] = 255


def no_share(pixels):
    pixels[3, 5] = 100


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (inside, "more mixed inside the objects of S"),
        (pure, "no mixed pixel"),
        (no_share, "values in 1 pixels that are no shares of 32 rays"),
    ],
)
def test_damage_within_it_is_named(whole, tmp_path, change, said):
    copy = shutil.copytree(whole, tmp_path / "copy")
    (copy / "checksums").unlink()
    path = Dataset(copy).layout.image("L0", "U", 3)
    pixels = files.read_image(path).copy()
    change(pixels)
    files.write_image(path, pixels)
    problems = validate(copy, quiet=True).problems
    assert any(path.name in problem and said in problem for problem in problems), problems
