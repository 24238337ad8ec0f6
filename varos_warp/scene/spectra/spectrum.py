"""Spectra: values by wavelength [nm], linear between, and the files that hold them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from varos_warp.errors import did_you_mean
from varos_warp.files import require_file
from varos_warp.scene.angle_table import CsvRows, read_csv

DATA = Path(__file__).parents[2] / "data" / "spectra"
"""Spectra that come with the package; the head of each file names its source."""
ALSO = {"lamps": ("halogen_3200K",)}
"""Spectra of the package that are formulas, by kind."""
VISIBLE = (400.0, 700.0)
"""What every spectrum covers [nm]; light is integrated over this range."""
GRID = np.arange(VISIBLE[0], VISIBLE[1] + 0.5)
"""Wavelengths at which integrals are taken [nm], each nanometre."""
STEPS = np.concatenate([[0.5], np.ones(len(GRID) - 2), [0.5]])
"""Weights of the trapezoidal rule over `GRID` [nm]."""


@dataclass(frozen=True)
class Spectrum:
    """A value by wavelength [nm], linear between; beyond its ends the values there."""

    wavelength_nm: np.ndarray
    values: np.ndarray

    def at(self, wavelength_nm=GRID) -> np.ndarray:
        """Values at wavelengths [nm]."""
        return np.interp(wavelength_nm, self.wavelength_nm, self.values)

    def integral(self) -> float:
        """Integral over `VISIBLE`, by the trapezoidal rule of one nanometre."""
        return float(STEPS @ self.at())


def read_spectra(path: Path, key: str, what: str, columns: tuple[str, ...]) -> dict[str, Spectrum]:
    """Spectra of a CSV file with ``wavelength_nm`` and other columns.

    Raises:
        InputError: The file is missing or no such table, has a negative value, or does not cover 400 to 700 nm.
    """
    rows = read_csv(path, key, what).rows("wavelength_nm", *columns)
    _check_wavelengths(rows)
    for i in range(1, 1 + len(columns)):
        rows.refuse_amounts(i, "Light has no negative amounts: 0 where noise takes it below.", f"Give a {what}.")
    nm, *values = rows.values.T
    return {column: Spectrum(nm, curve) for column, curve in zip(columns, values, strict=True)}


def _check_wavelengths(rows: CsvRows) -> None:
    """Wavelengths ascend, are nanometres, and cover the visible."""
    first, last = float(rows.values[:, 0].min()), float(rows.values[:, 0].max())
    for unit, factor in (("micrometres", 1e3), ("metres", 1e9), ("Angstrom", 0.1)):
        if 200.0 <= first * factor <= 3000.0 and not 200.0 <= first <= 3000.0:
            raise rows.file.error(
                f"wavelength_nm goes from {first:g} to {last:g}, which look like {unit}",
                f"Give nanometres: multiply by {factor:g}.",
            )
    rows.refuse_falls(0, "Sort the rows by wavelength, each wavelength once.")
    if first > VISIBLE[0] or last < VISIBLE[1]:
        raise rows.file.error(
            f"goes from {first:g} to {last:g} nm",
            "A spectrum must cover 400 to 700 nm; give 0 where there is no light.",
        )


@cache
def bundled(name: str, *columns: str) -> dict[str, Spectrum]:
    """Spectra of a file of the package, by its path in `DATA` without the suffix."""
    return read_spectra(DATA / f"{name}.csv", "spectra", "spectrum", columns)


def named_files(kind: str) -> dict[str, Path]:
    """The files of one kind that come with the package, by name: ``lamps``, ``cameras``."""
    return {path.stem: path for path in sorted((DATA / kind).glob("*.csv"))}


def is_file_name(name: str, kind: str) -> bool:
    """Return whether a name is that of a user's file, and of no spectrum of one kind that comes with the package."""
    return name not in named_files(kind) and name not in ALSO.get(kind, ())


def named_or_file(name: str, kind: str, what: str, resolve: Callable[[str], Path], key: str) -> Path:
    """The file of the package that has a name, or that of the user which ``resolve`` leads to.

    Raises:
        InputError: There is neither; names the spectra of the package.
    """
    own = named_files(kind)
    if name in own:
        return own[name]
    path = resolve(name)
    require_file(
        path,
        what,
        did_you_mean(name, [*own, *ALSO.get(kind, ())])
        or f"Give the path of a file, or one that comes with the package: {', '.join([*own, *ALSO.get(kind, ())])}.",
        key,
    )
    return path
