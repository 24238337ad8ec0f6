"""Surfaces that carry growth: triangles near the course, each with a key, and smoothed normals of their corners."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from varos_warp.scene.geometry.growth.chance import mixed
from varos_warp.scene.geometry.normals import kept_corner_normals
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.geometry.relief.density import Footprint
from varos_warp.scene.geometry.topology import chunks

REACH_M = 25.0
"""Farther from the course there is no growth [m]."""
LARGEST_M = 1.0
"""Edges of triangles [m]; larger ones are cut in four until they are not, or lie beyond reach."""
QUARTERS = np.array([[[2, 0, 0], [1, 1, 0], [1, 0, 1]], [[1, 1, 0], [0, 2, 0], [0, 1, 1]],
                     [[1, 0, 1], [0, 1, 1], [0, 0, 2]], [[0, 1, 1], [1, 0, 1], [1, 1, 0]]]) / 2.0
"""Corners of a triangle's quarters in its barycentric coordinates."""


@dataclass(frozen=True)
class Host:
    """Triangles of one part or copy that are near enough to a course."""

    name: str
    origin: np.ndarray
    """float64 [3]: where fields have their origin [m]; it goes where the host goes."""
    corners: np.ndarray
    """float64 [F, 3, 3] [m]."""
    normals: np.ndarray
    """float [F, 3, 3]: smoothed, of the corners."""
    keys: np.ndarray
    """uint64 [F]: by their places in the mesh, whatever of it is near."""
    gap: np.ndarray
    """float64 [F]: distance of the course, or less [m]."""

    @property
    def area_normals(self) -> np.ndarray:
        """Normals [F, 3], as long as the area [m^2]."""
        return np.concatenate([0.5 * np.cross(self.corners[part, 1] - self.corners[part, 0],
                                              self.corners[part, 2] - self.corners[part, 0])
                               for part in chunks(len(self.keys))] or [np.zeros((0, 3))])

    def of(self, chosen: np.ndarray) -> "Host":
        """Some of the triangles."""
        return replace(self, **{name: getattr(self, name)[chosen] for name in PER_FACE})


PER_FACE = ("corners", "normals", "keys", "gap")


class Carrier:
    """A part, or copies, that growth may stand on: what of it is near to the course.

    Args:
        part: As it is rendered.
        footprint: Tells the distance of the course.
    """

    def __init__(self, part: Part | Instances, footprint: Footprint):
        self._part, self._footprint = part, footprint
        whole = slice(None) if part.skin is None or part.skin.cut is None else np.flatnonzero(~part.skin.cut)
        self._faces = part.faces[whole]  # nothing grows where masks may cut holes
        self._keys = np.arange(len(part.faces), dtype=np.uint64)[whole]
        normals = part.normals
        if normals is None:
            normals = kept_corner_normals(part.vertices, part.faces, part.smooth_angle)
        self._normals = normals.astype(np.float32)[whole]
        self._own = self._near(part.name, part.vertices, self._normals) if isinstance(part, Part) else None

    def hosts(self) -> Iterator[Host]:
        """The part, or one after the other each of the copies that come within reach of the course."""
        if self._own is not None:
            yield self._own
            return
        part = self._part
        assert isinstance(part, Instances)
        box, scale, names = part.extents(), part.scale, part.names
        gap = self._footprint.distance(box.mean(axis=1)) - 0.5 * np.linalg.norm(box[:, 1] - box[:, 0], axis=1)
        for i in np.flatnonzero(gap <= REACH_M):
            T = part.T_w_o[i]
            yield self._near(names[i], part.vertices @ T[:3, :3].T + T[:3, 3], self._normals @ T[:3, :3].T / scale[i])

    def _near(self, name, vertices, normals) -> Host:
        """What is within reach of the course, no triangle larger than `LARGEST_M`."""
        gap = _gaps(vertices, self._faces, self._footprint)
        near = np.flatnonzero(gap <= REACH_M)
        rest = Host(name, vertices.min(axis=0), vertices[self._faces[near]], normals[near], self._keys[near], gap[near])
        done = []
        while len(rest.keys):
            edges = np.linalg.norm(rest.corners - np.roll(rest.corners, 1, axis=1), axis=2).max(axis=1)
            done.append(rest.of(edges <= LARGEST_M))
            rest = self._quartered(rest.of(edges > LARGEST_M))
        if len(done) <= 1:
            return done[0] if done else rest
        return replace(rest, **{column: np.concatenate([getattr(each, column) for each in done])
                                for column in PER_FACE})

    def _quartered(self, host: Host) -> Host:
        """Of four triangles for each those that are within reach."""
        corners, normals = (np.einsum("qij,fjk->fqik", QUARTERS, x).reshape(-1, 3, 3)
                            for x in (host.corners, host.normals))
        keys = mixed(host.keys[:, None], np.arange(1, 5, dtype=np.uint64)).ravel()
        gap = _gaps(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), self._footprint)
        return replace(host, corners=corners, normals=normals, keys=keys, gap=gap).of(np.flatnonzero(gap <= REACH_M))


def _gaps(vertices, faces, footprint):
    """Distance of the course from triangles, or less, float64 [F] [m]."""
    gap = np.empty(len(faces))
    for part in chunks(len(faces)):
        corners = vertices[faces[part]]
        middle = corners.mean(axis=1)
        gap[part] = footprint.distance(middle) - np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    return gap
