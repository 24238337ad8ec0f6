"""Surfaces that carry growth: triangles near the course, each with a key, and smoothed normals of their corners."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from varos_warp.cache import digest
from varos_warp.device.launch import in_tiles
from varos_warp.scene.description.surfaces import Layered
from varos_warp.scene.geometry.growth.chance import mixed
from varos_warp.scene.geometry.growth.edges import AROUND_M, Edges, edges_of
from varos_warp.scene.geometry.lazily import once
from varos_warp.scene.geometry.normals import kept_corner_normals
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.geometry.relief.density import Footprint

REACH_M = 25.0
"""Farther from the course there is no growth [m]."""
LARGEST_M = 1.0
"""Edges of triangles [m]; larger ones are cut in four until they are not, or lie beyond reach."""
QUARTERS = (
    np.array(
        [
            [[2, 0, 0], [1, 1, 0], [1, 0, 1]],
            [[1, 1, 0], [0, 2, 0], [0, 1, 1]],
            [[1, 0, 1], [0, 1, 1], [0, 0, 2]],
            [[0, 1, 1], [1, 0, 1], [1, 1, 0]],
        ]
    )
    / 2.0
)
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
    """uint64 [F]: keys of the triangles by their places in the mesh, whatever of it is near."""
    gap: np.ndarray
    """float64 [F]: distance of the course, or less [m]."""
    silt: float = 0.0
    """How much silt lies on faces that look up, 0 to 1."""

    @once
    def area_and_up(self) -> tuple[np.ndarray, np.ndarray]:
        """Areas [F] [m^2], and vertical parts [F] of the unit normals; 0 without area."""
        area, up = np.zeros(len(self.keys)), np.zeros(len(self.keys))

        def fill(part):
            a, b, c = np.moveaxis(self.corners[part], 1, 0)
            normal = 0.5 * np.cross(b - a, c - a)
            area[part] = np.sqrt(np.einsum("ni,ni->n", normal, normal))
            up[part] = normal[:, 2] / np.where(area[part] > 0.0, area[part], 1.0)

        in_tiles(fill, len(self.keys))
        return area, up

    @once
    def edges(self) -> Edges:
        """Edges of the host, which are asked at places from its origin."""
        return edges_of(self.corners - self.origin, self.keys)

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

    @once
    def digest(self) -> str:
        """A hash of all of it that places depend on, but for the course."""
        part = self._part
        arrays = [part.vertices, part.faces, np.array(part.smooth_angle)]
        arrays += [part.normals if part.normals is not None else np.zeros(0)]
        arrays += [part.T_w_o, part.numbers] if isinstance(part, Instances) else []
        arrays += [np.array(self._silt)]
        return digest(*arrays, *([] if self._holes is None else [self._holes]))

    @property
    def _silt(self):
        """How much silt lies on the part's faces that look up, 0 to 1, by its material."""
        return float(getattr(self._part.material, "silt", 0.0)) if isinstance(self._part.material, Layered) else 0.0

    @property
    def _holes(self):
        """Faces, bool [F], that masks may cut; None: none."""
        return None if self._part.skin is None else self._part.skin.cut

    @once
    def _whole(self):
        """Faces that no mask cuts, their keys and their corners' normals: nothing grows where there may be holes."""
        part = self._part
        chosen = slice(None) if self._holes is None else np.flatnonzero(~self._holes)
        normals = part.normals
        if normals is None:
            normals = kept_corner_normals(part.vertices, part.faces, part.smooth_angle)
        return (
            part.faces[chosen],
            np.arange(len(part.faces), dtype=np.uint64)[chosen],
            normals[chosen].astype(np.float32),
        )

    @once
    def _own(self):
        """A part's only host."""
        return self._near(self._part.name, self._part.vertices, self._whole[2])

    def hosts(self) -> Iterator[Host]:
        """The part, or one after the other each of the copies that come within reach of the course."""
        if isinstance(self._part, Part):
            yield self._own
            return
        part = self._part
        box, scale, names = part.extents(), part.scale, part.names
        radius = 0.5 * np.linalg.norm(box[:, 1] - box[:, 0], axis=1)
        gap = self._footprint.distance(box.mean(axis=1), radius=radius + AROUND_M)
        for i in np.flatnonzero(gap <= REACH_M):
            T = part.T_w_o[i]
            yield self._near(names[i], part.vertices @ T[:3, :3].T + T[:3, 3], self._whole[2] @ T[:3, :3].T / scale[i])

    def _near(self, name, vertices, normals) -> Host:
        """A host of the triangles within reach of the course, none larger than `LARGEST_M`."""
        faces, keys, _ = self._whole
        gap = _gaps(vertices, faces, self._footprint)
        near = np.flatnonzero(gap <= REACH_M)
        rest = Host(name, vertices.min(axis=0), vertices[faces[near]], normals[near], keys[near], gap[near], self._silt)
        done = []
        while len(rest.keys):
            large = _are_large(rest.corners)
            if not large.any():
                done.append(rest)
                break
            done.append(rest.of(~large))
            rest = self._quartered(rest.of(large))
        if len(done) <= 1:
            return done[0] if done else rest
        return replace(
            rest, **{column: np.concatenate([getattr(each, column) for each in done]) for column in PER_FACE}
        )

    def _quartered(self, host: Host) -> Host:
        """A host whose triangles are each cut into four; only those within reach are kept."""
        corners, normals = (
            np.einsum("qij,fjk->fqik", QUARTERS, x).reshape(-1, 3, 3) for x in (host.corners, host.normals)
        )
        keys = mixed(host.keys[:, None], np.arange(1, 5, dtype=np.uint64)).ravel()
        gap = _gaps(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), self._footprint)
        return replace(host, corners=corners, normals=normals, keys=keys, gap=gap).of(np.flatnonzero(gap <= REACH_M))


def _gaps(vertices, faces, footprint):
    """Distance of the course from triangles, or less, by what tells whether they are edges, float64 [F] [m]."""
    gap = np.empty(len(faces))

    def fill(part):
        corners = vertices[faces[part]]
        middle = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3.0
        gap[part] = footprint.distance(middle, radius=_longest(corners, middle[:, None]) + AROUND_M)

    in_tiles(fill, len(faces))
    return gap


def _are_large(corners):
    """Which triangles [F] have an edge longer than `LARGEST_M`."""
    large = np.empty(len(corners), bool)

    def fill(part):
        large[part] = _longest(corners[part], np.roll(corners[part], 1, axis=1)) > LARGEST_M

    in_tiles(fill, len(corners))
    return large


def _longest(corners, others):
    """The longest way [F] from one of three corners [F, 3, 3] to its other; an axis as short is slow to reduce."""
    x, y, z = np.moveaxis(corners - others, 2, 0)
    square = x * x + y * y + z * z
    return np.sqrt(np.maximum(np.maximum(square[:, 0], square[:, 1]), square[:, 2]))
