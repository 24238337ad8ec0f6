"""How fine a surface must be: the width of a pixel on it, from where any camera of the course sees it nearest.

What is smaller than a pixel of the nearest view need not be geometry; what is larger must be.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp
from scipy.spatial.transform import Rotation, Slerp

from varos_warp.cache import digest
from varos_warp.device.devices import upload
from varos_warp.device.launch import launch
from varos_warp.kernels.mesh.views import find_nearest_view
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.frames import camera_pose, transform
from varos_warp.scene.geometry.course import find_course, places, turns, used_stops
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.optics.camera import camera_model

PIXELS = 3.0
"""Longest edge, in pixels of the nearest view; the mean is then about two thirds of it."""
SHORTEST_M, LONGEST_M = 0.001, 2.0
"""Bounds of edges [m]; those of a mesh that are longer show no form."""
NEAREST_M = 0.25
"""No camera is taken to come nearer than this [m]."""
STEP_M, STEP_RAD = 0.1, 0.1
"""Distance and turn between the poses that stand for a course."""
MOST_POSES = 2000
ASIDE_M, ASIDE_RAD = 0.15, 0.2
"""How far from its course a vehicle may be, or turned from it: it takes curves where the course has corners."""
FASTER, AHEAD_M = 1.25, 0.5
"""How much faster than asked a vehicle may be, and how much farther along its course [m]: where ``duration_s`` ends a
sequence, what comes after it is not seen."""
UNSEEN = 8.0
"""Factor on the distance of surfaces where no camera looks: they are as coarse as if they were so much farther away."""
WITHOUT_CAMERA = 1e-3
"""Angle of a pixel [rad] where a scene has no camera."""


Pixels = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""The width of a pixel [N] [m] at points [N, 3] with normals [N, 3], zero where they are not known."""


@dataclass(frozen=True, eq=False)
class Footprint:
    """The width of a pixel at points of the world, in the nearest view that any camera of the course has of them."""

    eyes: np.ndarray
    """float64 [N, 3]: places of cameras along the courses of all vehicles [m]."""
    axes: np.ndarray
    """float64 [N, 3]: unit vectors along which they look."""
    halves: np.ndarray
    """float64 [N]: half angles of the cones that they see, with what the vehicle may be turned aside; pi: they see
    everything [rad]."""
    aside: float
    """How far cameras may be from these places [m]."""
    angle: float
    """The smallest of all cameras' angles of a pixel [rad]."""

    @property
    def digest(self) -> list:
        """All data of the footprint, as plain types for a key of the cache."""
        return [digest(self.eyes, self.axes, self.halves), self.aside, self.angle]

    def distance(
        self, points: np.ndarray, normals: np.ndarray | None = None, radius: np.ndarray | float = 0.0
    ) -> np.ndarray:
        """Least distance [N] [m] of any camera that sees points [N, 3], on the safe side.

        Where none does, `UNSEEN` times that of the nearest. With ``normals`` [N, 3], zero where they are not known,
        only of cameras before the surface, and farther where they see it at a slant, by the area of a pixel there.
        With a ``radius`` [m], one or [N], of balls about the points: of those that see some of the ball, from its
        nearest point.
        """
        middle = self.eyes.mean(axis=0)
        nearest, seen = (wp.empty(len(points), dtype=wp.float32, device="cpu") for _ in range(2))

        def single(values, kind=wp.vec3):
            return upload(np.asarray(values, np.float32), kind, "cpu")

        given = {
            "eyes": single(self.eyes - middle),
            "axes": single(self.axes),
            "cones": single(np.stack([self.halves, np.cos(self.halves), np.sin(self.halves)], axis=1)),
            "radius": single(np.broadcast_to(np.float32(radius), len(points)), wp.float32),
            "points": single(points - middle),
            "normals": single(np.zeros(points.shape) if normals is None else normals),
        }
        launch(find_nearest_view, len(points), {**given, "distance": nearest, "seen": seen}, "cpu")
        found = np.minimum(seen.numpy(), UNSEEN * nearest.numpy()).astype(float)
        return np.maximum(found - self.aside, NEAREST_M)

    def __call__(self, points: np.ndarray, normals: np.ndarray | None = None) -> np.ndarray:
        """Width [N] of a pixel at points [N, 3] [m]: the root of its area."""
        return self.angle * self.distance(points, normals)


def longest_edge(pixel: np.ndarray, factor: float = 1.0) -> np.ndarray:
    """The longest edge [m] where a pixel is so wide [m]; ``factor`` times as long."""
    return factor * np.clip(PIXELS * pixel, SHORTEST_M, LONGEST_M)


def footprint(scene: Scene, parts: list[Part | Instances], but: str | None = None) -> Footprint:
    """What the cameras of a scene come to see, of all of its vehicles alike.

    Args:
        but: Id of a vehicle whose cameras do not count, as they never see its body; unless it is the only one.
    """
    others = [vehicle for vehicle in scene.vehicles or () if vehicle.id != but] or scene.vehicles
    observed = [scene.observed_by(vehicle.id) for vehicle in others] if others else [scene]
    views, angles, aside = [], [], ASIDE_M
    for seen in observed:
        find_course(seen, parts)
        poses = _poses(seen.trajectory)
        aside = max(aside, ASIDE_M + 0.5 * float(_steps(poses).max(initial=0.0)))
        angles += [camera_model(camera).pixel_angle for camera in seen.vehicle.cameras]
        views += [_view(camera, poses) for camera in seen.vehicle.cameras] or [
            (poses[:, :3, 3], poses[:, :3, 1], np.full(len(poses), np.pi))
        ]
    return Footprint(*map(np.concatenate, zip(*views, strict=True)), aside, min(angles, default=WITHOUT_CAMERA))


def _view(camera: Camera, poses):
    """Places, axes and half angles of a camera along poses [N, 4, 4] of its vehicle, or where it stands."""
    fixed = camera.mount == "world"
    T_w_c = camera_pose(camera, np.eye(4)[None] if fixed else poses)
    half = min(_half_angle(camera) + (0.0 if fixed else ASIDE_RAD), np.pi)
    return T_w_c[:, :3, 3], T_w_c[:, :3, 2], np.full(len(T_w_c), half)


def _half_angle(camera):
    """Angle from the axis of a camera to the farthest of the rays along the border of its image [rad]."""
    across, down = (np.linspace(0.0, side, 17) for side in camera.resolution)
    grid = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    direction = camera_model(camera).rays(grid).direction
    z = direction[np.isfinite(direction).all(axis=1), 2]
    return float(np.arccos(np.clip(z.min(), -1.0, 1.0))) if len(z) == len(grid) else np.pi


def _steps(poses):
    """Distances [N - 1] from pose to pose [m]."""
    return np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)


def _longest_way(trajectory):
    """How far along its course a vehicle may come within the sequence [m]."""
    if trajectory.duration_s is None or trajectory.is_exact:
        return np.inf
    return FASTER * trajectory.speed * trajectory.duration_s + AHEAD_M


def _poses(trajectory):
    """Poses [N, 4, 4] along a course that is found, close enough to each other."""
    used = used_stops(trajectory)
    place, turn = places(trajectory)[used], turns(trajectory)[used]
    if len(used) == 1:
        return transform(turn.as_matrix(), place)
    far = np.linalg.norm(np.diff(place, axis=0), axis=1)
    wide = (turn[:-1].inv() * turn[1:]).magnitude()
    steps = np.maximum(np.ceil(np.maximum(far / STEP_M, wide / STEP_RAD)), 1.0)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    end = np.interp(_longest_way(trajectory), np.concatenate([[0.0], np.cumsum(far)]), way)
    at = np.linspace(0.0, end, min(int(np.ceil(end)), MOST_POSES - 1) + 1)
    along = np.column_stack([np.interp(at, way, place[:, axis]) for axis in range(3)])
    return transform(Slerp(way, Rotation.concatenate([turn]))(at).as_matrix(), along)
