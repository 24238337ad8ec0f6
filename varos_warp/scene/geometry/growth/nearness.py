"""How near cameras of the course come, and how wide a pixel is there."""

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from varos_warp.scene.description import Scene
from varos_warp.scene.geometry.course import find_course, places, used_stops
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.optics.camera import camera_model

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
    lever: float
    """How far cameras sit from such a point, at most [m]."""
    angle: float
    """The smallest of all cameras' angles of a pixel [rad]."""

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Least distance [N] of any camera from points [N, 3] [m], or less."""
        nearest = cKDTree(self.eyes).query(points)[0]
        return np.maximum(nearest - self.lever - 0.5 * STEP_M, NEAREST_M)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Width [N] of a pixel at points [N, 3] [m]."""
        return self.angle * self.distance(points)


def footprint(scene: Scene, parts: list[Part | Instances]) -> Footprint:
    """Where the cameras of a scene come to, of all of its vehicles alike; ``parts`` are its geometry."""
    observed = [scene.observed_by(vehicle.id) for vehicle in scene.vehicles] if scene.vehicles else [scene]
    eyes, angles, lever = [], [], 0.0
    for seen in observed:
        find_course(seen, parts)
        eyes.append(_along(places(seen.trajectory)[used_stops(seen.trajectory)]))
        for camera in seen.vehicle.cameras:
            angles.append(camera_model(camera).pixel_angle)
            if camera.mount == "world":
                eyes.append(np.array([camera.position], float))
            else:
                lever = max(lever, float(np.linalg.norm(camera.position)))
    return Footprint(np.concatenate(eyes), lever, min(angles, default=WITHOUT_CAMERA))


def _along(stops: np.ndarray) -> np.ndarray:
    """Points [M, 3] no more than a step apart on the line through stops [N, 3]."""
    pieces = [stops[:1]]
    for a, b in itertools.pairwise(stops):
        count = max(int(np.ceil(np.linalg.norm(b - a) / STEP_M)), 1)
        pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(pieces)
