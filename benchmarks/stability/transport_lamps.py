"""Sweeps of light transport over the lights: near the ray, near a surface, narrow, wide, weak and strong."""

import numpy as np
import warp as wp

from benchmarks.stability.entry import Measured, Sweeps
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

# ----------------------------------------------------------------------------------------------------- near the ray


def beside_error(side: float, ahead: float, integrator: str, spp: int = 256) -> float:
    """Relative error of single scattering with a point light ``side`` from the ray and ``ahead`` of the camera [m]."""
    spp = 2 if integrator == "field" else spp
    lamp = (side, 0.0, ahead)
    scene = one_ray_scene([point(lamp)], water(0.05, 0.1, 0.8), pixels=8)
    mean, _ = estimate(scene, [floor(5.0, 0.0)], layer="single", integrator=integrator, spp=spp)
    return off(mean, truth_of(lamp, 0.05, 0.1, 0.8, 5.0))


SIDES = [0.1, 0.01, 1e-3, 1e-4, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 1e-8]


def lamp_beside_the_ray() -> Measured:
    """A light in view, 2 m ahead."""
    return SIDES, {name: [beside_error(h, 2.0, name) for h in SIDES] for name in INTEGRATORS}


def lamp_on_the_camera() -> Measured:
    """A light beside the lens, down to on it."""
    return SIDES, {name: [beside_error(h, 0.0, name) for h in SIDES] for name in INTEGRATORS}


def lit_error(distance: float, size: float, integrator: str) -> float:
    """Relative error of direct light off a plate ``distance`` from camera and light, without water."""
    scene = one_ray_scene([point((0.0, 0.0, 0.0))], None, pixels=4)
    mean, _ = estimate(scene, [floor(distance, 0.5, size)], layer="direct", integrator=integrator, spp=4)
    return off(mean, 0.5 / np.pi / distance**2)


def distance_to_a_lit_surface() -> Measured:
    """Light and camera against a wall."""
    values = [1e-7, 5e-7, 1e-6, 1e-5, 1e-4, 1e-3, 0.01, 1.0, 100.0, 1e4, 1e6, 1e8]
    sizes = {"20 distances": 0.0, "at least 400 m": 200.0}
    return values, {
        f"{name}, plate of {label}": [lit_error(d, max(20 * d, least), name) for d in values]
        for name in ("path", "reference")
        for label, least in sizes.items()
    }


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
    record = light_record(Distribution(half, blend), np.ones(3))
    record.axis = wp.vec3(*axis)
    theta = np.linspace(0.0, min(np.pi, 1.5 * half), 100_001)
    directions = np.cos(theta)[:, None] * axis + np.sin(theta)[:, None] * across
    got = run(_falloff_values, [record, wp.array(directions, dtype=wp.vec3, device="cpu")], len(theta))
    # 1 - cos by the half angle, or narrow cones would have no digits in the truth
    x = (np.sin(half / 2) ** 2 - np.sin(theta / 2) ** 2) / (max(blend, 1e-12) * np.sin(half / 2) ** 2)
    x = np.clip(x, 0.0, 1.0)
    truth = np.trapezoid(x * x * (3 - 2 * x) * np.sin(theta), theta)
    return float(abs(np.trapezoid(got * np.sin(theta), theta) / truth - 1))


CONES = [0.01, 0.1, 0.3, 0.5, 1.0, 2.0, 5.0, 10.0, 65.0, 120.0, 179.0, 181.0, 270.0, 350.0, 359.9, 359.99, 359.999]


def power_of_a_cone() -> Measured:
    """Measure cones from a laser to a light without one."""
    return CONES, {f"blend {blend:g}": [flux_error(cone, blend) for cone in CONES] for blend in (0.0, 0.15, 1.0)}


def cone_error(cone_deg: float, blend: float, integrator: str, spp: int = 256) -> float:
    """Relative error of single scattering by a spot that crosses the view."""
    lamp, axis = (0.1, 0.0, 0.0), (-0.05, 0.0, 1.0)
    truth = truth_of(lamp, 0.05, 0.1, 0.5, 10.0, axis, cone_deg, blend, 1000)
    scene = one_ray_scene([spot(lamp, axis, cone_deg, blend)], water(0.05, 0.1, 0.5), pixels=8)
    spp = 2 if integrator == "field" else spp
    return off(estimate(scene, [floor(10.0, 0.0)], layer="single", integrator=integrator, spp=spp)[0], truth)


def cone_across_the_view() -> Measured:
    """Measure the cone in an image, hard and soft."""
    values = [1.0, 2.0, 5.0, 10.0, 20.0, 65.0, 120.0, 179.0, 181.0, 270.0, 350.0]
    return values, {
        f"{name}, blend {blend:g}": [
            cone_error(cone, blend, name) if 20 <= cone <= 179 or name == "path" else np.nan for cone in values
        ]
        for name in ("field", "path")
        for blend in (0.0, 1.0)
    }


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


def intensity() -> Measured:
    """Measure intensities from a glow-worm's ghost to a star."""
    exponents = [-38, -35, -33, -30, -28, -25, -20, -10, 0, 10, 20, 30, 35, 36, 37, 38]
    return [10.0**p for p in exponents], {name: [intensity_error(p, name) for p in exponents] for name in INTEGRATORS}


SWEEPS: Sweeps = (
    lamp_beside_the_ray,
    lamp_on_the_camera,
    distance_to_a_lit_surface,
    power_of_a_cone,
    cone_across_the_view,
    intensity,
)
