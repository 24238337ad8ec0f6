"""The course of a scene among its meshes; and hull-following, whose waypoints only the meshes tell.

Hull-following keeps a constant distance from a surface, of which the vehicle faces the nearest point. The places at a
distance from a mesh are a smooth surface of their own, rounded about convex edges. Given points are moved onto it,
straight away from the nearest point of the mesh; then places half way between two are, until none are far apart.
"""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError
from varos_warp.scene.courses.recorded import RecordedCourse, read_course
from varos_warp.scene.description import Scene
from varos_warp.scene.description.patterns import HullFollowing
from varos_warp.scene.description.vehicle import Trajectory
from varos_warp.scene.frames import attitudes, look_at_matrix
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.geometry.placed import object_part, terrain_part
from varos_warp.scene.geometry.query import is_inside
from varos_warp.scene.geometry.surface import Surface

KEY = "trajectory.pattern"
ROUNDS, MOST_WAYPOINTS = 30, 20_000
NEARLY = 0.01
"""Share of the distance that a waypoint may be off it."""


def find_course(scene: Scene, parts: list[Part | Instances] | None = None) -> None:
    """Find the waypoints of a course along a surface, or read a recorded one, once; other courses know theirs.

    Args:
        parts: The scene's geometry; absent: what is followed is built.

    Raises:
        InputError: There is no such surface, or the distance from it cannot be kept; or a file cannot be read.
    """
    read_course(scene)
    pattern = scene.trajectory.pattern
    if not isinstance(pattern, HullFollowing) or pattern._found is not None:
        return
    part = next((part for part in parts or () if part.name == pattern.surface), None) or _part(scene, pattern.surface)
    shell = Shell(part, pattern.distance_m)
    ends = shell.settle(np.array(pattern.through, float))
    if (lost := np.flatnonzero(~shell.keeps(ends))).size:
        raise InputError(
            f"there is no place {pattern.distance_m:g} m from {pattern.surface} near it",
            key=f"{KEY}.through.{lost[0]}",
            value=pattern.through[lost[0]],
            remedy="It may lie in a hollow: move it, or lower distance_m",
        )
    places = _along(shell, ends, pattern)
    facing = _facing(shell.nearest(places) - places)
    pattern._found = [
        {"position": tuple(place), "rotation_euler_deg": tuple(angles)}
        for place, angles in zip(places.tolist(), facing.as_euler("xyz", degrees=True).tolist(), strict=True)
    ]


def standpoints(scene: Scene, parts: list[Part | Instances]) -> np.ndarray:
    """Places where the vehicle's course bends or a camera stands in the world, float64 [N, 3] [m]."""
    find_course(scene, parts)
    fixed = [camera.position for camera in scene.vehicle.cameras if camera.mount == "world"]
    passed = places(scene.trajectory)[used_stops(scene.trajectory)]
    return np.vstack([passed, np.array(fixed, float).reshape(-1, 3)])


def used_stops(trajectory: Trajectory) -> np.ndarray:
    """Numbers of the stops of a course that is found; of a recorded one, of those within the sequence."""
    stops = trajectory.stops
    return np.arange(len(stops))[stops.used if isinstance(stops, RecordedCourse) else slice(None)]


def places(trajectory: Trajectory) -> np.ndarray:
    """Positions [N, 3] [m] of the stops of a course that is found."""
    stops = trajectory.stops
    return stops.position if isinstance(stops, RecordedCourse) else np.array([stop.position for stop in stops], float)


def turns(trajectory: Trajectory) -> Rotation:
    """Attitudes, N, of the stops of a course that is found."""
    stops = trajectory.stops
    return stops.attitude if isinstance(stops, RecordedCourse) else Rotation.concatenate(attitudes(stops))


def local_origin(scene: Scene, parts: list[Part | Instances]) -> np.ndarray:
    """Origin of the device's world, float64 [3], whole metres: the middle of the cameras' places, within the scene.

    There float32 is most precise, however large the terrain.
    """
    positions = standpoints(scene, parts)
    middle = (positions.min(axis=0) + positions.max(axis=0)) / 2
    if parts:
        boxes = np.concatenate([part.extents() for part in parts])
        middle = np.clip(middle, boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0))
    return np.round(middle)


def _part(scene: Scene, name: str) -> Part:
    if name == "terrain" and scene.terrain is not None:
        return terrain_part(scene)
    number = int(name.partition(".")[2] or -1)
    if not 0 <= number < len(scene.objects):
        raise InputError(
            "there is no such surface in the scene",
            key=f"{KEY}.surface",
            value=name,
            remedy=f"Name terrain or one of the {len(scene.objects)} objects, counted from objects.0",
        )
    return object_part(scene, scene.objects[number], name)


class Shell:
    """The places at a distance from a part, on its outer side; above, of the terrain."""

    def __init__(self, part: Part, distance: float):
        self._surface, self._distance = Surface(part.vertices, part.faces), distance
        self._closed = part.name == "terrain" or trimesh.Trimesh(part.vertices, part.faces, process=False).is_watertight

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """Nearest points [N, 3] of the part."""
        _, face = self._surface.nearest(points)
        return trimesh.triangles.closest_point(self._surface.vertices[self._surface.faces[face]], points)

    def keeps(self, points: np.ndarray) -> np.ndarray:
        """Return whether points [N, 3] are at the distance, and on the outer side, bool [N]."""
        off = np.abs(self._surface.nearest(points)[0] - self._distance)
        return (off <= NEARLY * self._distance) & ~self._inside(points)

    def settle(self, points: np.ndarray) -> np.ndarray:
        """Points [N, 3] moved onto the shell, where that is possible."""
        for _ in range(ROUNDS):
            there = self.nearest(points)
            away = points - there
            size = np.linalg.norm(away, axis=1, keepdims=True)
            away = np.where(size > 1e-6 * self._distance, away / np.maximum(size, 1e-300), self._outwards(there))
            away[self._inside(points)] *= -1.0
            points = there + self._distance * away
        return points

    def _outwards(self, points: np.ndarray) -> np.ndarray:
        """Normals [N, 3] at points of the part."""
        normal = trimesh.triangles.normals(
            self._surface.vertices[self._surface.faces[self._surface.nearest(points)[1]]]
        )[0]
        side = 1e-3 * self._distance * normal
        return np.where(self._inside(points + side)[:, None], -normal, normal)

    def _inside(self, points: np.ndarray) -> np.ndarray:
        if not self._closed:
            return np.zeros(len(points), bool)
        return is_inside(self._surface.vertices, self._surface.faces, points)


def _along(shell: Shell, places: np.ndarray, pattern: HullFollowing) -> np.ndarray:
    """Places [M, 3] on the shell from each to the next, no farther apart than the pattern's spacing."""
    for _ in range(ROUNDS):
        gaps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        wide = np.flatnonzero(gaps > pattern.spacing_m)
        if not wide.size:
            return places
        if gaps.sum() / pattern.spacing_m > MOST_WAYPOINTS:
            break
        between = shell.settle(0.5 * (places[wide] + places[wide + 1]))
        kept = shell.keeps(between)
        stuck = ~kept | (
            np.linalg.norm(np.stack([between - places[wide], between - places[wide + 1]]), axis=2).max(0)
            > 0.999 * gaps[wide]
        )
        if stuck.any():
            where = ", ".join(f"{x:.2f}" for x in places[wide[stuck.argmax()]])
            raise InputError(
                f"the way at {pattern.distance_m:g} m from {pattern.surface} ends near ({where})",
                key=f"{KEY}.through",
                remedy="A hollow may be narrower than that, or the next point on "
                "the other side: lower distance_m, or give points between",
            )
        places = np.insert(places, wide + 1, between, axis=0)
    raise InputError(
        f"the course takes more than {MOST_WAYPOINTS} waypoints",
        key=f"{KEY}.spacing_m",
        value=pattern.spacing_m,
        remedy="Raise it",
    )


def _facing(forward: np.ndarray) -> Rotation:
    """Attitudes that look along directions [N, 3]: the first level, the others without a turn about the view."""
    forward = forward / np.linalg.norm(forward, axis=1, keepdims=True)
    turned = [Rotation.from_matrix(look_at_matrix(np.zeros(3), forward[0]))]
    for d in forward[1:]:
        before = turned[-1].apply([0.0, 1.0, 0.0])
        axis, cosine = np.cross(before, d), float(before @ d)
        size = np.linalg.norm(axis)
        bend = axis * (np.arctan2(size, cosine) / size if size > 0.0 else 1.0)
        turned.append(Rotation.from_rotvec(bend) * turned[-1])
    return Rotation.concatenate(turned)
