"""How the intensity of a light is distributed over directions: a cone, or a profile; in the water, behind its port."""

from dataclasses import asdict, dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from varos_warp.cache import digest
from varos_warp.errors import InputError
from varos_warp.scene.description import Scene
from varos_warp.scene.description.lights import LampPort, Light
from varos_warp.scene.lights.goniometry import NODES, Profile, even_planes
from varos_warp.scene.lights.profiles import read_profile
from varos_warp.scene.optics.ports import snell, transmitted

HALF = 0.5
"""Share of its peak at which a profile is divided for quadratures along rays."""
RESOLVED = 0.98
"""Least share of a file's peak that its profile must have somewhere: goniometers err by as much. Half a step beside
its peak a beam loses more if it falls to nothing within 25 steps, which are 4 degrees of a lamp that ends at 90."""


@dataclass(frozen=True, eq=False)
class Distribution:
    """Relative radiant intensity around a light's axis, in the water; lights of one distribution share a field.

    Those of the same numbers are equal, and one as keys; a table of two angles is only read once for that.
    """

    half_angle: float = np.pi
    """Angle to the axis [rad] beyond which there is no light; pi where there is no cone."""
    blend: float = 0.0
    """Width of the soft edge as in kernels.world.lights; with a profile, only where quadratures divide rays."""
    profile: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Values from 0 to 1 at NODES even steps of the sine of half the angle, to the edge, float64, read only; none: 1,
    and the soft edge."""
    gain: float = 1.0
    """Peak intensity in the water over that of the light itself."""
    planes: int = 1
    """Half planes around the axis, in even steps, with such values each, one after the other; 1: the same all
    around."""

    def __post_init__(self) -> None:
        values = np.array(self.profile, float).ravel()
        values.flags.writeable = False
        object.__setattr__(self, "profile", values)

    @cached_property
    def _numbers(self) -> tuple:
        """All that tells a distribution from others."""
        return self.half_angle, self.blend, digest(self.profile), self.gain, self.planes

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Distribution) and self._numbers == other._numbers

    def __hash__(self) -> int:
        return hash(self._numbers)

    def described(self) -> dict:
        """All numbers of the distribution in plain JSON types."""
        return asdict(self) | {"profile": self.profile.tolist()}

    @property
    def has_profile(self) -> bool:
        """True if the values stand in a table, not in a formula."""
        return self.profile.size > 0

    @property
    def everywhere(self) -> bool:
        """True if the intensity is the same in all directions."""
        return self.half_angle >= np.pi and not self.has_profile

    @property
    def angles(self) -> np.ndarray:
        """Angles to the axis [rad] of the profile's values."""
        return 2.0 * np.arcsin(np.linspace(0.0, np.sin(0.5 * self.half_angle), NODES + 1))

    @property
    def is_round(self) -> bool:
        """True if the intensity is the same all around the axis."""
        return self.planes == 1

    @property
    def table(self) -> np.ndarray:
        """The profile's values, float64 [planes, NODES + 1]."""
        return np.reshape(self.profile, (self.planes, -1))

    def at(self, angle: ArrayLike, azimuth: ArrayLike = 0.0) -> np.ndarray:
        """Relative intensity, without the gain, at angles to the axis and around it (as C of type C) [rad]."""
        angle = np.asarray(angle, float)
        x = np.sin(0.5 * angle) / np.sin(0.5 * self.half_angle)
        inside = (x <= 1.0) | (self.half_angle >= np.pi)
        if self.has_profile:
            return np.where(inside, self._profile_at(x, azimuth), 0.0)
        if self.half_angle >= np.pi or self.blend == 0.0:
            return inside.astype(float)
        s = np.clip((1.0 - x * x) / self.blend, 0.0, 1.0)  # 1 - x^2 = (cos - cos_half) / (1 - cos_half)
        return s * s * (3.0 - 2.0 * s)

    def _profile_at(self, x: np.ndarray, azimuth: ArrayLike) -> np.ndarray:
        """The profile's value at shares of the sine of half its edge's angle, as in `profile_around` of the kernels."""
        if self.is_round:
            return np.interp(x, np.linspace(0.0, 1.0, NODES + 1), self.profile)
        x, turn = np.broadcast_arrays(NODES * np.clip(x, 0.0, 1.0), self.planes * np.asarray(azimuth) / (2.0 * np.pi))
        k, plane = np.minimum(x.astype(int), NODES - 1), np.floor(turn).astype(int)
        u, v, table = x - k, turn - plane, self.table
        one, next_one = (
            table[row % self.planes, k] * (1.0 - u) + table[row % self.planes, k + 1] * u for row in (plane, plane + 1)
        )
        return one * (1.0 - v) + next_one * v


def distribution(light: Light, scene: Scene) -> Distribution:
    """How the intensity of a light of a scene is distributed, behind its port if it has one; everywhere for a sheet.

    Raises:
        InputError: The file of a profile is missing, or is none, or a port lets no light through.
    """
    own = own_distribution(light, scene)
    if light.kind in ("point", "sheet") or light.port is None:
        return own
    try:
        return behind_port(own, light.port)
    except InputError as error:
        raise error.at(f"{scene.key_of_light(light)}.port") from None


def own_distribution(light: Light, scene: Scene) -> Distribution:
    """How the intensity of a light of a scene is distributed before its port; everywhere for a sheet.

    Raises:
        InputError: The file of a profile is missing, or is none.
    """
    if light.kind in ("point", "sheet"):
        return Distribution()
    if light.kind == "profile":
        return _of_file(scene.resolve(light.file), f"{scene.key_of_light(light)}.file")
    half = np.pi if light.cone_deg >= 360.0 else float(np.radians(light.cone_deg) / 2)
    return Distribution(half, light.blend)


def _of_file(path: Path, key: str) -> Distribution:
    """The distribution of a file, which a key of the scene names."""
    profile = read_profile(path, key)
    try:
        return of_profile(profile)
    except InputError as error:
        raise error.but(file=path, key=key) from None


def of_profile(profile: Profile) -> Distribution:
    """Distribution of what a file tells, relative to the file's own peak; any scale.

    Raises:
        InputError: If its brightest light is between the steps of the table.
    """
    if profile.is_round:
        return of_table(profile.polar, profile.intensity[0])
    return _around(*_at_nodes(profile.polar, even_planes(profile), profile.highest), 1.0)


def of_table(angle: np.ndarray, intensity: np.ndarray) -> Distribution:
    """Distribution of intensities at increasing angles to the axis [rad], linear between, 0 beyond; any scale.

    Raises:
        InputError: If its brightest light is between the steps of the table.
    """
    edge, relative = _at_nodes(angle, intensity[None], float(intensity.max()))
    return _all_round(edge, relative[0], 1.0)


def _at_nodes(angle: np.ndarray, intensity: np.ndarray, peak: float) -> tuple[float, np.ndarray]:
    """The last angle to the axis [rad] with light, and the values [planes, NODES + 1] of a profile up to there.

    Args:
        intensity: Intensities [planes, angle].
        peak: The highest intensity of the file, which becomes 1.
    """
    lit = np.flatnonzero(intensity.any(axis=0))
    if len(lit):
        edge = Distribution(float(angle[min(int(lit[-1]) + 1, len(angle) - 1)]))
        values = np.array([np.interp(edge.angles, angle, row) for row in intensity])
        if values.max() >= RESOLVED * peak:
            return edge.half_angle, values / peak
    raise InputError(
        f"its brightest beam is so narrow that it falls between the {NODES} steps of a table",
        remedy="Leave that beam out of the file, and give it as a spot beside the profile.",
    )


@lru_cache(maxsize=8)  # a table of two angles takes 3 MB, and its original is kept too
def behind_port(own: Distribution, port: LampPort) -> Distribution:
    """What becomes of a distribution in air behind a flat pane that is perpendicular to its axis.

    Light at an angle a in air leaves at w in water, sin a = n sin w, and the power in a cone is that in air but for
    Fresnel's reflections T: I_w = I_a T n^2 cos w / cos a. Nothing leaves beyond the critical angle.

    Raises:
        InputError: If no light goes that way.
    """
    most = min(own.half_angle, 0.5 * np.pi)
    edge = Distribution(float(snell(most, 1.0, port.n_water)))
    water = edge.angles
    air = np.minimum(snell(water, port.n_water, 1.0), most)
    # T / cos a stays finite where light grazes the pane
    azimuth = 2.0 * np.pi * np.arange(own.planes)[:, None] / own.planes  # which a pane across the axis keeps
    values = own.at(air, azimuth) * transmitted(air, (1.0, port.n_glass, port.n_water)) * port.n_water**2
    values = np.atleast_2d(values * np.cos(water))
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.where(np.cos(air) > 1e-9, values / np.cos(air), 0.0)
    if air[-1] > 0.5 * np.pi - 1e-6:
        values[:, -1] = values[:, -2]
    if not values.any():
        raise InputError("a pane before a lamp that shines backwards only: no light leaves", remedy="Leave it out.")
    peak = float(values.max())
    if own.is_round:
        return _all_round(edge.half_angle, values[0] / peak, own.gain * peak)
    return _around(edge.half_angle, values / peak, own.gain * peak)


def _all_round(half_angle: float, relative: np.ndarray, gain: float) -> Distribution:
    """A profile [NODES + 1], from 0 to 1, that is the same all around the axis, divided where it falls to HALF."""
    x = (np.flatnonzero(relative >= HALF)[-1] / NODES) ** 2  # (1 - cos) / (1 - cos_half)
    return Distribution(half_angle, float(1.0 - x), relative, gain)


def _around(half_angle: float, relative: np.ndarray, gain: float) -> Distribution:
    """Profiles [planes, NODES + 1], from 0 to 1, around the axis."""
    return Distribution(half_angle, 0.0, relative, gain, len(relative))
