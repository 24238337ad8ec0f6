"""Sweeps of light transport over the water: how much it scatters, how sharply, and the functions that sample it."""

from functools import cache

import numpy as np
import warp as wp

from benchmarks.stability.entry import Sweeps
from benchmarks.stability.transport import by_each, estimate, off, run, truth_of
from tests.physics.rig import VAROS_LAMPS, one_ray_scene, point, water
from varos_warp.kernels.world.medium import sample_truncated_exponential
from varos_warp.kernels.world.phase import hg_eval, hg_sample_one_minus_cos
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene

BESIDE = (0.15, 0.0, -0.1)
"""A light beside the camera, like the paper's."""


def single_error(sigma_t: float, g: float, integrator: str, lamp=BESIDE, albedo=0.5, spp=256) -> float:
    """Relative error of light scattered once along a ray to the horizon, against quadrature in float64."""
    truth = truth_of(lamp, albedo * sigma_t, sigma_t, g, np.inf)
    scene = one_ray_scene([point(lamp)], water(albedo * sigma_t, sigma_t, g), pixels=8)
    return off(estimate(scene, layer="single", integrator=integrator, spp=spp)[0], truth)


def _worst_over_lamps(g: float, integrator: str) -> float:
    if not -0.99 <= g <= 0.999:
        return np.nan
    return max(single_error(0.1, g, integrator, lamp, spp=1024) for lamp in (BESIDE, (0.02, 0.0, 0.5)))


@wp.kernel(enable_backward=False)
def _phase_values(g: float, one_minus_cos: wp.array(dtype=float), out: wp.array(dtype=float)):
    i = wp.tid()
    out[i] = hg_eval(one_minus_cos[i], g)


@wp.kernel(enable_backward=False)
def _phase_samples(g: float, u: wp.array(dtype=float), out: wp.array(dtype=float)):
    i = wp.tid()
    out[i] = hg_sample_one_minus_cos(g, u[i])


def evenly(count: int) -> np.ndarray:
    """The middles of so many equal parts of 0 .. 1."""
    return ((np.arange(count) + 0.5) / count).astype(np.float32)


def phase_value_error(g: float) -> float:
    """Largest relative error of the phase function over angles, against float64."""
    x = np.geomspace(1e-12, 1.0, 400)
    x = np.concatenate([x, 2.0 - x]).astype(np.float32)
    got = run(_phase_values, [g, x], len(x)).astype(float)
    truth = (1 - g * g) / (4 * np.pi * ((1 - g) ** 2 + 2 * g * x.astype(float)) ** 1.5)
    return float(np.abs(got / truth - 1).max())


def phase_moment_error(g: float) -> float:
    """Relative error of 1 - the mean cosine (forward) or of 1 + it (backward) of a million even samples."""
    u = evenly(1 << 20)
    x = run(_phase_samples, [g, u], len(u)).astype(float)
    return float(abs(x.mean() / (1 - g) - 1) if g >= 0 else abs((2 - x).mean() / (1 + g) - 1))


@cache
def case_zweifel_total(albedo: float, foot: float = 0.0) -> float:
    """Radiance 1 m from an isotropic point source of 1 W in isotropic water with sigma_t = 1/m, along a tangent ray.

    The ray begins ``foot`` [m] before its nearest point. Fluence phi of the infinite medium is a Fourier integral (Case
    and Zweifel 1967): with t(k) = atan(k)/k the transform of what is scattered at least once is c t^2 / (1 - c t). The
    radiance is the integral of c phi / 4 pi along the ray; exp(-r)/(4 pi r^2) of phi is added in closed form.
    """
    k = np.concatenate([[0.0], np.geomspace(1e-6, 1000.0, 60_000)])
    t = np.ones_like(k)
    t[1:] = np.arctan(k[1:]) / k[1:]
    y = np.concatenate([np.linspace(-foot, 0.0, 50)[:-1], np.geomspace(1e-2, 40.0, 200) - 1e-2])
    r = np.sqrt(1.0 + y * y)
    spectrum = albedo * t * t / (1.0 - albedo * t) * k
    scattered = np.array([np.trapezoid(spectrum * np.sin(k * d), k) for d in r]) / (2 * np.pi**2 * r)
    fluence = scattered + np.exp(-r) / (4 * np.pi * r * r)
    return float(np.trapezoid(albedo * fluence / (4 * np.pi) * np.exp(-y - foot), y))


@cache
def isotropic_total(albedo: float, integrator: str, spp: int = 256) -> tuple[float, float]:
    """Radiance of all orders along the ray of case_zweifel_total, and its standard error."""
    scene = one_ray_scene([point((1.0, 0.0, 0.0), 1 / (4 * np.pi))], water(albedo, 1.0, 0.0), pixels=8)
    mean, stderr = estimate(scene, integrator=integrator, spp=spp)
    return float(mean.mean()), float(stderr.max())


def _of_case_zweifel(absorbed: float, integrator: str) -> tuple[float, float]:
    """Radiance of all orders and its standard error over the truth, albedo 1 - ``absorbed``."""
    mean, stderr = isotropic_total(1.0 - absorbed, integrator)
    truth = case_zweifel_total(1.0 - absorbed)
    return mean / truth, stderr / truth


LAMPS = {"spots of 65 degrees": VAROS_LAMPS, "point": [point((0.15, 0, -0.1))]}


@cache
def multiple_errors(sigma_t: float, g: float, lamps: str, spp: int = 4096) -> tuple[float, float]:
    """Relative error of the layer multiple with the field, and of the standard error of the paths it is compared with.

    Of an image of 12 x 8 pixels of open water, on average over the image; albedo 0.8.
    """
    view = {"resolution": (12, 8), "sensor_mm": (6.0, 4.0), "focal_mm": 4.0}
    medium = water(0.8 * sigma_t, sigma_t, g)
    scene = Scene(
        water={"coefficients": medium},
        vehicle={"lights": LAMPS[lamps], "cameras": [view]},
        trajectory={"poses": [{"position": (0, 0, 0)}]},
    )
    renderer = FrameRenderer(scene, "cpu", parts=[])
    how = {"outputs": "A", "layers": ("multiple",), "seed": 5}
    got = renderer.render(np.eye(4), integrator="field", spp=16, **how).A
    truth = renderer.render(np.eye(4), integrator="path", spp=spp, **how).A
    mean = truth.radiance.mean(dtype=float)
    noise = np.sqrt((truth.stderr.mean(axis=2, dtype=float) ** 2).sum()) / got.radiance[..., 0].size
    return float(abs(got.radiance.mean(dtype=float) / mean - 1)), float(noise / mean)


@wp.kernel(enable_backward=False)
def _flight_shares(sigma: float, t_max: float, u: wp.array(dtype=float), out: wp.array(dtype=float)):
    i = wp.tid()
    out[i] = sample_truncated_exponential(sigma, t_max, u[i])


def flight_error(sigma: float, t_max: float) -> float:
    """Largest distance of F(sample(u)) from u, F in float64: 0 for exact samples."""
    u = evenly(4096)
    t = run(_flight_shares, [sigma, t_max, u], len(u)).astype(float)
    return float(np.abs(np.expm1(-sigma * t) / np.expm1(-sigma * t_max) - u).max())


SWEEPS: Sweeps = {
    "single_over_sigma_t": by_each(single_error, 0.8),
    "single_over_optical_distance": {
        name: lambda h, by=name: single_error(1.0, 0.8, by, (h, 0.0, 0.0)) for name in ("field", "path")
    },
    "single_over_g": by_each(_worst_over_lamps, integrators=("field", "path")),
    "phase_function_over_g": {
        "value, g > 0": lambda x: phase_value_error(1 - x),
        "value, g < 0": lambda x: phase_value_error(x - 1),
        "1 - mean cosine, g > 0": lambda x: phase_moment_error(1 - x),
        "1 + mean cosine, g < 0": lambda x: phase_moment_error(x - 1),
    },
    "all_orders_over_albedo": by_each(lambda x, by: abs(_of_case_zweifel(x, by)[0] - 1))
    | {"stderr of path": lambda x: _of_case_zweifel(x, "path")[1]},
    "field_over_sigma_t": {("field", "stderr of path"): lambda s: multiple_errors(s, 0.8, "spots of 65 degrees")},
    "field_over_g": {
        ("spots of 65 degrees", "stderr of path, spots"): lambda g: multiple_errors(0.3, g, "spots of 65 degrees"),
        ("point light", "stderr of path, point light"): lambda g: multiple_errors(0.3, g, "point"),
    },
    "flights_over_optical_depth": {
        "t_max = 5 m": lambda x: flight_error(x / 5.0, 5.0),
        "t_max = 1e9 m": lambda x: flight_error(x / 1e9, 1e9),
    },
}
