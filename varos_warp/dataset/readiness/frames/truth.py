"""Find what a frame shows in the next frame of the dataset: by F, or by D and the poses."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.points import points_at, project
from varos_warp.dataset.reader.rows import sight
from varos_warp.scene.description.image_types import DEPTH, FLOW

NEARER = 0.01
"""Share of its depth by which all around a place must be nearer than a point to hide it: D is of pixels' centres."""


@dataclass(frozen=True)
class Moves:
    """What becomes of each pixel; places as OpenCV counts them, the centre of the top left pixel at (0, 0)."""

    place: np.ndarray
    """Place in the next frame, float64 [H, W, 2]: right, down; NaN: not known."""
    hidden: np.ndarray
    """True where something is in front of it then, bool [H, W]."""

    def of(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places [N, 2] and whether hidden [N] of image points [N, 2]: each moves with the pixel that it lies in."""
        pixel = np.rint(points).astype(int)
        col, row = pixel[:, 0].clip(0, self.hidden.shape[1] - 1), pixel[:, 1].clip(0, self.hidden.shape[0] - 1)
        return self.place[row, col] + (points - np.column_stack([col, row])), self.hidden[row, col]


def source_of_moves(data: Dataset) -> str | None:
    """What `moves` follows: ``F``, ``D``, or None where there is neither, or objects move, which D does not tell."""
    if FLOW in data.outputs and data.frames == list(range(data.frames[0], data.frames[0] + len(data))):
        return FLOW
    return DEPTH if DEPTH in data.outputs and not data.moving else None


def moves(data: Dataset, index: int, camera: str) -> Moves:
    """Moves from the frame at a place of the dataset to the one after it; `source_of_moves` says of what."""
    if source_of_moves(data) == FLOW:
        found = data.flow(data.frames[index], camera)
        rows, cols = np.indices(found.occluded.shape)
        return Moves(np.stack([cols, rows], -1) + found.flow.astype(float), found.occluded)
    return _from_depth(data, data.frames[index], data.frames[index + 1], camera)


def _from_depth(data: Dataset, frame: int, following: int, camera: str) -> Moves:
    depth, later = data.planar_depth(frame, camera), data.planar_depth(following, camera)
    model = data.camera_model(camera)
    place, hidden = np.full((*depth.shape, 2), np.nan), np.zeros(depth.shape, bool)
    row, col = np.nonzero(np.isfinite(depth))
    points = points_at(model, sight(data, frame, camera), row, col, depth[row, col])
    seen = project(points, model, sight(data, following, camera))
    seen[~(seen[:, 2] > 0)] = np.nan
    place[row, col] = seen[:, :2] - 0.5
    hidden[row, col] = hidden_behind(later, seen)
    return Moves(place, hidden)


def hidden_behind(depth: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return whether all pixels of D [H, W] [m] around points are nearer than these are, bool [N].

    ``seen`` [N, 3]: u, v (the centre of the top left pixel at 0.5) and the depth of each; outside nothing hides.
    """
    around = maximum_filter(depth, 3, mode="nearest")
    u, v = (np.floor(np.nan_to_num(seen[:, i], nan=-1.0, posinf=-1.0, neginf=-1.0)) for i in range(2))
    inside = (u >= 0) & (u < depth.shape[1]) & (v >= 0) & (v < depth.shape[0])
    nearest = np.full(len(seen), np.inf)
    nearest[inside] = around[v[inside].astype(int), u[inside].astype(int)]
    return nearest < seen[:, 2] * (1.0 - NEARER)
