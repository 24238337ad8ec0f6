"""What a recipe of a surface is given, and what it gives."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

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
    """Where noise is computed."""
    known: dict[Hashable, Any] = field(default_factory=dict, repr=False, compare=False)
    """What `once` has made, for all steps of a recipe."""

    @cached_property
    def edges(self) -> np.ndarray:
        """How much of a sharp edge is at a vertex, float64 [N]: 0 on flat places, 1 on an edge of about 90 degrees."""
        return np.zeros(len(self.p)) if self.sharp is None else np.clip(3.0 * self.sharp, 0.0, 1.0)

    def once(self, name: Hashable, make: Callable[[], Any]) -> Any:
        """What a recipe needs in more than one of its steps, made in the first: it must follow from ``p`` alone."""
        if name not in self.known:
            self.known[name] = make()
        return self.known[name]

    def patterns(self, seed: int) -> Patterns:
        """Noise at the vertices."""
        return Patterns(self.p, self.edge, seed, self.device)


class Recipe(Protocol):
    """A kind of surface, as functions of the vertices of a mesh."""

    name: str

    def coarse(self, sites: Sites, look: Look) -> np.ndarray:
        """Displacement along the normals [m], float64 [N]: forms larger than about 20 edges."""

    def fine(self, sites: Sites, look: Look) -> np.ndarray:
        """Displacement [m], float64 [N], along the normals of what ``coarse`` has made."""

    def colour(self, sites: Sites, shape: Shape, look: Look) -> tuple[np.ndarray, np.ndarray]:
        """Linear reflectance, float64 [N, 3], and thickness of the silt that lies there [m], float64 [N]."""
