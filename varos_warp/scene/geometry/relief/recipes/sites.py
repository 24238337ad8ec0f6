"""What a recipe of a surface is given, and what it gives."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from threading import RLock
from typing import Any, Protocol, Self

import numpy as np

from varos_warp.scene.geometry.noise import Patterns
from varos_warp.scene.geometry.relief.recipes.masks import Shape


class Look(Protocol):
    """A material block, as far as recipes read it."""

    @property
    def paint(self) -> tuple[float, float, float] | None:
        """Linear reflectance of the paint, or of the bare surface; None: the recipe's own."""

    @property
    def wear(self) -> float:
        """0: as new, to 1: nothing is left of the outermost layer."""

    @property
    def silt(self) -> float:
        """0: none, to 1: wherever it can lie."""

    @property
    def film(self) -> float:
        """0: none, to 1: everywhere."""

    @property
    def seed(self) -> int:
        """Another seed is another surface of the same kind."""


@dataclass(frozen=True)
class Sites:
    """The N vertices of a mesh as a recipe sees them."""

    p: np.ndarray
    """float64 [N, 3]: places of patterns in axes that stand with the object, z up where it stands still [m]. They are
    those of the mesh before anything moved it, in all calls alike: a stain then lies on the pit that it belongs to."""
    n: np.ndarray
    """float64 [N, 3]: unit normals in world axes."""
    edge: np.ndarray
    """float64 [N]: mean length of the edges at a vertex [m]; what is shorter than two of them is left out."""
    size: float
    """Diameter of the object, or size of a terrain's features [m]."""
    height: np.ndarray
    """float64 [N]: height over the ground, or over the lowest point of the object [m]."""
    clear: np.ndarray
    """float64 [N]: distance to the nearest other thing that stands there [m]; inf where there is none."""
    middle: np.ndarray | None = None
    """float64 [3]: middle of the object's surface, in the axes of ``p``; None: the mean of the places."""
    spread: np.ndarray | None = None
    """float64 [3, 3]: covariance of the object's surface about it, by area [m^2]; None: that of the places."""
    sharp: np.ndarray | None = None
    """float64 [N]: convexity of the mesh before the recipe moved it, as of `Shape`: where edges chip and wear first.
    None: it has no edges."""
    device: str = "cpu"
    """Device on which noise is computed."""
    known: dict[Hashable, Any] = field(default_factory=dict, repr=False, compare=False)
    """What `once` has made, for all steps of a recipe."""
    whole: Self | None = field(default=None, repr=False, compare=False)
    """The vertices of the whole mesh, where these are some of them."""
    rows: np.ndarray | None = None
    """int [N]: ascending numbers of these vertices in the mesh; None: it is all of them."""
    lock: RLock = field(default_factory=RLock, repr=False, compare=False)

    @property
    def edges(self) -> np.ndarray:
        """How much of a sharp edge is at a vertex, float64 [N]: 0 on flat places, 1 on an edge of about 90 degrees."""
        if self.sharp is None:
            return np.zeros(len(self.p))
        return self.once("edges", lambda: np.clip(3.0 * self.sharp, 0.0, 1.0))

    def once(self, name: Hashable, make: Callable[[], Any]) -> Any:
        """What more than one step of a recipe needs, made in the first: it must not depend on what the steps change."""
        with self.lock:  # threads ask for what is of the whole mesh
            if name not in self.known:
                self.known[name] = make()
            return self.known[name]

    def some(self, rows: np.ndarray) -> Self:
        """Some of the vertices, by their ascending numbers; what is told of the whole mesh stays."""
        columns = {name: getattr(self, name)[rows] for name in ("p", "n", "edge", "height", "clear")}
        sharp = None if self.sharp is None else self.sharp[rows]
        return replace(self, **columns, sharp=sharp, known={}, whole=self, rows=rows, lock=RLock())

    def chances(self, count: int, *seed: int) -> np.ndarray:
        """Uniform numbers [count, N] in [0, 1): those of a vertex are the same, whichever others are asked for."""
        everywhere = self if self.whole is None else self.whole
        first, last = (0, len(self.p) - 1) if self.rows is None else self.rows[[0, -1]].tolist()
        made = np.empty((count, len(self.p)))
        for k in range(count):
            rng = np.random.Generator(np.random.PCG64(seed).advance(k * len(everywhere.p) + first))
            drawn = rng.random(last + 1 - first)
            made[k] = drawn if self.rows is None else drawn[self.rows - first]
        return made

    def patterns(self, seed: int) -> Patterns:
        """Noise at the vertices."""
        return Patterns(self.p, self.edge, seed, self.device)


class Recipe(Protocol):
    """A kind of surface, as functions of the vertices of a mesh."""

    name: str
    by_vertex: bool
    """Whether what it makes of a vertex does not depend on which others it is given: some may be made alone then."""

    def coarse(self, sites: Sites, look: Look) -> np.ndarray:
        """Displacement along the normals [m], float64 [N]: forms larger than about 20 edges."""

    def fine(self, sites: Sites, look: Look) -> np.ndarray:
        """Displacement [m], float64 [N], along the normals of what ``coarse`` has made."""

    def colour(self, sites: Sites, shape: Shape, look: Look) -> tuple[np.ndarray, np.ndarray]:
        """Linear reflectance, float64 [N, 3], and thickness of the silt that lies there [m], float64 [N]."""
