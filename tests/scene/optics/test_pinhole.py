"""The best pinhole in place of a port: a table of its errors, and keys that give the same pictures."""

import numpy as np
import pytest

from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.optics.camera import CameraModel, camera_model
from varos_warp.scene.optics.distortion import Lens
from varos_warp.scene.optics.pinhole import ALIKE_PX, distance_px, fit_pinhole, port_worth

RANGES = np.linspace(0.8, 6.2, 25)
CLOSE = {"kind": "flat", "distance_m": 1e-4}
KNOWN = {
    (0.005, 0.008): {0.5: (1.07, 2.29), 1: (0.43, 0.91), 2: (0.11, 0.23), 5: (0.09, 0.19), 10: (0.15, 0.32)},
    (0.020, 0.008): {0.5: (6.54, 13.6), 1: (2.61, 5.42), 2: (0.65, 1.35), 5: (0.52, 1.08), 10: (0.91, 1.90)},
    (0.050, 0.010): {0.5: (17.3, 35.8), 1: (6.87, 14.2), 2: (1.71, 3.54), 5: (1.37, 2.83), 10: (2.39, 4.94)},
}
"""Errors of a pinhole, root mean square and largest [px], by distance and thickness of the glass [m] and by z [m].

They are of the paper's camera (a focal length of 985.5 px) behind glass of index 1.49 in water of index 1.34. Rays were
bent by Snell's law, and the pinhole got the radial polynomial of four terms that fits best at 3 m, for radii that are
equally frequent up to the corner. That took a few lines of NumPy which share no code with this package."""
BY_SNELL = "Snell's law and a radial polynomial by least squares, without this package"


@pytest.mark.subject("camera")
@pytest.mark.parametrize("glass", KNOWN)
def test_a_pinhole_that_is_right_at_one_distance_is_off_at_others(truth, glass):
    model = camera_model(Camera(port={"kind": "flat", "distance_m": glass[0], "thickness_m": glass[1]}))
    radius = np.linspace(0.0, np.hypot(639.5, 359.5), 46)
    image = np.stack([640.0 + radius * 640.0 / 734.3, 360.0 + radius * 360.0 / 734.3], -1)
    rays = model.rays(image)

    def points(z):
        return rays.origin + ((z - rays.origin[:, 2:]) / rays.direction[:, 2:]) * rays.direction

    pinhole = fit_pinhole(model, image, points(3.0), "brown_conrady", centre=False)
    off = np.array([distance_px(pinhole, image, points(z)) for z in KNOWN[glass]])
    rms, most = np.array(list(KNOWN[glass].values())).T
    truth(
        f"rms [px] behind glass {glass[0] * 1e3:g} mm away",
        source=BY_SNELL,
        expected=rms,
        got=np.sqrt(np.square(off).mean(1)),
        tolerance=0.005 + 0.02 * rms,
        reason="two digits; its radii are not known",
    )
    truth(
        f"largest [px] behind glass {glass[0] * 1e3:g} mm away",
        source=BY_SNELL,
        expected=most,
        got=off.max(1),
        tolerance=0.005 + 0.005 * most,
        reason="two or three digits",
    )


@pytest.mark.parametrize(
    "lens",
    [
        Lens("brown_conrady", (-0.2, 0.05, 0.001, -0.002, 0.01)),
        Lens("kannala_brandt", (-0.02, 0.003, -0.001, 0.0002)),
        Lens(),
    ],
)
def test_a_pinhole_is_found_again(lens):
    K = np.array([[900.0, 0.0, 610.0], [0.0, 1080.0, 395.0], [0.0, 0.0, 1.0]])
    points = np.random.default_rng(1).uniform([-0.6, -0.4, 1.0], [0.6, 0.4, 1.2], (300, 3))
    image = CameraModel(K, lens).project(points)
    start = CameraModel(np.array([[700.0, 0.0, 640.0], [0.0, 840.0, 360.0], [0.0, 0.0, 1.0]]))
    found = fit_pinhole(start, image, points, lens.model)
    np.testing.assert_allclose(found.K, K, rtol=1e-9)
    np.testing.assert_allclose(found.lens.k, lens.k, atol=1e-7)
    np.testing.assert_allclose(distance_px(found, image, points), 0.0, atol=1e-9)


MEASURED = {"fx": 985.5, "fy": 984.5, "cx": 651.0, "cy": 340.25}
CENTRED = {"kind": "dome", "radius_m": 0.05, "thickness_m": 0.007}
SAME = {
    "close glass": {"port": CLOSE},
    "centred dome": {"port": CENTRED},
    "centred dome, barrel": {
        "port": CENTRED,
        "distortion": {"model": "brown_conrady", "k": [-0.35, 0.12, 0.001, -0.002, -0.01]},
    },
    "centred dome, aside": {"port": CENTRED, "intrinsics": MEASURED},
    "dome that moves the centre": {"port": CENTRED | {"centre": [2e-5, 0.0, 0.0]}, "intrinsics": MEASURED},
    "centred dome, fisheye aside": {
        "port": {"kind": "dome", "radius_m": 0.05},
        "intrinsics": MEASURED | {"fx": 377.0},
        "distortion": {"model": "kannala_brandt", "k": [-0.02, 0.003, -0.001, 0.0002]},
    },
    "centred dome, fisheye": {
        "port": {"kind": "dome", "radius_m": 0.05},
        "focal_mm": 1.3,
        "distortion": {"model": "kannala_brandt", "k": [-0.02, 0.003, -0.001, 0.0002]},
    },
}


@pytest.mark.parametrize("name", SAME)
def test_the_keys_of_a_pinhole_that_is_offered_show_the_same(name):
    camera = Camera(**SAME[name])
    worth = port_worth(camera, RANGES)
    assert worth.max_px < ALIKE_PX
    alone = camera_model(Camera(**{"resolution": camera.resolution} | worth.pinhole))
    rng = np.random.default_rng(4)
    image = rng.uniform(0.0, 1.0, (400, 2)) * camera.resolution
    rays = camera_model(camera).rays(image)
    points = rays.origin + rng.uniform(0.8, 6.2, (400, 1)) * rays.direction
    assert np.linalg.norm(alone.project(points) - image, axis=-1).max() < ALIKE_PX
    key = "intrinsics" if "intrinsics" in SAME[name] else "focal_mm"
    assert f"a pinhole without port shows the same (0.8 to 6.2 m), with the keys {key}: " in worth.in_words
    assert ("distortion" in worth.pinhole) == ("distortion" in SAME[name] or name == "close glass")


def test_colours_that_part_need_the_port():
    """Each of them alone would not. In the corner by Snell's law alone: the glass is a tenth of a millimetre away."""
    camera = Camera(port=CLOSE, n_water={"temperature_C": 10.0, "salinity": 35.0})
    worth = port_worth(camera, RANGES)
    assert worth.max_px < ALIKE_PX
    assert worth.pinhole is None
    (red, green, blue), f = camera_model(camera).n_water, camera_model(camera).K[0, 0]
    sine = np.sin(np.arctan(np.hypot(639.5, 359.5) / f)) / green
    parted = f * (np.tan(np.arcsin(blue * sine)) - np.tan(np.arcsin(red * sine)))
    assert worth.colours_px == pytest.approx(parted, rel=2e-3)
    assert worth.in_words.endswith(f"; red and blue part by up to {parted:.2g} px")
    assert port_worth(Camera(port=CLOSE, n_water=[1.34] * 3), RANGES).colours_px == 0.0


@pytest.mark.parametrize(
    "lens",
    [
        {"model": "double_sphere", "xi": -0.2, "alpha": 0.59},
        {"model": "rational", "k": [0.41, 0.27, 0.0001, -0.0002, 0.1, 0.45, 0.4, 0.09]},
    ],
)
def test_a_lens_of_another_model_is_judged_by_the_nearest_that_can_be_fitted(lens):
    """Behind a pane by what the pane does, not by what the fitted model lacks, which is less."""
    pane, dome = (
        port_worth(Camera(port=port, distortion=lens, intrinsics=MEASURED), RANGES)
        for port in ({"kind": "flat", "distance_m": 0.02}, CENTRED)
    )
    assert dome.rms_px < 0.1 < pane.rms_px < 10.0


def test_a_lens_that_ends_in_view_needs_the_port():
    """A centred dome before it changes nothing, but a fitted lens would end elsewhere."""
    fisheye = {"model": "kannala_brandt", "k": [-0.4, 0.0, 0.0, 0.0]}
    worth = port_worth(Camera(port=CENTRED, distortion=fisheye), RANGES)
    assert np.isfinite([worth.rms_px, worth.max_px]).all()
    assert worth.pinhole is None
    assert worth.in_words.endswith("; the lens ends within the image, and a fitted one would elsewhere")


def test_a_rim_in_view_needs_the_port():
    """A centred dome cut 20 degrees from the axis: what it shows a pinhole shows too, but nothing beyond."""
    worth = port_worth(Camera(port={"kind": "dome", "radius_m": 0.05, "half_angle_deg": 20.0}), RANGES)
    assert worth.max_px < 1e-9
    assert worth.pinhole is None
    assert worth.in_words.endswith("; a part of the image sees nothing through the port")
    assert port_worth(Camera(port={"kind": "dome", "radius_m": 0.05, "half_angle_deg": 40.0}), RANGES).pinhole


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"f_stop": 2.0, "focus_m": 2.0}, "its depth of field would be another"),
        ({"vignetting": {"kind": "cos4"}}, "its vignetting would be another"),
        ({"port": CENTRED | {"centre": [2e-5, 0.0, 0.0]}}, "with its centre in the middle of the image, 0."),
    ],
)
def test_what_else_a_pinhole_would_show_differently_needs_the_port(more, words):
    """Lens rays behind a dome meet elsewhere; cos^4 is that of the angle in air; the centre has no key."""
    worth = port_worth(Camera(**{"port": CENTRED} | more), RANGES)
    assert worth.max_px < ALIKE_PX
    assert worth.pinhole is None
    assert words in worth.in_words


def test_a_fisheye_behind_a_pane_is_judged_by_the_pixels_that_see():
    worth = port_worth(
        Camera(port={"kind": "flat", "distance_m": 0.02}, focal_mm=1.3, distortion={"model": "kannala_brandt"}), RANGES
    )
    assert 1.0 < worth.rms_px < worth.max_px < 1000.0
    assert worth.pinhole is None
