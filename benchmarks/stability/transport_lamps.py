"""Sweeps of light transport over the lights: near the ray, near a surface, narrow, wide, weak and strong."""

import numpy as np
import warp as wp

from benchmarks.stability.entry import Sweep, Sweeps
from benchmarks.stability.transport import (
    INTEGRATORS,
    estimate,
    floor,
    off,
    one_ray_scene,
    point,
    run,
    spot,
    truth_of,
    water,
)
from varos_warp.kernels.world.lights.light import falloff
from varos_warp.kernels.world.lights.record import Light
from varos_warp.scene.lights.distribution import Distribution
from varos_warp.scene.lights.records import light_record

TESTS = "tests/stability/test_lamp_limits.py::"


# ----------------------------------------------------------------------------------------------------- near the ray


def beside_error(side: float, ahead: float, integrator: str, spp: int = 256) -> float:
    """Relative error of single scattering with a point light ``side`` from the ray and ``ahead`` of the camera [m]."""
    spp = 2 if integrator == "field" else spp
    lamp = (side, 0.0, ahead)
    scene = one_ray_scene([point(lamp)], water(0.05, 0.1, 0.8), pixels=8)
    mean, _ = estimate(scene, [floor(5.0, 0.0)], layer="single", integrator=integrator, spp=spp)
    return off(mean, truth_of(lamp, 0.05, 0.1, 0.8, 5.0))


SIDES = [0.1, 0.01, 1e-3, 1e-4, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 1e-8]


def lamp_beside_the_ray() -> Sweep:
    """A light in view, 2 m ahead."""
    return Sweep(
        key="lamp_beside_the_ray",
        title="a light in view",
        method="field, path, reference",
        parameter="distance of the light from the ray [m]",
        values=SIDES,
        errors={name: [beside_error(h, 2.0, name) for h in SIDES] for name in INTEGRATORS},
        measure="Relative error of single scattering, a point light 2 m ahead, g = 0.8, against quadrature in float64. "
        "Noise of path 5e-4.",
        limit="3e-6 m (5e-4; the camera's own rays differ by 1e-7 m there)",
        fails="the truth grows as 1/distance without end; reference: its shadow rays find the light's surroundings by "
        "chance, 29 % off at 1e-4 m with its noise",
        program="distances below 1e-6 m count as 1e-6 m: bright, finite, the same in all integrators",
        test=TESTS + "test_a_lamp_near_the_ray_is_right_to_micrometres_and_finite_beyond",
        holds=(3e-6, None),
        bound=2e-3,
    )


def lamp_on_the_camera() -> Sweep:
    """A light beside the lens, down to on it."""
    return Sweep(
        key="lamp_on_the_camera",
        title="a light on the camera",
        method="field, path, reference",
        parameter="distance of the light from the camera [m]",
        values=SIDES,
        errors={name: [beside_error(h, 0.0, name) for h in SIDES] for name in INTEGRATORS},
        measure="As before, the light straight beside the camera.",
        limit="1e-6 m (7e-7)",
        fails="as before",
        program="as before; reference is too noisy to judge below 0.01 m",
        test=TESTS + "test_a_lamp_near_the_ray_is_right_to_micrometres_and_finite_beyond",
        holds=(1e-6, None),
        bound=2e-3,
    )


def lit_error(distance: float, size: float, integrator: str) -> float:
    """Relative error of direct light off a plate ``distance`` from camera and light, without water."""
    scene = one_ray_scene([point((0.0, 0.0, 0.0))], None, pixels=4)
    mean, _ = estimate(scene, [floor(distance, 0.5, size)], layer="direct", integrator=integrator, spp=4)
    return off(mean, 0.5 / np.pi / distance**2)


def distance_to_a_lit_surface() -> Sweep:
    """Light and camera against a wall."""
    values = [1e-7, 5e-7, 1e-6, 1e-5, 1e-4, 1e-3, 0.01, 1.0, 100.0, 1e4, 1e6, 1e8]
    sizes = {"20 distances": 0.0, "at least 400 m": 200.0}
    return Sweep(
        key="distance_to_a_lit_surface",
        title="distance to a lit surface",
        method="path, reference (direct)",
        parameter="distance [m]",
        values=values,
        errors={
            f"{name}, plate of {label}": [lit_error(d, max(20 * d, least), name) for d in values]
            for name in ("path", "reference")
            for label, least in sizes.items()
        },
        measure="Relative error of direct light off a grey plate with light and camera in one place, against the "
        "inverse "
        "square.",
        limit="1e-6 .. 1e8 m (2e-7)",
        fails="below 1e-6 m the inverse square is cut off; no ray is longer than 1e9 m",
        program="distances below 1e-6 m count as 1e-6 m; beyond 1e9 m nothing is hit",
        test=TESTS + "test_a_surface_is_lit_as_the_inverse_square_says_from_micrometres_on",
        holds=(1e-6, None),
        bound=1e-6,
    )


# ------------------------------------------------------------------------------------------------------- the cones


@wp.kernel(enable_backward=False)
def _falloff_values(light: Light, d: wp.array(dtype=wp.vec3), out: wp.array(dtype=float)):
    i = wp.tid()
    out[i] = falloff(light, wp.dot(wp.normalize(d[i]), light.axis))


def flux_error(cone_deg: float, blend: float) -> float:
    """Relative error of the power that a spot sends out, by the trapezoid rule over the angle to its axis."""
    axis = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    across = np.cross(axis, [1.0, 0.0, 0.0]) / np.linalg.norm(np.cross(axis, [1.0, 0.0, 0.0]))
    half = np.radians(cone_deg) / 2
    record = light_record(Distribution(half, blend), np.ones(3), axis=axis)
    theta = np.linspace(0.0, min(np.pi, 1.5 * half), 100_001)
    directions = np.cos(theta)[:, None] * axis + np.sin(theta)[:, None] * across
    got = run(_falloff_values, [record, wp.array(directions, dtype=wp.vec3, device="cpu")], len(theta))
    # 1 - cos by the half angle, or narrow cones would have no digits in the truth
    x = (np.sin(half / 2) ** 2 - np.sin(theta / 2) ** 2) / (max(blend, 1e-12) * np.sin(half / 2) ** 2)
    x = np.clip(x, 0.0, 1.0)
    truth = np.trapezoid(x * x * (3 - 2 * x) * np.sin(theta), theta)
    return float(abs(np.trapezoid(got * np.sin(theta), theta) / truth - 1))


CONES = [0.01, 0.1, 0.3, 0.5, 1.0, 2.0, 5.0, 10.0, 65.0, 120.0, 179.0, 181.0, 270.0, 350.0, 359.9, 359.99, 359.999]


def power_of_a_cone() -> Sweep:
    """From a laser to a light without a cone."""
    return Sweep(
        key="power_of_a_cone",
        title="power of a spot",
        method="falloff (float32)",
        parameter="cone [degrees]",
        values=CONES,
        errors={f"blend {blend:g}": [flux_error(cone, blend) for cone in CONES] for blend in (0.0, 0.15, 1.0)},
        measure="Relative error of the power that a spot of intensity 1 sends out, against the closed form of its soft "
        "edge in float64.",
        limit="1 .. 359.9 degrees (1.2e-3 at 1 degree, 1e-4 from 2 on)",
        fails="the cosine of the half angle is 1 to seven digits: 0.9 % off at 0.5 degrees, 9 % at 0.1; beyond 359.9 a "
        "soft edge rounds to none",
        program="refuses cones below 1 degree and between 359.9 and 360 (vehicle.lights.N.cone_deg)",
        test=TESTS + "test_spots_send_out_their_power_where_a_scene_may_name_them",
        holds=(1.0, 359.9),
        bound=2e-3,
    )


def cone_error(cone_deg: float, blend: float, integrator: str, spp: int = 256) -> float:
    """Relative error of single scattering by a spot that crosses the view."""
    lamp, axis = (0.1, 0.0, 0.0), (-0.05, 0.0, 1.0)
    truth = truth_of(lamp, 0.05, 0.1, 0.5, 10.0, axis, cone_deg, blend, 1000)
    scene = one_ray_scene([spot(lamp, axis, cone_deg, blend)], water(0.05, 0.1, 0.5), pixels=8)
    spp = 2 if integrator == "field" else spp
    return off(estimate(scene, [floor(10.0, 0.0)], layer="single", integrator=integrator, spp=spp)[0], truth)


def cone_across_the_view() -> Sweep:
    """The same in an image, hard and soft."""
    values = [1.0, 2.0, 5.0, 10.0, 20.0, 65.0, 120.0, 179.0, 181.0, 270.0, 350.0]
    return Sweep(
        key="cone_across_the_view",
        title="single scattering in a cone",
        method="field, path",
        parameter="cone [degrees]",
        values=values,
        errors={
            f"{name}, blend {blend:g}": [
                cone_error(cone, blend, name) if 20 <= cone <= 179 or name == "path" else np.nan for cone in values
            ]
            for name in ("field", "path")
            for blend in (0.0, 1.0)
        },
        measure="Relative error of single scattering where a spot 0.1 m aside crosses the ray, against quadrature. "
        "Noise "
        "of path 2e-3.",
        limit="path 1 .. 359.9 degrees; field 20 .. 179",
        fails="field: narrow cones are not resolved by its grids, wide ones have no convex nappe",
        program="auto takes path; the field asked for by name is refused",
        test=TESTS + "test_cones_are_tables_from_20_to_179_degrees_and_paths_beyond",
        holds=(20.0, 179.0),
        bound=1e-2,
    )


# ------------------------------------------------------------------------------------------------------ intensities


def intensity_error(exponent: int, integrator: str) -> float:
    """How far the image of a light of 10^exponent W/sr, divided by that, is from the one of 1 W/sr, in all layers."""

    def layers(intensity):
        light = point((0.15, 0.0, -0.1), 1.0)
        scene = one_ray_scene([light], water(0.05, 0.1, 0.8), pixels=4)
        lamp = scene.vehicle.lights[0].model_copy(update={"intensity": (intensity,) * 3})
        scene = scene.model_copy(update={"vehicle": scene.vehicle.model_copy(update={"lights": [lamp]})})
        names = ("direct", "single") if integrator == "field" else ("direct", "single", "multiple")
        return np.array(
            [
                estimate(scene, [floor(2.0, 0.5)], layer=name, integrator=integrator, spp=16)[0] / intensity
                for name in names
            ]
        )

    return off(layers(10.0**exponent), layers(1.0))


def intensity() -> Sweep:
    """From a glow-worm's ghost to a star."""
    exponents = [-38, -35, -33, -30, -28, -25, -20, -10, 0, 10, 20, 30, 35, 36, 37, 38]
    return Sweep(
        key="intensity",
        title="intensity of a light",
        method="field, path, reference",
        parameter="intensity [W/sr]",
        values=[10.0**p for p in exponents],
        errors={name: [intensity_error(p, name) for p in exponents] for name in INTEGRATORS},
        measure="How far an image divided by the light's intensity is from the one of 1 W/sr with the same random "
        "numbers, "
        "in all layers (field: direct and single).",
        limit="1e-20 .. 1e20 W/sr (1e-7)",
        fails="path: below 1e-25 W/sr the weights of its lights drown in the number that keeps them from 0 (2 % at "
        "1e-28, "
        "83 % at 1e-30), above 1e36 they overflow",
        program="refuses intensities outside 1e-20 .. 1e20 W/sr, but for 0 (vehicle.lights.N.intensity)",
        test=TESTS + "test_light_is_in_proportion_to_the_intensity_of_its_lamp",
        holds=(1e-20, 1e20),
        bound=1e-6,
    )


SWEEPS: Sweeps = (
    lamp_beside_the_ray,
    lamp_on_the_camera,
    distance_to_a_lit_surface,
    power_of_a_cone,
    cone_across_the_view,
    intensity,
)
