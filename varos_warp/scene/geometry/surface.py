"""A triangle mesh in a BVH on a device, in float32 about a local origin, and queries of it by many threads."""

import numpy as np
import trimesh
import warp as wp

from varos_warp.device.devices import upload
from varos_warp.device.launch import launch
from varos_warp.kernels.conventions import FAR
from varos_warp.kernels.mesh import project
from varos_warp.scene.geometry.topology import chunks

KERNELS = (project.find_first_hits, project.find_nearest)
"""What repairing nearly every terrain needs."""
EDGE_ON = 1e-6
"""How far from a triangle's corners, along a ray, its plane may be met, as a share: rounding of float32."""


class Surface:
    """Owns the BVH of a mesh.

    Args:
        vertices: float64 [V, 3] [m].
        faces: int32 [F, 3].
        device: ``cpu`` or ``cuda:N``.
        winding: Also prepare for ``signed_distance``.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, device: str = "cpu", winding: bool = False):
        self.vertices, self.faces, self.device = vertices, faces, device
        self.origin = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        self.mesh = wp.Mesh(
            points=upload(self.local(vertices), wp.vec3, device),
            indices=upload(faces.astype(np.int32, copy=False).ravel(), wp.int32, device),
            support_winding_number=winding,
            bvh_constructor="sah",
            bvh_leaf_size=8,
        )

    def local(self, points: np.ndarray) -> np.ndarray:
        """Points [N, 3] about the origin of the device, float32."""
        return (points - self.origin).astype(np.float32)

    def project(self, points: np.ndarray, reach: float = FAR) -> tuple[np.ndarray, np.ndarray]:
        """Nearest places float32 [N, 3] on the surface, of and in local points, and their faces [N].

        Farther than ``reach`` [m] there is none: the face is -1.
        """
        face = wp.empty(len(points), dtype=wp.int32, device=self.device)
        place = wp.zeros(len(points), dtype=wp.vec3, device=self.device)
        self._ask(project.find_nearest, points, reach=reach, face=face, place=place)
        return place.numpy(), face.numpy()

    def nearest(self, points: np.ndarray, reach: float = FAR) -> tuple[np.ndarray, np.ndarray]:
        """Distance [N] from points [N, 3] to the surface [m] and the face [N] where it is; infinite beyond ``reach``.

        The BVH finds the face in float32, so of two that are equally far to 1e-7 of the mesh's size it may be either;
        the distance to it is computed in float64.
        """
        _, face = self.project(self.local(points), reach)
        distance, found = np.full(len(points), np.inf), np.flatnonzero(face >= 0)
        for part in chunks(len(found)):
            chosen = found[part]
            on_face = trimesh.triangles.closest_point(self.vertices[self.faces[face[chosen]]], points[chosen])
            distance[chosen] = np.linalg.norm(on_face - points[chosen], axis=1)
        return distance, face

    def first_hits(self, points: np.ndarray, directions) -> tuple[np.ndarray, np.ndarray]:
        """First face [N] that rays from points [N, 3] meet (-1: none), and 1 or -1 [N]: its front or its back.

        ``directions`` are [N, 3], or [3] of parallel rays.
        """
        directions = np.broadcast_to(np.asarray(directions, np.float32), points.shape)
        face = wp.empty(len(points), dtype=wp.int32, device=self.device)
        side = wp.zeros(len(points), dtype=wp.float32, device=self.device)
        along = upload(directions, wp.vec3, self.device)
        self._ask(project.find_first_hits, self.local(points), directions=along, face=face, side=side)
        return face.numpy(), side.numpy()

    def distances(self, points: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Distance float64 [N] along rays to the first face, in lengths of their directions [N, 3]; infinite: none.

        The BVH finds the face in float32; the distance to its plane is computed in float64. Of a face that a ray meets
        edge on, it is that of its nearest corner.
        """
        face, _ = self.first_hits(points, directions)
        t, hit = np.full(len(points), np.inf), np.flatnonzero(face >= 0)
        for part in chunks(len(hit)):
            chosen = hit[part]
            t[chosen] = _along(points[chosen], directions[chosen], self.vertices[self.faces[face[chosen]]])
        return t

    def signed_distance(self, points: np.ndarray, threshold: float, known: np.ndarray) -> np.ndarray:
        """Distance float32 [N] [m] from local float32 points [N, 3], negative where the winding number is above.

        ``known``, int8 [N], is -1 or 1 where the sign is known already, else 0.
        """
        value = wp.zeros(len(points), dtype=wp.float32, device=self.device)
        known = upload(known, wp.int8, self.device)
        self._ask(project.sample_signed_distance, points, known=known, threshold=float(threshold), value=value)
        return value.numpy()

    def _ask(self, kernel: wp.Kernel, points: np.ndarray, **given) -> None:
        """Run a kernel for local points."""
        arguments = {"mesh": self.mesh.id, "points": upload(points, wp.vec3, self.device), **given}
        launch(kernel, len(points), arguments, self.device)


def _along(points, directions, corners):
    """Distances [N] at which rays meet the planes of triangles [N, 3, 3], in lengths of their directions [N, 3]."""
    a, b, c = np.moveaxis(corners, 1, 0)
    n = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):  # a face edge on
        t = ((a - points) * n).sum(axis=1) / (directions * n).sum(axis=1)
    of_corners = ((corners - points[:, None]) * directions[:, None]).sum(axis=2)
    of_corners /= np.square(directions).sum(axis=1)[:, None]
    least, most = of_corners.min(axis=1), of_corners.max(axis=1)
    slack = EDGE_ON * (1.0 + np.abs(of_corners).max(axis=1))
    return np.where((t >= least - slack) & (t <= most + slack), t, np.maximum(least, 0.0))
