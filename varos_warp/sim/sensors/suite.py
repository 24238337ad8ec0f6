"""All sensors of a vehicle, read along its way: in one piece, or a tick at a time."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

from varos_warp.scene.description import Scene
from varos_warp.sim.clock import samples_until
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.sensors.dvl import Dvl
from varos_warp.sim.sensors.noise import ImuNoiseStream
from varos_warp.sim.sensors.readings import (
    DepthGauge,
    Imu,
    Magnetometer,
    measure_depth,
    measure_dvl,
    measure_field,
    measure_imu,
)


@dataclass(frozen=True)
class Readings:
    """What the sensors of a vehicle read within a time; each is None where the vehicle has none."""

    imu: Imu | None = None
    depth_gauge: DepthGauge | None = None
    magnetometer: Magnetometer | None = None
    dvl: Dvl | None = None


class Sensors:
    """Sensors that go on reading where the piece before ended, the first sample of each at 0.

    Args:
        scene: Its vehicle has the sensors.
        end_ns: Last tick of the scene's sequence; for so long the noise of an IMU is drawn at once.
        parts: Everything solid, if there is a DVL: from ``build_parts``.
        others: Poses of other vehicles, whose bodies are among the parts.
    """

    def __init__(self, scene: Scene, end_ns: int, parts: list | None = None,
                 others: Mapping[str, Callable] | None = None):
        vehicle, self._measure = scene.vehicle, dict[str, Callable[..., Any]]()
        self.solids: Any = None
        """Everything solid, with the BVHs of a DVL."""
        if imu := vehicle.imu:
            stream = imu.noise and ImuNoiseStream(imu.noise, samples_until(end_ns, imu.rate_hz), imu.rate_hz,
                                                  scene.seed)
            self._measure["imu"] = partial(measure_imu, imu=imu, gravity=scene.gravity, stream=stream)
        if gauge := vehicle.depth_gauge:
            self._measure["depth_gauge"] = partial(measure_depth, gauge=gauge, surface_depth_m=scene.surface_depth_m)
        if magnetometer := vehicle.magnetometer:
            self._measure["magnetometer"] = partial(measure_field, magnetometer=magnetometer)
        if dvl := vehicle.dvl:
            from varos_warp.scene.geometry.query import Solids  # Warp is loaded only where there is a DVL

            self.solids = Solids(parts or [])
            self._measure["dvl"] = partial(measure_dvl, dvl=dvl, parts=self.solids, others=others)
        self._rates = {name: getattr(vehicle, name).rate_hz for name in self._measure}
        self._taken = dict.fromkeys(self._measure, 0)
        self._nothing: dict[str, Any] = {}

    def read(self, motion: Trajectory) -> Readings:
        """Readings of all samples up to the end of a piece of the trajectory that have not been taken yet.

        Args:
            motion: The next piece; it begins with the last row of the one before.
        """
        return Readings(**{name: self._read(name, motion) for name in self._measure})

    def _read(self, name: str, motion: Trajectory) -> Any:
        taken, due = self._taken[name], samples_until(int(motion.time_ns[-1]), self._rates[name])
        if taken == due:
            return self._nothing[name]
        read = self._measure[name](motion, first=taken)
        self._taken[name] = due
        if not taken:
            self._nothing[name] = replace(read, **{field.name: getattr(read, field.name)[:0].copy()
                                                   for field in fields(read)})
        return read
