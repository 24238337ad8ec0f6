"""The depth gauge: metres below the surface (paper 3.2.3)."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from varos_warp.products.sensors.noise import check_noise, noise, white_variance
from varos_warp.products.sensors.protocol import (
    Curve,
    Evidence,
    Mounted,
    RosMessages,
    Samples,
    SensorProduct,
    Surroundings,
)
from varos_warp.scene.block import Block, NonNegative
from varos_warp.scene.seawater import WATER_DENSITY
from varos_warp.sim.motion import Trajectory, applied

SEED = 0x646570
"""Parts its random numbers from those of other sensors."""
ATMOSPHERE = 101325.0
"""Pressure of the standard atmosphere on the surface [Pa]."""


class DepthGaugeNoise(Block):
    """Errors of the depth gauge, quantised last."""

    noise_density: NonNegative = 0.0
    """White noise [m/sqrt(Hz)]"""
    random_walk: NonNegative = 0.0
    """Random walk of the bias [m/s/sqrt(Hz)]"""
    bias: float = 0.0
    """Constant part [m]"""
    turn_on_bias: NonNegative = 0.0
    """Standard deviation of the part drawn once per sequence [m]"""
    resolution: NonNegative = 0.0
    """Step of the readings [m]; 0: none"""


@dataclass(frozen=True)
class DepthReadings:
    """Readings of the depth gauge: ``time_ns`` int64 [M], ``depth`` [M] [m] below the surface, positive down."""

    time_ns: np.ndarray
    depth: np.ndarray


class DepthGauge(SensorProduct[Mounted, DepthGaugeNoise, DepthReadings]):
    """The depth of the gauge itself, which may sit off the vehicle's origin."""

    key, id, label = "depth_gauge", "depth0", "depth gauge"
    noise = DepthGaugeNoise
    columns = {"depth": ["d_v_w [m]"]}
    curves = (Curve("depth", "Depth gauge", "m", ["below the surface"], down=True, viewed="depth gauge [m]"),)
    stream_id, stream_fields = 20, "float64: depth below the surface [m]"
    convention = "metres below the surface, positive down"
    chapter = """DEPTH GAUGE (depth0/depth0_data.csv)
  Metres below the surface, positive down; world z = 0 lies at {SURFACE} m.
"""
    is_standard = True
    ros_types = {"": "std_msgs/msg/Float64", "/pressure": "sensor_msgs/msg/FluidPressure"}

    def measure(self, there: Trajectory, sensor: Mounted, around: Surroundings) -> DepthReadings:
        """How far the gauge is below the surface."""
        lever = applied(there.rotation(), np.asarray(sensor.position, float))
        return DepthReadings(there.time_ns, around.surface_depth_m - (there.position[:, 2] + lever[:, 2]))

    def noisy(
        self, truth: Samples, about: dict[str, Any], model: DepthGaugeNoise, seed: int
    ) -> tuple[Samples, Samples]:
        """White noise and bias, then the step of the readings."""
        reading, bias = depth_gauge_noise(model, truth["depth"], about["rate_hz"], seed)
        return {**truth, "depth": reading}, {"depth": bias}

    def check(self, found: Evidence) -> None:
        """The depth is that of the poses of the gauge."""
        expected = {"depth": found.meta["surface_depth_m"] - found.T[:, 2, 3]}
        found.agree("against poses", expected, 1e-9, "m", "its depth is not that of the poses")
        if found.about.get("noise"):
            check_noise(found, "depth", 1e-9, "m")

    def ros(self, make: RosMessages, topic: str, time_ns: int, row: Samples, meta: dict[str, Any]) -> Any:
        """The depth alone, whose stamp is the time of the log, or the absolute pressure there and its variance.

        The variance is that of the white noise and of rounding to steps; 0 says that it is not known.
        """
        if not topic:
            return make[self.ros_types[topic]](float(row["depth"]))
        about, per_metre = meta["sensors"][self.id], WATER_DENSITY * float(np.linalg.norm(meta["gravity"]))
        step = (about.get("noise") or {}).get("resolution") or 0.0
        variance = white_variance(about) + step**2 / 12.0
        return make[self.ros_types[topic]](
            make.header(time_ns, self.ros_frame), ATMOSPHERE + per_metre * float(row["depth"]), per_metre**2 * variance
        )


def depth_gauge_noise(
    model: DepthGaugeNoise, depth: np.ndarray, rate_hz: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Readings of the depth gauge [n] and the bias in them [n], [m], of true depths [n]."""
    rng = np.random.default_rng([seed, SEED])
    made = noise(len(depth), rate_hz, model.noise_density, model.random_walk, rng, model.bias, model.turn_on_bias, 1)
    reading = depth + made.white[:, 0] + made.bias[:, 0]
    if model.resolution > 0.0:
        reading = np.rint(reading / model.resolution) * model.resolution
    return reading, made.bias[:, 0]


DEPTH_GAUGE = DepthGauge()
