"""Lenses by their models, with OpenCV's parameters in OpenCV's order: where directions are seen, and the inverse.

A point of the image plane is ((u - cx) / fx, (v - cy) / fy). The models are in perspective.py and fisheye.py.

A lens sees each direction once. Where a model says otherwise, as polynomials do that fall again, it is not followed:
the lens ends there. Beyond, image points see nothing, and directions are seen nowhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from varos_warp.scene.optics.fisheye import DoubleSphere, KannalaBrandt
from varos_warp.scene.optics.perspective import BrownConrady, Rational, along, tangents

BROWN_CONRADY, RATIONAL, KANNALA_BRANDT, DOUBLE_SPHERE = "brown_conrady", "rational", "kannala_brandt", "double_sphere"
LAWS = {BROWN_CONRADY: BrownConrady, RATIONAL: Rational, KANNALA_BRANDT: KannalaBrandt, DOUBLE_SPHERE: DoubleSphere}
"""The law of each model."""
FISHEYES = (KANNALA_BRANDT, DOUBLE_SPHERE)
"""Models that may see behind themselves."""
ALIASES = {
    "none": ("pinhole",),
    BROWN_CONRADY: ("radtan", "plumb_bob", "radial-tangential"),
    RATIONAL: ("rational_polynomial",),
    KANNALA_BRANDT: ("equidistant", "fisheye"),
    DOUBLE_SPHERE: ("ds",),
}
"""Other names of models: Kalibr's, ROS's, OpenCV's and EuRoC's."""


def canonical(model: str) -> str:
    """The name under which a model is kept, of any of its names."""
    return next((name for name, others in ALIASES.items() if model in others), model)


SETTLED = 1e-6
"""How far, over 1 and the distance from the centre, an inverse in float32 is off at most: several of its roundings."""


@dataclass(frozen=True)
class Lens:
    """The way between directions in air, camera axes, and points of the image plane."""

    model: str = "none"
    """Name of the model: none, brown_conrady, rational, kannala_brandt or double_sphere."""
    k: tuple[float, ...] = ()
    """Coefficients in OpenCV's order; of the double sphere xi and alpha."""

    def __post_init__(self) -> None:
        if self.model != "none" and self.model not in LAWS:
            raise ValueError(f"there is no lens {self.model!r} here")

    @cached_property
    def _law(self) -> BrownConrady | Rational | KannalaBrandt | DoubleSphere:
        return LAWS[self.model](self.k)

    @property
    def is_closed_form(self) -> bool:
        """True if directions follow from image points without steps."""
        return self.model in ("none", DOUBLE_SPHERE)

    @property
    def limit(self) -> float:
        """End of the lens: tangent (brown_conrady, rational) or angle [rad] to the axis."""
        return np.inf if self.model == "none" else self._law.limit

    @property
    def half_angle(self) -> float:
        """Half angle of the cone that it sees [rad]."""
        return 0.5 * np.pi if self.model == "none" else self._law.half_angle

    @property
    def central_scale(self) -> float:
        """Distance from the centre over the tangent of the axis, in the middle of the image."""
        return 1.0 / (1.0 + self.k[0]) if self.model == DOUBLE_SPHERE else 1.0

    def reach(self, corners: np.ndarray) -> float:
        """Tangent or angle of the axis that no point of an image exceeds; `limit` where the lens ends within it.

        Args:
            corners: Its first and last point [2, 2] in the image plane.
        """
        border = np.linspace(*corners, 65)
        x, y = np.meshgrid(border[:, 0], border[:, 1])
        d = self.directions(np.stack([x, y], -1))
        angle = np.arctan2(np.hypot(d[..., 0], d[..., 1]), d[..., 2]).max()
        if np.isnan(angle):
            return self.limit
        # between the places tried, a little more
        return min(1.1 * self._law.measure(float(angle)), self._law.radial_end)

    def settles(self, xy: np.ndarray, reach: float, halvings: int, steps: int) -> bool:
        """Return whether a fixed number of steps in float32 leads to the directions seen at all points [N, 2]."""
        target = xy.astype(np.float32)
        with np.errstate(all="ignore"):  # where steps lead anywhere
            found = self._law.short_directions(target, reach, halvings, steps).astype(float)
            off = np.abs(self.image_plane(found) - target).max(-1)
        return bool((off <= SETTLED * (1.0 + np.hypot(target[:, 0], target[:, 1]))).all())

    def edge(self, azimuth: np.ndarray) -> np.ndarray:
        """Points [..., 2] of the image plane at which it ends, by azimuths [...] [rad]; NaN or infinite if nowhere."""
        angle = (1.0 - 1e-9) * self.half_angle
        d = np.stack(
            [np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.full(azimuth.shape, np.cos(angle))],
            -1,
        )
        return self.image_plane(d)

    def image_plane(self, d: np.ndarray) -> np.ndarray:
        """Points [..., 2] of the image plane at which directions [..., 3] of any length are seen; NaN if nowhere."""
        return tangents(d) if self.model == "none" else self._law.image_plane(d)

    def directions(self, xy: np.ndarray) -> np.ndarray:
        """Unit directions [..., 3] that are seen at points [..., 2] of the image plane; NaN where there is none."""
        return along(xy) if self.model == "none" else self._law.directions(xy)


def lens_of(model: str, k: Sequence[float] = (), **named: float) -> Lens:
    """The lens of a block of a scene or dataset.json: a model by any of its names, ``k``, or xi and alpha."""
    name, numbers = canonical(model), tuple(k)
    if name == DOUBLE_SPHERE:
        numbers = (named["xi"], named["alpha"])
    if name == BROWN_CONRADY and len(numbers) == 4:
        numbers += (0.0,)
    return Lens(name, numbers if name != "none" else ())
