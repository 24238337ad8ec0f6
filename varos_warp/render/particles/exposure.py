"""A camera while its rows are exposed, and the lamps meanwhile, as the kernels of bodies get them."""

import functools
from typing import NamedTuple, Protocol

import numpy as np
import warp as wp

from varos_warp.kernels.particles.image import Directions
from varos_warp.kernels.particles.sighting import Exposure
from varos_warp.kernels.transport.moments import Moments
from varos_warp.kernels.world.camera import Camera as CameraData
from varos_warp.kernels.world.lights.record import Light as LightData
from varos_warp.render.moments import Motion, moments_of
from varos_warp.render.particles.cells import field_of
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import DeviceScene, optics_spec
from varos_warp.scene.frames import camera_pose
from varos_warp.scene.lights.records import lights_vary
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.optics.shutter import STILL, in_ns, instants

GUESSES = 65
"""Nodes along each side of the table of directions."""
IN_TURN = 9
"""Instants of an exposure at which it is asked where the camera is, to know what it may see."""


class View(Protocol):
    """A camera at one frame."""

    @property
    def view(self) -> Camera:
        """Camera that sees the bodies."""

    @property
    def T_w_v(self) -> np.ndarray:
        """Pose of the vehicle [4, 4]."""

    @property
    def motion(self) -> Motion | None:
        """Motion of the vehicle while the shutter is open; None: it stands still, and so does all else."""

    @property
    def world(self) -> DeviceScene:
        """The world, with what moves where it is at the frame's time."""

    @property
    def time_ns(self) -> int:
        """Time of the frame [ns]."""


class Open(NamedTuple):
    """A camera while its shutter is open."""

    exposure: Exposure
    lights: wp.array
    """Records of the lamps in the mean over the exposure, [row or 1, lamp]."""
    varies: bool
    """True if camera or lamps differ from sample to sample."""
    T_w_c: np.ndarray
    """Poses [N, 4, 4] of the camera at some instants."""
    longest_s: float
    """Longest time from the frame's until some row is exposed [s]."""


def open_shutter(seen: View, current: np.ndarray, after_s: float = 0.0, way: np.ndarray | None = None) -> Open:
    """What a camera and the lamps do while it is open.

    Args:
        seen: The camera.
        current: Velocity of the water at its frame [3] [m/s].
        after_s: Of the next frame: the frame interval [s].
        way: And how far the water moves meanwhile [3] [m].
    """
    view, world, scene = seen.view, seen.world, seen.world.scene
    motion = seen.motion if not view.exposure.is_instant else None
    varies = motion is not None or lights_vary(scene.lights)
    when = STILL if motion is None else instants(view, scene.lights)
    some = when.offset_s[np.unique(np.linspace(0, len(when.offset_s) - 1, IN_TURN).astype(int))]
    poses = seen.T_w_v[None] if motion is None else motion(in_ns(some))
    exposure = Exposure()
    if varies:
        exposure.moments = moments_of(world, view, seen.T_w_v, motion, pinhole=False)
        lights = wp.array(mean_lights(exposure.moments, view.resolution[1]), dtype=LightData, device=world.device)
    else:
        exposure.moments.cameras = wp.array([world.camera(view, seen.T_w_v)], dtype=CameraData, device=world.device)
        lights = world.lit(seen.T_w_v).lights.reshape((1, -1))
    length_s = when.length_s
    if when.open == 0.0 and len(when.offset_s) > 1:  # an instant to a row: from row to row
        length_s = float(when.offset_s[1] - when.offset_s[0])
    exposure.length_s, exposure.after_s = length_s, after_s
    exposure.current, exposure.way = wp.vec3(*current), wp.vec3(*(np.zeros(3) if way is None else way))
    exposure.begin_s = float(when.offset_s[0] - 0.5 * length_s)
    exposure.width, exposure.height = view.resolution
    exposure.table = directions(view, world.device)
    return Open(exposure, lights, varies, camera_pose(view, poses), float(np.abs(when.offset_s).max()))


@functools.lru_cache(maxsize=16)
def directions(view: Camera, device: str) -> Directions:
    """Image points by direction, of a camera with a lens or a port; empty for others."""
    table = Directions()
    if not optics_spec(view).bends:
        table.points = wp.empty((0, 0), dtype=wp.vec2, device=device)
        return table
    from scipy.ndimage import distance_transform_edt

    table.half_angle = min(field_of(view).half_angle + 0.05, np.pi - 1e-3)
    y, x = (table.half_angle * axis for axis in np.meshgrid(*[np.linspace(-1.0, 1.0, GUESSES)] * 2, indexing="ij"))
    angle = np.hypot(x, y)
    across = np.sinc(angle / np.pi)
    far = 2.0 * np.stack([across * x, across * y, np.cos(angle)], -1)
    points = camera_model(view).project(np.where((angle < np.pi)[..., None], far, np.nan))
    unseen = ~np.isfinite(points).all(-1)
    if unseen.any():
        points = points[tuple(distance_transform_edt(unseen, return_distances=False, return_indices=True))]
    table.points = wp.array(points.astype(np.float32), dtype=wp.vec2, device=device)
    return table


def mean_lights(moments: Moments, rows: int) -> np.ndarray:
    """Records of the lamps [row or 1, lamp] in the middle of a row's exposure, with their mean intensity over it."""
    lights, count = moments.lights.numpy(), moments.lights.shape[0]
    begin = np.arange(rows if moments.per_row else 1) * float(moments.per_row)
    end = begin + max(float(moments.open), 1.0)
    low, high = (moments.lit_begin, moments.lit_end) if moments.lit_end else (0, count)
    begin, end = np.clip(begin, low, high), np.clip(end, low, high)
    middle = np.clip((0.5 * (begin + end)).astype(int), 0, count - 1)
    found, summed = lights[middle], np.cumsum(lights["intensity"].astype(float), axis=0)
    summed = np.concatenate([np.zeros_like(summed[:1]), summed])
    nodes = np.arange(count + 1)
    over = [
        np.stack([np.interp(at, nodes, column) for column in summed.reshape(count + 1, -1).T], -1)
        for at in (begin, end)
    ]
    length = np.maximum(end - begin, 1e-9)[:, None]
    found["intensity"] = ((over[1] - over[0]) / length).reshape(found["intensity"].shape)
    found["intensity"][end <= begin] = 0.0
    return found
