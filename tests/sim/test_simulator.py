"""One tick at a time: a loop gives the batch's bytes, forces move the vehicle as mechanics says, mistakes are named."""

from pathlib import Path

import numpy as np
import pytest
from test_trajectory import COURSE, POSES

import varos_warp as vw
from varos_warp.errors import InputError
from varos_warp.products.sensors.imu import ImuNoiseStream, imu_noise
from varos_warp.scene.description import Scene
from varos_warp.scene.file.load import load_scene
from varos_warp.sim.clock import TICK_NS
from varos_warp.sim.vehicle.body import sphere

ROOT = Path(__file__).parents[2]
NOISE = {
    "accelerometer_noise_density": 0.01,
    "accelerometer_random_walk": 0.003,
    "gyroscope_noise_density": 1e-3,
    "gyroscope_random_walk": 1e-4,
    "gyroscope_bias": [1e-3, 0.0, 2e-3],
    "accelerometer_turn_on_bias": 0.05,
    "gyroscope_turn_on_bias": 1e-3,
}
SENSORS = {
    "imu": {"position": [0.1, 0.0, 0.02], "rotation_euler_deg": [10, 20, 90], "noise": NOISE},
    "depth_gauge": {"position": [0.0, 0.3, 0.1], "rate_hz": 30},
    "magnetometer": {"rate_hz": 50, "rotation_euler_deg": [0, 5, 30]},
    "dvl": {"position": [0.0, 0.0, -0.2], "rotation_euler_deg": [3, 0, 40], "rate_hz": 13, "range_m": [0.1, 5]},
}
WORLD = {
    "current": {"velocity": [0.1, 0, 0], "fluctuation": 0.1, "turbulence": {"rms": [0.03, 0.03, 0.02]}},
    "terrain": {"kind": "procedural", "size_m": 30, "position": [0, 0, -4], "resolution": 17, "relief_m": 1.0},
    "materials": {"seafloor": {}},
}
ROV = {
    "metacentric_height": 0.02,
    "rigid_body": {
        "thrusters": [
            {"position": [x, y, z], "direction": d, "max_force": 4.0}
            for x, y, z, d in (
                (0.11, 0.16, 0.04, [-1, 1, 0]),
                (-0.11, 0.16, 0.04, [1, 1, 0]),
                (0.11, -0.16, 0.04, [-1, -1, 0]),
                (-0.11, -0.16, 0.04, [1, -1, 0]),
                (0.1, 0, 0, [0, 0, 1]),
                (-0.1, 0, 0, [0, 0, 1]),
            )
        ]
    },
}
STONE = {"kind": "boulder", "diameter": 0.5, "chord_error_m": 0.05, "material": "seafloor"}
PATH = [
    {"time_s": 0, "position": [0.5, -1.5, -2]},
    {"time_s": 2, "position": [1.5, 2.5, -2], "rotation_euler_deg": [0, 0, 90]},
]


def scene_of(vehicle=None, *, duration_s=1.5, trajectory=None, **blocks):
    course = trajectory or {"waypoints": COURSE, "duration_s": duration_s}
    return Scene(trajectory=course, vehicle=SENSORS | (vehicle or {}), **WORLD | blocks)


def all_steps(simulator):
    """The state at 0 and those of all ticks until it is finished."""
    steps = [simulator.state]
    while not simulator.finished:
        steps.append(simulator.step())
    return steps


def assert_same_bytes(steps, batch):
    """Rows and readings of steps are those of a batch, to the byte."""
    rows = {name: np.stack([getattr(step, name) for step in steps]) for name in vars(batch.trajectory)}
    for name, column in vars(batch.trajectory).items():
        assert rows[name].tobytes() == column[: len(steps)].tobytes(), name
    poses = np.stack([step.T_w_v for step in steps])
    assert poses.tobytes() == np.stack([batch.trajectory.T_w_v(k) for k in range(len(steps))]).tobytes()
    assert np.array_equal([step.reference_position for step in steps], batch.reference_position[: len(steps)])
    assert np.array_equal([step.waypoint for step in steps], batch.waypoint[: len(steps)])
    for sensor in ("imu", "depth_gauge", "magnetometer", "dvl"):
        if (read := getattr(batch, sensor)) is None:
            assert all(getattr(step, sensor) is None for step in steps)
            continue
        for name, column in vars(read).items():
            pieces = np.concatenate([getattr(getattr(step, sensor), name) for step in steps])
            assert pieces.dtype == column.dtype
            assert pieces.tobytes() == column.tobytes(), (sensor, name)


# ---------------------------------------------------------------------------------------------------- the batch's bytes


@pytest.mark.parametrize(
    ("vehicle", "blocks"),
    [
        pytest.param({}, {}, id="sphere"),
        pytest.param({"max_force": 2.0, "max_torque": 0.05}, {}, id="saturated"),
        pytest.param({"actuator_frame": "body"}, {}, id="body frame"),
        pytest.param(ROV, {}, id="thrusters"),
        pytest.param({}, {"duration_s": None}, id="length of the course"),
        pytest.param({}, {"trajectory": {"poses": POSES}}, id="exact poses"),
        pytest.param(
            {},
            {
                "objects": [STONE | {"diameter": 1.2, "path": PATH}],
                "trajectory": {"poses": POSES},
                "scatter": [{"object": STONE, "count": 100}],
            },
            id="objects that move and copies",
        ),
        pytest.param({}, {"render": {"outputs": ["A", "F"], "frame_rate_hz": 4}}, id="flow"),
    ],
)
def test_a_loop_over_steps_gives_the_bytes_of_the_batch(vehicle, blocks):
    scene = scene_of(vehicle, **blocks)
    batch = vw.simulate(scene)
    steps = all_steps(vw.Simulator(scene))
    assert_same_bytes(steps, batch)
    assert 0 <= len(batch.trajectory) - len(steps) <= (50 if "render" in blocks else 0)


@pytest.mark.parametrize("rate", [29.97, 100, 150, 400, 1000])
def test_at_any_rate_of_the_imu(rate):
    scene = scene_of({"imu": SENSORS["imu"] | {"rate_hz": rate}, "dvl": None}, duration_s=0.7)
    assert_same_bytes(all_steps(vw.Simulator(scene)), vw.simulate(scene))


def test_a_recorded_course_is_stepped_through():
    scene = load_scene(ROOT / "examples" / "every_block" / "recorded.yaml", ["vehicles.0.trajectory.duration_s=1"])
    assert scene.trajectory.file
    assert scene.vehicle.imu.noise
    assert_same_bytes(all_steps(vw.Simulator(scene)), vw.simulate(scene))


def test_the_vehicle_of_a_fleet_is_stepped():
    scene = load_scene(
        ROOT / "examples" / "every_block" / "vehicles.yaml",
        ["terrain.resolution=33", "vehicles.0.trajectory.duration_s=1", "vehicles.0.dvl={}"],
    )
    assert_same_bytes(all_steps(vw.Simulator(scene)), vw.simulate(scene))


def test_a_reading_comes_with_the_tick_at_or_after_its_time():
    simulator = vw.Simulator(scene_of({"imu": {"rate_hz": 150}}))
    steps = all_steps(simulator)
    assert simulator.state is steps[-1]
    for step in steps:
        for sensor in (step.imu, step.depth_gauge, step.magnetometer, step.dvl):
            assert ((step.time_ns - TICK_NS < sensor.time_ns) & (sensor.time_ns <= step.time_ns)).all()


def test_noise_in_pieces_is_the_noise_at_once_and_its_bias_walks_on_after_it():
    model = scene_of().vehicle.imu.noise
    stream, whole = ImuNoiseStream(model, 100, 200.0, 3), imu_noise(model, 100, 200.0, 3)
    pieces = [stream.take(count) for count in (1, 0, 7, 92)]
    for i, made in enumerate(whole):
        for part in ("white", "bias"):
            assert np.array_equal(np.concatenate([getattr(piece[i], part) for piece in pieces]), getattr(made, part))
    _, rate = stream.take(9000)
    steps = np.diff(np.concatenate([whole[1].bias[-1:], rate.bias]), axis=0)
    for values, std in (
        (steps, model.gyroscope_random_walk / np.sqrt(200.0)),
        (rate.white, model.gyroscope_noise_density * np.sqrt(200.0)),
    ):
        assert abs(values.std() / std - 1.0) < 4.0 / np.sqrt(2 * values.size)


# ------------------------------------------------------------------------------------------------------------ after it


def test_after_the_course_the_controller_holds_the_last_waypoint():
    simulator = vw.Simulator(Scene(trajectory={"waypoints": [{"position": (0, 0, 0)}, {"position": (0, 1, 0)}]}))
    while not simulator.finished:
        simulator.step()
    for _ in range(2000):
        simulator.step()
    np.testing.assert_allclose(simulator.state.position, (0, 1, 0), atol=1e-3)
    assert np.linalg.norm(simulator.state.velocity) < 1e-4


def test_after_exact_poses_the_vehicle_comes_to_rest():
    simulator = vw.Simulator(Scene(trajectory={"poses": POSES}))
    while simulator.time_ns < 4_100_000_000:  # two seconds after the last pose
        simulator.step()
    assert (simulator.state.velocity == 0.0).all()
    assert simulator.state.waypoint == len(POSES) - 1


# ------------------------------------------------------------------------------------------------------------- forces


def free(**vehicle):
    """A vehicle that nothing but its thrusters moves, and they follow a command within a tenth of a second."""
    body = {
        "mass_kg": 10.0,
        "linear_drag": 0.0,
        "quadratic_drag": 0.0,
        "linear_rotational_drag": 0.0,
        "quadratic_rotational_drag": 0.0,
        "max_force": 50.0,
        "max_torque": 5.0,
        "actuator_frequency": 50.0,
        "actuator_damping": 1.0,
    }
    if "rigid_body" in vehicle:
        del body["max_force"], body["max_torque"]
    turned = {"position": (0, 0, 0), "rotation_euler_deg": (0, 0, 90)}
    return Scene(trajectory={"waypoints": [turned], "duration_s": 1.0}, vehicle=body | vehicle)


def pushed(scene, ticks, **command):
    simulator = vw.Simulator(scene)
    for _ in range(ticks):
        simulator.step(**command)
    return simulator.state


LAG_S = 2 * 1.0 / 50.0
"""Delay of a critically damped second-order thruster under a constant command: 2 zeta / omega_n."""


def test_without_drag_a_constant_force_gives_force_over_mass():
    """Its speed is (F / m)(t - 2 zeta / omega_n); ahead is the world's -x here.

    Simpson's rule, to which RK4 reduces, errs by h^4 2 omega_n^3 / 2880 = 5.4e-8 s in the time that the thrusters lag.
    """
    scene = free()
    state, mass = pushed(scene, 400, force=(0.0, 8.0, 0.0)), sphere(scene.vehicle).virtual_mass
    np.testing.assert_allclose(state.acceleration, (-8.0 / mass, 0, 0), atol=1e-12)
    np.testing.assert_allclose(state.velocity, (-8.0 / mass * (2.0 - LAG_S), 0, 0), rtol=6e-8, atol=1e-12)


def test_work_of_the_force_is_the_kinetic_energy_that_it_gives():
    """After the thrusters have settled F dx = m v dv, to the rounding of a polynomial that RK4 integrates exactly."""
    scene = free()
    simulator, mass = vw.Simulator(scene), sphere(scene.vehicle).virtual_mass
    for _ in range(200):
        simulator.step(force=(3.0, 4.0, 0.0))
    start = simulator.state
    for _ in range(200):
        simulator.step(force=(3.0, 4.0, 0.0))
    end = simulator.state
    work = np.array([-4.0, 3.0, 0.0]) @ (end.position - start.position)
    gained = 0.5 * mass * (end.velocity @ end.velocity - start.velocity @ start.velocity)
    assert work == pytest.approx(gained, rel=1e-10)


def test_a_constant_moment_turns_the_vehicle_about_its_own_axis():
    scene = free()
    state, inertia = pushed(scene, 200, torque=(0.0, 0.1, 0.0)), sphere(scene.vehicle).inertia
    np.testing.assert_allclose(state.angular_acceleration, (0, 0.1 / inertia, 0), atol=1e-12)
    np.testing.assert_allclose(state.angular_velocity, (0, 0.1 / inertia * (1.0 - LAG_S), 0), rtol=6e-8, atol=1e-11)


def test_the_terminal_speed_is_the_root_of_force_over_drag():
    state = pushed(free(quadratic_drag=20.0), 4000, force=(0.0, 0.0, 45.0))
    np.testing.assert_allclose(state.velocity, (0, 0, np.sqrt(45.0 / 20.0)), atol=1e-9)


@pytest.mark.parametrize(
    ("vehicle", "asked", "possible"),
    [
        (
            {},
            {"force": (300.0, 400.0, 0.0), "torque": (0.0, 0.0, 80.0)},
            {"force": (30.0, 40.0, 0.0), "torque": (0.0, 0.0, 5.0)},
        ),
        (ROV, {"force": (0.0, 1e6, 0.0)}, {"force": (0.0, 4 * 4.0 * np.sqrt(0.5), 0.0)}),
    ],
)
def test_more_than_the_thrusters_can_do_is_scaled_down(vehicle, asked, possible):
    states = [pushed(free(**vehicle), 100, **command) for command in (asked, possible)]
    for name in ("position", "velocity", "quaternion", "angular_velocity"):
        np.testing.assert_allclose(*(getattr(state, name) for state in states), rtol=1e-10, atol=1e-13)


def test_the_controllers_own_command_may_come_from_outside():
    """A PD law in Python reaches a place that the scene's course does not have."""
    simulator, goal = vw.Simulator(free(linear_drag=5.0)), np.array([0.5, -0.3, 0.2])
    for _ in range(4000):
        state = simulator.state
        to_goal = 8.0 * (goal - state.position) - 16.0 * state.velocity
        simulator.step(force=state.T_w_v[:3, :3].T @ to_goal)
    np.testing.assert_allclose(simulator.state.position, goal, atol=1e-3)


# ------------------------------------------------------------------------------------------------------ reset and copy


def test_reset_gives_the_same_bytes_again():
    simulator = vw.Simulator(scene_of())
    first = all_steps(simulator)
    assert simulator.reset().time_ns == 0
    assert not simulator.finished
    assert_same_bytes([simulator.state, *(simulator.step() for _ in first[1:])], vw.simulate(simulator.scene))


def test_another_seed_is_another_current_and_noise():
    scene = scene_of()
    simulator = vw.Simulator(scene)
    simulator.reset(seed=np.int64(8))
    assert_same_bytes(all_steps(simulator), vw.simulate(scene_of(seed=8)))


def test_a_copy_goes_its_own_way():
    simulator = vw.Simulator(scene_of(ROV))
    for _ in range(50):
        simulator.step()
    other = simulator.copy()
    for _ in range(20):
        other.step(force=(0, 5, 0))
    assert simulator.time_ns == 50 * TICK_NS
    assert other.time_ns == 70 * TICK_NS
    assert np.array_equal(simulator.step().imu.acceleration, vw.simulate(scene_of(ROV)).imu.acceleration[51:52])


# ----------------------------------------------------------------------------------------------------------- mistakes


@pytest.mark.parametrize(
    "value", [(1.0, 2.0), 3.0, (1.0, 2.0, np.nan), (np.inf, 0, 0), "abc", [[1, 2, 3]], (1e200, 0, 0), (1j, 0, 0), {}]
)
@pytest.mark.parametrize("key", ["force", "torque"])
def test_what_is_no_vector_is_refused_by_name_and_nothing_moves(key, value):
    simulator = vw.Simulator(free())
    with pytest.raises(InputError, match=rf"^{key} = .*three finite numbers") as caught:
        simulator.step(**{key: value})
    assert caught.value.key == key
    assert simulator.time_ns == 0


def test_a_force_on_exact_poses_is_refused():
    simulator = vw.Simulator(Scene(trajectory={"poses": POSES}))
    with pytest.raises(InputError, match="exact poses"):
        simulator.step(force=(0, 0, 1))
    assert simulator.step().time_ns == TICK_NS


@pytest.mark.parametrize("seed", [-1, 2**31, 1.5, "1"])
def test_what_is_no_seed_is_refused(seed):
    with pytest.raises(InputError, match="seed"):
        vw.Simulator(free()).reset(seed=seed)


def test_a_scene_that_cannot_be_simulated_is_refused_as_in_a_batch():
    scene = Scene(trajectory={"waypoints": COURSE}, vehicle={"depth_gauge": {"rate_hz": 1e-6}})
    with pytest.raises(InputError) as caught:
        vw.Simulator(scene)
    assert caught.value.key == "vehicle.depth_gauge.rate_hz"
