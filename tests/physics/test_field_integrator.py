"""Paths with the field of open water: right where closed forms exist, and where surfaces block and send as without it.

Its stated bias is at most 0.3 % of a pixel in the paper's water; everything else must be within standard errors.
"""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from chance import assert_plausible
from physics.rig import (
    ISOTROPIC,
    TURBID,
    VAROS_LAMPS,
    VAROS_WATER,
    agreement,
    assert_agrees,
    floor,
    line_of_sight,
    one_ray_scene,
    point,
    radiance,
    single_scattering,
    spot,
    varos_lamps,
)
from scipy import stats

from varos_warp.render.renderer import LAYERS, FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse, Metal
from varos_warp.scene.geometry.parts import Instances, Part

pytestmark = pytest.mark.subject("multiple scattering")

PAPER_WATER = VAROS_WATER | {"phase": {"g": 0.8}}
BIAS = 3e-3
"""Stated bound on the bias, as a share of the pixel."""
QUADRATURE = 1e-3
"""Stated error of single scattering."""
STATED = "the field's stated bias"


# -------------------------------------------------------------------------------------------- without anything blocked


@pytest.mark.parametrize(
    ("T", "expected"),
    [
        (2, (5.19739861055642e-5, 0.000582288048363675, 0.00139849876541647)),
        (5, (5.42226576952195e-5, 0.000617358347687215, 0.00148924559123547)),
        (10, (5.45304161185223e-5, 0.00062519221619206, 0.00151190406588714)),
        (25, (5.45633155963439e-5, 0.000627173268201532, 0.00151897711245271)),
    ],
)
@pytest.mark.subject("single scattering")
def test_single_scattering_without_obstacles_has_no_noise_and_the_error_of_its_quadrature(truth, T, expected):
    scene = one_ray_scene(VAROS_LAMPS, PAPER_WATER, pixels=2)
    mean, stderr = radiance(scene, [floor(T, 0.0)], "single", integrator="field", spp=4)
    assert np.all(stderr <= 1e-5 * mean)
    truth(
        f"field, red, green, blue, the paper's rig, ray up to {T} m",
        source="two independent quadratures to 15 digits",
        expected=expected,
        got=mean,
        tolerance=QUADRATURE * np.array(expected),
        reason="stated error of 10 nodes",
    )


@pytest.mark.parametrize("blend", [0.15, 1.0])
@pytest.mark.subject("single scattering")
def test_soft_edges_are_integrated_in_parts(truth, blend):
    lamp = {"axis": (0, 0, 1), "cone_deg": 65.0, "blend": blend}
    scene = one_ray_scene([spot((0.15, 0, -0.1), blend=blend)], PAPER_WATER, pixels=2)
    mean, _ = radiance(scene, [floor(5, 0.0)], "single", integrator="field", spp=4)
    expected = np.array(
        [
            single_scattering((0.15, 0, -0.1), s, t, 0.8, 5.0, **lamp)
            for s, t in ((0.00175, 0.125), (0.01825, 0.057989), (0.043125, 0.043125))
        ]
    )
    truth(
        f"field, red, green, blue, blend {blend}, ray up to 5 m",
        source="adaptive quadrature, tests/physics/rig.py",
        expected=expected,
        got=mean,
        tolerance=QUADRATURE * expected,
        reason="stated error of 10 nodes",
    )


def test_the_whole_pixel_in_blue_with_a_floor_with_the_field(truth):
    """Both lamps of the paper's rig above a floor; the expected sum has an error of 0.1 %."""
    estimate = radiance(one_ray_scene(VAROS_LAMPS, PAPER_WATER), [floor(5.0, 0.25)], integrator="field", spp=256)
    blue = tuple(np.repeat(part[2], 3) for part in estimate)
    truth(
        "all light, blue, floor of reflectance 0.25 at 5 m",
        source="an independent Monte Carlo (0.1 %)",
        **agreement(blue, 7.2505e-3, 7e-6, tolerance=BIAS, reason=STATED + ", 0.3 %"),
    )


def test_the_field_has_all_orders_of_the_isotropic_medium_around_a_point_source(truth):
    """Seen along a ray 1 m from a source of 1 W."""
    scene = one_ray_scene([point((1, 0, 1), 1 / (4 * np.pi))], ISOTROPIC, pixels=4)
    mean, stderr = radiance(scene, integrator="field", spp=4)
    for c, (albedo, total) in enumerate(((0.5, 1.483289011131e-3), (0.9, 7.294186485738e-3))):
        truth(
            f"all orders, albedo {albedo}, ray without end, 1 m from the source",
            source="Case and Zweifel (1967); Fourier inversion and integral over the ray",
            expected=total,
            got=mean[c],
            stderr=stderr[c],
            tolerance=BIAS * total,
            reason=STATED + ", 0.3 %",
        )
    assert mean[2] == 0.0


def test_open_water_of_the_paper(truth):
    """A line of sight that ends at 5 m while the water goes on: a black floor would take 0.14 % of the light."""
    estimate = line_of_sight(varos_lamps, PAPER_WATER, 5.0, integrator="field", spp=4)
    green = tuple(np.repeat(part[1], 3) for part in estimate)
    truth(
        "all orders, green, ray up to 5 m",
        source="an independent Monte Carlo (0.1 %)",
        **agreement(green, 6.3372e-4, 6.3e-7, tolerance=BIAS, reason=STATED + ", 0.3 %"),
    )


# ------------------------------------------------------------------------------------------ where surfaces stand about


def part(mesh, material, name="mesh"):
    return Part(name, np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32), material)


def boxed(extents, centre, reflectance, name="box"):
    mesh = trimesh.creation.box(extents).apply_translation(centre)
    return part(mesh, Diffuse(reflectance=[reflectance] * 3), name)


def shadows():
    """A wall near the lamps and a post in their light, over a floor."""
    return [
        boxed((20, 20, 0.2), (0, 6, -1.1), 0.4),
        boxed((0.1, 0.1, 2.0), (-0.25, 1.5, 0), 0.6),
        boxed((1.0, 0.1, 0.8), (0.9, 2.5, -0.6), 0.3),
        boxed((4, 0.2, 4), (0, 6, 0), 0.5),
    ]


def rough(parts):
    """The same with rough surfaces: the field has only what Lambertian ones would reflect."""
    return lambda: [replace(p, material=p.material.model_copy(update={"diffuse_roughness": 0.9})) for p in parts()]


def chamber():
    """The vehicle inside a closed box: all light of open water from beyond its walls is blocked."""
    return [boxed((3, 4, 2.4), (0.2, 1.2, 0.1), 0.4)]


def riches():
    """A metal ball, copies of a smaller one and a floor."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.3)
    small = part(ball.copy().apply_scale(0.3), Diffuse(reflectance=(0.2, 0.6, 0.4)))
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = [(-0.6, 2.0, -0.4), (-0.2, 2.4, -0.7), (0.9, 3.0, 0.2)]
    copies = Instances("copies", small.vertices, small.faces, small.material, poses)
    return [
        boxed((20, 20, 0.2), (0, 6, -1.1), 0.4),
        copies,
        part(ball.copy().apply_translation((0.4, 2.0, -0.2)), Metal(kind="metal", roughness=0.4), "ball"),
    ]


def view(lamps, coefficients, resolution=(24, 16)):
    camera = {"id": "M0", "resolution": resolution, "sensor_mm": [6.0, 4.0], "focal_mm": 4.0}
    return Scene(
        water={"coefficients": coefficients},
        vehicle={"lights": lamps, "cameras": [camera]},
        trajectory={"poses": [{"position": [0, 0, 0]}]},
    )


def assert_same_as_path(scene, parts, device="cpu", spp=(32, 96), bias=BIAS, precision=0.03):
    """Means over quarters of the image, by layer and channel: Welch's test beside the stated bias, Sidak over all.

    Errors are the spread of eight renderings: pixels share virtual point lights, and paths have heavy tails.
    """
    renderer = FrameRenderer(scene, device, parts=parts)
    ours, theirs = (
        [renderer.render(np.eye(4), outputs="A", integrator=name, spp=n, seed=seed).A for seed in range(8)]
        for name, n in zip(("field", "path"), spp, strict=True)
    )
    assert all(np.isfinite(image.radiance).all() for image in ours)
    total = np.mean([quarters(image.radiance) for image in theirs], axis=0)
    p_values = []
    for name in LAYERS:
        samples = [np.array([quarters(image.layers[name]) for image in images]) for images in (ours, theirs)]
        variance = [values.var(axis=0, ddof=1) / len(values) + 1e-12 * total**2 for values in samples]
        stderr = np.sqrt(sum(variance))
        assert np.all(stderr < precision * total), f"{name}: too noisy to tell"
        freedom = stderr**4 / sum(v**2 / 7 for v in variance)
        off = np.maximum(np.abs(samples[0].mean(axis=0) - samples[1].mean(axis=0)) - bias * total, 0.0)
        p_values.append(2.0 * stats.t.sf(off / stderr, freedom))
    assert_plausible(p_values)


def quarters(image):
    """Means over the quarters of an image [2, 2, 3], float64."""
    height, width = image.shape[:2]
    return image.astype(float).reshape(2, height // 2, 2, width // 2, 3).mean(axis=(1, 3))


@pytest.mark.parametrize("denoise", ["none", "oidn"])
def test_no_light_of_open_water_leaks_into_a_closed_box_around_the_camera(denoise):
    """The lamps are outside: what the field holds is blocked, at the first surface and at those seen from it."""
    scene = view(VAROS_LAMPS, PAPER_WATER)
    renderer = FrameRenderer(scene, "cpu", parts=[boxed((0.16, 0.16, 0.16), (0, 0, 0), 0.8)])
    how = {"integrator": "field", "spp": 16, "denoise": denoise}  # the second looks less for what is blocked
    images = [renderer.render(np.eye(4), outputs="A", seed=s, **how).A for s in range(8)]
    means = np.array([image.radiance.mean(axis=(0, 1), dtype=float) for image in images])
    assert_plausible(2.0 * stats.t.sf(np.abs(means.mean(axis=0)) / (means.std(axis=0, ddof=1) / np.sqrt(8)), 7))
    assert np.all(means.std(axis=0, ddof=1) / np.sqrt(8) < 3e-3)  # light that only first surfaces blocked was 1.3e-2


def test_a_black_wall_blocks_multiple_in_scattering_without_reflections():
    scene, wall = one_ray_scene(VAROS_LAMPS, TURBID, pixels=8), [floor(1.0, 0.25)]
    ours = radiance(scene, wall, integrator="field", spp=64, max_bounces=0)
    assert_agrees(ours, radiance(scene, wall, integrator="path", spp=4096, max_bounces=0)[0], 2e-4, precision=0.02)


UNLIKE_LAMPS = [VAROS_LAMPS[0], point((0.3, 0.2, 0.0), 0.5)]
"""A cone and a point, of which each has a field of its own."""
SCENES = {
    "shadows": (VAROS_LAMPS, PAPER_WATER, shadows, BIAS),
    "chamber": (VAROS_LAMPS, PAPER_WATER, chamber, BIAS),
    "riches, unlike lamps": (UNLIKE_LAMPS, PAPER_WATER, riches, BIAS),
    "turbid": (VAROS_LAMPS, TURBID, shadows, 1e-2),
    "rough shadows, unlike lamps": (UNLIKE_LAMPS, PAPER_WATER, rough(shadows), BIAS),
    "rough chamber": (VAROS_LAMPS, PAPER_WATER, rough(chamber), BIAS),
    "rough, turbid": (VAROS_LAMPS, TURBID, rough(shadows), 1e-2),
    "behind a port, few nodes": ([VAROS_LAMPS[0] | {"port": {"kind": "flat"}}], PAPER_WATER, shadows, 1e-2),
}
"""Lights, water, surfaces and the bias of the field there."""


@pytest.mark.parametrize("name", SCENES)
def test_the_image_is_that_of_the_path_integrator(name, request):
    if "few nodes" in name:
        request.getfixturevalue("few_nodes")
    lamps, coefficients, parts, bias = SCENES[name]
    assert_same_as_path(view(lamps, coefficients), parts(), bias=bias)


@pytest.mark.subject("single scattering")
def test_a_boxed_lamp_adds_nothing(truth):
    """Of the light of two equal lamps half is left."""
    scene, lid = one_ray_scene(VAROS_LAMPS, PAPER_WATER, pixels=64), boxed((0.1, 0.1, 0.1), (-0.15, -0.1, 0.0), 0.0)
    both, _ = radiance(scene, [floor(5.0, 0.0)], "single", integrator="field", spp=4)
    truth(
        "field, red, green, blue, one of two lamps boxed",
        source="half of the light of both",
        **agreement(
            radiance(scene, [floor(5.0, 0.0), lid], "single", integrator="field", spp=8), 0.5 * both, precision=0.03
        ),
    )


@pytest.mark.gpu
@pytest.mark.parametrize("name", SCENES)
def test_a_gpu_agrees_too(name):
    lamps, coefficients, parts, bias = SCENES[name]
    assert_same_as_path(view(lamps, coefficients), parts(), "cuda:0", (256, 4096), bias)
