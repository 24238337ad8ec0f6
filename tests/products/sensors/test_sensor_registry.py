"""All sensors: what each tells of itself fits together with what the others tell."""

from dataclasses import fields

import numpy as np
import pytest

from varos_warp.dataset.export import stream
from varos_warp.products.sensors.protocol import SensorProduct
from varos_warp.products.sensors.registry import BY_ID, SENSORS, Readings, SensorBlocks
from varos_warp.scene.description.vehicle import Vehicle
from varos_warp.scene.frames import pose_matrix
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.sensors.suite import measured
from varos_warp.sim.sensors.surroundings import Around

each_sensor = pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor.key)


def block_of(sensor: SensorProduct):
    return getattr(Vehicle(**{sensor.key: {"rate_hz": 5.0}}), sensor.key)


def at_rest() -> Trajectory:
    none = np.zeros((3, 3))
    return Trajectory(np.arange(3) * 200_000_000, none, none, none, np.tile([1.0, 0, 0, 0], (3, 1)), none, none)


def test_blocks_readings_and_sensors_have_the_same_names_in_the_same_order():
    keys = [sensor.key for sensor in SENSORS]
    assert list(SensorBlocks.model_fields) == keys
    assert [field.name for field in fields(Readings)] == keys


def test_no_two_sensors_have_a_name_or_an_id_of_messages_in_common():
    assert len(BY_ID) == len(SENSORS)
    fixed = {stream.DESCRIPTION, stream.STATE, stream.POSE, stream.IMAGE, stream.END}
    taken = [sensor.stream_id + i for sensor in SENSORS for i in range(3)]
    assert len({*taken} | fixed) == 3 * len(SENSORS) + len(fixed)


@each_sensor
def test_readings_are_the_columns_and_the_curves_are_of_them(sensor):
    read = vars(measured(sensor, at_rest(), block_of(sensor), Around()))
    assert read["time_ns"].tolist() == [0, 200_000_000, 400_000_000]
    for quantity, columns in sensor.columns.items():
        assert read[quantity].shape == ((3, len(columns)) if len(columns) > 1 else (3,))
    for curve in sensor.curves:
        assert len(curve.names) == len(sensor.columns[curve.quantity])


@each_sensor
def test_the_entries_of_dataset_json_are_those_that_a_reader_asks_for(sensor):
    assert sensor.describe(block_of(sensor)).keys() == sensor.facts.keys()


@each_sensor
def test_a_mounting_is_a_rotation_at_the_place_of_the_sensor(sensor):
    block = getattr(Vehicle(**{sensor.key: {"position": [0.1, -0.2, 0.3]}}), sensor.key)
    T = sensor.mounting(block)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-15)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    assert T[:, 3].tolist() == [0.1, -0.2, 0.3, 1.0]
    if hasattr(block, "rotation_euler_deg"):
        assert np.array_equal(T, pose_matrix(block))
