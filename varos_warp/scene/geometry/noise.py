"""Seeded noise at points of space, on the device that is asked for: what surfaces and stones are formed by."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import warp as wp

from varos_warp.device.devices import upload
from varos_warp.device.launch import launch
from varos_warp.kernels.mesh import noise as kernels

Cycles = float | tuple[float, float, float]
"""Cells of the first octave along every axis, or along each [1/m]."""


class Cells(NamedTuple):
    """Cellular noise at N points (Worley 1996); lengths are in cells."""

    near: np.ndarray
    """float64 [N]: distance to the nearest centre."""
    second: np.ndarray
    """float64 [N]: distance to the one after it."""
    id: np.ndarray
    """float64 [N]: a random number in [0, 1) that a whole cell shares."""

    @property
    def gap(self) -> np.ndarray:
        """How much farther the second is: 0 on the border between two cells."""
        return self.second - self.near


def fbm(
    p: np.ndarray,
    cycles_per_m: Cycles,
    octaves: int = 4,
    seed: int = 0,
    gain: float = 0.5,
    edge: np.ndarray | float = 0.0,
    device: str = "cpu",
    kind: int = kernels.FBM,
) -> np.ndarray:
    """Fractal sum of gradient noise: mean 0, standard deviation 0.18 to 0.2 of several octaves, seldom beyond 0.6.

    Args:
        p: Places, float64 [N, 3] [m].
        cycles_per_m: Cells of the first octave [1/m]; each octave after it has 2.03 times as many.
        seed: Another seed is another noise.
        gain: Weight of an octave over that of the octave before.
        edge: Length of a mesh's edges at the places, one or [N] [m]: octaves whose cells have fewer than 2.5 edges
            fade, those of fewer than 1.33 are left out. 0: all are there.
        device: Where to compute, ``cpu`` or ``cuda:N``.
        kind: Of another sum: RIDGED, a multifractal (Musgrave) with sharp crests, rough where they are high, about 0 to
            1, mean 0.5; or BILLOW, round humps with sharp clefts between them, about -1 to 1, of mean -0.38.

    Returns:
        float64 [N]; on a CPU the same bytes whatever the number of threads.
    """
    value = wp.empty(len(p), dtype=wp.float32, device=device)
    edges = np.broadcast_to(np.asarray(edge, np.float32), len(p))
    how = {
        "kind": int(kind),
        "octaves": octaves,
        "gain": gain,
        "edge": upload(edges, wp.float32, device),
        "value": value,
    }
    return _at_places(kernels.sum_octaves, p, cycles_per_m, seed, value, how)


def _at_places(
    kernel: wp.Kernel, p: np.ndarray, cycles_per_m: Cycles, seed: int, out: wp.array, how: dict
) -> np.ndarray:
    """What a kernel writes to ``out``, one of its arguments ``how``, at places [N, 3] [m]: float64 [N] or [N, K]."""
    device = str(out.device)
    places = {
        "seed": _bits(seed),
        "cycles": _vector(cycles_per_m),
        "points": upload(np.asarray(p, np.float64), wp.vec3d, device),
    }
    launch(kernel, len(p), places | how, device)
    return out.numpy().astype(np.float64)


def fbm_vector(
    p: np.ndarray,
    cycles_per_m: Cycles,
    octaves: int = 3,
    seed: int = 0,
    edge: np.ndarray | float = 0.0,
    device: str = "cpu",
) -> np.ndarray:
    """Three independent sums, float64 [N, 3]: what to move places by before they are looked up elsewhere."""
    return np.stack([fbm(p, cycles_per_m, octaves, seed + axis, 0.5, edge, device) for axis in range(3)], axis=1)


def worley(p: np.ndarray, cycles_per_m: Cycles, seed: int = 0, *, flat: bool = False, device: str = "cpu") -> Cells:
    """Cells around jittered points, one in each cube of a lattice; it is not limited to a band.

    Args:
        cycles_per_m: Cubes of the lattice along each axis [1/m].
        flat: Whether z does not count: points of a plane, one in each square.
    """
    cell = wp.empty(len(p), dtype=wp.vec3, device=device)
    how = {"is_flat": int(flat), "cell": cell}
    return Cells(*_at_places(kernels.find_cells, p, cycles_per_m, seed, cell, how).T)


class Faces(NamedTuple):
    """Faces that lean at random at N points, one in each cell of `worley`."""

    height: np.ndarray
    """float64 [N]: height of mean 0 and without steps, in cells."""
    id: np.ndarray
    """float64 [N]: that of the cell."""


def faces(p: np.ndarray, cycles_per_m: Cycles, seed: int = 0, device: str = "cpu") -> Faces:
    """Faces that lean at random in the cells of `worley`.

    A face leans by a tangent of 1 at most in space. Between faces are edges, a fifth of a cell wide. It is not limited
    to a band.
    """
    face = wp.empty(len(p), dtype=wp.vec2, device=device)
    return Faces(*_at_places(kernels.find_faces, p, cycles_per_m, seed, face, {"face": face}).T)


def resolved(length_m: np.ndarray | float, edge: np.ndarray | float) -> np.ndarray:
    """How much of a form of a length is shown by edges [m]: 1 from 4 edges on, 0 below 2; as octaves fade."""
    return np.clip(2.0 - 4.0 * np.asarray(edge, float) / np.asarray(length_m, float), 0.0, 1.0)


@dataclass(frozen=True)
class Patterns:
    """The noises above at the vertices of one mesh, limited to what its edges show."""

    p: np.ndarray
    """Places of the vertices, float64 [N, 3] [m]."""
    edge: np.ndarray
    """Length of the edges at the vertices, float64 [N] [m]."""
    seed: int
    device: str = "cpu"

    def at(self, p: np.ndarray) -> "Patterns":
        """Return the same noises at other places, for the same vertices."""
        return Patterns(p, self.edge, self.seed, self.device)

    def scaled(self, factor: float) -> "Patterns":
        """Return the same noises ``factor`` times as large."""
        return Patterns(self.p / factor, self.edge / factor, self.seed, self.device)

    def moved(self, amplitude_m: float, cycles: Cycles, salt: int, octaves: int = 2) -> "Patterns":
        """Return the same noises at places that noise has moved by up to ``amplitude_m``."""
        return self.at(
            self.p + amplitude_m * fbm_vector(self.p, cycles, octaves, self._salted(salt), self.edge, self.device)
        )

    def fbm(self, cycles: Cycles, octaves: int, salt: int, gain: float = 0.5) -> np.ndarray:
        """`fbm`, [N]."""
        return self._sum(kernels.FBM, cycles, octaves, salt, gain)

    def ridged(self, cycles: Cycles, octaves: int, salt: int, gain: float = 0.55) -> np.ndarray:
        """`fbm` with sharp crests, [N]."""
        return self._sum(kernels.RIDGED, cycles, octaves, salt, gain)

    def billow(self, cycles: Cycles, octaves: int, salt: int, gain: float = 0.5) -> np.ndarray:
        """`fbm` with round humps, [N]."""
        return self._sum(kernels.BILLOW, cycles, octaves, salt, gain)

    def worley(self, cycles: Cycles, salt: int, *, flat: bool = False) -> Cells:
        """`worley`."""
        return worley(self.p, cycles, self._salted(salt), flat=flat, device=self.device)

    def faces(self, cycles: Cycles, salt: int) -> Faces:
        """`faces`."""
        return faces(self.p, cycles, self._salted(salt), self.device)

    def resolved(self, length_m: np.ndarray | float) -> np.ndarray:
        """`resolved`, [N]."""
        return resolved(length_m, self.edge)

    def _sum(self, kind: int, cycles: Cycles, octaves: int, salt: int, gain: float) -> np.ndarray:
        return fbm(self.p, cycles, octaves, self._salted(salt), gain, self.edge, self.device, kind)

    def _salted(self, salt: int) -> int:
        return 1009 * self.seed + salt


def _vector(cycles: Cycles) -> wp.vec3d:
    return wp.vec3d(*np.broadcast_to(np.asarray(cycles, float), 3).tolist())


def _bits(seed: int) -> wp.uint32:
    """Seeds that follow each other as bits that have nothing in common."""
    return wp.uint32(int(np.random.SeedSequence(seed).generate_state(1)[0]))
