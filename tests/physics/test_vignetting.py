"""Vignetting: A times a share of the light that closed forms tell, and nothing else changed."""

import numpy as np
import pytest
from test_lens import rectangle
from test_ports_in_images import BARREL, FLAT, scene_of

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.optics.camera import camera_model, pixel_centres

pytestmark = pytest.mark.subject("camera")

WATER = {"coefficients": {"sigma_s": [0.3] * 3, "sigma_a": [0.1] * 3, "phase": {"kind": "henyey_greenstein", "g": 0.8}}}
COS4, POLYNOMIAL = {"kind": "cos4"}, {"kind": "polynomial", "coefficients": [-0.5, 0.1]}
HEIGHT, WIDTH = 9, 16


def renderer_of(water=WATER, **camera):
    plate = rectangle((-5, 2, -5), (10, 0, 0), (0, 0, 10), 0.6, "plate")
    view = {"resolution": [WIDTH, HEIGHT], "focal_mm": 2.0} | camera
    return FrameRenderer(scene_of(view, water), "cpu", parts=[plate])


def radius():
    """Of the pixels' centres from that of the image [H, W] [pixels]."""
    row, col = np.indices((HEIGHT, WIDTH)) + 0.5
    return np.hypot(col - WIDTH / 2, row - HEIGHT / 2)


def cos4():
    f = 2.0 / 4.416 * WIDTH
    return np.cos(np.arctan(radius() / f)) ** 4


def polynomial():
    r = radius() / (0.5 * np.hypot(WIDTH, HEIGHT))
    return 1.0 - 0.5 * r**2 + 0.1 * r**4


@pytest.mark.parametrize(("fall", "share"), [(COS4, cos4), (POLYNOMIAL, polynomial)])
@pytest.mark.parametrize(("integrator", "spp"), [("path", 4), ("field", 0.25), ("reference", 4)])
def test_a_and_its_errors_are_multiplied_by_the_share(truth, any_field, integrator, spp, fall, share):
    """Pixel by pixel with the same samples: radiance and layers; variances are means over tiles of what it leaves.

    With the field as few samples as are taken anyway: none are shared out by what is left of the noise.
    """
    how = {"outputs": "A", "integrator": integrator, "spp": spp, "denoise": "none"}
    plain, fallen = (renderer_of(**camera).render(np.eye(4), **how).A for camera in ({}, {"vignetting": fall}))
    truth(
        f"radiance of all pixels with vignetting by {fall['kind']}, {integrator}",
        source="closed form times without",
        expected=plain.radiance * share()[..., None],
        got=fallen.radiance,
        tolerance=1e-6 * plain.radiance,
        reason="float32 rounding of the layers",
    )
    for layer, L in plain.layers.items():
        np.testing.assert_allclose(fallen.layers[layer], L * share()[..., None], rtol=1e-6, atol=1e-9)
    if spp > 1:
        ratio = fallen.stderr / plain.stderr
        assert np.all((ratio >= share().min() * (1 - 1e-6)) & (ratio <= share().max() * (1 + 1e-6)))
        assert share().max() < 0.999  # so errors that know nothing of it would be seen


def test_samples_that_are_shared_out_have_the_mean_of_the_share_too(truth, any_field):
    """With the field, what pixels take follows from their noise; by standard errors."""
    how = {"outputs": "A", "integrator": "field", "spp": 16, "denoise": "none"}
    plain, fallen = (
        renderer_of(**camera).render(np.eye(4), seed=seed, **how).A
        for seed, camera in ((1, {}), (2, {"vignetting": COS4}))
    )
    off = (fallen.radiance - plain.radiance * cos4()[..., None]).mean((0, 1), dtype=np.float64)
    variance = np.square(fallen.stderr) + np.square(plain.stderr * cos4()[..., None])
    truth(
        "mean of an image whose samples are shared out, less that without times the share",
        source="closed form",
        expected=np.zeros(3),
        got=off,
        stderr=np.sqrt(variance.mean((0, 1)) / radius().size),
    )


def test_only_a_has_it():
    plain, fallen = (
        renderer_of(**camera).render(np.eye(4), outputs="BCDS", spp_b=4) for camera in ({}, {"vignetting": COS4})
    )
    assert np.array_equal(plain.B.radiance, fallen.B.radiance)
    assert np.array_equal(plain.D.depth, fallen.D.depth)
    assert np.array_equal(plain.C.normal, fallen.C.normal)
    assert np.array_equal(plain.S.instance, fallen.S.instance)


@pytest.mark.parametrize("camera", [{}, {"distortion": BARREL}, {"port": FLAT, "n_water": [1.339, 1.342, 1.347]}])
def test_cos4_is_that_of_the_ray_at_the_lens(camera):
    """In air behind a port, whatever the lens: of images, by the weights of `rays`, and of the weights by its angle."""
    how = {"outputs": "A", "integrator": "path", "spp": 6, "layers": ("direct", "single"), "denoise": "none"}
    plain, fallen = renderer_of("none", **camera), renderer_of("none", **camera, vignetting=COS4)
    cosine = camera_model(plain.scene.vehicle.cameras[0]).directions(pixel_centres(WIDTH, HEIGHT))[..., 2]
    np.testing.assert_allclose(fallen.rays(np.eye(4)).weight, plain.rays(np.eye(4)).weight * cosine**4, rtol=1e-12)
    A, without = (r.render(np.eye(4), **how).A.radiance for r in (fallen, plain))
    np.testing.assert_allclose(A, without * (cosine**4)[..., None], rtol=1e-6)
    assert cosine.min() < 0.8
