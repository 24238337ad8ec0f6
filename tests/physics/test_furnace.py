"""Furnaces: uniform light around surfaces of known reflectance (B), and closed spheres that keep all light (A)."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from chance import assert_plausible, two_sided
from physics.rig import Z, agreement, assert_agrees, floor, one_ray_scene, point, radiance, spot, water

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse, Metal
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.materials.lobe import lobe_albedo_table

pytestmark = pytest.mark.subject("surfaces and lights")


def part(mesh, reflectance, smooth=False):
    material = Diffuse(reflectance=np.broadcast_to(reflectance, 3))
    return Part(
        "mesh",
        np.asarray(mesh.vertices, float),
        np.asarray(mesh.faces, np.int32),
        material,
        smooth_angle=np.pi,
        smooth_shading=smooth,
    )


def camera_scene(position=(0, 0, 0), pixels=24, **view):
    view = {"position": position, "resolution": [pixels, pixels], "sensor_mm": [4.0, 4.0], "focal_mm": 3.4} | view
    return Scene(vehicle={"cameras": [view]}, trajectory={"poses": [{"position": [0, 0, 0]}]})


def clear(parts, scene, spp=64, seed=3):
    """Image B."""
    return FrameRenderer(scene, "cpu", parts=parts).render(np.eye(4), outputs="B", spp_b=spp, seed=seed).B


def sphere(radius=1.0, inside_out=False, subdivisions=4, centre=(0, 0, 0)):
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    mesh.apply_translation(centre)
    if inside_out:
        mesh.invert()
    return mesh


def rough_ground(seed=1, n=40, size=10.0):
    """A field of spikes and pits."""
    x, y = np.meshgrid(*2 * [np.linspace(-size, size, n)], indexing="ij")
    z = np.random.default_rng(seed).uniform(-1.0, 1.0, (n, n)) - 1.5
    i = np.arange(n * n).reshape(n, n)[:-1, :-1].ravel()
    faces = np.concatenate([np.column_stack([i, i + n, i + n + 1]), np.column_stack([i, i + n + 1, i + 1])])
    return trimesh.Trimesh(np.column_stack([x.ravel(), y.ravel(), z.ravel()]), faces, process=False)


# ------------------------------------------------------------------------------------------------- B: uniform light


@pytest.mark.parametrize("smooth", [False, True])
def test_white_surfaces_vanish_in_uniform_light(truth, smooth):
    """Reflectance 1 in open geometry: every pixel is 1, however often light bounces; roulette is the only noise."""
    parts = [part(rough_ground(), 1.0, smooth), part(sphere(0.5, centre=(0.3, 3, -0.5)), 1.0, smooth)]
    scene = camera_scene((0, -2, 0.5), rotation_euler_deg=[-20, 0, 0])
    scores = []
    for seed in range(4):
        image = clear(parts, scene, 256, seed)
        error, variance = image.radiance[..., 0].astype(float) - 1, image.stderr[..., 0].astype(float) ** 2
        assert np.mean(variance > 0) > 0.3
        # pixels of which no path met the roulette
        assert np.mean(np.abs(error) < 1e-5) > 0.2
        # of the whole image: in a single pixel too few paths meet the roulette for a normal distribution
        scores.append(error.sum() / np.sqrt(variance.sum()))
        assert abs(error.mean()) < 1e-3
        truth(
            f"mean of the image, reflectance 1, {'smooth' if smooth else 'flat'} normals, seed {seed}",
            source="furnace: radiance 1 everywhere",
            expected=1.0,
            got=1 + error.mean(),
            stderr=np.sqrt(variance.sum()) / variance.size,
        )
    assert_plausible(two_sided(scores))


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("reflectance", [(1.0, 0.5, 0.0), (0.2, 0.2, 0.2)])
def test_a_convex_object_in_uniform_light_has_the_radiance_of_its_reflectance(truth, reflectance, smooth):
    """Exactly: every reflected ray escapes. A ray that met its own surface again would show."""
    box = trimesh.creation.box((2, 2, 2)).apply_translation((0, 3, 0))
    for mesh in (sphere(1.0, centre=(0, 3, 0)), box):
        image = clear([part(mesh, reflectance, smooth)], camera_scene(focal_mm=10.0), spp=16)
        where = f"{'smooth' if smooth else 'flat'} {'box' if mesh is box else 'ball'}"
        pixels = image.radiance.reshape(-1, 3).astype(float)
        truth(
            f"{where} of reflectance {reflectance}, all pixels",
            source="furnace: every ray escapes",
            expected=np.float32(reflectance),
            got=pixels,
            tolerance=0.0,
            reason="exact",
        )
        assert np.all(image.stderr == 0.0)


@pytest.mark.parametrize("roughness", [0.3, 1.0])
def test_white_rough_surfaces_vanish_in_uniform_light(roughness):
    """Facets give back all light, to the 5e-4 of a polynomial: on a convex object, and between spikes and pits."""
    white = Diffuse(reflectance=(1, 1, 1), diffuse_roughness=roughness)
    ball = replace(part(sphere(0.5, centre=(0.3, 3, -0.5)), 1.0, smooth=True), material=white)
    spikes = replace(part(rough_ground(), 1.0), material=white)
    scene = camera_scene((0, -2, 0.5), rotation_euler_deg=[-20, 0, 0])
    for parts, spp in (([ball], 64), ([ball, spikes], 256)):
        image = clear(parts, scene, spp)
        error = np.sqrt((image.stderr[..., 0].astype(float) ** 2).sum()) / image.stderr[..., 0].size
        assert abs(image.radiance[..., 0].astype(float).mean() - 1) < 1e-3 + Z * error
        assert error < 0.004


@pytest.mark.parametrize("roughness", [0.1, 0.4, 0.9])
def test_white_metal_vanishes_in_uniform_light(roughness):
    """Its lobe gives back all light (to the 0.6 % of its table), on a convex object and between spikes and pits."""
    white = Metal(kind="metal", base=(1, 1, 1), roughness=roughness)
    ball = replace(part(sphere(0.5, centre=(0.3, 3, -0.5)), 1.0, smooth=True), material=white)
    spikes = replace(part(rough_ground(), 1.0), material=white)
    scene = camera_scene((0, -2, 0.5), rotation_euler_deg=[-20, 0, 0])
    for parts, most, spp in (([ball], 0.006, 64), ([ball, spikes], 0.012, 256)):
        image = clear(parts, scene, spp)
        error = np.sqrt((image.stderr[..., 0].astype(float) ** 2).sum()) / image.stderr[..., 0].size
        assert abs(image.radiance[..., 0].astype(float).mean() - 1) < most + Z * error
        assert error < 0.006


def test_direct_light_on_metal_is_the_lobe_times_the_beam(truth):
    """A lamp beside the camera and a slanted plate: GGX, Smith and Fresnel written out in float64."""
    roughness, base, T = 0.5, np.array([0.9, 0.6, 0.3]), 3.0
    lamp = np.array([0.8, 0.3, -0.2])
    plate = replace(floor(T, 0.5), material=Metal(kind="metal", base=tuple(base), roughness=roughness))
    scene = one_ray_scene([point(lamp)], water(0.0, 0.0, 0.0))
    made = radiance(scene, [plate], "direct", spp=4)[0]
    offset, n, v = lamp - [0, 0, T], np.array([0.0, 0, -1]), np.array([0.0, 0, -1])
    distance, alpha = np.linalg.norm(offset), roughness**2
    l = offset / distance
    h = (v + l) / np.linalg.norm(v + l)
    D = alpha**2 / (np.pi * ((n @ h) ** 2 * (alpha**2 - 1) + 1) ** 2)
    Lambda = [(np.sqrt(1 + alpha**2 * (1 - (n @ w) ** 2) / (n @ w) ** 2) - 1) / 2 for w in (v, l)]
    F = base + (1 - base) * (1 - v @ h) ** 5
    E = lobe_albedo_table()[:, -1]
    E = np.interp(roughness, np.linspace(0, 1, len(E)), E)
    once = F * D / (1 + sum(Lambda)) / (4 * (n @ v) * (n @ l))
    expected = once * (1 + base * (1 - E) / E) * (n @ l) / distance**2
    truth(
        "red, green, blue of rough metal",
        source="GGX, Smith and Schlick in float64",
        expected=expected,
        got=made,
        tolerance=1e-4 * expected,
        reason="float32 rounding, and the table of the lobe's albedo",
    )


@pytest.mark.parametrize("reflectance", [0.3, 0.8, 1.0])
def test_a_hemispherical_bowl_has_the_radiance_of_its_closed_form(truth, reflectance):
    """Between any two points of a sphere the form factor is the same, so half a sphere glows evenly: r/(2 - r).

    The mesh is a polyhedron of n = 128 segments: its error is of the order (pi/n)^2.
    """
    n = 128
    theta, phi = np.meshgrid(np.pi / 2 * np.linspace(0, 1, n // 4 + 1), 2 * np.pi * np.arange(n) / n, indexing="ij")
    vertices = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1).reshape(-1, 3)
    i = np.arange(n * n // 4).reshape(-1, n)
    right = np.roll(i, -1, axis=1)
    faces = np.concatenate([np.stack([i, right, i + n], -1), np.stack([right, right + n, i + n], -1)]).reshape(-1, 3)
    bowl = trimesh.Trimesh(vertices, faces)
    image = clear([part(bowl, reflectance)], camera_scene(pixels=48), spp=64)
    expected = reflectance / (2 - reflectance)
    mean = image.radiance[..., 0].mean(dtype=float)
    stderr = np.sqrt((image.stderr[..., 0].astype(float) ** 2).sum()) / 48**2
    assert stderr < 2e-3
    truth(
        f"reflectance {reflectance}",
        source="form factors of a sphere: r/(2 - r)",
        expected=expected,
        got=mean,
        stderr=stderr,
        tolerance=(np.pi / n) ** 2,
        reason="facets: (pi/128)^2",
    )
    # evenly: no place differs
    halves = image.radiance[..., 0].reshape(6, 8, 6, 8).mean(axis=(1, 3), dtype=float)
    errors = np.sqrt((image.stderr[..., 0].astype(float) ** 2).reshape(6, 8, 6, 8).sum(axis=(1, 3))) / 64
    assert np.all(np.abs(halves - expected) < Z * errors + 4 * (np.pi / n) ** 2)


def test_a_corner_of_two_squares_sees_what_the_form_factor_says(truth):
    """A black wall beside a floor: at distance a from its foot the floor loses (1 - a/sqrt(a^2 + h^2))/2 of light."""
    a, h = 0.5, 1.0
    long = 20.0
    ground = Part(
        "ground",
        np.array([[0, -long, 0], [long, -long, 0], [long, long, 0], [0, long, 0.0]]),
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        Diffuse(reflectance=(0.5,) * 3),
    )
    wall = Part(
        "wall",
        np.array([[0, -long, 0], [0, long, 0], [0, long, h], [0, -long, h]]),
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        Diffuse(reflectance=(0.0,) * 3),
    )
    scene = camera_scene((a, 0, 2.0), pixels=16, look_at=(a, 0, 0), sensor_mm=(1e-3, 1e-3), focal_mm=100.0)
    image = clear([ground, wall], scene, spp=256)
    mean = image.radiance[..., 0].mean(dtype=float)
    stderr = np.sqrt((image.stderr[..., 0].astype(float) ** 2).sum()) / 256
    truth(
        "floor of reflectance 0.5, 0.5 m from a black wall 1 m high",
        source="(1 - a/sqrt(a^2 + h^2))/2 is lost",
        expected=0.5 * (1 - 0.5 * (1 - a / np.hypot(a, h))),
        got=mean,
        stderr=stderr,
        tolerance=2.5e-5,
        reason="ends of the wall, 20 m away: 7e-6, and rays that start 0.16 mm above the floor: 1.5e-5",
    )
    assert stderr < 1e-3


def test_a_closed_box_is_dark_and_the_open_sky_is_1():
    box = trimesh.creation.box((4, 4, 4))
    assert np.all(clear([part(box, 0.9)], camera_scene(pixels=8), spp=16).radiance == 0.0)
    assert np.all(clear([], camera_scene(pixels=8)).radiance == 1.0)
    assert np.all(clear([part(sphere(centre=(0, -5, 0)), 0.5)], camera_scene(pixels=8)).radiance == 1.0)


# -------------------------------------------------------------------------------------------------------- A: spheres


def at_the_wall(lights, coefficients, gap=1e-3, radius=1.0):
    """One ray that looks at a sphere's wall from ``gap`` in front of it."""
    return one_ray_scene(lights, coefficients, position=[0, radius - gap, 0], look_at=None)


SPHERE = {"subdivisions": 5, "inside_out": True}
FACETS = 2e-3
"""Relative error of an icosphere of 20 480 faces as a sphere: of the order of (edge/radius)^2 = 0.035^2."""


@pytest.mark.parametrize("reflectance", [0.5, 0.9])
def test_an_integrating_sphere_sums_the_geometric_series(truth, reflectance):
    """A lamp of 1 W/sr in the middle, no water: the walls' irradiance is E r^n after n bounces, alike everywhere."""
    scene, wall = at_the_wall([point((0, 0, 0))], None), [part(sphere(**SPHERE), reflectance)]
    first, facets = reflectance / np.pi, {"tolerance": FACETS, "reason": "facets of the sphere, 0.2 %"}
    assert_agrees(radiance(scene, wall, "direct", spp=16), first, FACETS / Z * first)
    for bounces in (2, 3, None):
        expected = first * sum(reflectance**n for n in range(1, bounces or 1000))
        estimate = radiance(scene, wall, "multiple", spp=16 if bounces else 128, max_bounces=bounces)
        truth(
            f"reflectance {reflectance}, {bounces or 'all'} bounces",
            source="geometric series",
            **agreement(estimate, expected, **facets),
        )
    assert np.all(radiance(scene, wall, spp=2, max_bounces=0)[0] == 0.0)


@pytest.mark.parametrize(
    ("g", "sigma_s", "reflectance", "spp"),
    [(0.0, 1.0, 0.3, 64), (0.0, 1.0, 0.7, 96), (0.8, 1.0, 0.3, 128), (-0.6, 1.0, 0.3, 256), (0.5, 2.0, 0.3, 256)],
)
def test_water_that_absorbs_nothing_loses_no_light(truth, g, sigma_s, reflectance, spp):
    """All that a lamp in mid-sphere sends out ends in its wall, whatever the water is like.

    So the irradiance of the wall is 4 pi I / (4 pi R^2 (1 - r)) everywhere, and next to it one sees r E/pi.
    """
    scene = at_the_wall([point((0, 0, 0))], water(sigma_s, sigma_s, g), gap=2e-4)
    estimate = radiance(scene, [part(sphere(**SPHERE), reflectance)], spp=spp)
    truth(
        f"sphere of reflectance {reflectance} full of water, sigma_s = {sigma_s}, g = {g}",
        source="energy is conserved: rI/(1 - r)/pi",
        subject="multiple scattering",
        **agreement(
            estimate,
            reflectance / np.pi / (1 - reflectance),
            precision=0.02,
            tolerance=FACETS + 2e-4 * sigma_s * 2,
            reason="facets of the sphere, 0.2 %, gap to the wall",
        ),
    )


@pytest.mark.parametrize(
    "phase",
    [{"g": 0.0}, {"g": 0.9}, {"kind": "fournier_forand", "backscatter_fraction": 0.0183}],
    ids=["isotropic", "g 0.9", "Fournier-Forand"],
)
def test_the_field_loses_no_light_in_a_closed_sphere(truth, phase):
    """The same with the field of open water, all of which beyond the wall has to be taken away again."""
    reflectance = 0.3
    coefficients = {"sigma_s": [1.0] * 3, "sigma_a": [0.0] * 3, "phase": phase}
    scene = at_the_wall([point((0, 0, 0))], coefficients, gap=2e-4)
    estimate = radiance(scene, [part(sphere(**SPHERE), reflectance)], integrator="field", spp=256)
    truth(
        f"sphere of reflectance {reflectance} full of water, sigma_s = 1, {phase}, with the field",
        source="energy is conserved: rI/(1 - r)/pi",
        subject="multiple scattering",
        **agreement(
            estimate,
            reflectance / np.pi / (1 - reflectance),
            precision=0.002,
            tolerance=FACETS + 4e-4 + 2e-3,
            reason="facets of the sphere, 0.2 %, gap to the wall, the field's 0.2 %",
        ),
    )


def test_an_aimed_lamp_off_the_middle_of_a_sphere_fills_it_evenly_after_the_first_bounce(truth):
    """Light reflected by a sphere's wall lands evenly: beyond the spot the wall has E = flux r/((1 - r) 4 pi R^2)."""
    reflectance, cone = 0.6, 40.0
    flux = 2 * np.pi * (1 - np.cos(np.radians(cone / 2)))
    lamp = spot((0.2, 0.3, -0.1), axis=(0.1, 0.2, -1), cone_deg=cone)
    estimate = radiance(at_the_wall([lamp], None), [part(sphere(**SPHERE), reflectance)], spp=256)
    expected = reflectance / np.pi * flux / (4 * np.pi) * reflectance / (1 - reflectance)
    truth(
        "cone of 40 degrees, reflectance 0.6",
        source="flux 2 pi (1 - cos) I, geometric series",
        **agreement(estimate, expected, tolerance=FACETS, reason="facets of the sphere, 0.2 %"),
    )


# ------------------------------------------------------------------------------------------------------------ no lamps


@pytest.mark.parametrize("coefficients", [None, water(0.1, 0.2, 0.8)])
def test_without_lamps_it_is_dark_with_certainty(coefficients):
    renderer = FrameRenderer(one_ray_scene([], coefficients), "cpu", parts=[floor(2.0, 0.5)])
    image = renderer.render(np.eye(4), outputs="A").A
    assert np.all(image.radiance == 0.0)
    assert np.all(image.stderr == 0.0)
    assert set(image.layers) == {"direct", "single", "multiple"}


def test_a_lamp_of_no_intensity_is_dark_and_finite():
    scene = one_ray_scene([point((0.1, 0, 0), 0.0)], water(0.1, 0.2, 0.8))
    mean, stderr = radiance(scene, [floor(2.0, 0.5)], spp=8)
    assert np.all(mean == 0.0)
    assert np.all(stderr == 0.0)
