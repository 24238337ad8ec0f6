"""What happens in a scene: `simulate` runs the vehicle along its waypoints, 200 times per second."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from varos_warp.products.sensors.registry import Readings, needs_solids
from varos_warp.scene.description import Scene
from varos_warp.sim.companions import companions, meetings
from varos_warp.sim.driving import drive, rows_read
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.sensors.suite import Sensors, doubts

FELT = ("acceleration", "angular_velocity")
"""What splines through recorded poses make of their noise [m/s^2], [rad/s]."""
NEAR_M = 0.01
"""Nearer to the last stop a course counts as driven to its end [m]."""


@dataclass(frozen=True, kw_only=True)
class Simulation(Readings):
    """A trajectory, where it is at the frames, and what the sensors read."""

    trajectory: Trajectory
    """Motion of the vehicle, up to the first IMU sample after the last frame and the tick after that; for output F, up
    to one frame more."""
    frames: Trajectory
    """Motion of the vehicle at the frames' times, the first at 0."""
    messages: list[str]
    """Warnings and events in plain words."""
    reference_position: np.ndarray
    """What the controller was asked to follow [N, 3] [m]; the position itself for exact poses."""
    waypoint: np.ndarray
    """Index of the waypoint (or pose) that the reference heads for, int [N]."""

    def motion(self, time_ns: int) -> Callable[[np.ndarray], np.ndarray]:
        """Poses of the vehicle around a time: a function of times from there, int64 [N] [ns], to T_w_v [N, 4, 4].

        Before the first row the accelerations are those of that row.
        """
        return lambda offset_ns: self.trajectory.from_before(time_ns + offset_ns).poses()


class PathSamples(NamedTuple):
    """Positions that a vehicle has and was meant to have, densely enough to check clearances."""

    time_ns: np.ndarray
    position: np.ndarray
    reference: np.ndarray
    waypoint: np.ndarray


def path_samples(simulation: Simulation, spacing_m: float = 0.05) -> PathSamples:
    """Rows of a simulation thinned so that neither path moves more than ``spacing_m`` between two of them.

    Both ends are kept. Steps longer than the spacing (a vehicle faster than 10 m/s at 5 cm) are left as they are.
    """

    def travelled(path):
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])

    trajectory = simulation.trajectory
    distance = np.column_stack([travelled(trajectory.position), travelled(simulation.reference_position)])
    keep, last = [0], distance[0]
    while keep[-1] < len(distance) - 1:
        # the furthest row that is still within the spacing of the last one kept, by both paths
        within = min(np.searchsorted(distance[:, j], last[j] + spacing_m, side="right") - 1 for j in range(2))
        keep.append(max(int(within), keep[-1] + 1))
        last = distance[keep[-1]]
    return PathSamples(
        trajectory.time_ns[keep],
        trajectory.position[keep],
        simulation.reference_position[keep],
        simulation.waypoint[keep],
    )


def course_facts(simulation: Simulation, scene: Scene) -> dict[str, Any]:
    """Length [m] of the way from the first frame to the last, the time between them [s], and where it leads then.

    ``heads_for`` is the number of the stop that it is still on the way to where ``duration_s`` ends it; else None. Of a
    recorded course also ``rms`` and ``peak`` of the `FELT`.
    """
    last_ns, stops = simulation.frames.time_ns[-1], scene.trajectory.stops
    end = int(np.searchsorted(simulation.trajectory.time_ns, last_ns, side="right"))
    way = np.diff(simulation.trajectory.position[:end], axis=0)
    target = int(simulation.waypoint[end - 1])
    if (arrival := getattr(stops[-1], "time_s", None)) is not None:
        left = arrival - 1e-9 * last_ns > 0.0
    else:
        left = np.linalg.norm(simulation.reference_position[end - 1] - stops[-1].position) > NEAR_M
    far = target < len(stops) - 1 or left
    felt = {key: _sizes(getattr(simulation.trajectory, key)[:end]) for key in FELT} if scene.trajectory.file else {}
    return {
        **felt,
        "length_m": float(np.linalg.norm(way, axis=1).sum()),
        "duration_s": 1e-9 * float(last_ns),
        "heads_for": target if scene.trajectory.duration_s and far else None,
    }


def _sizes(vectors: np.ndarray) -> dict[str, float]:
    """Root mean square and largest length of vectors [N, 3]."""
    size = np.linalg.norm(vectors, axis=1)
    return {"rms": float(np.sqrt(np.mean(size**2))), "peak": float(size.max())}


# --------------------------------------------------------------------------------------------------------- simulation


def simulate(scene: Scene, parts: list | None = None, *, progress: Callable[[float], None] | None = None) -> Simulation:
    """Move the scene's vehicle and read its sensors. The same scene gives the same bytes.

    Args:
        scene: Waypoints to follow with the vehicle's dynamics, or exact poses.
        parts: The scene's geometry, from ``build_parts``, which only sensors with beams need; absent: built where there
            is one.
        progress: Called now and then with the share of the work done, 0 to 1.

    Raises:
        InputError: Poses are out of order, parameters cannot be simulated, a rate is less than one sample in a day,
            or the sequence would last longer than that.
    """
    run, others = drive(scene, parts, progress or (lambda share: None)), companions(scene)
    trajectory = run.trajectory.rows(slice(rows_read(scene, len(run.frames))))  # no more for F: noise knows the length
    if progress:
        progress(1.0)
    read = Sensors(scene, int(trajectory.time_ns[-1]), geometry_of(scene, parts), others).read(trajectory)
    messages = [
        scene.key_in_file(words)
        for words in (*run.messages, *meetings(scene, run.frames, others), *doubts(scene, read))
    ]
    return Simulation(
        trajectory=run.trajectory,
        frames=run.frames,
        messages=messages,
        reference_position=run.reference_position,
        waypoint=run.waypoint,
        **vars(read),
    )


def geometry_of(scene: Scene, parts: list | None) -> list | None:
    """The scene's geometry, which is built only where some sensor meets it and it is not there yet."""
    if parts is not None or not needs_solids(scene.vehicle):
        return parts
    from varos_warp.scene.geometry.build import build_parts  # meshes are loaded only where a sensor needs them

    return build_parts(scene)
