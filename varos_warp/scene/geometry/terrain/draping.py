"""The shrinkwrap of a height field: a regular grid draped over the model as seen from above."""

import numpy as np
from scipy.interpolate import NearestNDInterpolator
from scipy.ndimage import binary_dilation, binary_fill_holes

from varos_warp.scene.geometry.procedural import grid_mesh
from varos_warp.scene.geometry.topology import chunks, extents

ROUNDING = 1e-7
"""What float64 loses at UTM coordinates on a grid of centimetres, in grid steps and barycentric coordinates."""


def drape(vertices, faces, resolution: int, region=None):
    """A regular grid draped over the model as seen from above, ``resolution`` vertices along the longer side.

    Holes inside the outline are closed smoothly; beyond the outline there is nothing.
    """
    low, high = vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)
    if region is not None:
        low, high = np.maximum(low, region[:2]), np.minimum(high, region[2:])
    step = (high - low).max() / (resolution - 1)
    x, y = (np.linspace(low[i], high[i], max(2, round((high[i] - low[i]) / step) + 1)) for i in range(2))
    z = rasterise(vertices, faces, x, y)
    covered = np.isfinite(z)
    keep = binary_fill_holes(covered)
    if not keep.any():
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    return grid_mesh(x, y, _fill(z, keep & ~covered), keep)


def rasterise(vertices, faces, x, y, chunk: int = 2_000_000):
    """Height [len(y), len(x)] of the highest surface over every node of a regular grid; NaN where there is none.

    Every triangle is tried on the nodes of its bounding rectangle, a bounded number of pairs at a time.
    """
    z = np.full((len(y), len(x)), -np.inf)
    origin, step = np.array([x[0], y[0]]), np.array([np.ptp(x) / (len(x) - 1), np.ptp(y) / (len(y) - 1)])
    for part in chunks(len(faces)):
        triangles = vertices[faces[part]]
        flat = (triangles[..., :2] - origin) / step
        low, high = extents(flat)
        first = np.clip(np.ceil(low - ROUNDING), 0, None).astype(np.int64)
        last = np.minimum(np.floor(high + ROUNDING), (len(x) - 1, len(y) - 1)).astype(np.int64)
        span = np.maximum(last - first + 1, 0)
        count = span.prod(axis=1)
        bounds = np.searchsorted(np.cumsum(count), np.arange(0, max(count.sum(), 1) + chunk, chunk))
        for start, stop in zip(bounds[:-1], np.append(bounds[1:-1], len(triangles)), strict=True):
            _raster_chunk(z, flat, triangles[..., 2], first, span, count, np.arange(start, stop))
    return np.where(np.isfinite(z), z, np.nan)


def _raster_chunk(z, flat, heights, first, span, count, members):
    """Raise ``z`` to the triangles ``members``, in units of grid steps."""
    which = np.repeat(members, count[members])
    offset = np.arange(len(which)) - np.repeat(np.cumsum(count[members]) - count[members], count[members])
    column = first[which, 0] + offset % span[which, 0]
    row = first[which, 1] + offset // span[which, 0]
    a, b, c = (flat[which, i] for i in range(3))
    p = np.column_stack([column, row]) - a
    ab, ac = b - a, c - a
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    safe = np.where(area == 0.0, 1.0, area)
    v = (p[:, 0] * ac[:, 1] - p[:, 1] * ac[:, 0]) / safe
    w = (ab[:, 0] * p[:, 1] - ab[:, 1] * p[:, 0]) / safe
    hit = (area != 0.0) & (v >= -ROUNDING) & (w >= -ROUNDING) & (v + w <= 1.0 + ROUNDING)
    h = heights[which]
    np.maximum.at(z, (row[hit], column[hit]), (h[:, 0] + v * (h[:, 1] - h[:, 0]) + w * (h[:, 2] - h[:, 0]))[hit])


def _fill(z, holes):
    """Heights with ``holes`` closed: the harmonic surface through their rims, by repeated averaging."""
    if not holes.any():
        return z
    rim = binary_dilation(holes, np.ones((3, 3))) & ~holes & np.isfinite(z)
    z = z.copy()
    z[holes] = NearestNDInterpolator(np.argwhere(rim), z[rim])(np.argwhere(holes))
    row, column = np.nonzero(holes)
    up, down = np.maximum(row - 1, 0), np.minimum(row + 1, z.shape[0] - 1)
    left, right = np.maximum(column - 1, 0), np.minimum(column + 1, z.shape[1] - 1)
    for _ in range(4 * max(z.shape)):
        z[row, column] = 0.25 * (z[up, column] + z[down, column] + z[row, left] + z[row, right])
    return z
