"""D as geometry: depth along the camera's axis, and the points of the world that pixels see."""

import numpy as np

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.render.image.outputs import OUTPUTS


def pixel_rays(K: np.ndarray, row: np.ndarray, col: np.ndarray) -> np.ndarray:
    """Directions [..., 3] through the centres of pixels, camera axes, z = 1.

    Args:
        K: Intrinsics [3, 3], the centre of the top left pixel at (0.5, 0.5).
        row: Rows [...] from 0.
        col: Columns [...] from 0.
    """
    return np.stack([col + 0.5, row + 0.5, np.ones(np.shape(row))], -1) @ np.linalg.inv(K).T


def planar_depth(data: Dataset, frame: int, camera: str, pixels: np.ndarray | None = None) -> np.ndarray:
    """Metres [H, W] along the camera's z axis, whichever kind D has; inf where it has none.

    ``pixels`` of D, if they are at hand, save reading them.
    """
    if pixels is None:
        depth = data.depth(frame, camera)
    else:
        depth = OUTPUTS["D"].decode(pixels, data.scale("D", frame, camera))
    depth = depth.astype(float)
    if data.meta["depth"]["kind"] == "z":
        return depth
    return depth / np.linalg.norm(pixel_rays(data.intrinsics(camera), *np.indices(depth.shape)), axis=-1)


def project(points: np.ndarray, K: np.ndarray, T_w_c: np.ndarray) -> np.ndarray:
    """Pixel coordinates u, v (the centre of the top left pixel at 0.5) and depth z [m] of world points [N, 3]."""
    p = (points - T_w_c[:3, 3]) @ T_w_c[:3, :3] @ K.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.column_stack([p[:, :2] / p[:, 2:], p[:, 2]])


def points_at(depth: np.ndarray, K: np.ndarray, T_w_c: np.ndarray, row: np.ndarray, col: np.ndarray) -> np.ndarray:
    """Points [N, 3] of the world that pixels (row [N], col [N]) of a map of planar depth [H, W] see."""
    return pixel_rays(K, row, col) * depth[row, col, None] @ T_w_c[:3, :3].T + T_w_c[:3, 3]
