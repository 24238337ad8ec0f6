"""A triangle mesh in a BVH on a device, in float32 about a local origin, and questions to it from many threads."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import trimesh
import warp as wp

from varos_warp.kernels.conventions import BLOCK_DIM, FAR
from varos_warp.kernels.mesh import project
from varos_warp.scene.geometry.topology import chunks

wp.config.log_level = wp.LOG_WARNING

CHUNK = 1 << 15
"""Threads of one CPU launch: small enough to keep all cores busy to the end, large beside the cost of a launch."""


def cores() -> int:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def launch(kernel, count: int, inputs: list, outputs: list, device: str) -> None:
    """Run a kernel whose first argument is its first thread: at once on a GPU, as chunks on all cores of a CPU.

    A CPU launch is serial and lets go of Python's lock, so that threads share the work.
    """
    if count == 0:
        return
    if wp.get_device(device).is_cuda:
        wp.launch(kernel, dim=count, inputs=[0, *inputs], outputs=outputs, device=device, block_dim=BLOCK_DIM)
        return
    kernel.module.load(wp.get_device(device))

    def run(part):
        wp.launch(kernel, dim=part.stop - part.start, inputs=[part.start, *inputs], outputs=outputs, device=device)

    with ThreadPoolExecutor(cores()) as pool:
        list(pool.map(run, chunks(count, CHUNK)))


def upload(array: np.ndarray, dtype, device: str) -> wp.array:
    """An array on the device; on a CPU the array itself, where it is laid out alike."""
    return wp.array(np.ascontiguousarray(array), dtype=dtype, device=device, copy=False)


class Surface:
    """Owns the BVH of a mesh.

    Args:
        vertices: float64 [V, 3] [m].
        faces: int32 [F, 3].
        device: ``cpu`` or ``cuda:N``.
        winding: Also prepare for ``signed_distance``.
    """

    leaf_size = 8

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, device: str = "cpu", winding: bool = False):
        self.vertices, self.faces, self.device = vertices, faces, device
        self.origin = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        self.mesh = wp.Mesh(points=upload(self.local(vertices), wp.vec3, device),
                            indices=upload(faces.astype(np.int32, copy=False).ravel(), wp.int32, device),
                            support_winding_number=winding, bvh_constructor="sah", bvh_leaf_size=self.leaf_size)

    def local(self, points: np.ndarray) -> np.ndarray:
        """Points [N, 3] about the origin of the device, float32."""
        return (points - self.origin).astype(np.float32)

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance [N] from points [N, 3] to the surface [m] and the face [N] where it is.

        The BVH finds the face in float32; the distance to it is computed in float64.
        """
        face = wp.empty(len(points), dtype=wp.int32, device=self.device)
        place = wp.empty(len(points), dtype=wp.vec3, device=self.device)
        launch(project.find_nearest, len(points), [self.mesh.id, upload(self.local(points), wp.vec3, self.device), FAR],
               [face, place], self.device)
        face, distance = face.numpy(), np.empty(len(points))
        for part in chunks(len(points)):
            on_face = trimesh.triangles.closest_point(self.vertices[self.faces[face[part]]], points[part])
            distance[part] = np.linalg.norm(on_face - points[part], axis=1)
        return distance, face

    def first_hits(self, points: np.ndarray, direction) -> tuple[np.ndarray, np.ndarray]:
        """First face [N] that rays from points [N, 3] meet (-1: none), and 1 or -1 [N]: its front or its back."""
        face = wp.empty(len(points), dtype=wp.int32, device=self.device)
        side = wp.zeros(len(points), dtype=wp.float32, device=self.device)
        launch(project.find_first_hits, len(points), [
            self.mesh.id, upload(self.local(points), wp.vec3, self.device), wp.vec3(*direction)], [face, side],
            self.device)
        return face.numpy(), side.numpy()

    def signed_distance(self, points: np.ndarray, threshold: float, known: np.ndarray) -> np.ndarray:
        """Distance float32 [N] [m] from local float32 points [N, 3], negative where the winding number is above.

        ``known``, int8 [N], is -1 or 1 where the sign is known already, else 0.
        """
        value = wp.zeros(len(points), dtype=wp.float32, device=self.device)
        inputs = [self.mesh.id, upload(points, wp.vec3, self.device), upload(known, wp.int8, self.device)]
        launch(project.sample_signed_distance, len(points), [*inputs, float(threshold)], [value], self.device)
        return value.numpy()
