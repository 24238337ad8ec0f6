"""The altimeter: one beam of sound, and the distance to what it meets first."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from varos_warp.products.sensors.protocol import (
    Curve,
    Evidence,
    NoiseDensity,
    RosMessages,
    Samples,
    SensorProduct,
    Surroundings,
    Vec3,
)
from varos_warp.scene.block import Block, Position, Positive
from varos_warp.scene.frames import transform
from varos_warp.sim.motion import Trajectory

SEED = 0x616C74
"""Parts its random numbers from those of other sensors."""
BEAM = np.array([[1.0, 0.0, 0.0]])
"""Direction of the beam in the sensor's axes, where ROS has the beam of a Range."""
EDGE = 1e-5
"""Angle [rad] about the beam within which an edge lets a ray that is traced anew miss what the first one met."""
ULTRASOUND = 0
"""radiation_type of sensor_msgs/Range."""


def _has_length(value: Vec3) -> Vec3:
    if not 1e-6 <= np.linalg.norm(value) <= 1e6:
        raise ValueError("the direction of an altimeter must be 1e-6 to 1e6 long")
    return value


class Altimeter(Block):
    """An altimeter: the distance along one beam to what it meets first, by default straight down."""

    position: Position = (0.0, 0.0, 0.0)
    """Position of the sensor in vehicle axes [m]."""
    direction: Annotated[Vec3, AfterValidator(_has_length)] = (0.0, 0.0, -1.0)
    """Direction of the beam in vehicle axes, of any length."""
    rate_hz: Positive = 10.0
    """Readings per second [Hz]."""
    max_range_m: Annotated[float, Field(gt=0.0, le=1e9)] = 50.0
    """Farthest distance that is read [m]; where nothing is met until then, readings are nan."""


class AltimeterNoise(Block):
    """Errors of the altimeter; where it reads nothing it goes on reading nothing."""

    range_std: NoiseDensity = 0.0
    """White noise of a range, standard deviation [m]"""
    scale: Annotated[float, Field(gt=-1.0, le=1.0)] = 0.0
    """Share by which ranges are too large, as with a wrong speed of sound"""
    bias: Annotated[float, Field(ge=-1e6, le=1e6)] = 0.0
    """Constant part [m]"""


@dataclass(frozen=True)
class AltimeterReadings:
    """Readings of the altimeter: ``time_ns`` int64 [M], ``range`` [M] [m], NaN where its beam meets nothing."""

    time_ns: np.ndarray
    range: np.ndarray


class AltimeterProduct(SensorProduct[Altimeter, AltimeterNoise, AltimeterReadings]):
    """Distance along the beam to the first surface at the time; the vehicle itself is not in its way."""

    key, id, label = "altimeter", "altimeter0", "altimeter"
    noise = AltimeterNoise
    columns = {"range": ["range [m]"]}
    curves = (Curve("range", "Altimeter", "m", ["along the beam"], viewed="altimeter [m]"),)
    stream_id, stream_fields = 70, "float64: distance along the beam to what it meets first [m]; NaN for nothing"
    convention = (
        "distance along the beam, the x axis of the sensor, to what it meets first; nan where that is "
        "nothing within max_range_m"
    )
    chapter = """ALTIMETER (altimeter0/altimeter0_data.csv)
  range is the distance along the beam, which is the x axis of the sensor, to the terrain or an object; nan: it meets
  nothing within sensors.altimeter0.max_range_m of dataset.json. If noise is listed there, the column true_range is
  without it.
"""
    needs_solids, has_bias = True, False
    facts = {"max_range_m": float}
    ros_types = {"": "sensor_msgs/msg/Range"}

    def mounting(self, sensor: Altimeter) -> np.ndarray:
        """T_v_s [4, 4]: x along the beam, z up as far as that allows; of a vertical beam, z forwards."""
        x = np.array(sensor.direction) / np.linalg.norm(sensor.direction)
        z = np.array([0.0, 0.0, 1.0]) if np.hypot(x[0], x[1]) > 1e-6 else np.array([0.0, 1.0, 0.0])
        z = z - (z @ x) * x
        z /= np.linalg.norm(z)
        return transform(np.column_stack([x, np.cross(z, x), z]), sensor.position)

    def measure(self, there: Trajectory, sensor: Altimeter, around: Surroundings) -> AltimeterReadings:
        """The distance at the instants of the motion's rows."""
        T_w_s = there.poses() @ self.mounting(sensor)
        distance, _ = around.met_by_beams(there.time_ns, T_w_s, BEAM, (0.0, sensor.max_range_m))
        return AltimeterReadings(there.time_ns, distance[:, 0])

    def doubt(self, sensor: Altimeter, read: AltimeterReadings) -> str:
        """Return whether it never meets anything."""
        if np.isfinite(read.range).any():
            return ""
        return (
            f"its beam meets nothing within max_range_m = {sensor.max_range_m:g} in the whole run, so all readings "
            "are nan"
        )

    def describe(self, sensor: Altimeter) -> dict[str, Any]:
        """Farthest distance that it reads."""
        return {"max_range_m": sensor.max_range_m}

    def noisy(self, truth: Samples, about: dict[str, Any], model: AltimeterNoise, seed: int) -> tuple[Samples, None]:
        """A range that is scaled, off by a constant, and noisy."""
        white = model.range_std * np.random.default_rng([seed, SEED]).standard_normal(len(truth["range"]))
        return {**truth, "range": _scaled(truth["range"], model.scale, model.bias) + white}, None

    def check(self, found: Evidence) -> None:
        """Ranges are those to the scene's meshes, where these are at hand, and within what it reads; then the noise."""
        truth, most = found.truth["range"], found.about["max_range_m"]
        within = np.where((truth >= 0.0) & (truth <= most), truth, np.nan)
        found.agree("ranges beyond max_range_m", {"range": within}, 0.0, "m", f"is no distance up to {most:g} m")
        _check_ranges(found, truth)
        if noise := found.about.get("noise"):
            off = found.apart(found.read, {"range": _scaled(truth, noise["scale"], noise["bias"])})
            found.measure("range off the truth, at most", off.max(initial=0.0), 8 * noise["range_std"] + 1e-9, "m")
            found.repeated(1e-9, "m")

    def ros(self, make: RosMessages, topic: str, time_ns: int, row: Samples, meta: dict[str, Any]) -> Any:
        """Infinite where it meets nothing (REP 117)."""
        distance, most = float(row["range"]), meta["sensors"][self.id]["max_range_m"]
        return make[self.ros_types[topic]](
            make.header(time_ns, self.ros_frame), ULTRASOUND, 0.0, 0.0, most, np.inf if np.isnan(distance) else distance
        )


ALTIMETER = AltimeterProduct()


def _scaled(truth: np.ndarray, scale: float, bias: float) -> np.ndarray:
    return (1.0 + scale) * truth + bias


def _check_ranges(found: Evidence, truth: np.ndarray) -> None:
    """Ranges are those of rays that are traced anew; at an edge, one between those of rays close by."""
    aside = EDGE * np.array([[0, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    beams = (BEAM + aside) / np.linalg.norm(BEAM + aside, axis=1, keepdims=True)
    met = found.met_by_beams(beams, (0.0, found.about["max_range_m"]))
    if met is None:
        return
    read, near = np.nan_to_num(truth, nan=np.inf), np.nan_to_num(met[0], nan=np.inf)
    slack = 1e-6 + 1e-9 * np.where(np.isfinite(read), read, 0.0)
    wrong = (read < near.min(axis=1) - slack) | (read > near.max(axis=1) + slack)
    expected = np.where(wrong, met[0][:, 0], truth)
    found.agree(
        "range against the scene's meshes", {"range": expected}, 1e-6, "m", "is not the distance to the scene's meshes"
    )
