"""A simulated scene as a whole: time base, frames, sensors, exact poses, repeatability."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError
from varos_warp.scene.description import Scene
from varos_warp.scene.frames import pose_matrix
from varos_warp.sim.clock import TICK_NS, TICK_RATE_HZ
from varos_warp.sim.trajectory import course_facts, path_samples, simulate

COURSE = [
    {"position": (0, 0, 0), "look_at": (0, 5, -1)},
    {"position": (0, 2, 0), "rotation_euler_deg": (-10, 0, 20)},
    {"position": (1, 3, 0.5), "rotation_euler_deg": (0, 0, -60)},
]
POSES = [
    {"time_s": 0.0, "position": (0, 0, 0)},
    {"time_s": 0.5, "position": (1, 0, 0), "rotation_euler_deg": (5, 0, 9)},
    {"time_s": 0.8, "position": (1, 2, 0), "rotation_euler_deg": (0, 40, 30)},
    {"time_s": 2.0, "position": (0, 0, 3)},
]


def driven(**blocks):
    return simulate(Scene(trajectory={"waypoints": COURSE}, **blocks))


def posed(poses, *, duration_s=None, **blocks):
    return simulate(Scene(trajectory={"poses": poses, "duration_s": duration_s}, **blocks))


def columns(trajectory):
    return [getattr(trajectory, name) for name in trajectory.__dataclass_fields__]


# ---------------------------------------------------------------------------------------------------------- time base


def test_times_are_whole_ticks_of_five_milliseconds_in_integers():
    simulation = driven()
    time = simulation.trajectory.time_ns
    assert time.dtype == np.int64
    assert (time == np.arange(len(time)) * 5_000_000).all()
    assert (simulation.frames.time_ns == np.arange(len(simulation.frames)) * 100_000_000).all()


@pytest.mark.parametrize(
    ("frame_rate", "imu_rate"),
    [(10, 200), (10, 100), (40, 200), (8, 40), (25, 10), (200, 200), (29.97, 200), (30, 400), (15, 125), (60, 1000)],
)
def test_exactly_one_imu_row_comes_after_the_last_frame(frame_rate, imu_rate):
    simulation = driven(render={"frame_rate_hz": frame_rate}, vehicle={"imu": {"rate_hz": imu_rate}})
    last = simulation.frames.time_ns[-1]
    assert 0 <= simulation.trajectory.time_ns[-1] - simulation.imu.time_ns[-1] < TICK_NS
    after = (simulation.imu.time_ns > last).sum()
    assert after >= 1
    assert after == 1 or imu_rate > TICK_RATE_HZ  # of which a tick has several


@pytest.mark.parametrize("frame_rate", [2, 10, 29.97])
@pytest.mark.parametrize("make", [driven, lambda **blocks: posed(POSES, **blocks)])
def test_with_flow_the_motion_goes_on_to_the_frame_after_the_last_and_nothing_else_changes(make, frame_rate):
    vehicle = {"imu": {"noise": {"accelerometer_noise_density": 0.01}}, "depth_gauge": {}}
    without, having = (
        make(render={"frame_rate_hz": frame_rate, "outputs": list(outputs)}, vehicle=vehicle)
        for outputs in ("ABCD", "ABCDF")
    )
    following = round(len(having.frames) * 1e9 / frame_rate)
    assert 0 <= having.trajectory.time_ns[-1] - following < TICK_NS
    assert having.trajectory.at([following]).time_ns == following
    rows = len(without.trajectory)
    for mine, theirs in (
        (without.trajectory, having.trajectory),
        (without.frames, having.frames),
        (without.imu, having.imu),
        (without.depth_gauge, having.depth_gauge),
    ):
        for name in mine.__dataclass_fields__:
            assert np.array_equal(getattr(mine, name), getattr(theirs, name)[:rows]), name
    assert len(without.imu.time_ns) == len(having.imu.time_ns)


@pytest.mark.parametrize(
    ("block", "key"),
    [
        ({"render": {"frame_rate_hz": 2e4}}, "render.frame_rate_hz"),
        ({"vehicle": {"imu": {"rate_hz": 2e4}}}, "vehicle.imu.rate_hz"),
        ({"vehicle": {"depth_gauge": {"rate_hz": 1e-6}}}, "vehicle.depth_gauge.rate_hz"),
    ],
)
def test_rates_without_samples_or_with_too_many_are_refused(block, key):
    with pytest.raises(InputError) as caught:
        driven(**block)
    assert caught.value.key == key


def test_a_sensor_of_a_lower_rate_reads_every_so_many_rows():
    fast, slow = driven(), driven(vehicle={"imu": {"rate_hz": 50}, "depth_gauge": {"rate_hz": 20}})
    np.testing.assert_array_equal(slow.imu.time_ns[:50], fast.imu.time_ns[:200:4])
    np.testing.assert_array_equal(slow.imu.acceleration[:50], fast.imu.acceleration[:200:4])
    np.testing.assert_array_equal(slow.depth_gauge.depth[:20], fast.depth_gauge.depth[:200:10])


def test_a_vehicle_without_sensors_has_none():
    simulation = driven(vehicle={"imu": None, "depth_gauge": None})
    assert simulation.imu is None
    assert simulation.depth_gauge is None


def test_a_duration_gives_that_many_frames():
    scene = Scene(trajectory={"waypoints": COURSE, "duration_s": 3.0})
    simulation = simulate(scene)
    assert len(simulation.frames) == 30
    assert simulation.messages == []  # it is what was asked for
    assert course_facts(simulation, scene)["heads_for"] == 1
    on_the_last_leg = Scene(trajectory={"waypoints": COURSE, "duration_s": 8.0})
    assert course_facts(simulate(on_the_last_leg), on_the_last_leg)["heads_for"] == 2
    scene = Scene(trajectory={"waypoints": COURSE, "duration_s": 60.0})
    long = simulate(scene)
    assert course_facts(long, scene)["heads_for"] is None
    assert len(long.frames) == 600
    assert any("holds the last waypoint" in message for message in long.messages)
    poses = [{"time_s": t, "position": [10 * t, 0, 0]} for t in (0.0, 1.0)]
    for duration, target in ((0.5, 1), (2.0, None)):
        scene = Scene(trajectory={"poses": poses, "duration_s": duration})
        assert course_facts(simulate(scene), scene)["heads_for"] == target
    np.testing.assert_allclose(long.trajectory.position[-1], COURSE[-1]["position"], atol=1e-6)


STRAIGHT = {"waypoints": [{"position": (0, 0, 1)}, {"position": (0.5, 3.65, 1.2)}], "speed": 0.6, "duration_s": 3.0}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({}, True),
        ({"max_acceleration": 0.6}, True),
        ({"constant_speed": True}, False),
        ({"duration_s": 8.0}, False),
        ({"duration_s": None}, False),
        ({"duration_s": 0.9}, False),  # nine frames are a look
        (
            {
                "max_angular_speed_deg": 0.2,
                "waypoints": [{"position": (0, 0, 0)}, {"position": (0, 0.4, 0), "rotation_euler_deg": (0, 0, 90)}],
            },
            False,
        ),
    ],
)  # what turns is slow otherwise
def test_a_sequence_that_ends_while_the_vehicle_still_gathers_speed_is_told_of(changes, told):
    found = [text for text in simulate(Scene(trajectory=STRAIGHT | changes)).messages if "duration_s" in text]
    assert len(found) == told
    if told:
        assert found[0].startswith("trajectory.duration_s: ends the sequence after ")
        assert "of the 0.6 m/s asked for" in found[0]
        assert "constant_speed: true and raise trajectory.max_acceleration" in found[0]


def test_turns_are_no_reason_where_there_are_none():
    fast = {"speed": 6.0, "constant_speed": True, "duration_s": None}
    (text,) = simulate(Scene(trajectory=STRAIGHT | fast)).messages
    assert "but stops are too near to each other for more than" in text
    assert "turns" not in text
    assert "angular" not in text


# -------------------------------------------------------------------------------------------------------- the contents


def test_the_same_scene_gives_the_same_bytes():
    blocks = {"current": {"velocity": (0.05, 0, 0), "fluctuation": 0.05}, "seed": 7}
    one, other = driven(**blocks), driven(**blocks)
    for a, b in zip(columns(one.trajectory), columns(other.trajectory), strict=True):
        assert a.tobytes() == b.tobytes()
    assert driven(**(blocks | {"seed": 8})).trajectory.position.tobytes() != one.trajectory.position.tobytes()


def test_a_course_far_from_the_origin_is_driven_alike():
    shift = np.array([569_000.0, 7_033_000.0, -80.0])
    moved = [w | {"position": tuple(np.add(w["position"], shift))} for w in COURSE[1:]]
    moved.insert(0, {"position": tuple(shift), "look_at": tuple(np.add(COURSE[0]["look_at"], shift))})
    near, far = driven(), simulate(Scene(trajectory={"waypoints": moved}))
    np.testing.assert_allclose(far.trajectory.position - shift, near.trajectory.position, atol=1e-8)  # ulp of 7e6 m
    np.testing.assert_allclose(far.trajectory.acceleration, near.trajectory.acceleration, atol=1e-8)


def test_quaternions_are_of_unit_length_with_w_not_negative_and_match_the_matrices():
    trajectory = driven().trajectory
    q = trajectory.quaternion
    assert (q[:, 0] >= 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-15)
    T = trajectory.T_w_v(777)
    np.testing.assert_allclose(T[:3, :3], trajectory.rotation()[777].as_matrix())
    np.testing.assert_array_equal(T[:3, 3], trajectory.position[777])


def test_rates_are_the_derivatives_of_the_poses():
    trajectory, h = driven().trajectory, 0.005
    velocity = (trajectory.position[2:] - trajectory.position[:-2]) / (2 * h)
    jerk = np.abs(np.diff(trajectory.acceleration, axis=0)).max() / h
    np.testing.assert_allclose(trajectory.velocity[1:-1], velocity, atol=jerk * h**2)
    np.testing.assert_allclose(
        np.diff(trajectory.velocity, axis=0) / h,
        0.5 * (trajectory.acceleration[1:] + trajectory.acceleration[:-1]),
        atol=jerk * h / 10,
    )


@pytest.mark.parametrize(("mass", "speed"), [(12.0, 0.6), (40.0, 0.5), (100.0, 1.0)])
def test_with_full_feed_forward_the_vehicle_follows_its_reference_closely(mass, speed):
    scene = Scene(trajectory={"waypoints": COURSE, "speed": speed}, vehicle={"mass_kg": mass})
    simulation = simulate(scene)
    error = np.linalg.norm(simulation.trajectory.position - simulation.reference_position, axis=1)
    jerk = np.abs(np.diff(simulation.trajectory.acceleration, axis=0)).max() / 0.005
    # what the feed-forward misses is the lag of the thrusters, 2 / wn, which acts on the jerk; 1 / k1 = 1
    wn = {12.0: 20.0, 40.0: 15.0, 100.0: 10.0}[mass]
    drag_rate = {12.0: 3.0, 40.0: 2.0, 100.0: 2.0}[mass]  # drag asks for changing thrust as well, of its own slope
    peak = np.abs(simulation.trajectory.acceleration).max()
    assert error.max() < 2.0 / wn * (jerk * np.sqrt(3) + drag_rate * peak * np.sqrt(3))
    assert not simulation.messages


def test_progress_rises_to_one():
    seen = []
    simulate(Scene(trajectory={"waypoints": COURSE}), progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert len(seen) > 5


# -------------------------------------------------------------------------------------------------------- exact poses


def test_a_single_pose_is_one_still_frame():
    simulation = posed([{"position": (1, 2, -78), "look_at": (1, 7, -79)}])
    assert simulation.frames.time_ns.tolist() == [0]
    block = simulation.trajectory
    np.testing.assert_allclose(
        block.T_w_v(0),
        pose_matrix(
            Scene(trajectory={"poses": [{"position": (1, 2, -78), "look_at": (1, 7, -79)}]}).trajectory.poses[0]
        ),
        atol=1e-15,
    )
    assert (block.velocity == 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(simulation.imu.acceleration, axis=1), 9.81)
    assert not simulation.messages


def test_a_single_pose_with_a_duration_stands_still_for_it():
    simulation = posed([{"position": (1, 2, -78)}], duration_s=2.0)
    assert len(simulation.frames) == 20
    assert np.ptp(simulation.trajectory.position, axis=0).max() == 0.0
    assert not simulation.messages


def test_every_pose_on_a_frame_tick_is_that_pose_to_the_last_digit():
    simulation = posed(POSES)
    trajectory = simulation.trajectory
    assert len(simulation.frames) == 21
    for pose in POSES:
        tick = round(pose["time_s"] * 200)
        assert trajectory.time_ns[tick] in simulation.frames.time_ns
        assert trajectory.position[tick].tolist() == list(map(float, pose["position"]))
        angles = pose.get("rotation_euler_deg", (0, 40, 30) if tick else (0, 0, 0))  # or that of the pose before
        expected = Rotation.from_euler("xyz", angles, degrees=True)
        np.testing.assert_array_equal(trajectory.quaternion[tick], expected.as_quat(canonical=True, scalar_first=True))


def test_between_poses_the_rates_are_the_derivatives_of_position_and_attitude():
    trajectory, h, inside = posed(POSES).trajectory, 0.005, slice(0, 401)
    p, v, a = (x[inside] for x in (trajectory.position, trajectory.velocity, trajectory.acceleration))
    jerk = np.abs(np.diff(a, axis=0)).max() / h
    np.testing.assert_allclose(v[1:-1], (p[2:] - p[:-2]) / (2 * h), atol=jerk * h**2)
    np.testing.assert_allclose(a[1:-1], (v[2:] - v[:-2]) / (2 * h), atol=jerk * h)
    turned, omega = trajectory.rotation()[inside], trajectory.angular_velocity[inside]
    alpha = trajectory.angular_acceleration[inside]
    angular_jerk = np.abs(np.diff(alpha, axis=0)).max() / h
    np.testing.assert_allclose(
        omega[1:-1],
        (turned[:-2].inv() * turned[2:]).as_rotvec() / (2 * h),
        atol=(angular_jerk + np.abs(omega).max() ** 3) * h**2,
    )
    np.testing.assert_allclose(alpha[1:-1], (omega[2:] - omega[:-2]) / (2 * h), atol=angular_jerk * h)


LATE = [pose | {"time_s": pose["time_s"] + 3.0} for pose in POSES]
"""Poses before and after which there is time for the vehicle to come from rest and to stop."""


def test_rates_are_the_derivatives_of_the_poses_and_continuous_before_within_and_after_them():
    trajectory, h = posed(LATE, duration_s=8.0).trajectory, 0.005
    p, v, a = trajectory.position, trajectory.velocity, trajectory.acceleration
    turned, omega, alpha = trajectory.rotation(), trajectory.angular_velocity, trajectory.angular_acceleration
    between = (turned[:-1].inv() * turned[1:]).as_rotvec() / h
    # of the splines and of the brakes, whose third derivative is 6 v / T^2 - 4 a / T; a jump of a is not within it
    jerk, angular_jerk = (np.abs(np.diff(x[601:1000], axis=0)).max() / h for x in (a, alpha))
    assert np.abs(np.diff(a, axis=0)).max() <= 1.001 * jerk * h
    assert np.abs(np.diff(alpha, axis=0)).max() <= 1.001 * angular_jerk * h
    np.testing.assert_allclose(np.diff(p, axis=0) / h, 0.5 * (v[1:] + v[:-1]), atol=jerk * h**2)
    np.testing.assert_allclose(np.diff(v, axis=0) / h, 0.5 * (a[1:] + a[:-1]), atol=jerk * h)
    np.testing.assert_allclose(
        between, 0.5 * (omega[1:] + omega[:-1]), atol=(angular_jerk + np.abs(omega).max() * np.abs(alpha).max()) * h**2
    )
    np.testing.assert_allclose(np.diff(omega, axis=0) / h, 0.5 * (alpha[1:] + alpha[:-1]), atol=angular_jerk * h)


def test_before_and_after_the_poses_the_vehicle_is_at_rest():
    simulation = posed(LATE, duration_s=9.0)
    trajectory = simulation.trajectory
    for rows in (slice(0, 201), slice(1400, None)):
        for values in (
            trajectory.velocity,
            trajectory.acceleration,
            trajectory.angular_velocity,
            trajectory.angular_acceleration,
        ):
            np.testing.assert_array_equal(values[rows], 0.0)
        assert np.ptp(trajectory.position[rows], axis=0).max() == 0.0
    assert sum("at rest" in message for message in simulation.messages) == 2


def test_braking_from_a_steady_speed_takes_half_the_way_that_it_would_have_gone():
    poses = [
        {"time_s": 0, "position": (0, 0, 0)},
        {"time_s": 1, "position": (0.6, 0, 0), "rotation_euler_deg": (0, 0, 50)},
    ]
    trajectory = posed(poses, duration_s=4.0).trajectory
    np.testing.assert_allclose(trajectory.position[-1], [0.6 + 0.6 * 2.0 / 2.0, 0.0, 0.0], rtol=1e-14)
    np.testing.assert_allclose(trajectory.rotation()[-1].as_rotvec(degrees=True), [0.0, 0.0, 100.0], atol=1e-12)


def test_the_rows_after_the_last_frame_go_on_with_the_speed_of_the_last_pose():
    trajectory = posed(POSES).trajectory
    assert len(trajectory.time_ns) == 402
    assert np.linalg.norm(trajectory.velocity[400]) > 0.5
    np.testing.assert_allclose(trajectory.velocity[401], trajectory.velocity[400], rtol=2.0 * (3 * (0.005 / 2.0) ** 2))


@pytest.mark.parametrize(
    ("step_s", "there", "turned", "told"),
    [
        (1.0, 30.0, 0.0, ["poses.0: 45 m/s at 0 s", "poses.1: 90 m/s^2 at 1 s"]),
        (0.2, 1.0, 0.0, ["poses.1: 75 m/s^2 at 0.2 s"]),
        (0.2, 0.0, 170.0, [": 850 deg/s at "]),
        (1.0, 1.0, 90.0, []),
    ],
)
def test_motion_beyond_sense_is_told_of_with_its_pose(step_s, there, turned, told):
    """There and back: a natural spline starts with 3/2 the mean speed and turns round with 3 s / T^2. Turns go on."""
    poses = [
        {"time_s": 0.0, "position": (0, 0, 0)},
        {"time_s": step_s, "position": (there, 0, 0), "rotation_euler_deg": (0, 0, turned)},
        {"time_s": 2.0 * step_s, "position": (0, 0, 0), "rotation_euler_deg": (0, 0, 2.0 * turned)},
    ]
    messages = [text for text in posed(poses).messages if "no underwater vehicle" in text]
    assert [text in message for text, message in zip(told, messages, strict=True)] == [True] * len(told)


@pytest.mark.parametrize("second", [0.0, -0.0, 0.5])
def test_poses_out_of_time_order_are_refused(second):
    poses = [{"time_s": 0.5, "position": (0, 0, 0)}, {"time_s": abs(second), "position": (1, 0, 0)}]
    with pytest.raises(InputError, match=r"trajectory\.poses\.1\.time_s"):
        posed(poses)


# --------------------------------------------------------------------------------------------------------- clearances


@pytest.mark.parametrize("spacing", [0.02, 0.05])
def test_path_samples_leave_no_gap_wider_than_asked_in_either_path(spacing):
    simulation = driven()
    samples = path_samples(simulation, spacing)
    for path in (samples.position, samples.reference):
        assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= spacing
    assert samples.time_ns[0] == 0
    assert samples.time_ns[-1] == simulation.trajectory.time_ns[-1]
    assert len(samples.time_ns) < len(simulation.trajectory.time_ns) / 3
    assert set(samples.waypoint) == {1, 2}
