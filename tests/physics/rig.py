"""A camera that looks along one ray, lamps and water around it, and a quadrature to compare with.

The ray starts at the origin along +z of the notes that hold the truths; that is +y of the vehicle. A floor of any
reflectance may end it at a distance T.
"""

from contextlib import AbstractContextManager
from unittest import mock

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.integrate import quad

from tests.truths import SIGMAS, compare
from varos_warp.render.field import open_water
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Part

RED, GREEN, BLUE = (0.00175, 0.125), (0.01825, 0.057989), (0.043125, 0.043125)
VAROS_WATER = {"sigma_s": [0.00175, 0.01825, 0.043125], "sigma_a": [0.12325, 0.039739, 0.0]}
TURBID = {"sigma_s": [0.55, 0.7, 0.8], "sigma_a": [0.45, 0.3, 0.2], "phase": {"g": 0.8}}
"""Turbid water of three albedos, one a channel. Tests that share it share its field, which is solved once a run."""
ISOTROPIC = {"sigma_s": [0.5, 0.9, 0.0], "sigma_a": [0.5, 0.1, 1.0], "phase": {"g": 0.0}}
"""Water of two albedos in which all orders of light are known, and no scattering in blue."""
Z = SIGMAS
TABLES = ("MULTIPLE", "SINGLE")
"""Nodes of what is kept along the rays of a camera."""


def to_vehicle(p):
    """Point (x right, y up, z along the ray) of the notes in vehicle axes."""
    return [float(p[0]), float(p[2]), float(p[1])]


def point(position, intensity=1.0):
    return {"kind": "point", "position": to_vehicle(position), "intensity": [intensity] * 3}


def spot(position, axis=(0, 0, 1), cone_deg=65.0, blend=0.0):
    return {
        "kind": "spot",
        "position": to_vehicle(position),
        "direction": to_vehicle(axis),
        "cone_deg": cone_deg,
        "blend": blend,
        "intensity": [1.0, 1.0, 1.0],
    }


VAROS_LAMPS = [spot((-0.15, 0, -0.1)), spot((0.15, 0, -0.1))]


def varos_lamps(gone):
    """The paper's lamps, seen from ``gone`` metres along the ray."""
    return [spot((x, 0, -0.1 - gone)) for x in (-0.15, 0.15)]


def water(sigma_s, sigma_t, g):
    """The same in all channels."""
    return {"sigma_s": [sigma_s] * 3, "sigma_a": [sigma_t - sigma_s] * 3, "phase": {"g": g}}


def floor(distance, reflectance, size=200.0, offset=(0.0, 0.0, 0.0)):
    """A square plate across the ray."""
    corners = np.array(
        [[-size, distance, -size], [size, distance, -size], [size, distance, size], [-size, distance, size]]
    )
    return Part(
        "floor", corners + offset, np.array([[0, 2, 1], [0, 3, 2]], np.int32), Diffuse(reflectance=[reflectance] * 3)
    )


def one_ray_scene(lights, coefficients, direction=(0, 0, 1), pixels=16, **camera):
    """Every pixel of the camera sees the same ray, to 1e-7 rad."""
    view = {
        "id": "M0",
        "look_at": to_vehicle(direction),
        "resolution": [pixels, pixels],
        "sensor_mm": [1e-3, 1e-3],
        "focal_mm": 1e4,
        **camera,
    }
    return Scene(
        water="none" if coefficients is None else {"coefficients": coefficients},
        vehicle={"lights": lights, "cameras": [view]},
        trajectory={"poses": [{"position": [0, 0, 0]}]},
    )


def tables_of_one_ray() -> AbstractContextManager:
    """Tables along the rays of a camera have all nodes along a ray, and across the image as few as one ray needs.

    Its corners see the same, so that what is looked up between them is as right as with all nodes.
    """
    return mock.patch.multiple(
        open_water,
        **{name: (nodes := getattr(open_water, name))._replace(counts=(nodes.counts[0], 2, 3)) for name in TABLES},
    )


def radiance(scene, parts=(), layer=None, device="cpu", **how):
    """Mean over the pixels and its standard error, float64 [3] each; of one layer or of the total."""
    how = {"spp": 64, "seed": 7, "integrator": "path"} | how
    if layer:
        how["layers"] = (layer,)
    with tables_of_one_ray():
        image = FrameRenderer(scene, device, parts=list(parts)).render(np.eye(4), outputs="A", **how).A
    pixels = image.radiance.reshape(-1, 3).astype(float)
    return pixels.mean(axis=0), np.sqrt((image.stderr.astype(float) ** 2).sum(axis=(0, 1))) / len(pixels)


def line_of_sight(lights, coefficients, T, *, seed=7, **how):
    """Radiance of a ray that ends at ``T`` while the water goes on behind it, as no floor can make it.

    The whole open ray less what its part behind T sends through the first T metres; the lamps are moved instead of the
    camera. ``lights`` is a function of the distance that the camera has gone.
    """
    whole = radiance(one_ray_scene(lights(0.0), coefficients), **how, seed=seed)
    if np.isinf(T):
        return whole
    behind = radiance(one_ray_scene(lights(T), coefficients), **how, seed=seed + 1)
    through = np.exp(-T * (np.array(coefficients["sigma_s"]) + np.array(coefficients["sigma_a"])))
    return whole[0] - through * behind[0], np.hypot(whole[1], through * behind[1])


def agreement(estimate, expected, truth_stderr=0.0, precision=0.01, tolerance=0.0, reason="") -> dict:
    """An estimate beside what is known, as a truth takes it: Z standard errors of both, and float32 rounding (2e-5).

    The error must be small enough to tell; ``tolerance`` is relative, with its reason.
    """
    mean, stderr = estimate
    expected = np.broadcast_to(np.asarray(expected, float), 3)
    assert np.all(stderr <= precision * expected), f"too noisy to tell: {stderr / expected}"
    return {
        "expected": expected,
        "got": mean,
        "stderr": np.hypot(stderr, truth_stderr),
        "tolerance": (2e-5 + tolerance) * expected,
        "reason": reason or "float32 rounding",
    }


def assert_agrees(estimate, expected, truth_stderr=0.0, precision=0.01):
    """The same for what is not a truth of the field."""
    compared = compare(**agreement(estimate, expected, truth_stderr, precision))
    assert compared["share"] <= 1.0, compared


def hg(cos_theta, g):
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cos_theta) ** 1.5)


def smoothstep_edge(cos_angle, cone_deg, blend):
    """Blender's soft edge."""
    size = np.cos(np.radians(cone_deg) / 2)
    x = np.clip((cos_angle - size) / max(blend * (1 - size), 1e-12), 0.0, 1.0)
    return x * x * (3 - 2 * x)


def single_scattering(p, sigma_s, sigma_t, g, T, axis=None, cone_deg=360.0, blend=0.0, breaks=400):
    """Radiance along +z from a unit lamp at ``p``, by adaptive quadrature in the equiangular angle."""
    p = np.asarray(p, float)
    h, foot = np.hypot(p[0], p[1]), p[2]

    def integrand(theta):
        y = h * np.tan(theta)
        d = np.hypot(h, y)
        edge = 1.0
        if axis is not None:
            along = np.asarray(axis, float) / np.linalg.norm(axis)
            edge = smoothstep_edge(((foot + y) * along[2] - p @ along) / d, cone_deg, blend)
        return edge * sigma_s * hg(-y / d, g) * np.exp(-sigma_t * (foot + y + d)) / h

    end = np.pi / 2 if np.isinf(T) else np.arctan2(T - foot, h)
    nodes = np.linspace(np.arctan2(-foot, h), end, breaks + 1)
    return integral(integrand, nodes)


def integral(f, nodes):
    """Of a function of arrays, from node to node; by `quad` where two rules of Gauss and Legendre differ."""
    middle, half = (nodes[1:] + nodes[:-1]) / 2, np.diff(nodes) / 2
    fine, coarse = (half * (f(middle[:, None] + half[:, None] * x) @ w) for x, w in map(leggauss, (20, 12)))
    for i in np.flatnonzero(np.abs(fine - coarse) > 1e-10 * np.abs(fine).sum() / len(fine)):
        fine[i] = quad(f, nodes[i], nodes[i + 1], epsabs=0, epsrel=1e-10)[0]
    return fine.sum()
