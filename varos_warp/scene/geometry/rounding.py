"""Find whether the places of a mesh were rounded to single precision far from the origin, before it was read."""

import numpy as np

COARSE_M = 1e-3
"""A step of single precision that shows [m]: from 16 km on."""
FEWEST = 100
"""Vertices of which something can be told."""


def single_precision_step(vertices: np.ndarray) -> float | None:
    """Return the step [m] to which single precision rounded vertices float64 [V, 3]; None if nothing shows one.

    In every axis that reaches so far out that the step shows, all places are multiples of the step, and so many are odd
    multiples that it is no coarser grid: at random half of them are.
    """
    steps = []
    for values in vertices.T if len(vertices) >= FEWEST else ():
        step = float(np.spacing(np.float32(np.abs(values).max())))
        if step < COARSE_M:
            continue
        if (values.astype(np.float32) != values).any() or np.mean(values / step % 2.0 == 1.0) < 0.125:
            return None
        steps.append(step)
    return max(steps, default=None)
