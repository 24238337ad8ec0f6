"""What a noise profile may say: the errors of the sensors and the cameras (docs/noise.md).

A profile is a YAML file with a block for each sensor that errs; a block that is absent adds nothing.
"""

from typing import Annotated

from pydantic import Field, model_validator

from varos_warp.scene.description.block import Block, NonNegative, Positive, Vec3, unwritten_if_absent
from varos_warp.scene.description.optics import Vignetting
from varos_warp.scene.description.vehicle import ImuNoise, NoiseDensity

SENSOR_BLOCKS = {"imu0": "imu", "depth0": "depth_gauge", "mag0": "magnetometer", "dvl0": "dvl"}
"""Block of a profile by the sensor's name in a dataset; of the vehicle, too."""


class DepthGaugeNoise(Block):
    """Errors of the depth gauge, quantised last."""

    noise_density: NonNegative = 0.0
    """White noise [m/sqrt(Hz)]"""
    random_walk: NonNegative = 0.0
    """Of the bias [m/s/sqrt(Hz)]"""
    bias: float = 0.0
    """Constant part [m]"""
    turn_on_bias: NonNegative = 0.0
    """Standard deviation of the part drawn once per sequence [m]"""
    resolution: NonNegative = 0.0
    """Step of the readings [m]; 0: none"""


class MagnetometerNoise(Block):
    """Errors of each axis of the magnetometer: white noise, and a bias as of the IMU."""

    noise_density: NoiseDensity = 0.0
    """White noise [T/sqrt(Hz)]"""
    random_walk: NoiseDensity = 0.0
    """Of the bias [T/s/sqrt(Hz)]"""
    bias: Vec3 = (0.0, 0.0, 0.0)
    """Constant part, sensor axes: hard iron [T]"""
    turn_on_bias: NoiseDensity = 0.0
    """Standard deviation of the part drawn once per sequence [T]"""


class DvlNoise(Block):
    """Errors of each beam of the DVL; its velocity and altitude are those of the beams that err."""

    velocity_std: NoiseDensity = 0.0
    """White noise of a reading, standard deviation [m/s]"""
    scale: Annotated[float, Field(gt=-1.0, le=1.0)] = 0.0
    """Share by which velocities are too large, as with a wrong speed of sound"""
    range_std: NoiseDensity = 0.0
    """White noise of a range, standard deviation [m]"""


class CameraNoise(Block):
    """A linear image sensor (EMVA 1288): photons to electrons to digital numbers (DN), each colour channel alike.

    The highest DN is white. Give ``electrons_per_dn``: the exposure gain of a frame is a time of exposure, so white
    is the same number of electrons in every frame. Or give ``electrons_per_radiance``: the time of exposure is the
    same in every frame, and its gain is an amplifier's, which amplifies the noise as well.
    """

    electrons_per_dn: Annotated[float, Field(gt=0.0, le=1e9)] | None = None
    """Conversion, the reciprocal of the system gain K [e-/DN]"""
    electrons_per_radiance: Annotated[float, Field(gt=0.0, le=1e12)] | None = None
    """[e- per W/sr/m^2]"""
    full_well_electrons: Positive | None = None
    """Electrons at which a pixel saturates [e-]; absent: above white"""
    shot_noise: bool = True
    """Poisson noise of the electrons"""
    read_noise_electrons: NonNegative = 0.0
    """Standard deviation, per pixel [e-]"""
    dark_current_electrons_per_s: NonNegative | None = None
    """Electrons that gather without light while a pixel is exposed [e-/s]; for cameras whose ``shutter`` has an
    ``exposure_s``"""
    row_noise_electrons: NonNegative = 0.0
    """Standard deviation of an offset that a row of all channels shares [e-]"""
    bits: Annotated[int, Field(ge=4, le=16)] = 12
    """Of the analogue-to-digital converter"""
    black_level: Annotated[int, Field(ge=0)] = 0
    """DN of no light; noise below it is kept until it is taken off"""
    vignetting: Vignetting | None = None

    _written = unwritten_if_absent("dark_current_electrons_per_s")

    @model_validator(mode="after")
    def _one_exposure_and_room_above_black(self):
        if (self.electrons_per_dn is None) == (self.electrons_per_radiance is None):
            raise ValueError("give one of electrons_per_dn and electrons_per_radiance")
        if self.black_level >= 2**self.bits - 1:
            raise ValueError(f"black_level must be below {2**self.bits - 1}, the highest value of {self.bits} bits")
        return self


class NoiseProfile(Block):
    """Errors of all sensors."""

    name: str = "unnamed"
    imu: ImuNoise | None = None
    depth_gauge: DepthGaugeNoise | None = None
    magnetometer: MagnetometerNoise | None = None
    dvl: DvlNoise | None = None
    camera: CameraNoise | None = None

    _written = unwritten_if_absent("magnetometer", "dvl")
