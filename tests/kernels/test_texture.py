"""Procedural reflectances: between 0 and 1, the same each time, and different where they should be."""

import numpy as np
import pytest
import warp as wp
from chance import run

from varos_warp.kernels import texture
from varos_warp.scene.description import Diffuse, Rust, SlopeBlend
from varos_warp.scene.geometry import Part
from varos_warp.scene.materials import device_material

SQUARE = 25.0 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]], np.int32)
UP, SIDE = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)


@wp.kernel(enable_backward=False)
def colour(material: texture.Material, p: wp.array(dtype=wp.vec3), n: wp.array(dtype=wp.vec3),
           out: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    out[i] = texture.reflectance(material, p[i], n[i], 0.0)


def reflectance(material, p, n=UP, seed=1, origin=(0.0, 0.0, 0.0), local_origin=(0.0, 0.0, 0.0)):
    """At points ``p`` [N, 3] of the device's world, whose origin is at ``local_origin``."""
    record = device_material(Part("x", *SQUARE, material, origin), seed, np.array(local_origin))
    return run(colour, [record, p, np.broadcast_to(np.asarray(n, float), p.shape).copy()], [wp.vec3])


def points(extent=25.0, n=20000, seed=1):
    return np.random.default_rng(seed).uniform(-extent, extent, (n, 3))


def slope_blend(flat="sand", steep="rock", tiles=50.0):
    textures = {"flat": {"texture": flat, "tiles": tiles}, "steep": {"texture": steep, "tiles": tiles}}
    return SlopeBlend(kind="slope_blend", **textures)


def rust(**values):
    return Rust(kind="rust", **values)


MATERIALS = {
    "sand and rock": slope_blend(), "a single tile": slope_blend("rock", "sand", 1),
    "very fine tiles": slope_blend(tiles=1e5),
    "rust": rust(), "bare metal": rust(amount=0.0), "all rust": rust(amount=1.0), "white metal": rust(base=(1, 1, 1)),
    "black metal": rust(base=(0, 0, 0)), "white": Diffuse(reflectance=(1, 1, 1)),
}


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("extent", [1e-3, 25.0, 5000.0])
def test_reflectance_lies_between_0_and_1(name, extent):
    directions = points(1.0, seed=2)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    c = reflectance(MATERIALS[name], points(extent), directions)
    assert np.all((c >= 0) & (c <= 1))


@pytest.mark.parametrize("name", MATERIALS)
def test_reflectance_is_the_same_each_time_and_in_any_order(name):
    p = points()
    c = reflectance(MATERIALS[name], p)
    assert np.array_equal(c, reflectance(MATERIALS[name], p))
    assert np.array_equal(c[::-1], reflectance(MATERIALS[name], p[::-1].copy()))


@pytest.mark.parametrize("name", ["sand and rock", "rust"])
def test_the_pattern_stays_on_its_surface_wherever_the_local_origin_is(name):
    """Which follows from the trajectory: a change of course must not repaint the seabed."""
    p, moved = points(), np.array([300.0, -20.0, 7.0])
    off = np.abs(reflectance(MATERIALS[name], p) - reflectance(MATERIALS[name], p - moved, local_origin=moved))
    # at 300 m a position is known to 3e-5 m; grains are millimetres wide
    assert np.median(off) < 5e-3
    assert np.mean(off > 0.1) < 0.02


def test_a_diffuse_material_is_its_reflectance():
    assert np.all(reflectance(Diffuse(reflectance=(0.25, 0.5, 0.0)), points()) == np.float32([0.25, 0.5, 0.0]))


@pytest.mark.parametrize("name", ["sand and rock", "rust"])
def test_textures_vary_over_the_surface_without_bleaching_out(name):
    c = reflectance(MATERIALS[name], points())
    assert np.all(c.std(axis=0) > 0.01)
    assert np.all(c.mean(axis=0) < 0.6)
    assert np.all((c == 1.0).mean(axis=0) < 1e-3)


def test_sand_lies_where_the_ground_is_level_and_rock_where_it_is_steep():
    sand_below, p = slope_blend("rock", "sand"), points()
    level, steep = reflectance(slope_blend(), p, UP), reflectance(slope_blend(), p, SIDE)
    assert np.array_equal(level, reflectance(sand_below, p, SIDE))
    assert np.array_equal(steep, reflectance(sand_below, p, UP))
    assert level.mean() > 1.2 * steep.mean()
    assert np.array_equal(level, reflectance(slope_blend(), p, (0.0, 0.0, -1.0)))


def test_more_rust_covers_more_metal():
    p, amounts = points(1.0), (0.0, 0.25, 0.5, 0.75, 1.0)
    metal = [np.mean(np.abs(reflectance(rust(amount=amount), p)[:, 2] - 0.47) < 0.1) for amount in amounts]
    assert metal[0] > 0.95
    assert metal[-1] < 0.05
    assert np.all(np.diff(metal) <= 0)


def test_no_two_places_and_no_two_seeds_rust_alike():
    p = points(1.0)
    one = reflectance(rust(), p)
    assert np.array_equal(one, reflectance(rust(), p))
    for other in (reflectance(rust(), p, origin=(1.0, 0.0, 0.0)), reflectance(rust(), p, seed=2)):
        assert abs(np.corrcoef(one[:, 0], other[:, 0])[0, 1]) < 0.1
