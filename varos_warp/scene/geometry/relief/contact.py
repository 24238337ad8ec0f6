"""The foot of things in the ground: how high they stand over it, and the fine sediment that lies against them.

The bank of the ground and the foot of the thing are of one tone, which thins out on both, so that no line of colour is
left where they meet.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from varos_warp.scene.geometry.noise import Patterns
from varos_warp.scene.geometry.parts import Instances, Moving, Part
from varos_warp.scene.geometry.relief.drifts import drift, least_width, size_of, unevenness
from varos_warp.scene.geometry.relief.recipes.blending import mix, smoothstep
from varos_warp.scene.geometry.relief.recipes.layers import SILT, SILT_DARK
from varos_warp.scene.geometry.surface import Surface

TONE = 0.82
"""Reflectance of what lies at a foot over that of silt: sand is mixed into it."""
THIN, THINNEST_M, WIDEST_M = 0.22, 0.015, 0.09
"""Height over the bank by which the sediment on a body has thinned out, over the body's size, and its bounds [m]."""
BESIDE_M = 0.08
"""Distance from a body to which the ground has the tone of its foot [m]."""
SALT = 950
"""Salt of the noise of these layers."""

Height = Callable[[np.ndarray], np.ndarray]
"""Height [N] over the ground [m] of points [N, 3]; infinite where there is none."""


def _no_bank(points):
    return np.zeros(len(points))


@dataclass(frozen=True, eq=False)
class Foot:
    """How a thing stands in the ground."""

    height: Height
    """Height over the ground before its relief, of points about the middle of the thing's base."""
    size: float
    """Size of the thing that its bank is in proportion to [m]."""
    bank: Height = field(default=_no_bank)
    """Height of the bank over the ground, of the same points."""

    def covers(self, points: np.ndarray, pattern: Patterns) -> np.ndarray:
        """How much of the surface is under sediment, [N]: all below the bank's top, then less; ragged."""
        thin = float(np.clip(THIN * self.size, THINNEST_M, WIDEST_M))
        ragged = 1.3 * pattern.fbm(30.0, 4, SALT + 1) - 0.5
        return 1.0 - smoothstep(0.0, thin, self.height(points) - self.bank(points) + thin * ragged)


def foot_of(
    part: Part | Instances, ground: Surface | None, middle: np.ndarray, banked: bool, seed: int = 0
) -> Foot | None:
    """How a part stands in the ground; None: it does not, or there is none, or it moves.

    Copies of one mesh share what lies on it, by the mean of where they stand.

    Args:
        ground: The terrain before its relief.
        middle: Middle of the part's base, which points are about [m].
        banked: Whether the ground banks up against what stands in it.
    """
    if ground is None or isinstance(part, Moving):
        return None
    if isinstance(part, Instances):
        level = (_ground_under(ground, part.T_w_o[:, :3, 3]) - part.T_w_o[:, 2, 3]) / part.scale
        level = float(level[np.isfinite(level)].mean()) if np.isfinite(level).any() else np.inf

        def height(points):
            return points[:, 2] + middle[2] - level
    else:
        under = _ground_under(ground, part.vertices)
        level = float(under[np.argmin(np.abs(part.vertices[:, 2] - under))])

        def height(points):
            return points[:, 2] + middle[2] - _ground_under(ground, points + middle)

    top = part.vertices[:, 2].max()
    if not part.vertices[:, 2].min() <= level <= top:
        return None
    size = size_of(least_width(part.vertices[:, :2]), top - level)
    return Foot(height, size, lambda points: banked * drift(0.0, size, 0.0, unevenness(points + middle, size, seed)))


def _ground_under(ground, points):
    """Height [N] of the highest ground under or over points [N, 3]; -inf beside it."""
    from_above = np.column_stack([points[:, :2], np.full(len(points), ground.vertices[:, 2].max() + 1.0)])
    return from_above[:, 2] - ground.distances(from_above, np.broadcast_to([0.0, 0.0, -1.0], from_above.shape))


def beside(clear: np.ndarray, pattern: Patterns) -> np.ndarray:
    """How much of the ground has the tone of what lies at a foot, [N], by the distance from the nearest body."""
    near = np.minimum(clear, 2.0 * BESIDE_M)
    return 1.0 - smoothstep(0.15 * BESIDE_M, BESIDE_M, near + BESIDE_M * (1.2 * pattern.fbm(12.0, 4, SALT + 2)))


def settled(colour: np.ndarray, cover: np.ndarray, pattern: Patterns, tint: np.ndarray) -> np.ndarray:
    """Colours [N, 3] under fine sediment that covers so much [N]; its tint [3] is that of the ground."""
    tone = mix(SILT_DARK, SILT, smoothstep(-0.4, 0.4, pattern.fbm(5.0, 4, SALT + 3)))
    tone = TONE * tint * tone * (1.0 + 0.5 * pattern.fbm(60.0, 3, SALT + 4))[:, None]
    return mix(colour, tone, 0.92 * cover)
