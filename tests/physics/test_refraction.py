"""Refraction at ports in closed form: angles, places, viewpoints, the caustic, Fresnel, and the index of sea water."""

import numpy as np
import pytest

from varos_warp.scene.optics.ports import DomePort, FlatPort, refract
from varos_warp.scene.optics.seawater import seawater_index

pytestmark = pytest.mark.subject("camera")
N = 1.333
LENS = np.zeros(3)
THIN = FlatPort((0.0, 0.0, 1.0), 0.05, 0.0, 1.5)
GLASS = FlatPort((0.0, 0.0, 1.0), 0.02, 0.01, 1.5)
EXACT = {"tolerance": 1e-9, "reason": "digits of the truth"}


def along(degrees):
    """Unit vectors at angles to the axis."""
    return np.stack([np.sin(np.radians(degrees)), np.zeros(np.shape(degrees)), np.cos(np.radians(degrees))], -1)


def angle(d):
    """Angles [degrees] to the axis."""
    return np.degrees(np.arctan2(d[..., 0], d[..., 2]))


def viewpoint(ray):
    """Where rays, extended backwards, cross the axis."""
    return ray.origin[..., 2] - ray.origin[..., 0] * ray.direction[..., 2] / ray.direction[..., 0]


def test_rays_behind_a_thin_flat_port(truth):
    ray = THIN.leave(LENS, along(np.array([10.0, 30.0, 33.0])), N)
    truth(
        "angle in water [deg] of 10, 30, 33 degrees in air, n = 1.333",
        source="Snell",
        expected=[7.4851197564, 22.0301087256, 24.1157530299],
        got=angle(ray.direction),
        **EXACT,
    )
    truth(
        "place on the port [m], 50 mm away",
        source="d0 tan",
        got=ray.origin[:, 0],
        expected=[0.00881634903542, 0.0288675134595, 0.0324703796599],
        **EXACT,
    )
    truth(
        "virtual viewpoint z [m]",
        source="d0 - x / tan",
        got=viewpoint(ray),
        expected=[-0.0171014793891, -0.0213416428182, -0.0225349324553],
        **EXACT,
    )
    truth(
        "virtual viewpoint near the axis z [m]",
        source="d0 (1 - n)",
        expected=-0.01665,
        got=viewpoint(THIN.leave(LENS, along(1e-3), N)),
        **EXACT,
    )


def test_the_caustic_of_a_thin_flat_port(truth):
    """The envelope of the rays in the water, by central differences of the angle (error 1e-11 of the derivative)."""
    step = 1e-3
    before, ray, after = (THIN.leave(LENS, along(30.0 + x), N) for x in (-step, 0.0, step))
    slope = [r.direction[0] / r.direction[2] for r in (before, ray, after)]
    z = 0.05 - (after.origin[0] - before.origin[0]) / (slope[2] - slope[0])
    truth(
        "caustic (x, z) [m] at 30 degrees",
        source="dx/dangle = 0 along the envelope",
        expected=[-0.00420713836824, -0.0317389416079],
        got=[ray.origin[0] + (z - 0.05) * slope[1], z],
        **EXACT,
    )


def test_points_seen_through_flat_ports(truth):
    points = np.array([[1, 0, 2], [0.5, 0, 1], [0.1, 0, 0.3]], float)
    truth(
        "angle in air [deg] to (1, 0, 2), (.5, 0, 1), (.1, 0, .3), thin port",
        source="the quartic",
        expected=[36.1890499643, 35.7996703569, 23.4747495838],
        got=angle(THIN.arrive(points, N)),
        **EXACT,
    )
    truth(
        "angle in air [deg] to (1, 0, 2) behind 10 mm of glass",
        source="degree 12",
        expected=36.452365141,
        got=angle(GLASS.arrive(points[0], N)),
        **EXACT,
    )


def test_rays_behind_10_mm_of_glass(truth):
    ray = GLASS.leave(LENS, along(30.0), N)
    truth(
        "place on the outside [m], 30 degrees",
        source="two layers",
        expected=0.0150825392897,
        got=ray.origin[0],
        **EXACT,
    )
    truth("virtual viewpoint z [m]", source="two layers", expected=-0.00727418824311, got=viewpoint(ray), **EXACT)


def test_the_view_through_a_flat_port_is_narrow(truth):
    edge = THIN.leave(LENS, along(90.0 - 1e-6), N)
    truth("largest angle in water [deg]", source="asin 1/n", expected=48.6066263917, got=angle(edge.direction), **EXACT)
    truth(
        "66 degrees of view, in water [deg]",
        source="Snell",
        expected=48.2315060597,
        got=2.0 * angle(THIN.leave(LENS, along(33.0), N).direction),
        **EXACT,
    )
    assert np.isnan(THIN.leave(LENS, along(90.1), N).direction).all()
    assert THIN.leave(LENS, along(90.1), N).transmittance == 0.0


def test_reflection_at_the_water(truth):
    got = [1.0 - refract(along(a), np.array([0.0, 0.0, 1.0]), 1.0, N)[1].mean() for a in (0.0, 30.0, 45.0)]
    truth(
        "reflectance of air to water at 0, 30, 45 degrees",
        source="Fresnel, unpolarised",
        expected=[0.02037318784, 0.02143646586, 0.0278983646],
        got=got,
        **EXACT,
    )
    through = GLASS.leave(LENS, along(0.0), N).transmittance
    # Snell by hand, and Fresnel by sines and tangents of the angles: other forms than the program's
    a, g, w = np.radians(60.0), np.arcsin(np.sin(np.radians(60.0)) / 1.5), np.arcsin(np.sin(np.radians(60.0)) / N)
    s, p = ([1.0 - (f(x - y) / f(x + y)) ** 2 for x, y in ((a, g), (g, w))] for f in (np.sin, np.tan))
    truth(
        "transmittance of a pane of 1.5 to water, at 60 degrees in air",
        source="Fresnel for s and p waves apart",
        expected=0.5 * (s[0] * s[1] + p[0] * p[1]),
        got=GLASS.leave(LENS, along(60.0), N).transmittance,
        **EXACT,
    )
    truth(
        "transmittance of a pane of 1.5 to water, on axis",
        source="4 n1 n2 / (n1 + n2)^2, twice",
        expected=4 * 1.5 / 2.5**2 * 4 * 1.5 * N / (1.5 + N) ** 2,
        got=through,
        **EXACT,
    )


def test_a_lens_in_the_centre_of_a_dome_sees_straight(truth):
    dome = DomePort((0.0, 0.0, 0.0), 0.05, 0.007, 1.473)
    d = along(np.linspace(-80.0, 80.0, 9))
    ray = dome.leave(LENS, d, N)
    truth(
        "directions behind a centred dome of any thickness",
        source="radii are not refracted",
        expected=d,
        got=ray.direction,
        tolerance=1e-12,
        reason="rounding",
    )
    truth(
        "and their places",
        source="radius times direction",
        expected=0.05 * d,
        got=ray.origin,
        tolerance=1e-12,
        reason="rounding",
    )


@pytest.mark.parametrize(("point", "image"), [(np.inf, 0.3003003003), (1.0, 0.214454214025)])
def test_a_dome_shows_the_world_near(truth, point, image):
    """A ray that leaves the lens off its centre towards the virtual image goes on to the point."""
    dome, h = DomePort((0.0, 0.0, 0.0), 0.1, 0.0, 1.5), 1e-6
    aim = np.array([-h, 0.0, 0.1 + image])
    ray = dome.leave(np.array([h, 0.0, 0.0]), aim / np.linalg.norm(aim), N)
    vergence = -ray.direction[0] / ray.direction[2] / ray.origin[0]
    truth(
        f"vergence [1/m] at the vertex of a thin dome of 0.1 m, of an image of a point at {point} m",
        source="n/s - 1/s' = (n - 1)/R",
        expected=1.0 / point,
        got=vergence,
        tolerance=1e-7,
        reason="paraxial to the square of 1e-5",
    )


@pytest.mark.parametrize(("ahead", "expected"), [(0.01, 29.2836493048), (-0.01, 30.7163506952)])
def test_a_lens_off_the_centre_of_a_dome(truth, ahead, expected):
    dome = DomePort((0.0, 0.0, -ahead), 0.1, 0.0, 1.5)
    truth(
        f"angle in water [deg] of 30 degrees, lens {ahead} m before the centre of a thin dome of 0.1 m",
        source="Snell",
        expected=expected,
        got=angle(dome.leave(LENS, along(30.0), N).direction),
        **EXACT,
    )


def test_the_index_of_sea_water(truth):
    nm = np.array([450.0, 550.0, 600.0, 650.0])
    table = {
        (35.0, 10.0): [1.346761, 1.341671, 1.339944, 1.338532],
        (35.0, 20.0): [1.345861, 1.340789, 1.339068, 1.337661],
        (0.0, 20.0): [1.339247, 1.334338, 1.332679, 1.331324],
    }
    for (salinity, temperature), expected in table.items():
        truth(
            f"index at 450, 550, 600, 650 nm, {salinity:g} per mille, {temperature:g} C",
            source="Quan and Fry 1995",
            expected=expected,
            got=seawater_index(temperature, salinity, nm),
            tolerance=5e-7,
            reason="digits of the table",
        )
