"""What survey files hold, as all readers give it: a grid or points, and what the file says of its coordinates."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.description.survey import Heights


@dataclass(frozen=True)
class Request:
    """A file to read, and how the user wants it read."""

    path: Path
    asked: Heights
    key: str
    """The key of the block, ``terrain``, for messages."""

    def error(self, problem: str, remedy: str, name: str = "file", value: Any = None) -> InputError:
        """Make a refusal of the file that names one of the block's keys."""
        return InputError(problem, file=self.path, key=f"{self.key}.{name}", value=value, remedy=remedy)


@dataclass(frozen=True)
class Reference:
    """What a file says of its coordinates."""

    name: str | None = None
    """The coordinate reference system, such as EPSG:32632; None if it names none."""
    unit_m: float | None = None
    """Metres in a unit of x and y; None if it does not say."""
    height_unit_m: float | None = None
    """Metres in a unit of the heights; None if it does not say."""
    downwards: bool = False
    """True if it speaks of depth."""
    unknown_unit: str | None = None
    """What it names in place of a unit that we know, or a system whose unit it leaves open; None if neither."""
    unknown_height_unit: str | None = None
    """What it names in place of a unit of the heights that we know; None if it names no such thing."""


@dataclass
class Raster:
    """Heights at the nodes of a grid."""

    values: np.ndarray
    """float64 [rows, columns], NaN where there is none."""
    T: np.ndarray
    """float64 [2, 3]: T (column, row, 1) is x, y of a node."""
    reference: Reference = Reference()
    notes: list[str] = field(default_factory=list)
    """What the user should know of how it was read, a sentence each."""


@dataclass
class Cloud:
    """Points of a surface."""

    points: np.ndarray
    """float64 [N, 3]."""
    reference: Reference = Reference()
    notes: list[str] = field(default_factory=list)
