"""How a camera exposes: how long, row after row or at once, and with which gain."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from varos_warp.scene.block import Block, Positive, unwritten_if_absent, written_otherwise
from varos_warp.scene.description.image_types import WATER
from varos_warp.scene.description.optics import Duration


class PercentileMeter(Block):
    """Exposure by highlights, of which the brightest may clip; with ``mean``, dark and milky water stay dark."""

    meter: Literal["percentile"]
    """Tells how the light is measured."""
    percentile: Annotated[float, Field(gt=0.0, le=100.0)] = 98.5
    """Share of the image in percent that is no brighter than ``level``. Each pixel counts by its brightest channel, and
    in the middle of the image more than at its edges."""
    level: Annotated[float, Field(gt=0.0, le=1.0)] = 0.95
    """Linear value to which that percentile is exposed; 1 is white."""
    mean: Annotated[float, Field(gt=0.0, le=1.0)] | None = Field(default=None, examples=[0.1])
    """Most that the mean of the luminance becomes, by the same weights: where there are no highlights but milky water,
    that keeps it dark. Absent: no bound."""

    _written = unwritten_if_absent("mean")

    @property
    def column(self) -> str:
        """Name of what is measured, in tables of exposures."""
        return f"percentile_{self.percentile!r}"


Gain = Literal["adaptive", "constant"] | Positive | PercentileMeter
"""What gives each frame its gain before 8 bits: its brightness, that of the sequence, a number, or a meter."""


WhiteBalance = Literal["none", "grey_world", "lamps"]
"""What makes A's colours grey in the mean of an image, or of grey things in the light of the vehicle's lamps."""


class Exposure(Block):
    """Exposure correction before 8-bit output (paper 3.2.1)."""

    A: Gain = "adaptive"
    """``adaptive``: each frame by its own brightness, smoothed over time (paper 3.2.1); ``constant``: one gain for the
    sequence; the gain itself; or ``{meter: percentile}``: by the highlights, smoothed likewise. Cameras may have one of
    their own (``exposure.gain``)."""
    B: Gain = "constant"
    """Exposure of B, in the same forms as that of A; with ``constant``, a reflectance of 0.5 becomes the same grey in
    every frame."""
    white_balance: WhiteBalance = "none"
    """White balance of A and P, by a gain for each channel: ``grey_world`` makes the mean of an image grey, smoothed as
    the gain is; ``lamps`` makes grey what is so at ``focus_m`` in the light of the vehicle's lamps (docs/dataset.md).
    Cameras may have one of their own (``exposure.white_balance``)."""

    _written = written_otherwise(lambda exposure: ["white_balance"] if exposure.white_balance == "none" else [])


class CameraExposure(Block):
    """Exposure of a camera: while it lasts, the vehicle's motion blurs A and B; C, D, S, F and T show the middle."""

    time_s: Duration = 0.0
    """How long each pixel is exposed [s]; 0 is an instant."""
    readout_s: Duration = 0.0
    """Time that a rolling shutter takes to read all rows, first row first: their number times the time from one row to
    the next [s]; 0 is a global shutter. Time stamps are of the middle of the exposure of the middle row."""
    gain: Gain | None = Field(default=None, examples=["constant"])
    """Gain of this camera's A, and of P with it, in the forms of ``render.exposure.A``. Absent: that."""
    white_balance: WhiteBalance | None = Field(default=None, examples=["grey_world"])
    """White balance of this camera's A and P: ``none``, ``grey_world`` or ``lamps``. Absent: that of
    ``render.exposure``."""

    _written = written_otherwise(
        lambda exposure: [
            *(("time_s", "readout_s") if exposure.is_instant else ()),
            *(key for key in ("gain", "white_balance") if getattr(exposure, key) is None),
        ]
    )

    @property
    def is_instant(self) -> bool:
        """Whether an image is of one instant, without blur and without a rolling shutter."""
        return self.time_s == 0.0 == self.readout_s


def gain_of(exposure: Exposure, of_camera: CameraExposure, letter: str) -> Gain:
    """What gives A or B of a camera its gain: of A the camera's own setting, if it has one."""
    own = of_camera.gain if letter == WATER else None
    gain: Gain = getattr(exposure, letter) if own is None else own
    return gain


def white_balance_of(exposure: Exposure, of_camera: CameraExposure, letter: str) -> WhiteBalance:
    """White balance of A or B of a camera: B has none, A that of the camera, if it has one of its own."""
    if letter != WATER:
        return "none"
    return exposure.white_balance if of_camera.white_balance is None else of_camera.white_balance


def varies(exposure: Exposure, of_camera: CameraExposure) -> bool:
    """Whether images A of a camera may have different gains."""
    gain, balance = gain_of(exposure, of_camera, WATER), white_balance_of(exposure, of_camera, WATER)
    return gain != "constant" and (balance == "grey_world" or not isinstance(gain, float))


class Shutter(Block):
    """What older files call the times of ``exposure``."""

    exposure_s: Duration = 0.0
    """``exposure.time_s`` [s]."""
    readout_s: Duration = 0.0
    """``exposure.readout_s`` [s]."""

    @model_validator(mode="after")
    def _is_open(self):
        if self.exposure_s == 0.0 == self.readout_s:
            raise ValueError("a shutter has an exposure_s or a readout_s above 0; leave it out for sharp images")
        return self


def with_shutter(camera: Any) -> Any:
    """Validator of a camera: an older file's ``shutter`` gives the times of its exposure."""
    old, exposure = vars(camera)["shutter"], camera.exposure
    if old is None:
        return camera
    if given := [f"exposure.{key}" for key in ("time_s", "readout_s") if key in exposure.model_fields_set]:
        raise ValueError(
            f"shutter: cannot be given beside {' and '.join(given)}: exposure_s is what older files call "
            "exposure.time_s, and readout_s is exposure.readout_s; leave out shutter"
        )
    times = {"time_s": old.exposure_s, "readout_s": old.readout_s}
    vars(camera).update(shutter=None, exposure=exposure.model_copy(update=times))
    camera.model_fields_set.discard("shutter")
    camera.model_fields_set.add("exposure")
    return camera
