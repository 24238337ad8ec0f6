"""Cameras as Kalibr's camchain.yaml and EuRoC's sensor.yaml have them: camera_model and a list of intrinsics.

(https://github.com/ethz-asl/kalibr/wiki/supported-models, and the file of Kalibr's ConfigReader.py.)
"""

from typing import Any

from varos_warp.scene.calibration.documents import Entry
from varos_warp.scene.calibration.models import READ, Calibration, distortion
from varos_warp.scene.optics.distortion import DOUBLE_SPHERE, canonical

COEFFICIENTS = ("distortion_coeffs", "distortion_coefficients")
"""Names of the coefficients of distortion, Kalibr's and EuRoC's."""
NUMBERS = {"pinhole": 4, "ds": 6, DOUBLE_SPHERE: 6}
"""Camera models, and how many intrinsics they have."""


def is_camera(entry: Entry) -> bool:
    """Return whether a block is a camera of this form."""
    return "camera_model" in entry and "intrinsics" in entry


def read_camera(entry: Entry) -> Calibration:
    """The calibration that a block gives.

    Raises:
        InputError: Its model is not had here, or something is missing.
    """
    model = entry["camera_model"]
    name = model.text().lower()
    if name not in NUMBERS:
        model.refuse("is no camera model that is had here", READ)
    numbers, expected = entry["intrinsics"].numbers(), NUMBERS[name]
    if len(numbers) != expected:
        entry["intrinsics"].refuse(f"has {len(numbers)} numbers, but those of {model.text()} are {expected}")
    lens = _distortion(entry)
    if name != "pinhole":
        if lens is not None:
            entry["distortion_model"].refuse("is a distortion beside a double sphere, which has none", READ)
        lens = {"model": DOUBLE_SPHERE, "xi": numbers[0], "alpha": numbers[1]}
    return Calibration(numbers[-4:], lens, _resolution(entry))  # type: ignore[arg-type]


def _distortion(entry: Entry) -> dict[str, Any] | None:
    """The block of distortion of a camera; a file without coefficients must say that there are none."""
    given = [entry[name] for name in COEFFICIENTS if name in entry]
    if len(given) > 1:
        given[1].refuse(f"stands beside {given[0].key}", "Keep one of them.")
    model = entry.need("distortion_model")
    if not given:
        if canonical(model.text().lower()) != "none":
            entry.need(COEFFICIENTS[0])
        return None
    return distortion(model, given[0])


def _resolution(entry: Entry) -> tuple[int, int] | None:
    if "resolution" not in entry:
        return None
    sides = entry["resolution"].numbers()
    if len(sides) != 2 or any(side != int(side) for side in sides):
        entry["resolution"].refuse("should be width and height, two whole numbers")
    return int(sides[0]), int(sides[1])
