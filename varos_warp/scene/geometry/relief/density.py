"""How fine a surface must be: the width of a pixel on it, from where any camera of the course comes nearest.

What is smaller than a pixel of the nearest view need not be geometry; what is larger must be.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from varos_warp.scene.description import Scene
from varos_warp.scene.geometry.course import find_course, places, used_stops
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.optics.camera import camera_model

PIXELS = 3.0
"""Longest edge, in pixels of the nearest view; the mean is then about two thirds of it."""
SHORTEST_M, LONGEST_M = 0.001, 0.25
"""Bounds of edges [m]; longer ones would show no form at all."""
NEAREST_M = 0.25
"""No camera is taken to come nearer than this [m]."""
STEP_M = 0.1
"""Distance of the points that stand for a course [m]."""
WITHOUT_CAMERA = 1e-3
"""Angle of a pixel [rad] where a scene has no camera."""


@dataclass(frozen=True, eq=False)
class Footprint:
    """The width of a pixel at points of the world, at the least distance of any camera of the course."""

    eyes: np.ndarray
    """float64 [N, 3]: points along the courses of all vehicles, and cameras that stand in the world [m]."""
    lever: np.ndarray
    """float64 [N]: how far cameras sit from such a point, at most [m]."""
    angle: float
    """The smallest of all cameras' angles of a pixel [rad]."""

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Least distance [N] of any camera from points [N, 3] [m], on the safe side by steps and levers."""
        nearest, eye = cKDTree(self.eyes).query(points, workers=-1)
        return np.maximum(nearest - self.lever[eye] - 0.5 * STEP_M, NEAREST_M)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Width [N] of a pixel at points [N, 3] [m]."""
        return self.angle * self.distance(points)

    def edges(self, points: np.ndarray, factor: float = 1.0) -> np.ndarray:
        """Longest edges [N] [m] that show at points [N, 3] all that a pixel shows; ``factor`` times as long."""
        return longest_edge(self(points), factor)


def longest_edge(pixel: np.ndarray, factor: float = 1.0) -> np.ndarray:
    """The longest edge [m] where a pixel is so wide [m]; ``factor`` times as long."""
    return np.clip(factor * PIXELS * pixel, SHORTEST_M, LONGEST_M)


def footprint(scene: Scene, parts: list[Part | Instances]) -> Footprint:
    """Where the cameras of a scene come to, of all of its vehicles alike.

    Args:
        scene: Its courses are found, if they follow a surface.
        parts: The scene's geometry before relief.
    """
    observed = [scene.observed_by(vehicle.id) for vehicle in scene.vehicles] if scene.vehicles else [scene]
    eyes, levers, angles = [], [], []
    for seen in observed:
        find_course(seen, parts)
        cameras = seen.vehicle.cameras
        angles += [camera_model(camera).pixel_angle for camera in cameras]
        fixed = [camera.position for camera in cameras if camera.mount == "world"]
        offsets = [np.linalg.norm(camera.position) for camera in cameras if camera.mount != "world"]
        along = _along(places(seen.trajectory)[used_stops(seen.trajectory)]) if offsets or not cameras else []
        for points, lever in ((along, max(offsets, default=0.0)), (fixed, 0.0)):
            eyes.append(np.array(points, float).reshape(-1, 3))
            levers.append(np.full(len(points), lever))
    return Footprint(np.concatenate(eyes), np.concatenate(levers), min(angles, default=WITHOUT_CAMERA))


def _along(stops):
    """Points [M, 3] no more than a step apart on the line through stops [N, 3]."""
    lengths = np.linalg.norm(np.diff(stops, axis=0), axis=1)
    counts = np.maximum(np.ceil(lengths / STEP_M).astype(int), 1)
    pieces = [a + (b - a) * np.linspace(0.0, 1.0, count, endpoint=False)[:, None]
              for a, b, count in zip(stops[:-1], stops[1:], counts, strict=True)]
    return np.concatenate([*pieces, stops[-1:]])
