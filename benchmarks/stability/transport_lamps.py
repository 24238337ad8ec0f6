"""Sweeps of light transport over the lights: near the ray, near a surface, narrow, wide, weak and strong."""

import numpy as np
import warp as wp

from benchmarks.stability.entry import Sweeps
from benchmarks.stability.transport import by_each, estimate, off, run, truth_of
from tests.physics.rig import floor, one_ray_scene, point, spot, water
from varos_warp.kernels.world.lights.light import falloff
from varos_warp.kernels.world.lights.record import Light
from varos_warp.scene.lights.distribution import Distribution
from varos_warp.scene.lights.records import light_record


def beside_error(side: float, ahead: float, integrator: str, spp: int = 256) -> float:
    """Relative error of single scattering with a point light ``side`` from the ray and ``ahead`` of the camera [m]."""
    lamp = (side, 0.0, ahead)
    scene = one_ray_scene([point(lamp)], water(0.05, 0.1, 0.8), pixels=8)
    mean, _ = estimate(scene, [floor(5.0, 0.0)], layer="single", integrator=integrator, spp=spp)
    return off(mean, truth_of(lamp, 0.05, 0.1, 0.8, 5.0))


def lit_error(distance: float, size: float, integrator: str) -> float:
    """Relative error of direct light off a plate ``distance`` from camera and light, without water."""
    scene = one_ray_scene([point((0.0, 0.0, 0.0))], None, pixels=4)
    mean, _ = estimate(scene, [floor(distance, 0.5, size)], layer="direct", integrator=integrator, spp=4)
    return off(mean, 0.5 / np.pi / distance**2)


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


def cone_error(cone_deg: float, blend: float, integrator: str, spp: int = 256) -> float:
    """Relative error of single scattering by a spot that crosses the view."""
    lamp, axis = (0.1, 0.0, 0.0), (-0.05, 0.0, 1.0)
    truth = truth_of(lamp, 0.05, 0.1, 0.5, 10.0, axis, cone_deg, blend, 1000)
    scene = one_ray_scene([spot(lamp, axis, cone_deg, blend)], water(0.05, 0.1, 0.5), pixels=8)
    return off(estimate(scene, [floor(10.0, 0.0)], layer="single", integrator=integrator, spp=spp)[0], truth)


def intensity_error(exponent: float, integrator: str) -> float:
    """How far the image of a light of 10^exponent W/sr, divided by that, is from the one of 1 W/sr, in all layers."""
    names = ("direct", "single") if integrator == "field" else ("direct", "single", "multiple")

    def layers(intensity):
        scene = one_ray_scene([point((0.15, 0.0, -0.1))], water(0.05, 0.1, 0.8), pixels=4)
        lamp = scene.vehicle.lights[0].model_copy(update={"intensity": (intensity,) * 3})  # any, unlike a file's
        scene = scene.model_copy(update={"vehicle": scene.vehicle.model_copy(update={"lights": [lamp]})})
        how = {"integrator": integrator, "spp": 16}
        return np.array([estimate(scene, [floor(2.0, 0.5)], layer=name, **how)[0] / intensity for name in names])

    return off(layers(10.0**exponent), layers(1.0))


def _cone_or_nan(cone: float, blend: float, integrator: str) -> float:
    return cone_error(cone, blend, integrator) if 20 <= cone <= 179 or integrator == "path" else np.nan


SWEEPS: Sweeps = {
    "lamp_beside_the_ray": by_each(beside_error, 2.0),
    "lamp_on_the_camera": by_each(beside_error, 0.0),
    "distance_to_a_lit_surface": {
        f"{name}, plate of {label}": lambda d, by=name, least=least: lit_error(d, max(20 * d, least), by)
        for name in ("path", "reference")
        for label, least in {"20 distances": 0.0, "at least 400 m": 200.0}.items()
    },
    "power_of_a_cone": {
        f"blend {blend:g}": lambda cone, soft=blend: flux_error(cone, soft) for blend in (0.0, 0.15, 1.0)
    },
    "cone_across_the_view": {
        f"{name}, blend {blend:g}": lambda cone, by=name, soft=blend: _cone_or_nan(cone, soft, by)
        for name in ("field", "path")
        for blend in (0.0, 1.0)
    },
    "intensity": by_each(lambda x, by: intensity_error(np.log10(x), by)),
}
