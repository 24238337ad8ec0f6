"""Single scattering in open water, by quadrature: no random numbers, and no code shared with the kernels."""

import numpy as np

from benchmarks.peers.view import soft_edge
from varos_warp.scene.description import Scene
from varos_warp.scene.description.lights import SpotLight
from varos_warp.scene.frames import camera_pose, intrinsics
from varos_warp.scene.water import optical_properties

DISTANCES_M = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
"""Ends of the pieces of a ray, beside those where it enters and leaves a cone. What lies beyond is below 1e-6."""


def single_scattering_image(scene: Scene, nodes: int = 16, points: int = 2) -> np.ndarray:
    """Radiance [H, W, 3] of the first camera, a pinhole, of what its lights send through water without surfaces.

    Integral of sigma_s p(cos) I exp(-sigma_t (t + d)) / d^2 along the ray, in the equiangular variable (Kulla and
    Fajardo 2012), by Gauss-Legendre in pieces with ends where the ray crosses the cone, and ``points`` across a pixel
    each way.
    """
    view = scene.vehicle.cameras[0]
    width, height = view.resolution
    T_v_c, backwards = camera_pose(view, np.eye(4)), np.linalg.inv(intrinsics(view))
    offsets, weights = np.polynomial.legendre.leggauss(points)
    image = np.zeros((height, width, 3))
    columns = np.arange(width)[:, None] + 0.5 + 0.5 * offsets
    for row in range(height):
        for y, weight in zip(row + 0.5 + 0.5 * offsets, weights, strict=True):
            rays = np.stack([columns, np.full_like(columns, y), np.ones_like(columns)], -1).reshape(-1, 3)
            rays = rays @ backwards.T @ T_v_c[:3, :3].T
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            light = sum(along_rays(scene, lamp, T_v_c[:3, 3], rays, nodes) for lamp in scene.vehicle.lights)
            image[row] += 0.25 * weight * (light.reshape(width, points, 3) * weights[:, None]).sum(axis=1)
    return image


def along_rays(scene: Scene, lamp, origin: np.ndarray, rays: np.ndarray, nodes: int = 16) -> np.ndarray:
    """Radiance [n, 3] that one light sends along unit ``rays`` [n, 3] from ``origin``, vehicle axes."""
    water, v = optical_properties(scene), origin - np.asarray(lamp.position, float)
    nearest = -rays @ v
    h = np.sqrt(np.maximum(v @ v - nearest**2, 1e-24))
    ends = np.broadcast_to(DISTANCES_M, (len(rays), len(DISTANCES_M)))
    axis = None
    if isinstance(lamp, SpotLight) and lamp.cone_deg < 360.0:
        axis = np.asarray(lamp.direction, float) / np.linalg.norm(lamp.direction)
        size = np.cos(np.radians(lamp.cone_deg) / 2)
        for cosine in (size, size + lamp.blend * (1.0 - size)):  # where the soft edge begins and where it ends
            ends = np.concatenate([ends, _crossings(v, rays, axis, cosine)], axis=1)
    angles = np.arctan2(np.sort(ends, axis=1) - nearest[:, None], h[:, None])
    x, w = np.polynomial.legendre.leggauss(nodes)
    middle, half = 0.5 * (angles[:, 1:] + angles[:, :-1]), 0.5 * np.diff(angles, axis=1)
    theta = (middle[..., None] + half[..., None] * x).reshape(len(rays), -1)
    t = nearest[:, None] + h[:, None] * np.tan(theta)
    d = h[:, None] / np.cos(theta)
    integrand = (half[..., None] * w).reshape(theta.shape) / h[:, None]
    integrand *= water.phase.eval(-np.sin(theta))
    if axis is not None:
        cosine = (v @ axis + t * (rays @ axis)[:, None]) / d
        integrand *= soft_edge(cosine, np.radians(lamp.cone_deg) / 2, lamp.blend)
    path = np.maximum(t + d, 0.0)
    return np.stack(
        [
            water.sigma_s[k] * lamp.intensity[k] * (integrand * np.exp(-water.sigma_t[k] * path)).sum(axis=1)
            for k in range(3)
        ],
        axis=1,
    )


def _crossings(v, rays, axis, cosine: float) -> np.ndarray:
    """Distances [n, 2] at which rays cross a cone or its mirror image, 0 where they do not."""
    a, b = rays @ axis, v @ axis
    A, B, C = a**2 - cosine**2, a * b - cosine**2 * (rays @ v), b**2 - cosine**2 * (v @ v)
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(B**2 - A * C)
        distances = np.stack([(-B - root) / A, (-B + root) / A], axis=1)
    return np.clip(np.nan_to_num(distances, nan=0.0, posinf=0.0, neginf=0.0), 0.0, DISTANCES_M[-1])
