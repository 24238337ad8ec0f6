"""Intensities measured around a lamp, whatever the goniometer: types C, B and A of IES LM-63 become one `Profile`.

Axes of a lamp: its ``direction``, where the angles (0, 0) of a file point, and ``up``, across it; left and right are
those of who stands behind the lamp, looks along its direction and has ``up`` above. In words of LM-63-2002, of types B
and C the direction is photometric zero, of type A it is photometric horizontal, and

* type C: half planes through the direction; C = 0 holds ``up`` (photometric horizontal), and C grows counter-clockwise
  as seen from behind: 90 is left. The vertical angle is that to the direction.
* type B: V turns about the axis from left to right, 90 is up, and H is the angle out of that plane, 90 is right.
* type A: V is the angle out of the plane of direction and right, 90 is up; H turns in that plane, 90 is right.

(The definitions of LM-63-2002: horizontal angles are counter-clockwise for type C and clockwise for types A and B, seen
from above, which for a lamp that shines down is from behind. EN 13032-1 has the same planes.)
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import maximum_filter

from varos_warp.scene.lights.ies import IesFile

NODES = 512
"""Steps of a profile by the angle to the axis, even in the sine of half that angle."""
MOST_PLANES = 720
"""Half planes around the axis of a profile at most: steps of half a degree."""
UNEVEN = 0.02
"""Intensities of one angle to the axis may differ by so much of the peak around it; their mean is taken."""
SAME_DEG = 1e-3
"""Angles of a file that differ by less are one."""
ROUNDING = 1e-9
"""Rounding of angles that are computed [degrees], at most."""
GAP = 1.5
"""A full turn may end before 360 degrees by so many of its largest steps: there its first plane follows the last."""
WIDEST_GAP_DEG = 90.0
"""Largest gap between two half planes of a full turn [degrees]: what lies in wider ones was rather left out."""


@dataclass(frozen=True)
class Profile:
    """Intensities of any scale by the angle to a lamp's axis, and around it; linear in both between the nodes."""

    polar: np.ndarray
    """Angles to the axis [rad], increasing; beyond the last there is no light."""
    azimuth: np.ndarray
    """Half planes around the axis [rad], increasing, as C of type C; one only: the same all around."""
    intensity: np.ndarray
    """Intensities [azimuth, polar]."""
    source: str
    """The file and format that the profile was read from, in words."""
    uneven: float = 0.0
    """Largest difference around the axis of the file's intensities at one angle to it, over the peak."""
    opening_m: tuple[float, float, float] | None = None
    """Width, length and height of the lamp's opening [m], where the file tells."""
    notes: tuple[str, ...] = ()
    """Notes on how the file was read, in words."""
    peak: float | None = None
    """The highest intensity of the file, where none of ``intensity`` may be it; None: it is the highest of those."""

    @property
    def is_round(self) -> bool:
        """True if the intensity is the same all around the axis, or as good as."""
        return len(self.azimuth) == 1

    @property
    def highest(self) -> float:
        """The highest intensity of the file."""
        return float(self.intensity.max()) if self.peak is None else self.peak

    def describe(self) -> dict:
        """The facts of the profile in plain JSON types."""
        return {
            "source": self.source,
            "round": self.is_round,
            "uneven": float(f"{self.uneven:.3g}"),
            "ends_at_deg": float(f"{np.degrees(self.polar[-1]):.6g}"),
            "opening_m": self.opening_m and list(self.opening_m),
            "notes": list(self.notes),
        }


class NotMeasured(ValueError):
    """The angles of a file do not say where a lamp shines; the message says why."""


def profile_of(file: IesFile) -> Profile:
    """The profile that an IES file describes.

    Raises:
        NotMeasured: If its angles are not those of the file's type.
    """
    planes = len(file.horizontal)
    source = f"IES LM-63-{file.edition}, type {file.kind}, {planes} horizontal angle{'s' * (planes != 1)}"
    polar, azimuth, intensity = (_of_type_c if file.kind == "C" else _of_planes)(file)
    notes = ["its factors of tilt scale the output of a tilted lamp and do not count"] * file.tilted
    if file.kind != "C" and _is(file.vertical[0], 0.0):
        notes.append("its vertical angles begin at 0: it is taken to shine below as above")
    profile = full_turn(np.radians(polar), np.radians(azimuth), intensity, source)
    peak = None if profile.is_round else float(file.candela.max())  # of a round one there are means only
    return replace(profile, opening_m=file.opening_m, notes=tuple(notes), peak=peak)


def full_turn(polar: np.ndarray, azimuth: np.ndarray, intensity: np.ndarray, source: str) -> Profile:
    """A profile of half planes all around, which is round where they hardly differ.

    Args:
        polar: Angles to the axis [rad], increasing.
        azimuth: Half planes [rad], increasing, within a full turn.
        intensity: Intensities [azimuth, polar], of any scale.
        source: The file and format that it was read from, in words.
    """
    uneven = float(np.ptp(intensity, axis=0).max() / max(intensity.max(), 1e-300))
    if uneven <= UNEVEN:
        azimuth, intensity = np.zeros(1), intensity.mean(axis=0)[None]
    return Profile(polar, azimuth, intensity, source, uneven)


def even_planes(profile: Profile) -> np.ndarray:
    """Intensities [planes, polar] in even steps of the azimuth from 0 on, which hold its own planes if few can."""
    steps = np.rint(100.0 * np.degrees(profile.azimuth)).astype(int)
    planes = 36_000 // int(np.gcd.reduce([36_000, *steps]))
    exact = np.allclose(100.0 * np.degrees(profile.azimuth), steps, rtol=0.0, atol=100.0 * SAME_DEG)
    if planes > MOST_PLANES or not exact:
        planes = MOST_PLANES
    even = 2.0 * np.pi * np.arange(planes) / planes
    return np.column_stack(
        [np.interp(even, profile.azimuth, column, period=2.0 * np.pi) for column in profile.intensity.T]
    )


# -------------------------------------------------------------------------------------------------------------- type C


SYMMETRIES = {(0.0, 90.0): (90.0, 0.0), (0.0, 180.0): (0.0,), (90.0, 270.0): (90.0,)}
"""Planes in which the half planes of a file are to be mirrored [degrees], by the first and the last of them."""


def _of_type_c(file: IesFile) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertical angles, half planes of the whole turn [degrees], and intensities [half plane, vertical angle]."""
    vertical, candela = _increasing(file.vertical, "vertical"), file.candela
    first, last = vertical[[0, -1]]
    if not (_is(first, 0.0) or _is(first, 90.0)) or last > 180.0 + SAME_DEG:
        raise NotMeasured(
            f"its vertical angles go from {first:g} to {last:g}; those of type C begin at 0, straight "
            "along the lamp's axis, or at 90, and end at 180 at most"
        )
    if _is(first, 90.0):  # dark up to there
        vertical = np.concatenate([[0.0, 90.0 - ROUNDING], np.maximum(vertical, 90.0)])
        candela = np.pad(candela, ((0, 0), (2, 0)))
    if np.ptp(candela, axis=0).max() <= UNEVEN * candela.max():  # wherever its half planes are
        return np.clip(vertical, 0.0, 180.0), file.horizontal, candela
    return np.clip(vertical, 0.0, 180.0), *_all_around(file.horizontal, candela)


def _all_around(horizontal: np.ndarray, candela: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The half planes of a whole turn [degrees] and their intensities, from those that symmetry leaves in a file."""
    first, last = _increasing(horizontal, "horizontal")[[0, -1]]
    if _is(first, 0.0) and last > 180.0 + SAME_DEG:
        return _closed(horizontal, candela)
    for (begin, end), planes in SYMMETRIES.items():
        if _is(first, begin) and _is(last, end):
            for plane in planes:
                horizontal, candela = _with_mirror_image(horizontal, candela, plane)
            return horizontal, candela
    raise NotMeasured(
        f"its horizontal angles go from {first:g} to {last:g}; those of type C are one, or go from 0 to "
        "90, 180 or 360, or from 90 to 270"
    )


def _with_mirror_image(horizontal: np.ndarray, candela: np.ndarray, plane: float) -> tuple[np.ndarray, np.ndarray]:
    """Half planes in order, and those that a plane at an angle [degrees] mirrors them to."""
    both = np.concatenate([horizontal, 2.0 * plane - horizontal])
    order, at = np.unique(np.round(both % 360.0, 6) % 360.0, return_index=True)  # of two in one place the file's own
    return order, np.concatenate([candela, candela])[at]


def _closed(horizontal: np.ndarray, candela: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half planes from 0 to less than 360, after the last of which the first follows."""
    last = horizontal[-1]
    if _is(last, 360.0):
        if (apart := np.abs(candela[-1] - candela[0]).max() / candela.max()) > UNEVEN:
            raise NotMeasured(f"its horizontal angles 0 and 360 are one, but differ by {apart:.0%} of the peak")
        return horizontal[:-1], candela[:-1]
    if last > 360.0 or 360.0 - last > min(GAP * np.diff(horizontal).max(), WIDEST_GAP_DEG):
        raise NotMeasured(f"its horizontal angles go from 0 to {last:g} and do not close a full turn of 360")
    return horizontal, candela


# -------------------------------------------------------------------------------------------------------- types B and A


def _of_planes(file: IesFile) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles to the axis, half planes [degrees], and intensities there, of a lamp of type B or A."""
    turns, leans = (file.vertical, file.horizontal) if file.kind == "B" else (file.horizontal, file.vertical)
    candela = file.candela.T if file.kind == "B" else file.candela
    names = ("vertical", "horizontal") if file.kind == "B" else ("horizontal", "vertical")
    turns, candela = _both_sides(turns, candela, names[0], 180.0)
    leans, columns = _both_sides(leans, candela.T, names[1], 90.0)
    reach = _farthest(turns, leans, columns.T)
    polar = np.degrees(2.0 * np.arcsin(np.linspace(0.0, np.sin(0.5 * np.radians(reach)), NODES + 1)))
    azimuth = 360.0 * np.arange(MOST_PLANES) / MOST_PLANES
    grid = [np.concatenate([[ends[0] - ROUNDING], ends[1:-1], [ends[-1] + ROUNDING]]) for ends in (turns, leans)]
    at = RegularGridInterpolator(grid, columns.T, bounds_error=False, fill_value=0.0)
    return polar, azimuth, at(_turn_and_lean(file.kind, *np.meshgrid(azimuth, polar, indexing="ij")))


def _turn_and_lean(kind: str, azimuth: np.ndarray, polar: np.ndarray) -> np.ndarray:
    """Angles [..., 2] [degrees] of directions: about the axis of the planes, and out of the middle of them."""
    a, p = np.radians(azimuth), np.radians(polar)
    ahead, up, right = np.cos(p), np.sin(p) * np.cos(a), -np.sin(p) * np.sin(a)
    turned, leaning = (up, right) if kind == "B" else (right, up)
    return np.degrees(np.stack([np.arctan2(turned, ahead), np.arcsin(np.clip(leaning, -1.0, 1.0))], axis=-1))


def _both_sides(angles: np.ndarray, candela: np.ndarray, name: str, most: float) -> tuple[np.ndarray, np.ndarray]:
    """Angles on both sides of 0 and intensities [angle, ...]; where those below are left out, they are mirrored."""
    first, last = _increasing(angles, name)[[0, -1]]
    if len(angles) < 2 or last > most + SAME_DEG or not (_is(first, 0.0) or -most - SAME_DEG <= first < 0.0 < last):
        raise NotMeasured(
            f"its {name} angles go from {first:g} to {last:g}; those of types A and B go from -90 or 0 to 90"
        )
    if not _is(first, 0.0):
        return angles, candela
    return np.concatenate([-angles[:0:-1], [0.0], angles[1:]]), np.concatenate([candela[:0:-1], candela])


def _farthest(turns: np.ndarray, leans: np.ndarray, candela: np.ndarray) -> float:
    """The largest angle to the axis [degrees] at which there is light: at a corner of a cell that has some."""
    lit = maximum_filter(candela > 0.0, size=3, mode="constant")
    cosine = np.outer(np.cos(np.radians(turns)), np.cos(np.radians(leans)))
    if np.abs(turns[lit.any(axis=1)]).max() > 90.0 + SAME_DEG:  # corners are not the farthest there
        return 180.0
    return float(np.degrees(np.arccos(np.clip(cosine[lit].min(), -1.0, 1.0))))


def _increasing(angles: np.ndarray, name: str) -> np.ndarray:
    """The angles, if they increase."""
    if (np.diff(angles) <= 0.0).any():
        raise NotMeasured(f"its {name} angles are not increasing")
    return angles


def _is(angle: float, other: float) -> bool:
    """Return whether two angles [degrees] are one."""
    return abs(angle - other) <= SAME_DEG
