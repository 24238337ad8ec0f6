"""One entry of the stability map: what is swept, what map.yaml says of it, and what was measured."""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import yaml
from pydantic import ValidationError

from varos_warp.errors import InputError

Series = dict[str | tuple[str, ...], Callable]
"""Name of a series -> its error as a function of a value; several names -> a function that gives as many errors."""
Sweeps = dict[str, Series]
"""What a module of sweeps holds as ``SWEEPS``, by the key of a sweep; the values of its parameter are in map.yaml."""
Measured = tuple[list[float], dict[str, list[float]]]
"""Values of the parameter; name of a series -> error at each value, nan where the method refuses or fails."""
REFUSED = (InputError, ValidationError, OverflowError, ZeroDivisionError)


def measured(values: list[float], series: Series) -> Measured:
    """The errors of every series at every value; nan where a value is refused or numbers run out."""
    errors: dict[str, list[float]] = {}
    for names, function in series.items():
        names = (names,) if isinstance(names, str) else names
        rows = [_row(function, value, len(names)) for value in values]
        errors |= dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))
    return values, errors


def _row(function: Callable, value: float, count: int) -> tuple[float, ...]:
    try:
        made = function(value)
    except REFUSED:
        return (math.nan,) * count
    return tuple(made) if count > 1 else (made,)


@dataclass(frozen=True)
class Sweep:
    """One method over one parameter."""

    key: str
    """Name of the entry, unique over all modules."""
    title: str
    method: str
    """What of ours is swept: an integrator, a function, a model."""
    parameter: str
    """Name [unit], as the axis of the chart has it."""
    measure: str
    """What the error is, against which truth, and how that was got."""
    limit: str
    """Limit of the method, in words and numbers."""
    fails: str
    """What fails beyond."""
    program: str
    """What the program does there: switches the method, takes smaller steps, refuses with a message, warns ..."""
    test: str
    """Node of pytest that guards the boundary, from the root of the repository."""
    values: list[float]
    errors: dict[str, list[float]]
    """Errors as in `Measured`."""
    holds: tuple[float | None, float | None] = (None, None)
    """Values from .. to which it holds; None where the sweep found no end. Drawn as vertical lines."""
    bound: float | None = None
    """Error that is promised within these; drawn as a horizontal line."""
    scale: str = "log"
    """Scale of the axis of values: log, linear or symlog (for values on either side of zero)."""

    def __post_init__(self):
        wrong = [name for name, series in self.errors.items() if len(series) != len(self.values)]
        if wrong:
            raise ValueError(f"{self.key}: {wrong} must have an error for each of the {len(self.values)} values")
        if "::" not in self.test or not self.test.startswith("tests/"):
            raise ValueError(f"{self.key}: test must be a node of pytest below tests/, not {self.test!r}")


@functools.cache
def words() -> dict[str, dict]:
    """What map.yaml says: key of a sweep -> fields of `Sweep`, but for errors."""
    return yaml.safe_load(Path(__file__).with_name("map.yaml").read_text(encoding="utf-8"))


def record_of(measured: Measured) -> dict:
    """What was measured as plain JSON types; what is not finite is None."""
    values, errors = measured
    series = {name: [_number(error) for error in row] for name, row in errors.items()}
    return {"values": [float(value) for value in values], "errors": series}


def sweep_of(key: str, record: dict, said: dict) -> Sweep:
    """An entry of a record, which may hold more than `record_of`, and of what is said of it."""
    errors = {
        name: [math.nan if error is None else error for error in series] for name, series in record["errors"].items()
    }
    return Sweep(key=key, **said | {"values": record["values"], "errors": errors})


def _number(error) -> float | None:
    return float(error) if math.isfinite(error) else None
