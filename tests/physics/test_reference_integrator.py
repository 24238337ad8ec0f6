"""The reference integrator against closed forms, and the path integrator against the reference.

Free flights find a lamp's neighbourhood by chance, and light there goes as 1/d^2. On a ray that passes beside the lamp
that is bounded. A walk may scatter anywhere, and its light exceeds x with a probability that goes as x^-3/2: it has a
mean but no finite variance, and estimates mostly fall short, at times by several of their standard errors (``SHORT``).
"""

import json
from functools import lru_cache

import numpy as np
import pytest
import trimesh
from chance import assert_plausible
from physics.rig import (
    GREEN,
    VAROS_LAMPS,
    VAROS_WATER,
    Z,
    agreement,
    assert_agrees,
    floor,
    one_ray_scene,
    point,
    spot,
    water,
)
from physics.rig import radiance as any_radiance
from scipy import stats
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError
from varos_warp.render.renderer import LAYERS, FrameRenderer
from varos_warp.scene.description.world import Diffuse, Metal, Nut, Rust
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.assets import make_asset
from varos_warp.scene.geometry.parts import Instances, Part

pytestmark = pytest.mark.subject("multiple scattering")

SHORT = 8.0
"""Standard errors that a right mean of values with a tail of x^-3/2 may fall short by. Of 4000 simulated means of such
Pareto variables in 16 batches, one in a thousand falls short by 7.4, and one in a hundred exceeds by 1.4."""

DIGITS = "two independent quadratures to 15 digits"
PAPER_WATER = VAROS_WATER | {"phase": {"g": 0.8}}


def radiance(scene, parts=(), layer=None, **how):
    return any_radiance(scene, parts, layer, **{"integrator": "reference", "spp": 1024} | how)


def assert_agrees_with_heavy_tail(estimate, expected, expected_stderr=0.0, precision=0.025):
    """As assert_agrees, for light that may have been scattered beside a lamp on a walk; the mean and its error."""
    mean, stderr = estimate
    off, error = mean - expected, np.hypot(stderr, expected_stderr)
    assert np.all(stderr <= precision * expected), f"too noisy to tell: {stderr / expected}"
    assert np.all((off > -SHORT * error) & (off < Z * error)), f"{off / expected}: {off / error} sigma"
    return {"expected": expected, "got": mean, "stderr": error, "sigmas": SHORT}


def sphere(reflectance):
    """A closed room of radius 1, seen from inside."""
    mesh = trimesh.creation.icosphere(subdivisions=5)
    return Part(
        "wall", np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32), Diffuse(reflectance=[reflectance] * 3)
    )


FACETS = 2e-3
"""Relative error of its 20 480 faces as a sphere: of the order of (edge/radius)^2 = 0.035^2."""


def at_the_wall(coefficients, gap):
    """One ray that looks at the sphere's wall from ``gap`` in front of it, and a lamp of 1 W/sr in the middle."""
    return one_ray_scene([point((0, 0, 0))], coefficients, position=[0, 1 - gap, 0], look_at=None)


# --------------------------------------------------------------------------------------------------- light of one event


@pytest.mark.subject("surfaces and lights")
def test_water_that_only_absorbs_obeys_beer_lambert_in_each_channel(truth):
    """A lamp at the camera and a floor at 5 m: 10 m of water, which in red does nothing at all."""
    clear_red = {"sigma_s": [0.0] * 3, "sigma_a": [0.0, 0.057989, 0.125]}
    expected = np.array([1.0, 0.559959958773234, 0.28650479686019]) * 0.25 / (np.pi * 25.0)
    truth(
        "floor seen through 10 m, reference integrator",
        source="exp(-sigma_a t) rho/(pi d^2)",
        **agreement(radiance(one_ray_scene([point((0, 0, 0))], clear_red), [floor(5.0, 0.25)]), expected),
    )


def test_without_water_a_floor_has_the_radiance_of_the_inverse_square_law_and_no_noise():
    mean, stderr = radiance(one_ray_scene([point((3, 0, 0))], None), [floor(4.0, 0.5)], spp=16)
    np.testing.assert_allclose(mean, 0.5 / np.pi * (4 / 5) / 25.0, rtol=2e-5)
    assert np.all(stderr < 1e-6 * mean)


@pytest.mark.parametrize(
    ("position", "sigma_s", "sigma_t", "g", "T", "expected"),
    [
        ((1, 0, 0), 1, 1, 0.0, np.inf, 0.015382720109353),
        ((1, 0, 0), 1, 1, 0.0, 2, 0.0152954359892282),
        ((1, 0, 0), 1, 1, 0.8, np.inf, 0.0018073046013872),
        ((1, 0, 0), 1, 1, 0.8, 2, 0.00180157358033412),
        ((1, 0, 0), 0.5, 0.7, -0.5, 3, 0.0143304877593851),
        ((0.15, 0, -0.1), *GREEN, 0.0, 5, 0.00874058838653483),
        ((0.15, 0, -0.1), *GREEN, 0.8, 5, 0.00061849240331754),
    ],
)
@pytest.mark.subject("single scattering")
def test_the_reference_integrator_scatters_the_light_of_a_lamp_once(truth, position, sigma_s, sigma_t, g, T, expected):
    end = [] if np.isinf(T) else [floor(T, 0.0)]
    estimate = radiance(one_ray_scene([point(position)], water(sigma_s, sigma_t, g)), end, "single", spp=4096)
    truth(
        f"lamp at {position}, sigma_s = {sigma_s}, sigma_t = {sigma_t}, g = {g}, ray up to {T} m",
        source=DIGITS,
        **agreement(estimate, expected),
    )


@pytest.mark.parametrize(
    ("T", "g", "expected"),
    [
        (2, 0.8, (5.19739861055642e-5, 0.000582288048363675, 0.00139849876541647)),
        (10, 0.8, (5.45304161185223e-5, 0.00062519221619206, 0.00151190406588714)),
        (5, 0.0, (0.000838168023095091, 0.00956255858258945, 0.0230789239711541)),
    ],
)
@pytest.mark.subject("single scattering")
def test_the_reference_integrator_scatters_light_of_the_papers_rig_once(truth, T, g, expected):
    """Three channels from one free flight; blue has albedo 1."""
    scene = one_ray_scene(VAROS_LAMPS, VAROS_WATER | {"phase": {"g": g}})
    truth(
        f"red, green, blue; ray up to {T} m, g = {g}",
        source=DIGITS,
        **agreement(radiance(scene, [floor(T, 0.0)], "single", spp=4096), expected),
    )


# ------------------------------------------------------------------------------------------------- light of more events


@pytest.mark.parametrize(
    ("albedo", "first", "second", "total"),
    [
        (0.5, 6.94657213878e-4, 4.419859876407e-4, 1.483289011131e-3),
        (0.9, 1.25038298498e-3, 1.432034599956e-3, 7.294186485738e-3),
    ],
)
def test_the_reference_integrator_has_all_orders_in_an_isotropic_medium(truth, albedo, first, second, total):
    """Case and Zweifel's infinite medium, seen along a ray 1 m from the source (power 1 W: intensity 1/4 pi)."""
    scene = one_ray_scene([point((1, 0, 1), 1 / (4 * np.pi))], water(albedo, 1.0, 0.0))
    source = "Case and Zweifel (1967); light with a heavy tail may fall short by 8 standard errors"
    assert_agrees(radiance(scene, [], "single"), first)
    for order, expected, how in (
        ("scattered twice", second, {"layer": "multiple", "max_scatterings": 2, "spp": 16384}),
        ("all orders", total, {"spp": 8192}),
    ):
        truth(
            f"{order}, albedo {albedo}, ray without end, 1 m from the source",
            source=source,
            **assert_agrees_with_heavy_tail(radiance(scene, [], seed=3, **how), expected),
        )


def test_one_scattering_on_the_way_to_or_from_the_floor():
    """Blue, floor at 10 m, one lamp of the paper's rig; the truth is a Monte Carlo of other samplers, to 0.1 %."""
    scene, expected = one_ray_scene([spot((0.15, 0, -0.1))], PAPER_WATER), 1.21722e-4 + 1.09274e-4
    mean, stderr = radiance(scene, [floor(10, 0.25)], "multiple", max_scatterings=1, max_bounces=1, spp=16384)
    assert_agrees_with_heavy_tail((mean[2], stderr[2]), expected, np.hypot(6e-8, 1e-3 * expected / Z), precision=0.03)


def test_two_floors_exchange_light_like_a_geometric_series():
    """Its first term, for parallel plates of reflectance r at +-D with a lamp midway, by quadrature."""
    r, D = 0.1, 1.0
    plates = [floor(D, r, 300.0), floor(-D, r, 300.0)]
    rho = np.linspace(0.0, 40.0, 400_001)
    form_factor = (2 * D) ** 2 / (np.pi * (rho**2 + 4 * D**2) ** 2)
    second = r * np.trapezoid(D / (D**2 + rho**2) ** 1.5 * form_factor * 2 * np.pi * rho, rho)
    estimate = radiance(one_ray_scene([point((0, 0, 0))], None), plates, "multiple", max_bounces=2)
    assert_agrees(estimate, r / np.pi * second)


@pytest.mark.parametrize(("reflectance", "bounces"), [(0.5, 2), (0.5, 3), (0.9, None)])
def test_an_integrating_sphere_sums_the_geometric_series(reflectance, bounces):
    """No water: the walls' irradiance is r^n after n bounces, alike everywhere."""
    orders = np.arange(1, bounces or 1000)
    expected = reflectance / np.pi * np.sum(reflectance**orders)
    estimate = radiance(at_the_wall(None, 1e-3), [sphere(reflectance)], "multiple", max_bounces=bounces, spp=128)
    assert_agrees(estimate, expected, FACETS / Z * expected)


def test_a_furnace_of_water_that_absorbs_nothing_loses_no_light():
    """All that the lamp sends out ends in the wall, however the water scatters it, and in red it does not at all."""
    r, gap, sigma = 0.3, 2e-4, np.array([0.0, 0.2, 1.0])
    scene = at_the_wall({"sigma_s": sigma.tolist(), "sigma_a": [0.0] * 3, "phase": {"g": 0.5}}, gap)
    expected = r / np.pi / (1 - r)
    estimate = radiance(scene, [sphere(r)], spp=2048, seed=3)
    assert_agrees_with_heavy_tail(estimate, expected, (FACETS + 2 * gap * sigma) / Z * expected)


# ------------------------------------------------------------------------------------------------- what it is asked for


@pytest.mark.parametrize(
    ("bounds", "empty"),
    [
        ({"max_scatterings": 0, "max_bounces": 1}, {"single", "multiple"}),
        ({"max_scatterings": 1, "max_bounces": 0}, {"direct", "multiple"}),
        ({"max_scatterings": 0}, {"single"}),
        ({"max_bounces": 0}, {"direct"}),
    ],
)
def test_bounds_empty_the_layers_that_need_more(bounds, empty):
    """Two floors face each other, so that light without scatterings is exchanged too."""
    scene = one_ray_scene(VAROS_LAMPS, water(0.2, 0.3, 0.5))
    renderer = FrameRenderer(scene, "cpu", parts=[floor(1.0, 0.5), floor(-1.0, 0.5)])
    layers = renderer.render(np.eye(4), outputs="A", spp=16, integrator="reference", **bounds).A.layers
    assert {name for name, layer in layers.items() if not layer.any()} == empty


def test_radiance_is_that_of_the_layers_asked_for():
    renderer = FrameRenderer(one_ray_scene(VAROS_LAMPS, water(0.2, 0.3, 0.5)), "cpu", parts=[floor(1.0, 0.5)])
    how = {"outputs": "A", "spp": 16, "integrator": "reference"}
    whole = renderer.render(np.eye(4), **how).A
    for layers in (("direct",), ("single",), ("multiple",), ("direct", "single")):
        some = renderer.render(np.eye(4), layers=layers, **how).A
        assert set(some.layers) == set(layers)
        for layer in layers:
            np.testing.assert_array_equal(some.layers[layer], whole.layers[layer])
        np.testing.assert_allclose(some.radiance, sum(whole.layers[layer] for layer in layers), rtol=1e-6)


def test_the_scene_file_chooses_unless_the_call_does():
    scene = one_ray_scene(VAROS_LAMPS, PAPER_WATER, pixels=4)
    chosen = scene.model_copy(update={"render": scene.render.model_copy(update={"integrator": "reference"})})

    def image(scene, integrator=None):
        return any_radiance(scene, [floor(3.0, 0.5)], spp=4, integrator=integrator)[0]

    np.testing.assert_array_equal(image(chosen), image(scene, "reference"))
    np.testing.assert_array_equal(image(chosen, "path"), image(scene, "path"))
    assert np.all(image(chosen) != image(scene))
    with pytest.raises(InputError, match="integrator"):
        image(scene, "magic")


# -------------------------------------------------------------------------------------------------- the path integrator


RICH = {
    "water": {"coefficients": {"sigma_s": [0.05, 0.1, 0.2], "sigma_a": [0.2, 0.05, 0.0], "phase": {"g": 0.6}}},
    "materials": {"sand": {"kind": "slope_blend", "flat": {"texture": "sand", "size_m": 0.5}}},
    "terrain": {"kind": "procedural", "material": "sand"},
    "vehicle": {
        "lights": [
            {
                "kind": "spot",
                "position": [x, 0.5, 0.8],
                "direction": [-x, 1, -2],
                "cone_deg": 70,
                "blend": 0.6,
                "intensity": [4, 3, 2],
            }
            for x in (-0.7, 0.7)
        ],
        "cameras": [{"id": "M0", "resolution": [32, 24], "rotation_euler_deg": [-35, 0, 0]}],
    },
    "trajectory": {"poses": [{"position": [0, 0, 0]}]},
}
POSE = np.array([[1, 0, 0, 0], [0, 1, 0, -1.2], [0, 0, 1, 1.0], [0, 0, 0, 1]], float)


def rich_parts(sand):
    """Sand, a smooth metal ball that mirrors it, and copies of a rusty nut."""
    corners = 9.0 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    ground = Part("terrain", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), sand)
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.25).apply_translation((-0.3, 0.1, 0.25))
    metal = Metal(kind="metal", roughness=0.4)
    ball = Part(
        "ball",
        np.asarray(mesh.vertices),
        np.asarray(mesh.faces, np.int32),
        metal,
        smooth_angle=np.pi,
        smooth_shading=True,
    )
    rng = np.random.default_rng(4)
    T = np.tile(np.eye(4), (30, 1, 1))
    T[:, :3, :3] = Rotation.random(30, random_state=4).as_matrix() * rng.uniform(2, 6, (30, 1, 1))
    T[:, :3, 3] = np.column_stack([rng.uniform(-1, 1, (30, 2)), rng.uniform(0.0, 0.3, 30)])
    rusty = Rust(kind="rust", amount=0.4, roughness=0.4)
    nuts = Instances("scatter.0", *make_asset(Nut(kind="nut", size="M24")), rusty, T, smooth_shading=True)
    return [ground, ball, nuts]


@lru_cache(maxsize=1)
def rich_renderer(device, water):
    """Of these parts in water, of which the block is given as text."""
    scene = scene_from_dict(RICH | {"water": json.loads(water)})
    return FrameRenderer(scene, device, parts=rich_parts(scene.materials["sand"]))


BATCHES = 16


def quarters(renderer, integrator, spp, seed, **bounds):
    """Mean radiance of each layer in each quarter of the image [layer, 2, 2, 3]."""
    layers = renderer.render(POSE, outputs="A", integrator=integrator, spp=spp, seed=seed, **bounds).A.layers
    return np.array([layers[name].astype(float).reshape(2, 12, 2, 16, 3).mean(axis=(1, 3)) for name in LAYERS])


def two_integrators(device, spp, spp_reference, water=RICH["water"], **bounds):
    """Independent batches of the reference and of the path integrator, [batch, layer, 2, 2, 3] each."""
    renderer = rich_renderer(device, json.dumps(water))
    samples = {"reference": spp_reference, "path": spp}
    return [
        np.array([quarters(renderer, name, n, 1000 * k + seed, **bounds) for seed in range(BATCHES)])
        for k, (name, n) in enumerate(samples.items())
    ]


def assert_same_layers(whole, unscattered, precision):
    """Light of finite variance: Welch's t-test of every quarter, layer and channel.

    Direct light and single scattering of the ``whole``, then what surfaces exchange through the water without
    scattering, both as from `two_integrators`. ``precision`` is the relative error of the image's means that keeps the
    test from passing for noise.
    """
    reference, path = (
        np.concatenate([one[:, :2], other[:, 2:]], axis=1) for one, other in zip(whole, unscattered, strict=True)
    )
    assert_plausible(stats.ttest_ind(reference, path, equal_var=False).pvalue)
    mean, error = difference(reference.mean(axis=(2, 3)), path.mean(axis=(2, 3)))[1:]
    assert np.all(error < precision * mean), f"too noisy to tell: {error / mean}"


def difference(reference, path):
    """What the reference has more than path, the mean of path, and the difference's standard error."""
    variance = (reference.var(axis=0, ddof=1) + path.var(axis=0, ddof=1)) / BATCHES
    return reference.mean(axis=0) - path.mean(axis=0), path.mean(axis=0), np.sqrt(variance)


def assert_same_multiple_scattering(reference, path, precision):
    """Light of all orders, which the reference finds with a heavy tail; both as from `two_integrators`."""
    off, mean, error = difference(*(batches[:, 2].mean(axis=(1, 2)) for batches in (reference, path)))
    assert_agrees_with_heavy_tail((mean + off, error), mean, precision=precision)


def test_the_path_integrator_has_the_same_layers_among_textures_metal_and_copies():
    whole = two_integrators("cpu", 4, 48)
    assert_same_layers(whole, two_integrators("cpu", 6, 40, max_scatterings=0), 0.03)
    assert_same_multiple_scattering(*whole, 0.02)


WATERS = {
    "of the paper": (6, 20, {"coefficients": PAPER_WATER}),
    "Jerlov 1C, Fournier-Forand": (40, 64, {"jerlov": {"type": "1C"}}),
    "clear, Petzold": (
        4,
        96,
        {"coefficients": {"sigma_s": [0.1, 0.15, 0.2], "sigma_a": [0.2, 0.1, 0.05], "phase": {"kind": "petzold"}}},
    ),
    "turbid, backward": (
        8,
        64,
        {"coefficients": {"sigma_s": [1.0, 1.5, 1.8], "sigma_a": [1.0, 0.5, 0.2], "phase": {"g": -0.4}}},
    ),
    "clear and Rayleigh": (
        8,
        32,
        {"coefficients": {"sigma_s": [0.1, 0.2, 0.3], "sigma_a": [0.1, 0.1, 0.1], "phase": {"kind": "rayleigh"}}},
    ),
}
"""With the samples of paths and of the reference that leave errors of a few percent, of one in the clearest."""


@pytest.mark.parametrize("name", WATERS)
def test_the_path_integrator_is_the_reference_in_unlike_waters(name):
    spp, spp_reference, water = WATERS[name]
    reference, path = two_integrators("cpu", spp, spp_reference, water)
    assert_same_multiple_scattering(reference, path, 0.06)


@pytest.mark.gpu
def test_the_path_integrator_has_the_same_layers_on_a_gpu():
    whole = two_integrators("cuda:0", 512, 8192)
    assert_same_layers(whole, two_integrators("cuda:0", 512, 2048, max_scatterings=0), 0.005)
    assert_same_multiple_scattering(*whole, 0.02)
