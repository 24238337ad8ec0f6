"""Sweeps of courses: waypoints near and far, few and many, sharp turns, speeds, lengths."""

import time
import tracemalloc

import numpy as np

from benchmarks.stability.entry import Sweeps
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.sim.clock import TICK_NS, TICK_RATE_HZ, times_ns
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.trajectory import simulate


def drive(*positions, **options):
    """A course through places."""
    waypoints = [{"position": position} for position in positions]
    return simulate(scene_from_dict({"trajectory": {"waypoints": waypoints, **options}}))


def lag_of(run) -> float:
    """How far [m] the vehicle is from its reference at worst."""
    return float(np.linalg.norm(run.reference_position - run.trajectory.position, axis=1).max())


def with_its_cost(simulated, error) -> tuple[float, float, float]:
    """The error of what is simulated, the memory that it takes at most [GB], and CPU seconds."""
    tracemalloc.start()
    start = time.process_time()
    try:
        made = error(simulated())
        return made, tracemalloc.get_traced_memory()[1] * 1e-9, time.process_time() - start
    finally:
        tracemalloc.stop()


def far_leg(length: float) -> tuple[float, float, float]:
    """The first second of a leg to a place ever further away."""
    return with_its_cost(lambda: drive((0, 0, 0), (0, length, 0), duration_s=1.0), lag_of)


def long_course(seconds: float) -> tuple[float, float, float]:
    """Exact poses for so long; how much [ns] the last time stamp is off."""
    end = {"time_s": seconds, "position": (0, 1, 0), "rotation_euler_deg": (0, 0, 90)}
    course = {"trajectory": {"poses": [{"position": (0, 0, 0)}, end]}, "render": {"frame_rate_hz": 1}}

    def late(run):
        return float(abs(int(run.trajectory.time_ns[-1]) - (len(run.trajectory.time_ns) - 1) * TICK_NS))

    return with_its_cost(lambda: simulate(scene_from_dict(course)), late)


def corner(angle_deg: float) -> tuple[float, float]:
    """How much of a corner is cut [m], and how far from the goal the course ends [m]."""
    turn = np.radians(angle_deg)
    goal = (float(5.0 * np.sin(turn)), 5.0 + float(5.0 * np.cos(turn)), 0.0)
    made = drive((0, 0, 0), (0, 5, 0), goal)
    cut = np.linalg.norm(made.trajectory.position - [0.0, 5.0, 0.0], axis=1).min()
    return float(cut), float(np.linalg.norm(made.frames.position[-1] - goal))


def hurried(speed: float) -> tuple[float, float]:
    """Largest lag [m], and how far from the goal it ends [m]; the slowest are not there within a minute."""
    how = {"max_acceleration": 1e9 if speed > 1.0 else 0.25} | ({"duration_s": 60.0} if speed < 0.1 else {})
    made = drive((0, 0, 0), (0, 20, 0), speed=speed, **how)
    left = float(np.linalg.norm(made.frames.position[-1] - [0.0, 20.0, 0.0]))
    return lag_of(made), left if speed >= 0.1 else float("nan")


def shaken(frequency: float, time_ns: np.ndarray):
    """Place, velocity and acceleration of a vehicle that swings along x by a metre."""
    w, t = 2.0 * np.pi * frequency, 1e-9 * time_ns[:, None] * [1.0, 0.0, 0.0]
    return np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t)


def between(frequency: float) -> tuple[float, float]:
    """Errors of place and acceleration half way between the ticks of the simulation, over their amplitudes."""
    ticks, still = times_ns(201, TICK_RATE_HZ), np.zeros((201, 3))
    upright, asked = np.tile([1.0, 0.0, 0.0, 0.0], (201, 1)), ticks[:-1] + TICK_NS // 2
    made = Trajectory(ticks, *shaken(frequency, ticks), upright, still, still).at(asked)
    place, _, acceleration = shaken(frequency, asked)
    most = (2.0 * np.pi * frequency) ** 2
    return np.abs(made.position - place).max(), np.abs(made.acceleration - acceleration).max() / most


SWEEPS: Sweeps = {
    "leg_length": {("lag [m]", "memory [GB]", "CPU [s]"): far_leg},
    "sequence_length": {("time stamp off [ns]", "memory [GB]", "CPU [s]"): long_course},
    "turn_angle": {("corner cut by [m]", "from the goal at the end [m]"): corner},
    "leg_speed": {("largest lag [m]", "from the goal at the end [m]"): hurried},
    "between_ticks": {("place over amplitude", "acceleration over its amplitude"): between},
}
