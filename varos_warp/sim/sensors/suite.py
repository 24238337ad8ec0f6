"""All sensors of a vehicle, read along its way: in one piece, or a tick at a time."""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any

from varos_warp.products.sensors.protocol import SensorProduct
from varos_warp.products.sensors.registry import Readings, mounted
from varos_warp.scene.description import Scene
from varos_warp.sim.clock import samples_until, times_ns
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.sensors.surroundings import Around


def measured(sensor: SensorProduct, motion: Trajectory, block: Any, around: Around, first: int = 0) -> Any:
    """Readings without noise along a motion, from the sample with the number ``first`` up to its end."""
    rate_hz = block.rate_hz
    return sensor.measure(
        motion.at(times_ns(samples_until(int(motion.time_ns[-1]), rate_hz), rate_hz, first)), block, around
    )


def doubts(scene: Scene, read: Readings) -> list[str]:
    """What a person should know about the readings of a whole run of a scene, each after the sensor's key."""
    told = ((sensor.key, sensor.doubt(block, getattr(read, sensor.key))) for sensor, block in mounted(scene.vehicle))
    return [f"vehicle.{key}: {words}" for key, words in told if words]


class Sensors:
    """Sensors that go on reading where the piece before ended, the first sample of each at 0.

    To ``end_ns``, the last tick of the scene's sequence, the noise that the scene asks for is drawn at once. ``parts``,
    from ``build_parts``, are everything solid, if some sensor meets it, the bodies of ``others`` among them.
    """

    def __init__(
        self, scene: Scene, end_ns: int, parts: list | None = None, others: Mapping[str, Callable] | None = None
    ):
        self.around = Around.of(scene, parts, others)
        self._mounted = {sensor.key: (sensor, block) for sensor, block in mounted(scene.vehicle)}
        self._errors = {
            name: sensor.errors(block, samples_until(end_ns, block.rate_hz), scene.seed)
            for name, (sensor, block) in self._mounted.items()
        }
        self._taken = dict.fromkeys(self._mounted, 0)
        self._nothing: dict[str, Any] = {}

    def read(self, motion: Trajectory) -> Readings:
        """Readings not taken yet up to the end of the next piece, which begins with the last row of the one before."""
        return Readings(**{name: self._read(name, motion) for name in self._mounted})

    def _read(self, name: str, motion: Trajectory) -> Any:
        sensor, block = self._mounted[name]
        taken, due = self._taken[name], samples_until(int(motion.time_ns[-1]), block.rate_hz)
        if taken == due:
            return self._nothing[name]
        read = measured(sensor, motion, block, self.around, taken)
        if (erring := self._errors[name]) is not None:
            read = erring(read)
        self._taken[name] = due
        if not taken:
            self._nothing[name] = replace(
                read, **{field.name: getattr(read, field.name)[:0].copy() for field in fields(read)}
            )
        return read
