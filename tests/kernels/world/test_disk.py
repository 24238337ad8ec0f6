"""Disks: where the points lie that samples see of them."""

import numpy as np
import pytest
import warp as wp
from chance import assert_plausible, rng_array, run, uniform_p

from varos_warp.kernels.sampler import make_sampler
from varos_warp.kernels.sampling import concentric_disk
from varos_warp.kernels.transport.moments import place_of
from varos_warp.kernels.world.lights.disk import sample_point
from varos_warp.kernels.world.lights.record import Light
from varos_warp.scene.description.lights import SpotLight
from varos_warp.scene.lights.records import light_axes

EPS = 1.2e-7
"""Spacing of float32 at 1."""
AXES = light_axes(SpotLight(position=[0, 0, 0], direction=[0.3, 1.0, -0.2], cone_deg=60, intensity=[1, 1, 1]))


@wp.kernel(enable_backward=False)
def points(light: Light, u: wp.array(dtype=wp.vec2), p: wp.array(dtype=wp.vec3), radius: wp.array(dtype=float)):
    i = wp.tid()
    drawn = sample_point(light, u[i])
    p[i] = drawn.position
    radius[i] = drawn.radius


@wp.kernel(enable_backward=False)
def concentric(u: wp.array(dtype=wp.vec2), p: wp.array(dtype=wp.vec2)):
    i = wp.tid()
    p[i] = concentric_disk(u[i])


@wp.kernel(enable_backward=False)
def places(pixel: int, sample: wp.array(dtype=int), u: wp.array(dtype=wp.vec2)):
    i = wp.tid()
    u[i] = place_of(make_sampler(wp.uint32(5), pixel, sample[i]))


def disk(radius, position=(0.0, 0.0, 0.0)):
    light = Light()
    light.radius, light.position = radius, wp.vec3(*position)
    light.right, light.up, light.axis = (wp.vec3(*AXES[:, k].tolist()) for k in range(3))
    return light


def drawn(light, u):
    """Points [N, 3] of a light, float64, and the radius [N] of what is drawn."""
    p, radius = run(points, [light, u], [wp.vec3, float])
    return p.astype(float), radius


def test_points_are_even_over_the_disk():
    """In a circle's area the squared radius and the azimuth are independent and uniform."""
    p = drawn(disk(0.5), rng_array(1, (100_000, 2)))[0] @ AXES
    radius2, azimuth = (p[:, :2] ** 2).sum(axis=1) / 0.5**2, np.arctan2(p[:, 1], p[:, 0]) / (2.0 * np.pi) % 1.0
    assert_plausible(uniform_p(np.column_stack([np.minimum(radius2, 1.0), azimuth]), bins=16))


def test_points_have_the_moments_of_a_disk():
    """The mean of x^2 is r^2 / 4, of x^4 r^4 / 8 and of x^2 y^2 r^4 / 24; midpoints of squares err by their size."""
    middle = (np.arange(512) + 0.5) / 512
    x, y, _ = (drawn(disk(1.0), np.stack(np.meshgrid(middle, middle), -1).reshape(-1, 2))[0] @ AXES).T
    got = [np.mean(x**2), np.mean(y**2), np.mean(x**4), np.mean(x**2 * y**2), np.mean(x), np.mean(y), np.mean(x * y)]
    assert got == pytest.approx([1 / 4, 1 / 4, 1 / 8, 1 / 24, 0.0, 0.0, 0.0], abs=512**-2)


def test_points_lie_across_the_axis_within_the_radius():
    place = np.array([0.3, -0.2, 0.1])
    p = (drawn(disk(0.25, place), rng_array(2, (10_000, 2)))[0] - place) @ AXES
    assert np.abs(p[:, 2]).max() < 4 * EPS
    assert np.linalg.norm(p, axis=1).max() < 0.25 + 4 * EPS


def test_squares_about_the_centre_become_circles():
    """Shirley and Chiu 1997: the angle goes evenly around, 45 degrees to half a side."""
    share = np.linspace(-1.0, 1.0, 9)
    for half_side in (0.25, 1.0):
        right = np.column_stack([np.full(9, half_side), half_side * share])
        for turned, start in ((right, 0.0), (right[:, ::-1], np.pi / 2), (-right, np.pi)):
            angle = start + np.pi / 4 * share * (-1.0 if start == np.pi / 2 else 1.0)
            got = run(concentric, [0.5 * (turned + 1.0)], [wp.vec2])
            assert got == pytest.approx(half_side * np.column_stack([np.cos(angle), np.sin(angle)]), abs=4 * EPS)
    assert not run(concentric, [np.array([[0.5, 0.5]])], [wp.vec2]).any()


def test_what_is_drawn_is_a_point_and_a_point_stays_where_it_is():
    p, radius = drawn(disk(0.0, (0.1, 0.7, -0.3)), rng_array(3, (100, 2)))
    assert (p.astype(np.float32) == np.float32([0.1, 0.7, -0.3])).all()
    assert not radius.any()
    assert not drawn(disk(0.2), rng_array(3, (100, 2)))[1].any()


@pytest.mark.parametrize("half", [0, 1], ids=["even", "odd"])
def test_samples_of_a_pixel_see_points_of_all_parts_of_a_disk(half):
    """Of 256 samples of either half each lies in another of 16 x 16 squares, of 4 x 64 strips, and so on."""
    u = run(places, [7, 2 * np.arange(256, dtype=np.int32) + half], [wp.vec2], dim=256)
    for rows in (1, 4, 16, 64, 256):
        cells = np.floor(u * [rows, 256 / rows]).astype(int)
        assert len({tuple(cell) for cell in cells}) == 256


def test_pixels_see_unlike_points():
    one, other = (run(places, [pixel, np.arange(64, dtype=np.int32)], [wp.vec2], dim=64) for pixel in (0, 1))
    assert not (np.sort(one, axis=0) == np.sort(other, axis=0)).all(axis=1).any()
