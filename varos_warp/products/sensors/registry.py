"""The sensors that there are: a line for the block of each on a vehicle, and one for what it reads."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

from varos_warp.products.sensors.altimeter import ALTIMETER, Altimeter, AltimeterReadings
from varos_warp.products.sensors.depth_gauge import DEPTH_GAUGE, DepthReadings
from varos_warp.products.sensors.dvl import DVL, Dvl, DvlReadings
from varos_warp.products.sensors.imu import IMU, Imu, ImuReadings
from varos_warp.products.sensors.magnetometer import MAGNETOMETER, FieldReadings, Magnetometer
from varos_warp.products.sensors.protocol import Mounted, SensorProduct
from varos_warp.scene.block import Block


class SensorBlocks(Block):
    """The sensors on a vehicle, in the order of their readings."""

    imu: Annotated[Imu | None, IMU] = Imu()
    """The inertial measurement unit; null: none."""
    depth_gauge: Annotated[Mounted | None, DEPTH_GAUGE] = Mounted()
    """The depth gauge; null: none."""
    magnetometer: Annotated[Magnetometer | None, MAGNETOMETER] = None
    """The magnetometer (docs/sensors.md). Absent: none."""
    dvl: Annotated[Dvl | None, DVL] = None
    """The Doppler velocity log (docs/sensors.md). Absent: none."""
    altimeter: Annotated[Altimeter | None, ALTIMETER] = None
    """The altimeter (docs/sensors.md). Absent: none."""


@dataclass(frozen=True, kw_only=True)
class Readings:
    """What the sensors of a vehicle read within a time; each is None where the vehicle has none."""

    imu: ImuReadings | None = None
    depth_gauge: DepthReadings | None = None
    magnetometer: FieldReadings | None = None
    dvl: DvlReadings | None = None
    altimeter: AltimeterReadings | None = None


SENSORS: tuple[SensorProduct[Any, Any, Any], ...] = tuple(
    product for field in SensorBlocks.model_fields.values() for product in field.metadata
)
BY_ID = {sensor.id: sensor for sensor in SENSORS}
ASKED_FOR = tuple(name for name, field in SensorBlocks.model_fields.items() if field.default is None)
"""Keys of the sensors that a vehicle has only if its scene asks for them: without them nothing of them is written."""


def mounted(vehicle: SensorBlocks) -> Iterator[tuple[SensorProduct[Any, Any, Any], Any]]:
    """Each sensor that a vehicle has, and its block."""
    for sensor in SENSORS:
        if (block := getattr(vehicle, sensor.key)) is not None:
            yield sensor, block


def needs_solids(vehicle: SensorBlocks) -> bool:
    """Return whether some sensor of a vehicle meets what is solid in the scene."""
    return any(sensor.needs_solids for sensor, _ in mounted(vehicle))
