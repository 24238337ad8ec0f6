"""Readings of the sensors against poses, states and the scene's meshes, by the check in the file of each sensor."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from varos_warp.dataset.geometry import rebuilt
from varos_warp.dataset.noise_pass import is_repeatable, noise_of, noisy_readings
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.validate.objects import solid
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.errors import InputError
from varos_warp.products.sensors.protocol import Samples, SensorProduct
from varos_warp.products.sensors.registry import SENSORS
from varos_warp.sim.clock import times_ns
from varos_warp.sim.companions import companions
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.sensors.surroundings import Around


def check_sensors(data: Dataset, result: Validation) -> None:
    """Every sensor by its own check, where its poses are at the times of its readings."""
    for sensor in (sensor for sensor in SENSORS if sensor.id in data.recorded):
        result.guard(_check, data, result, sensor)


def _check(data: Dataset, result: Validation, sensor: SensorProduct) -> None:
    time_ns, T = data.poses(sensor.id)
    if not np.array_equal(time_ns, data.readings(sensor.id)["time_ns"]):
        result.add(f"{sensor.id}: poses and readings have different time stamps")
        return
    step = np.diff(times_ns(len(time_ns), rate := data.meta["sensors"][sensor.id]["rate_hz"]))
    wrong = np.diff(time_ns) != step
    uneven = result.add_rows(
        data.layout.sensor(sensor.id), f"the next sample is not {1e9 / rate:.0f} ns later", wrong, wrong[:, None], [0]
    )
    if not uneven:
        sensor.check(Checked(data, result, sensor, T))


class Checked:
    """The readings of a sensor at its poses T [N, 4, 4] and what they are held against: the protocol `Evidence`."""

    def __init__(self, data: Dataset, result: Validation, sensor: SensorProduct, T: np.ndarray):
        self._data, self._result, self._sensor, self.T = data, result, sensor, T
        self.meta, self.about = data.meta, data.meta["sensors"][sensor.id]
        self._path = data.layout.sensor(sensor.id)

    @property
    def truth(self) -> Samples:
        """Readings without noise."""
        return self._data.readings(self._sensor.id, truth=True)

    @property
    def read(self) -> Samples:
        """Readings with the noise that they may have."""
        return self._data.readings(self._sensor.id)

    @property
    def bias(self) -> Samples:
        """Bias in the readings."""
        return self._data.bias(self._sensor.id) or {}

    @cached_property
    def motion(self) -> Trajectory:
        """The vehicle's motion at the readings."""
        return self._data.motion_at(self.truth["time_ns"])

    @property
    def states(self) -> str:
        """Name of the file of the vehicle's states."""
        return self._data.layout.states.name

    @property
    def anything_moves(self) -> bool:
        """True if beams may meet something that moves."""
        return bool(solid(self._data))

    def met_by_beams(self, beams: np.ndarray, range_m: Sequence[float]) -> tuple[np.ndarray, np.ndarray] | None:
        """What beams meet in the scene's meshes; None where these are not at hand."""
        try:
            scene, parts = rebuilt(self._data)
        except InputError:
            return None
        around = Around.of(scene, parts, companions(scene))
        return around.met_by_beams(self.truth["time_ns"], self.T, beams, range_m)

    def agree(self, name: str, expected: Samples, limit: float, unit: str, problem: str, noisy: bool = False) -> None:
        """Readings are as expected within a limit; what is not is told of by row."""
        off = self.apart(self.read if noisy else self.truth, expected)
        told = self.rows(problem, ~(off.max(1) <= limit), off, slice(off.shape[1]), noisy)
        self._result.measure(f"{self._sensor.id}: {name}", off.max(initial=0.0), limit, unit, told)

    def apart(self, found: Samples, expected: Samples) -> np.ndarray:
        """How far quantities are apart [N, k], in the order of their columns: 0 where neither has a number."""
        one, other = (
            np.column_stack([of[quantity] for quantity in expected if quantity != "time_ns"])
            for of in (found, expected)
        )
        off = np.where(np.isnan(one) & np.isnan(other), 0.0, np.abs(one - other))
        return np.where(np.isnan(off), np.inf, off)

    def rows(self, problem: str, wrong: np.ndarray, off: np.ndarray, columns: slice, noisy: bool = False) -> bool:
        """Tell of rows that are ``wrong`` by their cell that is farthest off, and whether there are any."""
        count = sum(map(len, self._sensor.columns.values()))
        first = 1 + count if self.about.get("noise") and not noisy else 1
        return self._result.add_rows(self._path, problem, wrong, off, range(first, first + count)[columns])

    def measure(self, name: str, value: float, limit: float, unit: str) -> None:
        """Note a quantity, which above its limit is a problem."""
        self._result.measure(f"{self._sensor.id}: {name}", value, limit, unit)

    def guard(self, check: Callable[..., None], *args: Any) -> None:
        """Run a part of the check, without which the others go on."""
        self._result.guard(check, *args)

    def repeated(self, limit: float, unit: str) -> None:
        """Readings and bias are those of the profile and its seed, where NumPy can draw their noise again."""
        profile, seed = noise_of(self._data) or (None, 0)
        model = profile and profile.of_sensors.get(self._sensor.id)
        if model is None or not is_repeatable(self._data):
            return
        reading, bias = noisy_readings(self._data, self._sensor.id, model, seed)
        off = self.apart(self.read, reading).max()
        if bias is not None:
            off = max(off, self.apart(self.bias, bias).max())
        self.measure("readings against profile and seed", off, limit, unit)
