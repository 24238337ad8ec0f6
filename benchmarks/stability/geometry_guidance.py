"""Sweeps of courses: waypoints near and far, few and many, sharp turns, speeds, lengths."""

import time
import tracemalloc

import numpy as np

from benchmarks.stability.entry import Sweep, Sweeps
from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.sim.clock import TICK_NS, TICK_RATE_HZ, times_ns
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.trajectory import simulate

TESTS = "tests/stability/test_sequence_limits.py"
OLD_TESTS = "tests/stability/test_dynamics_limits.py"


def drive(*positions, **options):
    """A course through places, or through waypoint blocks."""
    waypoints = [p if isinstance(p, dict) else {"position": p} for p in positions]
    return simulate(scene_from_dict({"trajectory": {"waypoints": waypoints, **options}}))


def waypoint_gap() -> Sweep:
    """Two waypoints ever nearer to each other in the middle of a way."""
    gaps = [0.0, 1e-12, 1e-9, 1e-6, 1e-3, 0.01, 0.09, 0.11, 0.3, 1.0, 3.0]

    def missed(gap):
        run = drive((0, 0, 0), (0, 2, 0), (0, 2 + gap, 0), (2, 2 + gap, 0))
        return float(np.linalg.norm(run.trajectory.position - [0.0, 2.0, 0.0], axis=1).min())

    return Sweep(
        "waypoint_gap",
        "Coincident waypoints",
        "hand-over between waypoints",
        "gap [m]",
        gaps,
        {"how near it passes [m]": [missed(gap) for gap in gaps]},
        "Nearest approach of the vehicle to the first of two waypoints, before a right angle.",
        "no end: 1e-300 m as 0; nearer than 0.1 m (and 2 degrees) they are a strict waypoint, reached to 5 mm",
        "nothing is divided by the gap",
        "takes close pairs as the paper's way to ask for a strict waypoint",
        f"{TESTS}::test_waypoints_that_nearly_coincide_are_one_strict_waypoint",
        scale="symlog",
    )


def waypoint_count() -> Sweep:
    """Spirals of ever more waypoints."""
    counts, rows = [2, 10, 100, 1000, 2000], []
    for count in counts:
        angle = 0.12 * np.arange(count)
        spiral = np.column_stack([np.cos(angle), np.sin(angle), 0.01 * angle])
        start = time.process_time()
        run = drive(*map(tuple, spiral.tolist()), max_acceleration=2.0)
        spent = time.process_time() - start
        rows.append((float(np.linalg.norm(run.frames.position[-1] - spiral[-1])), spent / count))
    return Sweep(
        "waypoint_count",
        "Thousands of waypoints",
        "hand-over between waypoints",
        "waypoints",
        counts,
        {"from the goal at the end [m]": [a for a, _ in rows], "CPU a waypoint [s]": [b for _, b in rows]},
        "A spiral with legs of 1 s: distance from the last waypoint at the end, and the time it takes to simulate.",
        "no end found: the cost is that of the seconds driven",
        "nothing was found to fail",
        "makes the reference in blocks, two legs at a time",
        f"{TESTS}::test_hundreds_of_waypoints_are_driven_to_the_end_in_order",
        bound=0.55,
    )


def leg_length() -> Sweep:
    """The first second of a leg to a place ever further away."""
    lengths, rows = [1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 9.9e8], []
    for length in lengths:
        tracemalloc.start()
        start = time.process_time()
        run = drive((0, 0, 0), (0, length, 0), duration_s=1.0)
        rows.append(
            (
                float(np.linalg.norm(run.reference_position - run.trajectory.position, axis=1).max()),
                tracemalloc.get_traced_memory()[1] * 1e-9,
                time.process_time() - start,
            )
        )
        tracemalloc.stop()
    return Sweep(
        "leg_length",
        "Waypoints far away",
        "reference in blocks",
        "length of the leg [m]",
        lengths,
        {
            "lag [m]": [max(a, 1e-17) for a, _, _ in rows],
            "memory [GB]": [b for _, b, _ in rows],
            "CPU [s]": [c for _, _, c in rows],
        },
        "Lag behind the reference, memory and time of the first second of a leg at 0.5 m/s.",
        "1e9 m with trajectory.duration_s; without, a course of a day: 20 km at 0.5 m/s",
        "the reference of a whole leg took 65 GB at 1e7 m",
        "refuses courses of more than a day before they are driven",
        f"{TESTS}::test_a_leg_of_half_a_day_costs_no_more_to_start_than_a_short_one",
        holds=(None, 1e9),
        bound=1.0,
    )


def sequence_length() -> Sweep:
    """Exact poses for seconds to a day."""
    lengths, rows = [0.005, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4, 36_000.0, 9e4, 1e9], []
    for seconds in lengths:
        tracemalloc.start()
        start = time.process_time()
        try:
            run = simulate(
                scene_from_dict(
                    {
                        "trajectory": {
                            "poses": [
                                {"position": (0, 0, 0)},
                                {"time_s": seconds, "position": (0, 1, 0), "rotation_euler_deg": (0, 0, 90)},
                            ]
                        },
                        "render": {"frame_rate_hz": 1},
                    }
                )
            )
            late = abs(int(run.trajectory.time_ns[-1]) - (len(run.trajectory.time_ns) - 1) * 5_000_000)
            peak = tracemalloc.get_traced_memory()[1]
            rows.append((float(late) + 1e-9, peak * 1e-9, time.process_time() - start))
        except InputError:
            rows.append((float("nan"),) * 3)
        tracemalloc.stop()
    return Sweep(
        "sequence_length",
        "Ten hours and more",
        "int64 ns, rows of 200 Hz",
        "length of the sequence [s]",
        lengths,
        {
            "time stamp off [ns]": [a for a, _, _ in rows],
            "memory [GB]": [b for _, b, _ in rows],
            "CPU [s]": [c for _, _, c in rows],
        },
        "Error of the last time stamp (a billionth stands for none), memory and time to simulate exact poses; with "
        "waypoints a simulated second takes 10 to 20 ms of CPU.",
        "86 400 s: a day",
        "memory ends a sequence of some days; int64 nanoseconds would last 292 years",
        "refuses more than a day, also while a vehicle waits at a waypoint that it never reaches",
        f"{TESTS}::test_a_sequence_of_more_than_a_day_is_refused_before_it_is_driven",
        holds=(None, 86_400.0),
    )


def turn_angle() -> Sweep:
    """Corners from straight on to a reversal."""
    angles = [0.0, 10.0, 45.0, 90.0, 120.0, 135.0, 150.0, 170.0, 179.0, 180.0]

    def run(angle_deg):
        turn = np.radians(angle_deg)
        goal = (float(5.0 * np.sin(turn)), 5.0 + float(5.0 * np.cos(turn)), 0.0)
        made = drive((0, 0, 0), (0, 5, 0), goal)
        way = made.trajectory.position
        return (
            float(np.linalg.norm(way - [0.0, 5.0, 0.0], axis=1).min()),
            float(np.linalg.norm(made.frames.position[-1] - goal)),
        )

    made = [run(angle) for angle in angles]
    return Sweep(
        "turn_angle",
        "Sharp turns",
        "hand-over between waypoints",
        "turn [deg]",
        angles,
        {"corner cut by [m]": [max(a, 1e-17) for a, _ in made], "from the goal at the end [m]": [b for _, b in made]},
        "Two legs of 5 m: nearest approach to the corner, and distance from the goal at the end.",
        "no end: a reversal is a turn like any other",
        "a weight that follows the distance to the next waypoint, as the paper may be read, stalls from 90 degrees on",
        "lets time drive the weight",
        f"{OLD_TESTS}::test_a_weight_that_follows_the_distance_to_the_next_waypoint_stalls_at_a_right_angle",
        scale="linear",
        bound=0.55,
    )


def leg_speed() -> Sweep:
    """A speed ever further beyond the vehicle's."""
    speeds = [1e-3, 0.01, 0.1, 0.5, 1.0, 1.4, 1.5, 2.0, 5.0, 20.0, 1e3, 1e9]

    def run(speed):
        made = drive(
            (0, 0, 0),
            (0, 20, 0),
            speed=speed,
            max_acceleration=1e9 if speed > 1.0 else 0.25,
            **({"duration_s": 60.0} if speed < 0.1 else {}),
        )
        lag = np.linalg.norm(made.reference_position - made.trajectory.position, axis=1).max()
        left = np.linalg.norm(made.frames.position[-1] - [0.0, 20.0, 0.0])
        return float(lag), float(left) if speed >= 0.1 else float("nan")

    made = [run(speed) for speed in speeds]
    return Sweep(
        "leg_speed",
        "Speed beyond the vehicle",
        "guidance and saturated thrusters",
        "trajectory.speed [m/s]",
        speeds,
        {"largest lag [m]": [a for a, _ in made], "from the goal at the end [m]": [b for _, b in made]},
        "A leg of 20 m with a vehicle that goes 1.45 m/s: lag behind the reference, and distance from the goal when "
        "the course ends (not reached in the 60 s simulated below 0.1 m/s).",
        "1.45 m/s, the terminal speed of 40 kg",
        "the reference runs ahead, at most by the leg",
        "reports it before, waits at the hand-over, and goes on after trajectory.handover_timeout_s",
        f"{OLD_TESTS}::test_a_speed_beyond_the_vehicle_is_reported_and_the_course_still_ends",
        holds=(None, 1.45),
    )


def between_ticks() -> Sweep:
    """A vehicle that shakes ever faster, seen between the ticks of the simulation."""
    frequencies = [0.1, 0.3, 1.0, 3.0, 10.0, 20.0, 30.0, 50.0, 80.0, 100.0]
    ticks, still = times_ns(201, TICK_RATE_HZ), np.zeros((201, 3))

    def shaken(frequency, time_ns):
        w, t = 2.0 * np.pi * frequency, 1e-9 * time_ns[:, None] * [1.0, 0.0, 0.0]
        return np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t)

    def errors(frequency):
        upright = np.tile([1.0, 0.0, 0.0, 0.0], (201, 1))
        motion, asked = Trajectory(ticks, *shaken(frequency, ticks), upright, still, still), ticks[:-1] + TICK_NS // 2
        made, (place, _, acceleration) = motion.at(asked), shaken(frequency, asked)
        return (
            np.abs(made.position - place).max(),
            np.abs(made.acceleration - acceleration).max() / (2.0 * np.pi * frequency) ** 2,
        )

    place, acceleration = zip(*map(errors, frequencies), strict=True)
    return Sweep(
        "between_ticks",
        "Between ticks",
        "polynomials of degree five",
        "frequency of the motion [Hz]",
        frequencies,
        {"place over amplitude": place, "acceleration over its amplitude": acceleration},
        "Largest error halfway between ticks of 5 ms, where frames and sensors of any rate are.",
        "up to 30 Hz within 2e-5 of the place and 1e-3 of the acceleration; vehicles do not move as fast",
        "at 100 Hz ticks see a half-wave each",
        "nothing: no vehicle here has forces that change so fast",
        "tests/sim/test_motion.py::test_between_ticks_a_motion_is_itself_to_the_sixth_power_of_the_tick",
        holds=(None, 40.0),
        bound=1e-3,
    )


SWEEPS: Sweeps = (waypoint_gap, waypoint_count, leg_length, sequence_length, turn_angle, leg_speed, between_ticks)
