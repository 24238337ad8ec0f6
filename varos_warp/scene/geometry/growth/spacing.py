"""Copies whose bodies would overlap: the first of each two by their priority stays."""

import numpy as np
from scipy.spatial import cKDTree


def apart(points: np.ndarray, size: np.ndarray, body: float, priority: np.ndarray) -> np.ndarray:
    """Which copies stay, bool [N]: those that a copy of higher priority, which stays, does not come too near to.

    The result is that of laying them down one after the other (dart throwing), whatever their order.

    Args:
        points: Where they stand, float64 [N, 3] [m].
        size: How large they are [N] [m].
        body: Least distance of two of them over the mean of their sizes; 0: all stay.
        priority: uint64 [N], all different; the highest comes first.
    """
    stays = np.ones(len(points), bool)
    if body == 0.0 or len(points) < 2:
        return stays
    pairs = cKDTree(points).query_pairs(body * size.max(), output_type="ndarray")
    one, other = pairs.T
    gap = np.linalg.norm(points[one] - points[other], axis=1)
    pairs = pairs[gap < 0.5 * body * (size[one] + size[other])]
    first = priority[pairs[:, 0]] > priority[pairs[:, 1]]
    winner, loser = np.where(first, *pairs.T), np.where(first, *pairs.T[::-1])
    decided = np.ones(len(points), bool)
    decided[loser] = False
    while len(winner):
        # what no undecided copy beats stays, and drives out whom it beats
        out = loser[decided[winner]]
        stays[out], decided[out] = False, True
        left = stays[winner] & stays[loser]
        winner, loser = winner[left], loser[left]
        beaten = np.zeros(len(points), bool)
        beaten[loser] = True
        decided |= ~beaten
    return stays
