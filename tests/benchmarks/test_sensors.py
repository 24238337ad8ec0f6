"""The sweeps of the benchmark converge as it says they must."""

import numpy as np
import pytest

from benchmarks import sensors
from varos_warp.sim.trajectory import simulate


@pytest.mark.parametrize("frame", ["world", "body"])
def test_poses_and_readings_converge_with_the_fourth_power_of_the_step(frame, monkeypatch):
    """Differences from halving to halving; the next term, and commands that end in mid-motion, leave 0.2."""
    monkeypatch.setattr(sensors, "SECONDS", 8.0)
    scene = sensors.course(frame)
    held = sensors.commands(scene)
    a, b, c = (sensors.fly(scene, held, h) for h in (0.01, 0.005, 0.0025))
    for values in ("position", "specific_force", "angular_velocity"):
        x, y, z = (getattr(flight, values) for flight in (a, b, c))
        assert np.log2(sensors.rms(x - y) / sensors.rms(y - z)) == pytest.approx(sensors.STEP_ORDER, abs=0.2)


def test_dead_reckoning_converges_with_the_second_power_of_the_interval():
    simulation = simulate(sensors.course())
    errors = np.array([sensors.dead_reckoning(simulation, stride, 9.81) for stride in (4, 2, 1)])
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), sensors.RATE_ORDER, atol=0.1)


def test_steps_that_are_cut_say_so():
    scene = sensors.course()
    assert sensors.fly(scene, sensors.commands(scene)[:5], 0.04).substeps > 1
    assert sensors.fly(scene, sensors.commands(scene)[:5], 0.005).substeps == 1
