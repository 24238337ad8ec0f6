"""Sweeps of courses: waypoints near and far, few and many, sharp turns, speeds, lengths."""

import time
import tracemalloc

import numpy as np

from benchmarks.stability.entry import Measured, Sweeps
from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.sim.clock import TICK_NS, TICK_RATE_HZ, times_ns
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.trajectory import simulate


def drive(*positions, **options):
    """A course through places, or through waypoint blocks."""
    waypoints = [p if isinstance(p, dict) else {"position": p} for p in positions]
    return simulate(scene_from_dict({"trajectory": {"waypoints": waypoints, **options}}))


def leg_length() -> Measured:
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
    return lengths, {
        "lag [m]": [max(a, 1e-17) for a, _, _ in rows],
        "memory [GB]": [b for _, b, _ in rows],
        "CPU [s]": [c for _, _, c in rows],
    }


def sequence_length() -> Measured:
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
    return lengths, {
        "time stamp off [ns]": [a for a, _, _ in rows],
        "memory [GB]": [b for _, b, _ in rows],
        "CPU [s]": [c for _, _, c in rows],
    }


def turn_angle() -> Measured:
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
    return angles, {
        "corner cut by [m]": [max(a, 1e-17) for a, _ in made],
        "from the goal at the end [m]": [b for _, b in made],
    }


def leg_speed() -> Measured:
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
    return speeds, {"largest lag [m]": [a for a, _ in made], "from the goal at the end [m]": [b for _, b in made]}


def between_ticks() -> Measured:
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
    return frequencies, {"place over amplitude": place, "acceleration over its amplitude": acceleration}


SWEEPS: Sweeps = (leg_length, sequence_length, turn_angle, leg_speed, between_ticks)
