"""Silhouettes of what has a number in S: the pixels that would show each, were all else not there.

Rays are those that C, D and S follow: through the centres of pixels, lens and port, each row at its time.
"""

from dataclasses import replace

import numpy as np
import warp as wp

from varos_warp.device.devices import resolve_device
from varos_warp.device.launcher import Launcher
from varos_warp.kernels.transport.first_hits import Rows
from varos_warp.kernels.transport.silhouettes import make_silhouettes_kernel
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import DeviceScene, Poses, camera_record, camera_records, optics_spec
from varos_warp.scene.frames import camera_pose, inverse, transform
from varos_warp.scene.geometry.parts import Grown, Instances, Moving, Part
from varos_warp.scene.optics.shutter import in_ns, is_rolling, row_offsets_s

SURFACE = "terrain"
"""Key of what has no silhouette."""


class Silhouettes:
    """The silhouettes of a scene, by the numbers of S; that of a host has what grows on it, if that has its number.

    Args:
        scene: The scene.
        parts: Everything solid in it.
        numbers: The numbers in S, by key.
        origin: Of the local world, as in `DeviceScene`; that of the renderer makes rays equal to the last bit.
        device: ``auto``, ``cpu`` or ``cuda:N``.
    """

    def __init__(
        self,
        scene: Scene,
        parts: list[Part | Instances],
        numbers: dict[str, int],
        origin: np.ndarray,
        device: str = "auto",
    ):
        self.device = resolve_device(device)
        kept = [part for part in parts if part.name != SURFACE]
        if scene.render.segments != "fine":
            kept = [_not_on_surface(part) if isinstance(part, Grown) else part for part in kept]
        alone = [_alone(part, origin) for part in kept if not isinstance(part, Instances) or len(part)]
        self.launcher = Launcher(self.device)
        self.world = DeviceScene(scene, alone, self.device, origin=origin, joins_copies=False) if alone else None
        if self.world:
            of_names = np.array([0, *(numbers[name] for name in self.world.part_names)])
            self._number_of = of_names[self.world.segment_of]

    def of(
        self, view: Camera, T_w_c: np.ndarray, poses: Poses, margin: tuple[int, int] = (0, 0)
    ) -> dict[int, np.ndarray]:
        """Pixels of each thing that has any, by its number: places in the flattened image, ascending, int64 [N].

        Args:
            view: The camera.
            T_w_c: Its pose [4, 4]; or that of each row [H, 4, 4], of a rolling shutter.
            poses: Of everything that moves, at times from the frame's.
            margin: Rows and columns of pixels around the image that belong to it, on either side. Rows beyond those of
                a rolling shutter are of the time of the nearest.
        """
        if self.world is None:
            return {}
        with self.launcher.turn:
            pixels, parts = self._traced(view, T_w_c, poses, margin)
        numbers = self._number_of[parts + 1]
        order = np.lexsort((pixels, numbers))
        pixels, numbers = pixels[order], numbers[order]
        new = np.ones(len(pixels), bool)  # a host and what grows on it may share a pixel
        new[1:] = (np.diff(pixels) != 0) | (np.diff(numbers) != 0)
        pixels, numbers = pixels[new], numbers[new]
        found, first = np.unique(numbers, return_index=True)
        return dict(zip(found.tolist(), np.split(pixels, first[1:]), strict=True)) if len(found) else {}

    def _traced(
        self, view: Camera, T_w_c: np.ndarray, poses: Poses, margin: tuple[int, int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Places of pixels and parts, for every instance that a pixel's ray meets."""
        rolls, (width, height) = is_rolling(view), view.resolution
        row_ns = in_ns(row_offsets_s(view)) if rolls else np.zeros(0, np.int64)
        T_w_v = T_w_c @ inverse(camera_pose(view, np.eye(4)))
        world, rows = self.world.moved(poses, row_ns), Rows()
        if rolls:
            of_rows = np.broadcast_to(T_w_v, (height, 4, 4))
            rows.cameras = camera_records(view, of_rows, world.origin, self.device, pinhole=True)
            rows.moving = world.moving_at(row_ns)
        kernel = make_silhouettes_kernel(replace(world.spec, optics=optics_spec(view), rolling=rolls))
        shape = height + 2 * margin[0], width + 2 * margin[1]
        counts = wp.zeros(shape, dtype=wp.int32, device=self.device)
        camera = camera_record(view, T_w_v.reshape(-1, 4, 4)[0], world.origin, pinhole=True)
        arguments = {
            "scene": world.data,
            "camera": camera,
            "of_rows": rows,
            "margin": wp.vec2i(*margin),
            "counts": counts,
        }
        nowhere = wp.empty((0, 0), dtype=wp.int64, device=self.device)
        self.launcher.rows(
            kernel, shape, {**arguments, "starts": nowhere, "parts": wp.empty(0, dtype=wp.int32, device=self.device)}
        )
        on_host = self.launcher.fetch(counts)[0].copy()  # counts are written again
        ends = np.cumsum(on_host, dtype=np.int64).reshape(shape)
        parts = wp.empty(int(ends[-1, -1]), dtype=wp.int32, device=self.device)
        if len(parts):
            self.launcher.rows(
                kernel,
                shape,
                {**arguments, "parts": parts, "starts": wp.array(ends - on_host, dtype=wp.int64, device=self.device)},
            )
        return np.repeat(np.arange(on_host.size), on_host.ravel()), self.launcher.fetch(parts)[0]


def _alone(part: Part | Instances, origin: np.ndarray) -> Part | Instances:
    """A part as an instance of its own, with the very vertices that it has in the mesh of what stands still."""
    if isinstance(part, Instances | Moving):
        return part
    group, _, number = part.name.rpartition(".")
    return Instances(
        group,
        part.vertices - origin,
        part.faces,
        part.material,
        smooth_angle=part.smooth_angle,
        skin=part.skin,
        T_w_o=transform(position=origin)[None],
        numbers_in_block=np.array([int(number)]),
    )


def _not_on_surface(group: Grown) -> Grown:
    """The copies that do not grow on what has no silhouette."""
    surfaces = [k for k, host in enumerate(group.hosts) if host == SURFACE]
    return group.some(~np.isin(group.host, surfaces))
