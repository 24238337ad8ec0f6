"""Distortion of a camera as calibration files name and number it, and which models are had here."""

from typing import Any, NamedTuple

from varos_warp.errors import warn
from varos_warp.scene.calibration.documents import Entry
from varos_warp.scene.optics.distortion import BROWN_CONRADY, KANNALA_BRANDT, RATIONAL, canonical

READ = (
    "Read are pinholes with radtan (plumb_bob), rational_polynomial or equidistant (fisheye) distortion or none, "
    "and Kalibr's ds; docs/cameras.md lists them."
)
OPENCV = "opencv"
"""A model of OpenCV's calib3d, which the number of coefficients tells."""
COUNTS = {"none": (), BROWN_CONRADY: (4, 5), RATIONAL: (5, 8, 12, 14), KANNALA_BRANDT: (4,), OPENCV: (4, 5, 8, 12, 14)}
"""Coefficients that a file may give of each model."""
AMBIGUOUS = (
    "has four coefficients and names no model: they are read as k1, k2, p1, p2 of radtan (plumb_bob); if they "
    "are k1 to k4 of a fisheye, add distortion_model: equidistant to the file"
)


class Calibration(NamedTuple):
    """The facts that a file gives of a camera."""

    intrinsics: tuple[float, float, float, float]
    """fx, fy, cx, cy [pixels]; the centre of the top left pixel is (0, 0)."""
    distortion: dict[str, Any] | None
    """A block ``distortion`` of a scene; None: a pinhole."""
    resolution: tuple[int, int] | None
    """Width and height [pixels]; None: the file does not say."""


def distortion(model: Entry | None, coefficients: Entry) -> dict[str, Any] | None:
    """The block of a scene for a model by its name, or OpenCV's by the number of its coefficients.

    Raises:
        InputError: There is no such model here, or not with so many coefficients.
    """
    k, name = coefficients.numbers(), OPENCV if model is None else canonical(model.text().lower())
    if name not in COUNTS:
        assert model is not None
        model.refuse("is no model of distortion that is had here", READ)
    if any(k) and len(k) not in COUNTS[name]:
        allowed = " or ".join(map(str, COUNTS[name])) or "none"
        of = f"{model.text()} has" if model is not None else "OpenCV's models have"
        coefficients.refuse(f"has {len(k)} coefficients, but {of} {allowed}")
    if model is None and any(k) and len(k) == 4:
        warn(f"{coefficients.file}: {coefficients.key} {AMBIGUOUS}")
    return _kannala_brandt(k) if name == KANNALA_BRANDT else _of_opencv(k, coefficients)


def _kannala_brandt(k: tuple[float, ...]) -> dict[str, Any]:
    return {"model": KANNALA_BRANDT, "k": [*k, 0.0, 0.0, 0.0, 0.0][:4]}


def _of_opencv(k: tuple[float, ...], coefficients: Entry) -> dict[str, Any] | None:
    """The simplest of OpenCV's models that k1, k2, p1, p2, k3 ... are of, so that every export can say it."""
    if any(k[8:12]):
        coefficients.refuse(
            "has coefficients s1 to s4 of a thin prism, which no lens has here",
            "Calibrate without CALIB_THIN_PRISM_MODEL.",
        )
    if any(k[12:]):
        coefficients.refuse(
            "has angles of a tilted sensor, which no camera has here", "Calibrate without CALIB_TILTED_MODEL."
        )
    if any(k[5:8]):
        return {"model": RATIONAL, "k": list(k[:8])}
    return {"model": BROWN_CONRADY, "k": [*k, 0.0][:5]} if any(k) else None
