"""Where light transport breaks elsewhere: coordinates of maps, lamps in the view, extremes of water, tiny and huge."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh
from physics.rig import (
    VAROS_LAMPS,
    VAROS_WATER,
    assert_agrees,
    floor,
    one_ray_scene,
    point,
    radiance,
    single_scattering,
    spot,
    water,
)

from varos_warp.errors import InputError
from varos_warp.render.renderer import LAYERS, FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse, Rust, SlopeBlend
from varos_warp.scene.frames import look_at_matrix, transform
from varos_warp.scene.geometry.parts import Part

PAPER_WATER = VAROS_WATER | {"phase": {"g": 0.8}}
GREY = Diffuse(reflectance=(0.5, 0.5, 0.5))


def part(mesh, material=GREY, offset=(0, 0, 0), name="mesh"):
    return Part(name, np.asarray(mesh.vertices, float) + offset, np.asarray(mesh.faces, np.int32), material)


def box(extents, centre, **how):
    return part(trimesh.creation.box(extents).apply_translation(centre), **how)


def ground(half=100.0, height=0.0, **how):
    """A square of two triangles."""
    corners = half * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + [0, 0, height]
    return part(trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]]), **how)


def scene_of(lights, coefficients, position=(0.0, 0.0, 0.0), resolution=(24, 16), **view):
    """A vehicle at ``position``; lamps in its axes."""
    view = {"id": "M0", "resolution": resolution, "sensor_mm": [6.0, 4.0], "focal_mm": 4.0} | view
    return Scene(
        water="none" if coefficients is None else {"coefficients": coefficients},
        vehicle={"lights": lights, "cameras": [view]},
        trajectory={"poses": [{"position": position}]},
        render={"integrator": "path"},
    )


def image_of(scene, parts=(), pose=None, **how):
    """Image A."""
    pose = transform(None, scene.trajectory.poses[0].position) if pose is None else pose
    return FrameRenderer(scene, "cpu", parts=list(parts)).render(pose, outputs="A", **{"spp": 16, "seed": 5} | how).A


def assert_finite(image):
    """Radiance, its error and every layer are numbers, none of them negative but for what a correction takes away."""
    signed = ("radiance", "single", "multiple") if image.correction is not None and image.correction.min() < 0.0 else ()
    for name, values in {"radiance": image.radiance, "stderr": image.stderr, **image.layers}.items():
        bad = np.count_nonzero(~np.isfinite(values))
        assert bad == 0, f"{name}: {bad} of {values.size} not finite"
        assert name in signed or values.min() >= 0.0, name
    if signed:
        rounding = 1e-6 * np.maximum(np.abs(image.radiance), np.abs(image.correction))
        assert np.all(image.radiance - image.correction >= -rounding)


# ------------------------------------------------------------------------------------------------ far from the origin

MAPS = [(1e6, 1e6, 0.0), (500_000.0, 6_700_000.0, -120.0), (-1e6, 0.0, 1e6)]


@cache
def world_at(offset, with_ground):
    """A seabed with boxes, textured; or open water."""
    parts = []
    if with_ground:
        sand = SlopeBlend(kind="slope_blend")
        parts = [
            ground(20.0, -2.0, material=sand, offset=offset),
            box((0.5, 0.5, 1.0), (0.4, 3.0, -1.5), material=Rust(kind="rust"), offset=offset),
            box((0.3, 0.3, 0.3), (-0.7, 2.5, -1.9), offset=offset),
        ]
    lamps = [spot((-0.15, 0, -0.1), blend=0.15), spot((0.15, 0, -0.1))]
    scene = scene_of(lamps, PAPER_WATER, offset, f_stop=1.7, rotation_euler_deg=(-25, 0, 0))
    return FrameRenderer(scene, "cpu", parts=parts).render(transform(None, offset), spp=32, seed=3)


@pytest.mark.parametrize("with_ground", [True, False])
@pytest.mark.parametrize("offset", MAPS)
def test_the_image_does_not_depend_on_where_on_the_map_it_is(offset, with_ground):
    """The same random numbers and, but for the rounding of a metre 1e6 m away (1e-10 m), the same numbers throughout.

    A path that just misses an edge may go another way: a few pixels differ, by no more than their noise.
    """
    here, there = world_at((0.0, 0.0, 0.0), with_ground), world_at(offset, with_ground)
    assert_finite(there.A)
    for name in LAYERS:
        off = np.abs(there.A.layers[name].astype(float) - here.A.layers[name])
        assert np.mean(off > 1e-4 * here.A.layers[name]) < 0.05, name
    assert np.mean(np.abs(there.B.radiance - here.B.radiance.astype(float)) > 1e-4 * here.B.radiance) < 0.05
    for far, near in ((there.A, here.A), (there.B, here.B)):
        noise = np.sqrt((near.stderr.astype(float) ** 2).sum(axis=(0, 1))) / near.stderr[..., 0].size
        assert np.all(np.abs((far.radiance - near.radiance.astype(float)).mean(axis=(0, 1))) <= noise)
    np.testing.assert_allclose(there.C.normal, here.C.normal, atol=1e-5)
    np.testing.assert_allclose(there.D.depth, here.D.depth, rtol=1e-6)
    np.testing.assert_allclose(there.D.range, here.D.range, rtol=1e-6)


@pytest.mark.parametrize("terrain_at", [None, (4000.0, 3000.0, -50.0)])
def test_single_scattering_far_from_the_origin_is_the_quadrature(terrain_at):
    """Lamp 1 mm beside the ray, at UTM coordinates, at the edge of kilometres of terrain: the first to lose digits."""
    lamp, offset = (1e-3, 0.0, 1.0), np.array(MAPS[1])
    scene = one_ray_scene([point(lamp)], water(0.02, 0.06, 0.8)).model_dump()
    scene["trajectory"]["poses"][0]["position"] = tuple(offset)
    scene = Scene(**scene)
    parts = [part(trimesh.Trimesh(*_plate(5.0)), Diffuse(reflectance=(0, 0, 0)), offset)]
    if terrain_at is not None:
        parts.append(ground(100.0, offset=offset + terrain_at))
    image = image_of(scene, parts, layers=("single",), spp=1024, integrator="path")
    mean = image.radiance.reshape(-1, 3).mean(axis=0, dtype=float)
    stderr = np.sqrt((image.stderr.astype(float) ** 2).sum(axis=(0, 1))) / 256
    assert_agrees((mean, stderr), single_scattering(lamp, 0.02, 0.06, 0.8, 5.0))


def _plate(distance):
    return floor(distance, 0.0, 10.0).vertices, floor(distance, 0.0).faces


# ------------------------------------------------------------------------------------------------ lamps next to the ray


@pytest.mark.parametrize("side", [1e-3, 1e-4])
@pytest.mark.parametrize("g", [0.0, 0.8, 0.99, -0.99])
@pytest.mark.parametrize("ahead", [2.0, -1e-3])
def test_a_lamp_next_to_the_ray(side, g, ahead):
    """In view, or beside the lens. The forward peak of g = 0.99 is met over millimetres there.

    The floor's middle is the local origin: 5 m from it a position is known to 2.4e-7 m, here seen from the lamp. In a
    backward peak 1 - cos is near 2, known to 1.2e-7, and the phase function a power -1.5 of (1 + g)^2 beside it.
    """
    lamp = (side, 0.0, ahead)
    scene = one_ray_scene([point(lamp)], water(0.04, 0.06, g))
    truth = single_scattering(lamp, 0.04, 0.06, g, 5.0)
    peak = 1.5 * 1.2e-7 / (1.0 + g) ** 2 if g < 0.0 else 0.0
    rounding = (2.4e-7 / np.hypot(side, min(ahead, 0.0)) + peak) * truth
    assert_agrees(radiance(scene, [floor(5.0, 0.0)], "single", spp=512), truth, rounding, precision=0.02)


@pytest.mark.parametrize("lamp", [(0, 0, 1.0), (0, 0, 0), (0, 0, -1.0), (1e-7, 0, 2.0), (0, 0, 5.0)])
@pytest.mark.parametrize("kind", [point, spot])
def test_a_lamp_on_the_ray_gives_numbers(lamp, kind):
    """The truth is infinite for a point on the ray; an image of it must still be one. Also on the floor, at the eye."""
    image = image_of(one_ray_scene([kind(lamp)], PAPER_WATER, pixels=8), [floor(5.0, 0.3)], spp=64)
    assert_finite(image)
    if kind is point or lamp[2] < 5.0:  # a spot on the floor shines into it
        assert image.radiance.max() > 0.0


@pytest.mark.parametrize("kind", [point, spot])
def test_a_lamp_at_the_camera_lights_the_floor_as_the_inverse_square_says(kind):
    estimate = radiance(one_ray_scene([kind((0, 0, 0))], PAPER_WATER), [floor(5.0, 0.3)], "direct")
    sigma_t = np.array(VAROS_WATER["sigma_s"]) + VAROS_WATER["sigma_a"]
    assert_agrees(estimate, 0.3 / np.pi / 25 * np.exp(-10 * sigma_t))


@cache
def all_around(start):
    """Single scattering of a lamp without a cone."""
    return single_scattering(start, 0.04, 0.06, 0.5, 5.0)


@pytest.mark.parametrize("off", [0.0, 1e-6, -1e-6, 1e-3, -1e-3])
@pytest.mark.parametrize("cone_deg", [20.0, 65.0, 120.0])
@pytest.mark.parametrize("start", [(0.15, 0.0, -0.5), (-0.15, 0.0, 2.5), (0.15, 0.0, 2.5), (-1e-3, 0.0, -0.5)])
def test_a_ray_along_the_edge_of_a_cone(off, cone_deg, start):
    """Parallel to a generator, on either side of it. The quadrature's pieces end up to one piece off the edge."""
    tilt = np.radians(cone_deg) / 2 + off
    axis = (np.sin(tilt), 0.0, np.cos(tilt))
    truth = single_scattering(start, 0.04, 0.06, 0.5, 5.0, axis, cone_deg, breaks=1000)
    scene = one_ray_scene([spot(start, axis, cone_deg)], water(0.04, 0.06, 0.5))
    mean, stderr = radiance(scene, [floor(5.0, 0.0)], "single", spp=64)
    whole = all_around(start)
    assert np.all(np.abs(mean - truth) <= 4 * stderr + 2e-3 * whole)
    assert np.all(stderr < 0.01 * whole)


# ---------------------------------------------------------------------------------------------------- extreme water


@pytest.mark.parametrize("sigma", [1e-7, 0.04, 20.0])
@pytest.mark.parametrize("g", [0.0, 0.99, -0.99])
@pytest.mark.parametrize("lamp", [(0.15, 0.0, -0.1), (0.05, 0.0, 0.3)])
def test_single_scattering_in_water_of_albedo_1(sigma, g, lamp):
    truth = single_scattering(lamp, sigma, sigma, g, 5.0)
    scene = one_ray_scene([point(lamp)], water(sigma, sigma, g))
    assert_agrees(radiance(scene, [floor(5.0, 0.0)], "single", spp=256), truth, precision=0.03)


@pytest.mark.parametrize("g", [0.0, 0.99, -0.99])
@pytest.mark.parametrize("sigma_s", [(1e-7, 0.04, 20.0), (0.0, 1e-7, 1e-3), (20.0, 20.0, 20.0), (0.0, 0.0, 20.0)])
@pytest.mark.parametrize("with_ground", [True, False])
def test_all_orders_are_numbers_in_any_water(sigma_s, g, with_ground):
    """Albedo 1, thin and thick channels in one path; and with red that only absorbs."""
    parts = [ground(50.0, -1.0), box((0.3, 0.3, 0.3), (0, 2, -0.8), material=Diffuse(reflectance=(1, 1, 1)))]
    for sigma_a in ((0.0, 0.0, 0.0), (20.0, 0.0, 1e-7)):
        medium = {"sigma_s": sigma_s, "sigma_a": sigma_a, "phase": {"g": g}}
        assert_finite(image_of(scene_of(VAROS_LAMPS, medium), parts if with_ground else ()))


def test_a_channel_that_does_not_scatter_has_no_light_from_the_water():
    medium = {"sigma_s": (0.0, 0.1, 1.0), "sigma_a": (0.1, 0.1, 0.0), "phase": {"g": 0.8}}
    image = image_of(scene_of(VAROS_LAMPS, medium))
    assert np.all(image.radiance[..., 0] == 0.0)
    assert np.all(image.radiance[..., 1:].mean(axis=(0, 1)) > 0.0)


def test_a_distant_observer_in_thick_water_sees_numbers():
    """Lamps 12 m away at 20/m: what they send here is too little for float32 (exp(-240))."""
    scene = scene_of([point((0, 0, 12.0))], water(15.0, 20.0, 0.8))
    for parts in ((), [ground(50.0, -1.0)]):
        assert_finite(image_of(scene, parts, spp=64))


def test_hardly_any_water_is_like_none():
    """sigma_t = 1e-7/m: the surfaces' light, direct and between them, as without water."""
    parts = [ground(20.0, -1.0), box((1, 1, 1), (0, 3, -0.5))]
    with_water = image_of(scene_of(VAROS_LAMPS, water(1e-7, 1e-7, 0.8)), parts, spp=64)
    without = image_of(scene_of(VAROS_LAMPS, None), parts, spp=64)
    np.testing.assert_allclose(with_water.layers["direct"], without.layers["direct"], rtol=1e-5)
    error = np.sqrt(sum((i.stderr.astype(float) ** 2).sum(axis=(0, 1)) for i in (with_water, without)))
    off = (with_water.radiance - without.radiance.astype(float)).sum(axis=(0, 1))
    assert np.all(np.abs(off) < 4 * error)


# ------------------------------------------------------------------------------------------------------- geometry


def test_open_water_without_any_mesh():
    lamp = (0.15, 0.0, -0.1)
    scene = one_ray_scene([point(lamp)], water(0.1, 0.2, 0.8))
    assert_agrees(radiance(scene, (), "single", spp=256), single_scattering(lamp, 0.1, 0.2, 0.8, np.inf))
    assert_finite(image_of(scene))


def test_a_lamp_inside_a_mesh_is_dark_and_so_is_a_camera_inside_one():
    """Nothing in the layers that reach no farther than the scene does.

    In blue this water absorbs nothing: subpaths come from a kilometre off, and from there rays miss a box by rounding.
    What they bring is less than 1e-20 of the lamp's light.
    """
    around_lamp, around_camera = box((0.2, 0.2, 0.2), (0.5, 0.5, 0.0)), box((0.2, 0.2, 0.2), (0, 0, 0))
    for hull in (around_lamp, around_camera):
        scene = scene_of([point((0.5, 0, 0.5))], PAPER_WATER)
        image = image_of(scene, [hull, ground(20.0, -1.0)], spp=64)
        assert not image.layers["direct"].any()
        assert not image.layers["single"].any()
        assert image.radiance.max() < 1e-20
        assert image.stderr.max() < 1e-20


def test_a_camera_and_its_lamp_inside_one_mesh_see_its_walls():
    image = image_of(scene_of([point((0.1, 0, 0))], PAPER_WATER), [box((2, 2, 2), (0, 0, 0))], spp=64)
    assert_finite(image)
    assert image.layers["direct"].min() > 0.0


def lit_ground(height, distance, parts, lamp_height=None):
    """Direct light on level ground around ``distance`` ahead, over its closed form with the lamp unoccluded."""
    lamp_height = height if lamp_height is None else lamp_height
    eye, target = np.array([0.3, 0.0, height]), np.array([0.3, distance, 0.0])
    pose = transform(look_at_matrix(eye, target), eye)
    lamp_in_vehicle = pose[:3, :3].T @ (np.array([0.5, 0.1, lamp_height]) - eye)
    lamp = {"kind": "point", "position": lamp_in_vehicle.tolist(), "intensity": [1, 1, 1]}
    scene = scene_of([lamp], None, sensor_mm=(0.2, 0.2), focal_mm=20.0, resolution=(24, 24))
    frame = FrameRenderer(scene, "cpu", parts=parts).render(pose, outputs="AD", spp=32, layers=("direct",))
    x, y = np.meshgrid(np.arange(24) + 0.5, np.arange(24) + 0.5)
    ray = np.stack([(x - 12) / 2400, (y - 12) / 2400, np.ones_like(x)], -1)
    world = ray @ (pose[:3, :3] @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])).T
    p = eye + world * (-height / world[..., 2])[..., None]
    offset = np.array([0.5, 0.1, lamp_height]) - p
    truth = 0.5 / np.pi * lamp_height / np.linalg.norm(offset, axis=-1) ** 3
    return frame.A.radiance[..., 0] / truth, frame.D.depth, truth


@pytest.mark.parametrize(
    ("height", "distance", "lamp_height"),
    [(1.0, 2.0, None), (1.0, 30.0, None), (5.0, 60.0, 0.05), (0.05, 0.1, 0.01), (0.3, 0.5, 0.002)],
)
def test_triangles_of_200_m_have_no_shadow_acne(height, distance, lamp_height):
    """Next to boxes of a centimetre, under grazing light, far away and very near: no pixel is darker than the truth."""
    tiny = [box((0.01, 0.01, 0.01), (3.0 + 0.02 * i, 4.0, 0.005)) for i in range(3)]
    ratio, _, truth = lit_ground(height, distance, [ground(100.0), *tiny], lamp_height)
    # within a pixel the truth varies: half of the change to its neighbours, and the noise of 32 samples over it
    spread = np.abs(np.gradient(truth)).sum(axis=0) / truth
    assert np.all(np.abs(ratio - 1) < 1e-4 + 0.75 * spread)
    assert abs(ratio.mean() - 1) < 2e-3


def test_a_tiny_box_on_huge_ground_casts_its_shadow():
    """1 cm on triangles of 200 m, away from the origin: neither lost nor leaking."""
    lamp = {"kind": "point", "position": [0.0, 0.0, 0.0], "intensity": [1, 1, 1]}
    eye = np.array([30.0, 40.0, 0.5])
    scene = scene_of(
        [lamp], None, sensor_mm=(1.0, 1.0), resolution=(48, 48), position=[0.2, 0.0, 0.0], look_at=[0.0, 0.02, -0.5]
    )
    cube = box((0.01, 0.01, 0.01), eye + [0.0, 0.0, -0.495])
    lit = image_of(scene, [ground(100.0)], transform(None, eye), layers=("direct",)).radiance[..., 0]
    shaded = image_of(scene, [ground(100.0), cube], transform(None, eye), layers=("direct",)).radiance[..., 0]
    # lamp 0.5 m straight above a cube of 1 cm: its shadow is hardly wider than itself; what changed is the cube's place
    changed = np.abs(shaded - lit) > 0.02 * lit
    assert 5 < changed.sum() < 120
    assert np.array_equal(shaded[:4], lit[:4])


@pytest.mark.parametrize("half", [0.5, 100.0])
def test_a_closed_hull_of_acute_wedges_leaks_no_light(half):
    """Uniform light outside, a flat tetrahedron around the camera: rays that start near its edges must stay inside."""
    corners = half * np.array([[1.0, 1, 0.2], [-1, -1, 0.2], [-1, 1, -0.2], [1, -1, -0.2]])
    hull = trimesh.Trimesh(corners, [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    scene = scene_of([], None)
    image = FrameRenderer(scene, "cpu", parts=[part(hull)]).render(np.eye(4), outputs="B", spp_b=256).B
    assert image.radiance.mean() < 1e-4


# ------------------------------------------------------------------------------------------------ smallest settings


@pytest.mark.parametrize(
    "lamp",
    [
        {"blend": 0.0},
        {"blend": 1.0},
        {"cone_deg": 360.0},
        {"cone_deg": 180.0},
        {"cone_deg": 360.0, "blend": 1.0},
        {"cone_deg": 1.0, "blend": 1.0},
    ],
)
@pytest.mark.parametrize(("spp", "resolution"), [(1, (1, 1)), (2, (1, 1)), (1, (5, 3)), (3, (1, 40))])
def test_the_smallest_images_are_images(lamp, spp, resolution):
    lamps = [spot((0.15, 0, -0.1), **lamp), spot((-0.15, 0, -0.1), **lamp)]
    scene = scene_of(lamps, PAPER_WATER, resolution=resolution, f_stop=0.0)
    frame = FrameRenderer(scene, "cpu", parts=[ground(20.0, -1.0)]).render(np.eye(4), spp=spp, spp_b=spp)
    for image in (frame.A, frame.B):
        assert image.radiance.shape == image.stderr.shape == (*resolution[::-1], 3)
        assert np.isfinite(image.radiance).all()
        assert not np.isnan(image.stderr).any()
        assert np.isinf(image.stderr).all() if spp == 1 else np.isfinite(image.stderr).all()
    assert frame.C.normal.shape == (*resolution[::-1], 3)
    assert frame.D.depth.shape == frame.D.range.shape == resolution[::-1]


def test_a_spot_of_360_degrees_is_a_point_light():
    """Whatever its blend and axis; virtual lights are spread about the axis, so more reflections differ by noise."""
    parts = [ground(20.0, -1.0)]
    bare = image_of(scene_of([point((0.15, 0, -0.1))], PAPER_WATER), parts)
    whole = image_of(scene_of([spot((0.15, 0, -0.1), (0.3, -1, 0.2), 360.0, 1.0)], PAPER_WATER), parts)
    for layer in ("direct", "single"):
        assert np.array_equal(bare.layers[layer], whole.layers[layer])
    off = (bare.radiance - whole.radiance).mean((0, 1), dtype=float)
    pixels = bare.stderr[..., 0].size
    variance = sum(np.square(image.stderr, dtype=float).sum((0, 1)) for image in (bare, whole)) / pixels**2
    assert np.all(np.abs(off) < 4.0 * np.sqrt(variance))


# ------------------------------------------------------------------------------------------------------------- tables


POST = [ground(20.0, -1.0), box((0.1, 0.1, 2.0), (0.1, 0.6, 0.0))]


@pytest.mark.parametrize("parts", [[], POST[:1], POST])
@pytest.mark.parametrize(("spp", "resolution"), [(1, (1, 1)), (2, (1, 1)), (3, (1, 40)), (4, (24, 16))])
def test_images_with_tables_are_numbers(parts, spp, resolution):
    """Whatever their size, with nothing in the water or a post before the lamps; at a place of a map, too."""
    for offset in ((0.0, 0.0, 0.0), MAPS[1]):
        scene = scene_of(VAROS_LAMPS, PAPER_WATER, offset, resolution)
        moved = [replace(part, vertices=part.vertices + offset) for part in parts]
        image = image_of(scene, moved, spp=spp, integrator="field")
        assert np.isfinite(image.radiance).all()
        # one sample has one subpath, where there are surfaces, and four segments of the camera
        assert np.isinf(image.stderr).all() if spp == 1 and parts else np.isfinite(image.stderr).all()
        assert image.radiance.mean() > 0.0


def test_the_image_with_tables_does_not_depend_on_where_on_the_map_it_is():
    parts = [ground(20.0, -1.0), box((0.1, 0.1, 2.0), (0.1, 1.6, 0.0))]
    here, there = (
        image_of(
            scene_of(VAROS_LAMPS, PAPER_WATER, offset),
            [replace(p, vertices=p.vertices + offset) for p in parts],
            integrator="field",
        ).radiance.astype(float)
        for offset in ((0.0, 0.0, 0.0), MAPS[1])
    )
    assert np.mean(np.abs(there - here) > 1e-3 * here) < 0.05


def test_tables_refuse_what_they_do_not_hold():
    scene = scene_of([spot((0, 0, 0), cone_deg=4.0)], PAPER_WATER)
    with pytest.raises(InputError, match="cone"):
        image_of(scene, integrator="field")
    with pytest.raises(InputError, match="max_scatterings"):
        image_of(scene_of(VAROS_LAMPS, PAPER_WATER), integrator="field", max_scatterings=2)
