"""One entry of the stability map: a method, a parameter, the error measured at each value, and where that ends."""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Sweep:
    """What came of sweeping one method over one parameter. A function of the same name as ``key`` makes it."""

    key: str
    """Name of the entry, unique over all modules; an identifier."""
    title: str
    method: str
    """What of ours is swept: an integrator, a function, a model."""
    parameter: str
    """Name [unit], as the axis of the chart has it."""
    values: list[float]
    errors: dict[str, list[float]]
    """Name of a series -> error at each value; nan where the method refuses or fails."""
    measure: str
    """What the error is, against which truth, and how that was got."""
    limit: str
    """Where the method ends, in words and numbers."""
    fails: str
    """What fails beyond."""
    program: str
    """What the program does there: switches the method, takes smaller steps, refuses with a message, warns ..."""
    test: str
    """Node of pytest that guards the boundary, from the root of the repository."""
    holds: tuple[float | None, float | None] = (None, None)
    """Values from .. to which it holds; None where the sweep found no end. Drawn as vertical lines."""
    bound: float | None = None
    """Error that is promised within these; drawn as a horizontal line."""
    scale: str = "log"
    """Of the axis of values: log, linear or symlog (for values on either side of zero)."""

    def __post_init__(self):
        if not self.key.isidentifier():
            raise ValueError(f"the key of a sweep is an identifier, not {self.key!r}")
        wrong = [name for name, series in self.errors.items() if len(series) != len(self.values)]
        if wrong:
            raise ValueError(f"{self.key}: {wrong} must have an error for each of the {len(self.values)} values")
        if "::" not in self.test or not self.test.startswith("tests/"):
            raise ValueError(f"{self.key}: test must be a node of pytest below tests/, not {self.test!r}")

    def record(self) -> dict:
        """As plain JSON types; what is not finite is None."""
        record = asdict(self)
        record["values"] = [float(value) for value in self.values]
        record["errors"] = {name: [_number(error) for error in series] for name, series in self.errors.items()}
        record["holds"] = list(self.holds)
        return record

    @classmethod
    def from_record(cls, record: dict) -> "Sweep":
        """Inverse of `record`; other keys are left out."""
        fields = {name: record[name] for name in cls.__dataclass_fields__ if name in record}
        series = {
            name: [math.nan if error is None else error for error in errors]
            for name, errors in record["errors"].items()
        }
        return cls(**fields | {"errors": series, "holds": tuple(record["holds"])})


Sweeps = tuple[Callable[[], Sweep], ...]
"""What a module of sweeps holds as ``SWEEPS``; the name of a function is the key of its sweep."""


def _number(error) -> float | None:
    return float(error) if math.isfinite(error) else None
