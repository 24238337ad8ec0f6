"""D as geometry: depth along the camera's axis, and the points of the world that pixels see.

A pose T_w_c is [4, 4], or that of each row of the image [H, 4, 4], of a rolling shutter (`rows.sight`).
"""

import numpy as np

from varos_warp.render.image.flow import CONVERGED, MOST_TRIES, at_row
from varos_warp.scene.optics.camera import CameraModel, channel_number, pixel_centres


def pixel_rays(model: CameraModel, row: np.ndarray, col: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions [..., 3] of rays through the centres of pixels at rows and columns [...] from 0.

    In camera axes. Directions are unit vectors; of a pinhole z is 1, and the origin is 0.
    """
    if model.is_pinhole:
        return np.zeros(3), np.stack([col + 0.5, row + 0.5, np.ones(np.shape(row))], -1) @ np.linalg.inv(model.K).T
    rays = model.rays(np.stack([col + 0.5, row + 0.5], -1))
    return rays.origin, rays.direction


def along_axis(distance: np.ndarray, model: CameraModel) -> np.ndarray:
    """Metres [H, W] along the camera's z axis, of those along the ray of each pixel; inf stays inf."""
    pixels = np.indices(distance.shape)
    origin, d = pixel_rays(model, pixels[0], pixels[1])
    if model.is_pinhole:
        return distance / np.linalg.norm(d, axis=-1)
    return np.where(np.isfinite(distance), origin[..., 2] + distance * d[..., 2], np.inf)


def along_ray(z: np.ndarray, model: CameraModel) -> np.ndarray:
    """Metres [H, W] along the ray of each pixel in the water, of those along the camera's z axis; inf stays inf."""
    pixels = np.indices(z.shape)
    origin, d = pixel_rays(model, pixels[0], pixels[1])
    if model.is_pinhole:
        return z * np.linalg.norm(d, axis=-1)
    there = np.isfinite(z)
    return np.where(there, (np.where(there, z, 0.0) - origin[..., 2]) / d[..., 2], np.inf)


def project(points: np.ndarray, model: CameraModel, T_w_c: np.ndarray) -> np.ndarray:
    """Pixel coordinates u, v (the centre of the top left pixel at 0.5) and depth z [m] of world points [N, 3]."""
    if T_w_c.ndim == 3:
        return _project_by_rows(points, model, T_w_c)
    return _seen_at((points - T_w_c[:3, 3]) @ T_w_c[:3, :3], model)


def _project_by_rows(points: np.ndarray, model: CameraModel, T_w_c: np.ndarray) -> np.ndarray:
    """The row at which a point is seen tells when it is seen, and so where."""
    row = np.full(len(points), len(T_w_c) / 2)
    for _ in range(MOST_TRIES):
        T = at_row(T_w_c, row)
        seen = _seen_at(np.einsum("nij,ni->nj", T[:, :3, :3], points - T[:, :3, 3]), model)
        ahead = np.isfinite(seen[:, 1]) & (seen[:, 2] > 0)
        before, row = row, np.where(ahead, seen[:, 1].clip(0, len(T_w_c)), row)
        if np.abs(row - before).max(initial=0.0) < CONVERGED:
            break
    return seen


def _seen_at(p: np.ndarray, model: CameraModel) -> np.ndarray:
    """u, v and z of points [N, 3] in camera axes."""
    if not model.is_pinhole:
        return np.column_stack([model.project(p), p[:, 2]])
    with np.errstate(divide="ignore", invalid="ignore"):
        p = p @ model.K.T
        return np.column_stack([p[:, :2] / p[:, 2:], p[:, 2]])


def along_rays(model: CameraModel, row: np.ndarray, col: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Points [..., 3] in camera axes that pixels (row, col) see at a depth z along the axis, all [...]."""
    origin, d = pixel_rays(model, row, col)
    if model.is_pinhole:
        return d * z[..., None]
    return origin + d * ((z - origin[..., 2]) / d[..., 2])[..., None]


def colour_offsets(depth: np.ndarray, model: CameraModel, channel: str) -> np.ndarray:
    """Image points [H, W, 2] [pixels] at which a channel shows what pixels show in green, less those of the pixels.

    ``depth`` [H, W] [m] is that along the axis; NaN where it is infinite.
    """
    z = np.where(np.isfinite(depth), depth, np.nan)
    pixels = np.indices(z.shape)
    seen = along_rays(model, pixels[0], pixels[1], z)
    return model.project(seen, channel_number(channel)) - pixel_centres(*z.shape[::-1])


def points_at(model: CameraModel, T_w_c: np.ndarray, row: np.ndarray, col: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Points [N, 3] of the world that pixels (row, col) see at a depth z [m] along the camera's axis, all [N]."""
    seen = along_rays(model, row, col, z)
    if T_w_c.ndim == 2:
        return seen @ T_w_c[:3, :3].T + T_w_c[:3, 3]
    T = at_row(T_w_c, row + 0.5)
    return np.einsum("nij,nj->ni", T[:, :3, :3], seen) + T[:, :3, 3]


def seen_pixels(depth: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row, column and depth [N] of the pixels of a map of depth [H, W] that have any, on a grid of about ``most``."""
    step = max(1, round(np.sqrt(depth.size / most)))
    row, col = (grid.ravel() for grid in np.indices(depth.shape)[:, step // 2 :: step, step // 2 :: step])
    there = np.isfinite(depth[row, col])
    return row[there], col[there], depth[row, col][there]
