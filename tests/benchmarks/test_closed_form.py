"""Single scattering in open water against adaptive quadrature of the same integral along single rays."""

import numpy as np
import pytest

from benchmarks.closed_form import along_rays, single_scattering_image
from varos_warp.scene.file.load import scene_from_dict

S, A, G = [0.00175, 0.3, 0.8], [0.12, 0.3, 0.0], 0.8


def scene(**lamp):
    return scene_from_dict(
        {
            "water": {"coefficients": {"sigma_s": S, "sigma_a": A, "phase": {"g": G}}},
            "vehicle": {
                "lights": [
                    {"position": [-0.15, -0.1, 0.05], "direction": [0.1, 1, 0.2], "intensity": [1, 2, 3], **lamp}
                ],
                "cameras": [{"resolution": [8, 6]}],
            },
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
        }
    )


def integral(lamp, ray, nodes=200_000, end=300.0):
    """The definition, by midpoints in u with t = foot + h sinh(u): radiance [3] of one ray, and its largest term."""
    p, sigma_t = np.array(lamp.position), np.add(S, A)
    foot = ray @ p
    h = np.linalg.norm(foot * ray - p)
    u = np.linspace(np.arcsinh(-foot / h), np.arcsinh((end - foot) / h), nodes + 1)
    middle = 0.5 * (u[1:] + u[:-1])
    t = foot + h * np.sinh(middle)
    w = t[:, None] * ray - p
    d = np.linalg.norm(w, axis=1)
    mu = -(w @ ray) / d  # light travels along w and is seen travelling along -ray
    phase = (1 - G * G) / (4 * np.pi * (1 + G * G - 2 * G * mu) ** 1.5)
    weight = _edge(lamp, w, d) * phase / d**2 * h * np.cosh(middle) * np.diff(u)
    terms = np.array(S) * lamp.intensity * weight[:, None] * np.exp(-sigma_t * (t + d)[:, None])
    return terms.sum(axis=0), terms.max(axis=0)


def _edge(lamp, w, d):
    if lamp.kind == "point":
        return 1.0
    axis, size = np.array(lamp.direction), np.cos(np.radians(lamp.cone_deg) / 2)
    x = np.clip((w @ axis / np.linalg.norm(axis) / d - size) / ((1 - size) * max(lamp.blend, 1e-12)), 0, 1)
    return x * x * (3 - 2 * x)


@pytest.mark.parametrize(
    "lamp",
    [{"cone_deg": 65}, {"cone_deg": 65, "blend": 0.5}, {"cone_deg": 170}, {"kind": "point"}],
    ids=["hard", "soft", "wide", "point"],
)
def test_a_ray_through_a_cone_of_light(lamp):
    made = scene(**{"kind": "spot", **lamp}) if lamp.get("kind") != "point" else scene_without_direction()
    light = made.vehicle.lights[0]
    rays = np.array([[0.0, 1.0, 0.0], [0.4, 1.0, -0.2], [-0.6, 0.7, 0.3], [0.9, 0.1, -0.4]])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    found = along_rays(made, light, np.zeros(3), rays)
    for ray, values in zip(rays, found, strict=True):
        expected, largest = integral(light, ray)
        # a hard edge falls between midpoints, on the way in and on the way out; what lies beyond 300 m is below 1e-6
        assert (np.abs(values - expected) <= 2.0 * largest + 1e-6 * expected).all()


def scene_without_direction():
    plain = scene().model_dump(mode="json", exclude_unset=True)
    plain["vehicle"]["lights"] = [{"kind": "point", "position": [-0.15, -0.1, 0.05], "intensity": [1, 2, 3]}]
    return scene_from_dict(plain)


def test_a_pixel_is_the_mean_of_its_area():
    made = scene()
    one, few, many = (single_scattering_image(made, points=points).mean(axis=(0, 1)) for points in (1, 3, 6))
    np.testing.assert_allclose(few, many, rtol=1e-3)  # pixels of 8 degrees, with an edge of the cone through them
    assert (np.abs(few / many - 1.0) < np.abs(one / many - 1.0)).all()
