"""What a noise profile may say: the errors of the sensors and the cameras (docs/noise.md).

A profile is a YAML file with a block for each sensor that errs; a block that is absent adds nothing.
"""

from typing import Annotated, Any

from pydantic import Field, create_model, model_validator

from varos_warp.products.sensors.registry import ASKED_FOR, SENSORS
from varos_warp.scene.block import Block, NonNegative, Positive, unwritten_if_absent
from varos_warp.scene.description.optics import Vignetting


class CameraNoise(Block):
    """A linear image sensor (EMVA 1288): photons to electrons to digital numbers (DN), each colour channel alike.

    The highest DN is white. Give ``electrons_per_dn``: the exposure gain of a frame is a time of exposure, so white
    is the same number of electrons in every frame. Or give ``electrons_per_radiance``: the time of exposure is the
    same in every frame, and its gain is an amplifier's, which amplifies the noise as well.
    """

    electrons_per_dn: Annotated[float, Field(gt=0.0, le=1e9)] | None = Field(default=None, examples=[2.6])
    """Conversion, the reciprocal of the system gain K [e-/DN]"""
    electrons_per_radiance: Annotated[float, Field(gt=0.0, le=1e12)] | None = Field(default=None, examples=[2e6])
    """Electrons that a radiance gives, with a time of exposure that is the same in every frame [e- per W/sr/m^2]"""
    full_well_electrons: Positive | None = Field(default=None, examples=[10500])
    """Electrons at which a pixel saturates [e-]; absent: above white"""
    shot_noise: bool = True
    """Poisson noise of the electrons"""
    read_noise_electrons: NonNegative = 0.0
    """Standard deviation of the read noise, per pixel [e-]"""
    dark_current_electrons_per_s: NonNegative | None = Field(default=None, examples=[20])
    """Electrons that gather without light while a pixel is exposed [e-/s]; for cameras with
    ``exposure.time_s``"""
    row_noise_electrons: NonNegative = 0.0
    """Standard deviation of an offset that a row of all channels shares [e-]"""
    bits: Annotated[int, Field(ge=4, le=16)] = 12
    """Number of bits of the analogue-to-digital converter"""
    black_level: Annotated[int, Field(ge=0)] = 0
    """DN of no light; noise below it is kept until it is taken off"""
    vignetting: Vignetting | None = None
    """Fall of light towards the corners, of cameras of which the scene states none"""

    _written = unwritten_if_absent("dark_current_electrons_per_s")

    @model_validator(mode="after")
    def _one_exposure_and_room_above_black(self):
        if (self.electrons_per_dn is None) == (self.electrons_per_radiance is None):
            raise ValueError("give one of electrons_per_dn and electrons_per_radiance")
        if self.black_level >= 2**self.bits - 1:
            raise ValueError(f"black_level must be below {2**self.bits - 1}, the highest value of {self.bits} bits")
        return self


class _Named(Block):
    name: str = "unnamed"


_NOISES: dict[str, Any] = {sensor.key: (sensor.noise | None, None) for sensor in SENSORS}
_SENSORS: Any = create_model("_SENSORS", __base__=_Named, __module__=__name__, **_NOISES)


class NoiseProfile(_SENSORS):
    """Errors of all sensors: a block for each of the registry, by its key, and one for the cameras."""

    camera: CameraNoise | None = None

    _written = unwritten_if_absent(*ASKED_FOR)

    @property
    def of_sensors(self) -> dict[str, Block]:
        """The blocks of the sensors that err, by the names of these in a dataset."""
        return {sensor.id: block for sensor in SENSORS if (block := getattr(self, sensor.key)) is not None}
