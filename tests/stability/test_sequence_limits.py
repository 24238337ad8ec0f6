"""Courses and sequences of any length: from nothing to a day, and what is refused beyond."""

import tracemalloc

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from varos_warp.cli import app
from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.sim import clock, guidance
from varos_warp.sim.clock import LONGEST_S, TICK_S
from varos_warp.sim.guidance import BLOCK_TICKS, Guidance, plan
from varos_warp.sim.trajectory import simulate
from varos_warp.sim.vehicle import flight

DAY = 86_400.0


def course(*positions, vehicle=None, render=None, **options):
    waypoints = [p if isinstance(p, dict) else {"position": p} for p in positions]
    return scene_from_dict(
        {"trajectory": {"waypoints": waypoints, **options}, "vehicle": vehicle or {}, "render": render or {}}
    )


def poses(*times_s, **options):
    stops = [{"time_s": t, "position": (0.0, float(i), 0.0)} for i, t in enumerate(times_s)]
    return scene_from_dict({"trajectory": {"poses": stops, **options}})


def refusal(scene) -> InputError:
    with pytest.raises(InputError) as caught:
        simulate(scene)
    assert caught.value.key
    assert caught.value.remedy
    return caught.value


# ------------------------------------------------------------------------------------------------------------- too long


@pytest.mark.parametrize(
    ("positions", "options", "key"),
    [
        (((0, 0, 0), (0, 1e7, 0)), {}, "trajectory.waypoints.1"),
        (((0, 0, 0), (0, 1, 0), (0, 1e9, 0), (0, 3, 0)), {}, "trajectory.waypoints.2"),
        (((0, 0, 0), (0, 3, 0)), {"speed": 1e-9}, "trajectory.waypoints.1"),
        (((0, 0, 0), (0, 3, 0)), {"speed": 1e-300}, "trajectory.waypoints.1"),
        (((0, 0, 0), (0, 3, 0)), {"speed": 5e-324}, "trajectory.waypoints.1"),
        (((0, 0, 0), (0, 3, 0)), {"max_acceleration": 1e-300}, "trajectory.waypoints.1"),
        (
            ((0, 0, 0), {"position": (0, 3, 0), "rotation_euler_deg": (0, 0, 90)}),
            {"max_angular_speed_deg": 1e-9},
            "trajectory.waypoints.1",
        ),
        (((0, 0, 0), {"position": (0, 3, 0), "dwell_s": 1e300}), {}, "trajectory.waypoints.1"),
        (((0, 0, 0), (0, 3, 0)), {"duration_s": 1.001 * DAY}, "trajectory.duration_s"),
        (((0, 0, 0), (0, 3, 0)), {"duration_s": 1e300}, "trajectory.duration_s"),
    ],
)
def test_a_sequence_of_more_than_a_day_is_refused_before_it_is_driven(positions, options, key):
    assert refusal(course(*positions, **options)).key == key


@pytest.mark.parametrize(
    ("times", "options", "key"),
    [
        ((0.0, 1.001 * DAY), {}, "trajectory.poses.1.time_s"),
        ((0.0, 1e300), {}, "trajectory.poses.1.time_s"),
        ((0.0,), {"duration_s": 1e9}, "trajectory.duration_s"),
    ],
)
def test_exact_poses_of_more_than_a_day_are_refused(times, options, key):
    assert refusal(poses(*times, **options)).key == key


@pytest.mark.parametrize(
    ("rate", "block", "key"),
    [
        (1e-300, "render", "render.frame_rate_hz"),
        (1e-6, "imu", "vehicle.imu.rate_hz"),
        (1e-6, "depth_gauge", "vehicle.depth_gauge.rate_hz"),
        (1e-6, "dvl", "vehicle.dvl.rate_hz"),
        (1e-6, "magnetometer", "vehicle.magnetometer.rate_hz"),
    ],
)
def test_a_rate_of_less_than_a_sample_a_day_is_refused(rate, block, key):
    scene = course(
        (0, 0, 0),
        duration_s=0.1,
        **({"render": {"frame_rate_hz": rate}} if block == "render" else {"vehicle": {block: {"rate_hz": rate}}}),
    )
    assert refusal(scene).key == key


def test_a_vehicle_that_waits_longer_than_a_day_is_stopped_with_the_waypoint_it_waits_at(monkeypatch):
    monkeypatch.setattr(flight, "MAX_TICKS", 4000)
    scene = scene_from_dict(
        {
            "trajectory": {"waypoints": [{"position": (0, 0, 0)}, {"position": (0, 1, 0)}], "handover_timeout_s": 1e9},
            "current": {"velocity": (3.0, 0.0, 0.0)},
        }
    )
    error = refusal(scene)
    assert error.key == "trajectory.waypoints.1"
    assert "wait" in error.problem


def test_a_day_is_what_int64_nanoseconds_hold_a_hundred_thousand_times():
    assert LONGEST_S == DAY
    last = clock.times_ns(2, 1.0 / LONGEST_S)[-1]
    assert last == 86_400_000_000_000
    assert np.iinfo(np.int64).max / last > 1e5


# ------------------------------------------------------------------------------------------------------ long and short


def test_a_leg_of_half_a_day_costs_no_more_to_start_than_a_short_one():
    """The reference is made in blocks of ticks: a leg of 21 875 s, all at once, would take gigabytes and minutes."""
    scene = course((0, 0, 0), (0, 5000, 0), (0, 1e9, 0), duration_s=1.0)
    tracemalloc.start()
    simulation = simulate(scene)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(simulation.frames) == 10
    assert peak < 4e6  # 200 ticks and two blocks, of some hundred bytes


def whole_reference(course, ticks):
    """Every active leg at once, from the definition."""
    window = guidance.at_rest(course.positions[0], course.attitudes[0])
    start, rows = 0, np.arange(ticks)
    for leg, gate in zip(course.legs, course.gates, strict=True):
        s = (rows - start) * TICK_S / leg.duration
        w = guidance.weight(s)[0][:, None]
        window = guidance.Window(
            window.position + w * leg.step,
            *[None] * 2,
            window.attitude * Rotation.from_rotvec(w * leg.turn),
            None,
            None,
        )
        start += int(np.ceil(round((leg.duration - gate.overlap) / TICK_S, 6)))
    return window


def test_the_reference_made_in_blocks_is_the_sum_of_its_legs():
    stops = [
        {"position": p, "rotation_euler_deg": e}
        for p, e in (
            ((0, 0, 0), (0, 0, 0)),
            ((0, 2, 0), (0, 0, 80)),
            ((2, 2, 1), (10, -30, 120)),
            ((2.5, 2, 1), (0, 0, 0)),
        )
    ]
    planned = plan(course(*stops).trajectory)
    walk = Guidance(planned)
    ticks = round(planned.duration / TICK_S)
    assert ticks > 4 * BLOCK_TICKS
    target = [tuple(p) for p in planned.positions.tolist()]
    made = [walk.reference(tick, target[walk.leg + 1], walk.start) for tick in range(ticks)]
    expected = whole_reference(planned, ticks)
    np.testing.assert_allclose([r.position for r in made], expected.position, atol=1e-14)
    turned = Rotation.from_quat([r.attitude for r in made], scalar_first=True)
    assert (turned.inv() * expected.attitude).magnitude().max() < 1e-14


@pytest.mark.parametrize("duration", [1e-300, 1e-9, 0.004999, 0.1])
def test_the_shortest_sequence_is_one_frame_and_the_imu_sample_after_it(duration):
    simulation = simulate(course((0, 0, 0), (0, 3, 0), duration_s=duration))
    assert len(simulation.frames) == 1
    assert len(simulation.imu.time_ns) == 2


def test_hundreds_of_waypoints_are_driven_to_the_end_in_order():
    """A spiral of legs of 1 s, just long enough not to be strict ones."""
    angle = np.linspace(0.0, 7.5 * np.pi, 200)
    spiral = np.column_stack([np.cos(angle), np.sin(angle), 0.01 * angle])
    simulation = simulate(course(*map(tuple, spiral.tolist()), max_acceleration=2.0))
    assert (np.diff(simulation.waypoint) >= 0).all()
    assert set(simulation.waypoint) == set(range(1, len(spiral)))
    assert not any("gave up" in message for message in simulation.messages)
    assert np.linalg.norm(simulation.trajectory.position[-1] - spiral[-1]) < 0.5


@pytest.mark.parametrize("gap", [1e-300, 1e-12, 1e-9, 1e-6, 0.0999])
def test_waypoints_that_nearly_coincide_are_one_strict_waypoint(gap):
    with np.errstate(all="raise", under="ignore"):
        simulation = simulate(course((0, 0, 0), (0, 2, 0), (0, 2 + gap, 0), (0, 4, 0)))
    passed = np.linalg.norm(simulation.trajectory.position - [0.0, 2.0, 0.0], axis=1).min()
    assert passed < 0.005
    assert not simulation.messages


def test_waypoints_just_further_apart_than_the_strict_ones_are_passed_by():
    assert not any(gate.angle < np.inf for gate in plan(course((0, 0, 0), (0, 2, 0), (0, 2.1001, 0)).trajectory).gates)
    assert any(gate.angle < np.inf for gate in plan(course((0, 0, 0), (0, 2, 0), (0, 2.0999, 0)).trajectory).gates)


def test_info_tells_of_poses_that_no_vehicle_can_follow_and_refuses_two_at_one_time(tmp_path):
    path = tmp_path / "scene.yaml"
    scene = "trajectory: {poses: [{position: [0, 0, 0]}, {position: [9, 0, 0], time_s: %s}]}\n"
    path.write_text(scene % "0.01")
    result = CliRunner().invoke(app, ["info", str(path), "-q"])
    assert result.exit_code == 0
    assert "warning: trajectory.poses.0: 900 m/s" in result.output
    path.write_text(scene % "0")
    result = CliRunner().invoke(app, ["info", str(path), "-q"])
    assert result.exit_code == 2
    assert "trajectory.poses.1.time_s = 0.0: is not after the pose before it" in result.stderr
