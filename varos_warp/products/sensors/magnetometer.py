"""The magnetometer: the Earth's field in the axes of the sensor."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from varos_warp.products.sensors.noise import EPS, Noise, check_noise, noise, white_variance
from varos_warp.products.sensors.protocol import (
    Curve,
    Evidence,
    Mounted,
    NoiseDensity,
    RosMessages,
    Samples,
    SensorProduct,
    Surroundings,
    Vec3,
    xyz,
)
from varos_warp.scene.block import Block
from varos_warp.scene.frames import attitude
from varos_warp.sim.motion import Trajectory, applied, product

SEED = 0x6D6167
"""Parts its random numbers from those of other sensors."""
FieldStrength = Annotated[float, Field(ge=-1.0, le=1.0)]
"""[T]"""


class Magnetometer(Mounted):
    """A magnetometer in a field that is the same everywhere."""

    field_T: tuple[FieldStrength, FieldStrength, FieldStrength] = (0.0, 1.36e-5, -5.03e-5)  # noqa: N815
    """The Earth's field in world axes [T]; absent: about that of the Trondheim fjord, if world y points to magnetic
    north."""


class MagnetometerNoise(Block):
    """Errors of each axis of the magnetometer: white noise, and a bias as of the IMU."""

    noise_density: NoiseDensity = 0.0
    """White noise [T/sqrt(Hz)]"""
    random_walk: NoiseDensity = 0.0
    """Random walk of the bias [T/s/sqrt(Hz)]"""
    bias: Vec3 = (0.0, 0.0, 0.0)
    """Constant part, sensor axes: hard iron [T]"""
    turn_on_bias: NoiseDensity = 0.0
    """Standard deviation of the part drawn once per sequence [T]"""


@dataclass(frozen=True)
class FieldReadings:
    """Readings of the magnetometer: ``time_ns`` int64 [M], ``field`` [M, 3] [T] in its own axes."""

    time_ns: np.ndarray
    field: np.ndarray


class MagnetometerProduct(SensorProduct[Magnetometer, MagnetometerNoise, FieldReadings]):
    """The world's field in the sensor's axes, R_sv R_vw B; it is the same everywhere, so the lever arm has no part."""

    key, id, label = "magnetometer", "mag0", "magnetometer"
    noise = MagnetometerNoise
    columns = {"field": xyz("B_S", "T")}
    curves = (Curve("field", "Magnetic field", "µT", "xyz", scale=1e6, viewed="magnetic field [T]"),)
    stream_id, stream_fields = 30, "float64[3]: field x y z [T], axes of the magnetometer"
    convention = "field in sensor axes, R_s_w field_T, in tesla"
    chapter = """MAGNETOMETER (mag0/mag0_data.csv)
  The earth's field in sensor axes [T]; it is the same everywhere, sensors.mag0.field_T of dataset.json in world axes. \
If
  dataset.json lists noise there, the columns true_B_S hold the field without it, and b_B_S the bias contained in the \
readings.
"""
    facts = {"field_T": Vec3}
    ros_types = {"": "sensor_msgs/msg/MagneticField"}

    def measure(self, there: Trajectory, sensor: Magnetometer, around: Surroundings) -> FieldReadings:
        """The field in the axes of the sensor."""
        field = applied(there.rotation().inv(), np.asarray(sensor.field_T, float))
        return FieldReadings(there.time_ns, product(field, attitude(sensor)))

    def describe(self, sensor: Magnetometer) -> dict[str, Any]:
        """The field in world axes."""
        return {"field_T": list(sensor.field_T)}

    def noisy(
        self, truth: Samples, about: dict[str, Any], model: MagnetometerNoise, seed: int
    ) -> tuple[Samples, Samples]:
        """White noise and bias of each axis."""
        made = magnetometer_noise(model, len(truth["time_ns"]), about["rate_hz"], seed)
        return {**truth, "field": truth["field"] + made.white + made.bias}, {"field": made.bias}

    def check(self, found: Evidence) -> None:
        """The field is that of the world in the axes of the sensor's poses."""
        field = np.array(found.about["field_T"])
        found.agree(
            "against poses",
            {"field": field @ found.T[:, :3, :3]},
            1e-9 * float(np.linalg.norm(field)),
            "T",
            "is not the field in the axes of the poses",
        )
        if found.about.get("noise"):
            largest = max(np.abs(found.read["field"]).max(), np.abs(found.bias["field"]).max())
            check_noise(found, "field", 8 * EPS * largest, "T")

    def ros(self, make: RosMessages, topic: str, time_ns: int, row: Samples, meta: dict[str, Any]) -> Any:
        """The field; the variance is of the white noise, and 0 says that it is not known."""
        return make[self.ros_types[topic]](
            make.header(time_ns, self.ros_frame),
            make.vector(row["field"]),
            white_variance(meta["sensors"][self.id]) * np.eye(3).ravel(),
        )


def magnetometer_noise(model: MagnetometerNoise, count: int, rate_hz: float, seed: int) -> Noise:
    """Noise of the magnetometer [T]."""
    rng = np.random.default_rng([seed, SEED])
    return noise(count, rate_hz, model.noise_density, model.random_walk, rng, model.bias, model.turn_on_bias)


MAGNETOMETER = MagnetometerProduct()
