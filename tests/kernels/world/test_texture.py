"""Materials at a point: between 0 and 1, the same each time, different where they should be, blurred far away."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from chance import run

from varos_warp.kernels.spec import SceneSpec
from varos_warp.kernels.world import texture
from varos_warp.scene.description.world import Diffuse, Dirt, Metal, Rust, SlopeBlend
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.parts import Part, Skin
from varos_warp.scene.materials.records import device_material
from varos_warp.scene.materials.textures import Textures

SQUARE = 25.0 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]], np.int32)
UP, SIDE = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
material_at = texture.make_material_at(SceneSpec())


@wp.kernel(enable_backward=False)
def colour(
    material: texture.Material,
    p: wp.array(dtype=wp.vec3),
    n: wp.array(dtype=wp.vec3),
    footprint: float,
    out: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    surface = material_at(material, p[i], n[i], wp.vec3(0.0), 0, footprint)
    out[i] = surface.reflectance + surface.specular


@cache
def scene(seed):
    camera = {"resolution": [320, 180]}
    return scene_from_dict(
        {"seed": seed, "vehicle": {"cameras": [camera]}, "trajectory": {"poses": [{"position": [0, 0, 0]}]}}, "."
    )


@cache
def textures():
    return Textures(scene(1), "cpu")


def reflectance(
    material, p, n=UP, seed=1, origin=(0.0, 0.0, 0.0), local_origin=(0.0, 0.0, 0.0), at=(0.0, 0.0, 0.0), footprint=0.0
):
    """At points ``p`` [N, 3] of the device's world, whose origin is at ``local_origin``; ``at`` is the square's."""
    square = SQUARE[0] + at, SQUARE[1]
    part = Part("x", *square, material, origin)
    record = device_material(part, scene(seed), np.array(local_origin), textures())
    return run(colour, [record, p, np.broadcast_to(np.asarray(n, float), p.shape).copy(), footprint], [wp.vec3])


def points(extent=25.0, n=20000, seed=1):
    return np.random.default_rng(seed).uniform(-extent, extent, (n, 3))


def slope_blend(flat="sand", steep="rock", tiles=50.0):
    textures = {"flat": {"texture": flat, "tiles": tiles}, "steep": {"texture": steep, "tiles": tiles}}
    return SlopeBlend(kind="slope_blend", **textures)


def rust(**values):
    return Rust(kind="rust", **values)


def dirt(**values):
    return Dirt(kind="dirt", **values)


MATERIALS = {
    "sand and rock": slope_blend(),
    "wide tiles": slope_blend("rock", "sand", 15),
    "very fine tiles": slope_blend(tiles=1e5),
    "rust": rust(),
    "bare metal": rust(amount=0.0),
    "all rust": rust(amount=1.0),
    "white metal": rust(base=(1, 1, 1)),
    "black metal": rust(base=(0, 0, 0)),
    "dirt": dirt(),
    "white dirt": dirt(silt=(1, 1, 1), amount=1.0),
    "metal": Metal(kind="metal", base=(1, 1, 1)),
    "white": Diffuse(reflectance=(1, 1, 1)),
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
    p, sand, rock = points(), slope_blend("sand", "sand"), slope_blend("rock", "rock")
    level, steep = reflectance(slope_blend(), p, UP), reflectance(slope_blend(), p, SIDE)
    assert np.array_equal(level, reflectance(sand, p, UP))
    assert level.mean() > 1.2 * steep.mean()
    assert steep.mean(axis=0) == pytest.approx(reflectance(rock, p, SIDE).mean(axis=0), rel=0.02)
    assert np.array_equal(level, reflectance(slope_blend(), p, (0.0, 0.0, -1.0)))


def test_the_edge_between_sand_and_rock_is_ragged():
    """On a uniform slope at the threshold there is some of both, in patches wider than a grain."""
    tilt = np.radians(34.0)
    n = (np.sin(tilt), 0.0, np.cos(tilt))
    x = np.linspace(-5, 5, 4000)
    p = np.column_stack([x * np.cos(tilt), np.full_like(x, 0.3), -x * np.sin(tilt)])
    both, sand, rock = (
        reflectance(m, p, n)[:, 0] for m in (slope_blend(), slope_blend("sand", "sand"), slope_blend("rock", "rock"))
    )
    nearer_sand = np.abs(both - sand) < 1e-6
    assert 0.05 < nearer_sand.mean() < 0.95
    assert 4 < np.count_nonzero(np.diff(nearer_sand.astype(int))) < 400
    assert rock.std() > 0.0


@pytest.mark.parametrize(("make", "bare"), [(rust, 0.47), (dirt, 0.47)])
def test_the_amount_is_the_share_of_the_surface_that_is_covered(make, bare):
    p, amounts = points(5.0), (0.0, 0.25, 0.5, 0.75, 1.0)
    n = np.random.default_rng(3).standard_normal(p.shape)  # dirt lies on what looks up: over a sphere
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    covered = [np.mean(np.abs(reflectance(make(amount=amount), p, n)[:, 2] - bare) > 0.1) for amount in amounts]
    assert covered == pytest.approx(amounts, abs=0.07)
    assert np.all(np.diff(covered) > 0)


@pytest.mark.parametrize("make", [rust, dirt])
def test_no_two_places_and_no_two_seeds_rust_or_silt_up_alike(make):
    p = points(1.0)
    one = reflectance(make(), p)
    assert np.array_equal(one, reflectance(make(), p))
    for other in (reflectance(make(), p, origin=(1.0, 0.0, 0.0)), reflectance(make(), p, seed=2)):
        assert abs(np.corrcoef(one[:, 0], other[:, 0])[0, 1]) < 0.1


def test_silt_lies_on_what_looks_up():
    p = points(1.0)
    bare = [np.mean(np.abs(reflectance(dirt(), p, (0.0, 0.0, z))[:, 2] - 0.47) < 0.05) for z in (1.0, -1.0)]
    assert bare[0] < 0.2
    assert bare[1] > 0.8


@pytest.mark.parametrize("name", ["sand and rock", "rust", "dirt"])
def test_what_is_far_away_is_the_mean_of_what_is_near(name):
    """Within 5 %: patterns are averaged before colours are made of them."""
    p = points()
    near, far = reflectance(MATERIALS[name], p, footprint=1e-3), reflectance(MATERIALS[name], p, footprint=3.0)
    assert far.mean(axis=0) == pytest.approx(near.mean(axis=0), rel=0.05)
    assert np.all(far.std(axis=0) < 0.15 * near.std(axis=0))


@pytest.mark.parametrize("make", [rust, dirt])
@pytest.mark.parametrize("amount", [0.2, 0.5, 0.8])
def test_the_share_that_is_covered_does_not_depend_on_the_footprint(make, amount):
    """Also where the noise fades out and its mean takes over (6 patches a metre): within 0.05 of blue's range."""
    p = points(5.0)
    n = np.random.default_rng(3).standard_normal(p.shape)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    blue = [
        reflectance(make(amount=amount), p, n, footprint=f / 6.0)[:, 2].mean()
        for f in (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.75, 1.0, 2.0)
    ]
    assert np.ptp(blue) < 0.05 * 0.47


def test_patterns_keep_their_fineness_at_a_million_metres():
    p, far = points(25.0), np.array([1.0e6, -1.0e6, 0.0])
    here = reflectance(slope_blend(), p)
    # the same object there: its own coordinates, and a local origin beside it
    there = reflectance(slope_blend(), p, at=far, local_origin=far)
    assert np.array_equal(here, there)


@wp.kernel(enable_backward=False)
def lobe(
    material: texture.Material,
    p: wp.array(dtype=wp.vec3),
    diffuse: wp.array(dtype=wp.vec3),
    specular: wp.array(dtype=wp.vec3),
    roughness: wp.array(dtype=float),
):
    i = wp.tid()
    surface = material_at(material, p[i], wp.vec3(0.0, 0.0, 1.0), wp.vec3(0.0), 0, 0.001)
    diffuse[i] = surface.reflectance
    specular[i] = surface.specular
    roughness[i] = surface.roughness


def surfaces(material, p):
    record = device_material(Part("x", *SQUARE, material), scene(1), np.zeros(3), textures())
    return run(lobe, [record, p], [wp.vec3, wp.vec3, float])


def test_metal_mirrors_and_only_bare_metal_does():
    p, base = points(1.0), np.float32([0.45, 0.45, 0.47])
    diffuse, specular, roughness = surfaces(Metal(kind="metal", base=(0.45, 0.45, 0.47), roughness=0.2), p)
    assert np.all(diffuse == 0.0)
    assert np.all(specular == base)
    assert np.all(roughness == np.float32(0.2))
    diffuse, specular, _ = surfaces(rust(), p)  # over paint
    assert np.all(specular == 0.0)
    bare, rusty, metal = surfaces(rust(roughness=0.4), p)
    share = rusty / base
    assert np.all((share >= 0.0) & (share <= 1.0))
    assert 0.2 < share.mean() < 0.8
    assert np.all(bare[share[:, 0] == 1.0] == 0.0)
    assert np.all(metal == np.float32(0.4))
    np.testing.assert_allclose(diffuse, bare + rusty, atol=1e-6)


def compiled_for(**present):
    """The kernel `lobe` of what a scene needs that has no more than this."""
    material_at_less = texture.make_material_at(SceneSpec(**present))

    @wp.kernel(enable_backward=False, module="unique")
    def lobe_of_less(
        material: texture.Material,
        p: wp.array(dtype=wp.vec3),
        at: wp.vec3,
        diffuse: wp.array(dtype=wp.vec3),
        specular: wp.array(dtype=wp.vec3),
        roughness: wp.array(dtype=float),
    ):
        i = wp.tid()
        surface = material_at_less(material, p[i], wp.vec3(0.0, 0.0, 1.0), at, 0, 0.001)
        diffuse[i] = surface.reflectance
        specular[i] = surface.specular
        roughness[i] = surface.roughness

    return lobe_of_less


COLOURS = Skin(np.full((2, 3, 3), 0.4, np.float32))
LESS = {
    "colours": (Part("x", *SQUARE, Diffuse(), skin=COLOURS), {"patterns": False, "metals": False}),
    "plain": (Part("x", *SQUARE, Diffuse(reflectance=(0.1, 0.2, 0.3))), {"patterns": False, "metals": False}),
    "metal": (Part("x", *SQUARE, Metal(kind="metal", roughness=0.3)), {"patterns": False}),
    "painted": (Part("x", *SQUARE, Rust(kind="rust", roughness=None)), {"metals": False}),
    "ground": (Part("x", *SQUARE, slope_blend()), {"metals": False}),
}


@pytest.mark.parametrize("name", LESS)
def test_kernels_for_what_a_scene_has_find_the_same_bytes(name):
    part, present = LESS[name]
    record, p, at = device_material(part, scene(1), np.zeros(3), textures()), points(1.0), wp.vec3(0.1, 0.5, 0.7)
    results = [run(compiled_for(**some), [record, p, at], [wp.vec3, wp.vec3, float]) for some in ({}, present)]
    for whole, less in zip(*results, strict=True):
        assert whole.tobytes() == less.tobytes()
    assert results[0][0].any() or results[0][1].any()
