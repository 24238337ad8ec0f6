"""Datasets that differ in their seed alone, together: means, and their standard errors."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from varos_warp.dataset.readiness.measure import Readiness


def numbers(found: Readiness) -> dict[str, float | None]:
    """What one dataset is compared with others by: medians over frames, the mean chance of failure, the odometry."""
    row = found.medians() | {"failure_chance": found.failure_chance()}
    for kind, run in found.odometry.items():
        plain = run.plain()
        row |= {f"{kind}_{name}": plain[f"{name}_mean"] for name in ("ate_m", "ate_share", "drift", "lost")}
        row[f"{kind}_failed_share"] = plain["failed_share"]
    return row


def mean_and_error(values: Sequence[float | None]) -> tuple[float | None, float | None]:
    """Mean, and its standard error where there are several.

    None where one has no value: a mean of the others would look better than it is.
    """
    known = [value for value in values if value is not None]
    if not known or len(known) < len(values):
        return None, None
    error = float(np.std(known, ddof=1) / np.sqrt(len(known))) if len(known) > 1 else None
    return float(np.mean(known)), error


def by_depth(found: Sequence[Readiness]) -> list[Readiness]:
    """Datasets in order of their optical depth; those without one last."""

    def depth(each: Readiness) -> float:
        value = each.medians().get("optical_depth")
        return np.inf if value is None else value

    return sorted(found, key=depth)


def groups(found: Sequence[Readiness]) -> list[tuple[str, list[Readiness]]]:
    """Names and datasets: those together that differ in their seed alone, by optical depth; each other one alone."""
    together: dict[str, list[Readiness]] = {}
    for each in by_depth(found):
        together.setdefault(each.group or str(each.root), []).append(each)
    return [(f"{name} ({len(of)} seeds)" if len(of) > 1 else str(of[0].root), of) for name, of in together.items()]


def compared(of: Sequence[Readiness]) -> dict[str, tuple[float | None, float | None]]:
    """Mean and standard error of every number of datasets that differ in their seed alone."""
    rows = [numbers(each) for each in of]
    return {
        name: mean_and_error([row.get(name) for row in rows])
        for name in dict.fromkeys(name for row in rows for name in row)
    }


def over_seeds(found: Sequence[Readiness]) -> list[dict[str, Any]]:
    """Return means over each group of several datasets, as plain types for JSON."""
    return [
        {
            "name": name,
            "datasets": [str(each.root) for each in of],
            **{what: {key: pair[i] for key, pair in compared(of).items()} for i, what in enumerate(("mean", "stderr"))},
        }
        for name, of in groups(found)
        if len(of) > 1
    ]
