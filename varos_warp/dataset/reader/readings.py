"""What sensors measured, and the states of the vehicle: the part of `Dataset` that reads tables of samples."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.layout import STATES, Layout
from varos_warp.errors import require_known
from varos_warp.products.sensors.protocol import SensorProduct
from varos_warp.products.sensors.registry import BY_ID
from varos_warp.scene.description.image_types import WATER


class Readings:
    """Tables of samples of a dataset, kept once they are read; part of `Dataset`."""

    root: Path
    meta: dict[str, Any]
    layout: Layout
    _kept: dict[Any, Any]

    def _once(self, key: Any, read: Callable) -> Any:
        """What ``read()`` returns, which is called the first time only; two threads may both call it, with no harm."""
        if key not in self._kept:
            self._kept[key] = read()
        return self._kept[key]

    def states(self, start_ns: int | None = None, stop_ns: int | None = None) -> dict[str, np.ndarray]:
        """The vehicle at every tick, or at those in start_ns <= time < stop_ns.

        Returns:
            time_ns int64 [N]; position, velocity, acceleration [N, 3] in world axes; quaternion [N, 4], w first;
            angular_velocity, angular_acceleration [N, 3] in vehicle axes.
        """
        return self._samples(self.layout.states, STATES, start_ns, stop_ns)

    def has_noise(self, name: str) -> bool:
        """Return whether the readings of a sensor such as ``imu0``, or ``A`` of the cameras, have noise."""
        if name == WATER:
            return bool(((self.meta.get("noise") or {}).get("profile") or {}).get("camera"))
        return bool(self.meta["sensors"][name].get("noise"))

    def readings(
        self, name: str, start_ns: int | None = None, stop_ns: int | None = None, *, truth: bool = False
    ) -> dict[str, np.ndarray]:
        """Readings of a sensor, all or those in start_ns <= time < stop_ns.

        Args:
            name: One of ``data.meta["sensors"]``, such as ``imu0``.
            start_ns: The first time; absent: that of the first reading.
            stop_ns: The time before which they end; absent: all follow.
            truth: Without the noise in them.

        Returns:
            time_ns int64 [N], and quantities by their names: of the sensors that have one, what their methods say, as
            `imu` and `dvl`; of the others, docs/sensors.md.

        Raises:
            InputError: If there is no such sensor, or its readings cannot be read.
        """
        return self._samples(
            self.layout.sensor(name), self._sensor(name).columns, start_ns, stop_ns, int(truth and self.has_noise(name))
        )

    def bias(self, name: str, start_ns: int | None = None, stop_ns: int | None = None) -> dict[str, np.ndarray] | None:
        """The bias in the `readings` of a sensor such as ``imu0``, in their form; None without noise, or of a DVL."""
        sensor = self._sensor(name)
        if not (sensor.has_bias and self.has_noise(name)):
            return None
        path, before = (self.layout.bias(name), 0) if sensor.bias_apart else (self.layout.sensor(name), 2)
        return self._samples(path, sensor.columns, start_ns, stop_ns, before)

    def _sensor(self, name: str) -> SensorProduct[Any, Any, Any]:
        """The sensor of a name."""
        where = {"file": self.root, "key": "name"}
        require_known(name, self.meta["sensors"], "the dataset has no sensor of this name", near=True, **where)
        return BY_ID[name]

    def imu(
        self, start_ns: int | None = None, stop_ns: int | None = None, *, truth: bool = False
    ) -> dict[str, np.ndarray]:
        """Readings of the IMU, all or those in start_ns <= time < stop_ns; ``truth``: without the noise in them.

        Returns:
            time_ns int64 [N], acceleration (specific force) [m/s^2] and angular_velocity [rad/s] [N, 3].
        """
        return self.readings("imu0", start_ns, stop_ns, truth=truth)

    def imu_bias(self, start_ns: int | None = None, stop_ns: int | None = None) -> dict[str, np.ndarray] | None:
        """The bias in the readings of `imu`, of the same form; None where they have no noise."""
        return self.bias("imu0", start_ns, stop_ns)

    def depth_gauge(
        self, start_ns: int | None = None, stop_ns: int | None = None, *, truth: bool = False
    ) -> dict[str, np.ndarray]:
        """time_ns int64 [N] and depth [m] below the surface [N]; which of them, as in `readings`."""
        return self.readings("depth0", start_ns, stop_ns, truth=truth)

    def magnetometer(
        self, start_ns: int | None = None, stop_ns: int | None = None, *, truth: bool = False
    ) -> dict[str, np.ndarray]:
        """time_ns int64 [N] and field [N, 3] [T] in sensor axes; which of them, as in `readings`."""
        return self.readings("mag0", start_ns, stop_ns, truth=truth)

    def dvl(
        self, start_ns: int | None = None, stop_ns: int | None = None, *, truth: bool = False
    ) -> dict[str, np.ndarray]:
        """Readings of the DVL; which of them, as in `readings`.

        Returns:
            time_ns int64 [N]; velocity over the bottom [N, 3] in sensor axes, altitude [N]; range and beam_velocity of
            each beam [N, 4] (away from the sensor). NaN without bottom lock.
        """
        return self.readings("dvl0", start_ns, stop_ns, truth=truth)

    def _samples(
        self, path: Path, columns: dict[str, list[str]], start_ns: int | None, stop_ns: int | None, before: int = 0
    ) -> dict[str, np.ndarray]:
        """Rows of a table by quantity, as in `READINGS`; ``before``: so many blocks of the same columns come first."""
        count = sum(map(len, columns.values()))
        first = 1 + before * count
        table = self._once((path, first), lambda: files.read_numbers(path, first + count))
        rows = slice(*(None if t is None else np.searchsorted(table[0], t) for t in (start_ns, stop_ns)))
        result, found = {"time_ns": table[0][rows].copy()}, iter(table[first:])
        for quantity, names in columns.items():
            block = np.column_stack([next(found)[rows] for _ in names]).astype(float)
            result[quantity] = block if len(names) > 1 else block[:, 0]
        return result
