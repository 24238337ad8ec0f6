"""How much a file may ask for before it is refused, and how to raise that: docs/limits.md.

A file from elsewhere must not fill the memory of whoever opens it, so its own keys cannot raise these limits: the
environment can, as ``VAROS_WARP_MAX_TRIANGLES=2e8``.
"""

import os
from typing import Any

from varos_warp.errors import InputError

DEFAULTS = {
    "TRIANGLES": 50_000_000,
    "HEIGHTS": 100_000_000,
    "SCATTERED_POINTS": 5_000_000,
    "COPIES": 100_000,
    "TEXTURE_PIXELS": 8192 * 8192,
    "FRAMES": 1_000_000,
    "TEXT_BYTES": 2_000_000,
    "POSES": 5_000_000,
}
"""Triangles of a mesh file with all its copies or of a survey, heights of a survey file, points without a grid that are
joined, copies of nodes of a mesh file, pixels of an image file, frames of a sequence, bytes of a YAML file,
poses of a recorded course."""


def limit(name: str) -> int:
    """The limit of one of `DEFAULTS`.

    Raises:
        InputError: If the environment sets it to something that is not a positive number.
    """
    variable = f"VAROS_WARP_MAX_{name}"
    given = os.environ.get(variable) or DEFAULTS[name]
    try:
        value = int(float(given))
    except (ValueError, OverflowError):
        value = 0
    if value < 1:
        raise InputError("is not a positive number", key=variable, value=given)
    return value


def check_limit(name: str, count: int, **where: Any) -> None:
    """Refuse a count above the limit of one of `DEFAULTS`; ``where`` goes to the `InputError`."""
    if count > (most := limit(name)):
        words = name.lower().replace("_", " ")
        raise InputError(
            f"{count} {words} are more than the limit of {most}",
            remedy=f"If you trust it, raise the limit: VAROS_WARP_MAX_{name}={count}.",
            **where,
        )
