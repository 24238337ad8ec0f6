"""Images of measured cameras: intrinsics like those of a sensor, principal points aside, and lenses that end."""

import numpy as np
import pytest
from rig import VAROS_LAMPS, VAROS_WATER
from test_lens import rectangle

from varos_warp.render.renderer import FrameRenderer, NextFrame
from varos_warp.scene.description import Scene
from varos_warp.scene.frames import transform
from varos_warp.scene.optics.camera import camera_model, pixel_centres

pytestmark = pytest.mark.subject("camera")

BY_SENSOR = {"resolution": [48, 32], "sensor_mm": [4.416, 2.944], "focal_mm": 3.4}
F = 3.4 / 4.416 * 48
BY_PIXELS = {"resolution": [48, 32], "intrinsics": {"fx": F, "fy": 3.4 / 2.944 * 32, "cx": 23.5, "cy": 15.5}}
PART = {"resolution": [20, 16], "intrinsics": BY_PIXELS["intrinsics"] | {"cx": 23.5 - 26.0, "cy": 15.5 - 3.0}}
"""The columns from 26 and the rows from 3 on of the others: its principal point lies outside of its image."""
COLUMNS, ROWS = slice(26, 46), slice(3, 19)
ENDING = {
    "folding": {"distortion": {"model": "brown_conrady", "k": [-0.9, 0.0, 0.002, -0.003, 0.0]}},
    "sphere": {"focal_mm": 2.0, "distortion": {"model": "double_sphere", "xi": -0.3, "alpha": 0.95}},
}
NEXT = NextFrame(transform(position=[0.1, 0.0, 0.05]))


def renderer_of(view, water=VAROS_WATER):
    """A slanted wall and a plate before it."""
    wall = rectangle((-30, 3 - 9, -30), (60, 18, 0), (0, 0, 60), 0.5, "wall")
    plate = rectangle((-0.2, 2, -0.3), (0.8, 0, 0), (0, 0, 0.7), 0.3, "plate")
    scene = Scene(
        water={"coefficients": water} if water else "none",
        vehicle={"cameras": [view], "lights": VAROS_LAMPS},
        trajectory={"poses": [{"position": [0, 0, 0]}]},
    )
    return FrameRenderer(scene, "cpu", parts=[wall, plate])


@pytest.mark.parametrize("integrator", ["field", "path"])
def test_intrinsics_that_say_the_same_give_the_same_bytes(any_field, integrator):
    """K is made of the same products, so nothing differs, nor do the rays along which the field is tabulated."""
    how = {"outputs": "ABCDSF", "following": NEXT, "integrator": integrator, "spp": 2, "spp_b": 2, "denoise": "none"}
    frames = [renderer_of(view).render(np.eye(4), denoise_b="none", **how) for view in (BY_SENSOR, BY_PIXELS)]
    for image in (
        lambda f: f.A.radiance,
        lambda f: f.A.stderr,
        lambda f: f.B.radiance,
        lambda f: f.C.normal,
        lambda f: f.D.depth,
        lambda f: f.S.instance,
        lambda f: f.F.flow,
    ):
        np.testing.assert_array_equal(*map(image, frames))


def test_a_part_of_an_image_is_that_of_a_camera_whose_principal_point_is_aside():
    """C, D, S and F of each pixel: the pixel differs by whole columns and rows, and the rays by rounding."""
    whole, part = (
        renderer_of(view, None).render(np.eye(4), outputs="CDSF", following=NEXT) for view in (BY_PIXELS, PART)
    )
    cut = (ROWS, COLUMNS)
    np.testing.assert_array_equal(part.S.instance, whole.S.instance[cut])
    assert len(np.unique(part.S.instance)) == 2
    np.testing.assert_allclose(part.C.normal, whole.C.normal[cut], atol=1e-6)
    np.testing.assert_allclose(part.D.depth, whole.D.depth[cut], rtol=2e-5)
    np.testing.assert_allclose(part.F.flow, whole.F.flow[cut], atol=1e-3)
    np.testing.assert_array_equal(part.F.occluded, whole.F.occluded[cut])


@pytest.mark.parametrize("layers", [("single",), ("multiple",)])
def test_light_in_open_water_of_a_part_of_an_image_is_that_of_the_whole(truth, few_nodes, layers):
    """By the field tabulated along the rays: in between its nodes, which are finer in the part, it is interpolated."""
    how = {"outputs": "A", "integrator": "field", "spp": 16, "denoise": "none", "layers": layers}
    whole, part = (
        FrameRenderer(renderer_of(view).scene, "cpu", parts=[]).render(np.eye(4), **how).A.radiance
        for view in (BY_PIXELS, PART)
    )
    expected = whole[ROWS, COLUMNS].mean((0, 1))
    truth(
        f"mean radiance of a part of an image, {layers[0]}",
        source="the same part of the whole",
        expected=expected,
        got=part.mean((0, 1)),
        tolerance=2e-3 * expected,
        reason="stated bias of the field",
    )


@pytest.mark.parametrize(("lens", "integrator"), [("folding", "path"), ("folding", "field"), ("sphere", "reference")])
def test_where_a_lens_ends_images_are_black_or_nothing(any_field, lens, integrator):
    """All outputs; a pixel that the edge crosses may have some light, and one whose centre sees a wall has a depth."""
    renderer = renderer_of(BY_SENSOR | ENDING[lens])
    frame = renderer.render(
        np.eye(4),
        outputs="ABCDSF",
        following=NEXT,
        spp=4,
        spp_b=4,
        integrator=integrator,
        denoise="none",
        denoise_b="none",
    )
    view = renderer.scene.vehicle.cameras[0]
    model, (row, col) = camera_model(view), np.indices((33, 49))
    corner = model.rays(np.stack([col, row], -1).astype(float)).weight == 0.0
    blind = corner[:-1, :-1] & corner[1:, :-1] & corner[:-1, 1:] & corner[1:, 1:]
    seen = model.rays(pixel_centres(48, 32)).weight > 0.0
    assert 50 < blind.sum() < 1200
    assert (frame.A.radiance[blind] == 0.0).all()
    assert (frame.B.radiance[blind] == 0.0).all()
    assert frame.A.radiance[seen].mean() > 1e-4
    assert (frame.B.radiance[seen] > 0.0).mean() > 0.99
    found = np.isfinite(frame.D.depth)
    assert not found[~seen].any()
    assert found[seen].mean() > 0.95
    for there in (np.isfinite(frame.D.range), frame.C.normal.any(-1), frame.S.instance > 0):
        np.testing.assert_array_equal(there, found)
    assert np.isnan(frame.F.flow[~seen]).all()
    assert not frame.F.occluded[~seen].any()


def test_flow_into_what_a_lens_does_not_see_is_not_known():
    """After a step to the left what the rightmost pixels see is beyond the cone."""
    renderer = renderer_of(BY_SENSOR | ENDING["folding"], None)
    flow = renderer.render(np.eye(4), outputs="F", following=NextFrame(transform(position=[-0.4, 0.0, 0.0]))).F
    known, seen = np.isfinite(flow.flow).all(-1), np.isfinite(flow.motion).all(-1)
    lost = seen & ~known
    assert 5 < lost.sum() < 200
    model = camera_model(renderer.scene.vehicle.cameras[0])
    at = pixel_centres(48, 32) + np.where(known[..., None], flow.flow, np.nan)
    assert (model.rays(at[known].astype(float)).weight > 0.0).mean() > 0.99  # float32 of the flow may round it out


def test_vignetting_of_a_lens_that_ends_leaves_finite_numbers():
    """cos^4 of an angle that is not there counts as black."""
    view = BY_SENSOR | ENDING["folding"] | {"vignetting": {"kind": "cos4"}}
    image = renderer_of(view).render(np.eye(4), outputs="A", spp=2, integrator="path", layers=("direct",)).A
    assert np.isfinite(image.radiance).all()
    assert np.isfinite(image.stderr).all()
    assert (image.radiance[0, 0] == 0.0).all()
