"""What runs down a surface from where it starts: drips of rust, curtains of silt, streaks of lime."""

from dataclasses import dataclass

import numpy as np
import warp as wp
from scipy import sparse

from varos_warp.device.devices import upload
from varos_warp.device.launch import launch
from varos_warp.kernels.mesh.runs import find_uphill

MOST_STEPS = 512
"""Edges that a run is long at most."""


@dataclass(frozen=True, eq=False)
class Slopes:
    """The ways that water takes down a mesh of N vertices."""

    above: np.ndarray
    """int32 [N]: the vertex that water comes from; the vertex itself at the top of a way."""
    way: np.ndarray
    """float32 [N]: how far that is, over the sine of the slope [m]; infinite at the top."""
    neighbours: sparse.csr_array
    """float64 [N, N]: 1 where an edge joins two vertices."""

    def runs(self, start: np.ndarray) -> np.ndarray:
        """How far what passes a vertex has yet to run, float32 [N] [m]; 0 where nothing comes to.

        Args:
            start: How far something runs down that starts at a vertex [m], float [N]; 0: nothing does. Of what meets,
                the longer run counts.
        """
        left, way, above = np.asarray(start, np.float32), self.way, self.above
        longest = left.max(initial=0.0)
        # after k rounds each vertex knows all starts up to 2^k edges above it, and how far that vertex is
        for _ in range(MOST_STEPS.bit_length() - 1):
            if way.min(initial=np.inf) >= longest:
                break
            left = np.maximum(left, left[above] - way)
            way, above = way + way[above], above[above]
        return left

    def softened(self, values: np.ndarray) -> np.ndarray:
        """Values [N] averaged with those of the neighbours: runs are no thinner than two edges then."""
        degree = np.diff(self.neighbours.indptr)
        return (2.0 * values + self.neighbours @ values) / (2.0 + degree)


def slopes_of(p: np.ndarray, n: np.ndarray, neighbours: sparse.csr_array) -> Slopes:
    """The ways of water down a mesh.

    Args:
        p: Places, float64 [N, 3] [m].
        n: Unit normals, float64 [N, 3].
        neighbours: Which vertices edges join, [N, N].
    """
    above = wp.empty(len(p), dtype=wp.int32, device="cpu")
    way = wp.empty(len(p), dtype=wp.float32, device="cpu")
    launch(
        find_uphill,
        len(p),
        {
            "seed": wp.uint32(0),
            "points": upload((p - p.mean(axis=0)).astype(np.float32), wp.vec3, "cpu"),
            "normals": upload(np.asarray(n, np.float32), wp.vec3, "cpu"),
            "starts": upload(neighbours.indptr.astype(np.int32), wp.int32, "cpu"),
            "joined": upload(neighbours.indices.astype(np.int32), wp.int32, "cpu"),
            "above": above,
            "way": way,
        },
        "cpu",
    )
    return Slopes(above.numpy(), way.numpy(), neighbours)
