"""Which triangles the mask of a texture may cut: the rest need not be asked, as of a surface without a mask."""

import numpy as np

from varos_warp.scene.geometry.parts import Page

MARGIN = 0.05
"""Texels by which coordinates may be off in single precision."""


def may_cut(page: Page, uv: np.ndarray, fade: np.ndarray | None) -> np.ndarray:
    """Return whether a mask may cut each of some triangles, on the safe side.

    Args:
        uv: Its coordinates at the corners [F, 3, 2], v up.
        fade: Alpha of the corners [F, 3], which multiplies that of the page; None: it is 1.

    Returns:
        bool [F]: false where no texel that is blended into the triangle's bounding box is below the cutoff.
    """
    least = np.ones(len(uv)) if fade is None else fade.min(axis=1)
    anywhere = page.alpha.min() / 255.0 * least < page.cutoff
    opaque = least >= 1.0
    if not (anywhere & opaque).any():
        return anywhere
    u, v = np.moveaxis(np.asarray(uv[opaque], float), 2, 0)
    height, width = page.alpha.shape
    cols, rows = _texels(u, width, page.wrap[0]), _texels(1.0 - v, height, page.wrap[1])
    found = anywhere.copy()
    found[opaque] = _holes_within(page.alpha < 255.0 * page.cutoff, rows, cols) > 0
    return found


def _texels(at, count, wrap):
    """The texels that are blended along one axis: two runs of first and last + 1, [F] each; the second may be empty."""
    low, high = at.min(axis=1), at.max(axis=1)
    first = np.floor(low * count - 0.5 - MARGIN).astype(np.int64)
    last = np.floor(high * count - 0.5 + MARGIN).astype(np.int64) + 2
    inside = (low >= 0.0) & (high <= 1.0)
    if wrap != "repeat":  # beyond its ends all of the texture may be seen
        first, last = (np.where(inside, np.clip(end, 0, count), all_) for end, all_ in ((first, 0), (last, count)))
    every = last - first >= count
    first, last = np.where(every, 0, first), np.where(every, count, last)
    shift = first // count * count
    first, last = first - shift, last - shift
    empty = np.zeros_like(first)
    return (first, np.minimum(last, count)), (empty, np.maximum(last - count, 0))


def _holes_within(holes, rows, cols):
    """How many texels of ``holes`` are in runs of rows and columns, by the table of their sums (Crow 1984)."""
    table = np.zeros((holes.shape[0] + 1, holes.shape[1] + 1), np.int32)
    np.cumsum(holes, axis=0, out=table[1:, 1:])
    np.cumsum(table[1:, 1:], axis=1, out=table[1:, 1:])
    return sum(
        table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]
        for top, bottom in rows
        for left, right in cols
    )
