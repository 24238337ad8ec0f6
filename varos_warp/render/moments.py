"""What differs from sample to sample of an image, as kernels get it: camera, lights and objects by instant."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from varos_warp.errors import InputError
from varos_warp.kernels.transport.moments import Moments
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import DeviceScene, camera_records
from varos_warp.scene.frames import checked_poses
from varos_warp.scene.optics.shutter import STILL, in_ns, instants, row_offsets_s

Motion = Callable[[np.ndarray], np.ndarray]
"""Poses [N, 4, 4] of the vehicle at times from the frame's stamp, int64 [N] [ns] (`Simulation.motion`)."""


class NextFrame(NamedTuple):
    """The frame to which output F is the flow."""

    T_w_v: ArrayLike
    """Pose [4, 4] of the vehicle."""
    camera: str | Camera | None = None
    """Camera, if it is another one: with the same pose, F is the disparity of a pair."""
    motion: Motion | None = None
    """Motion of the vehicle around that frame, for a rolling shutter."""
    time_ns: int | None = None
    """Time at which to place objects that move [ns]; absent: that of this frame, as for a pair."""


def checked_motion(name: str, motion: Motion | None) -> Motion | None:
    """A motion that a caller gives, whose poses are checked whenever it is asked for them.

    Raises:
        InputError: If it is no function, by the argument's name; and when it gives something else than poses.
    """
    if motion is None:
        return None
    if not callable(motion):
        raise InputError(
            "is no function",
            key=name,
            remedy="Give one of times [ns] that returns poses [N, 4, 4], such as Simulation.motion(time_ns).",
        )
    return lambda offset_ns: checked_poses(name, motion(offset_ns), len(offset_ns))


def moments_of(
    world: DeviceScene, view: Camera, T_w_v: np.ndarray, motion: Motion | None, pinhole: bool, lit: bool = True
) -> Moments:
    """The moments of an image.

    Args:
        world: The scene on its device.
        view: The camera.
        T_w_v: Pose of the vehicle at the frame's time.
        motion: Around it; None: the vehicle stands still, and so does everything else.
        pinhole: Whether the camera has no depth of field; such images are not of lights, of which there are none then.
        lit: Whether the time in which no light is on does not count.
    """
    moments = Moments()
    when = STILL if view.exposure.is_instant else instants(view, world.scene.lights if lit else ())
    offset_ns = in_ns(when.offset_s) if motion is not None else np.zeros(len(when.offset_s), np.int64)
    poses = np.broadcast_to(T_w_v, (len(offset_ns), 4, 4)) if motion is None else motion(offset_ns)
    moments.cameras = camera_records(view, poses, world.origin, world.device, pinhole=pinhole)
    if not pinhole and world.scene.lights:
        moments.lights = world.lights.over(poses, world.origin, when, world.carriers_at(offset_ns))
    moments.moving = world.moving_at(offset_ns)
    moments.per_row, moments.open = when.per_row, when.open
    moments.lit_begin, moments.lit_end = when.lit
    return moments


def poses_of_rows(view: Camera, T_w_v: np.ndarray, motion: Motion | None) -> np.ndarray:
    """Pose [H, 4, 4] of the vehicle in the middle of the exposure of each row."""
    offset_s = row_offsets_s(view)
    return np.broadcast_to(T_w_v, (len(offset_s), 4, 4)) if motion is None else motion(in_ns(offset_s))


def times_seen(view: Camera, lights: Sequence, motion: Motion | None) -> np.ndarray:
    """Times from a frame's stamp that some image of it shows, int64 [N] [ns]: those of `moments_of` and of rows."""
    if view.exposure.is_instant or motion is None:
        return np.zeros(0, np.int64)
    in_water, in_air = (instants(view, which).offset_s for which in (lights, ()))  # of A and of B
    return np.unique(in_ns(np.concatenate([in_water, in_air, row_offsets_s(view)])))
