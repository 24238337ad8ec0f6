"""Warnings before rendering of what looks wrong with the cameras of a scene."""

import numpy as np

from varos_warp.scene.description import Scene
from varos_warp.scene.description.exposure import white_balance_of
from varos_warp.scene.description.image_types import DEPTH, WATER
from varos_warp.scene.frames import intrinsics
from varos_warp.scene.info import camera_info
from varos_warp.scene.lights.balance import MOST_BALANCE, lamp_gains
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.optics.distortion import FISHEYES
from varos_warp.scene.optics.shutter import row_offsets_s

PIXEL_BYTES, MANY_BYTES = 400, 4 * 2**30
"""Memory of a pixel while A is rendered, and how much of it is worth a warning (docs/stability.md)."""
GRID = 16
"""Rays along each side of an image that are looked at."""
FARTHEST_CENTRE = 0.2
"""Share of the width or height that a principal point may be off the middle of an image without a word."""
FARTHEST_SWAPPED = 0.05
"""Share of the width or height that it may be off where with both swapped it is much nearer to the middle."""


def check_cameras(scene: Scene) -> list[str]:
    """Warnings, one sentence each, of cameras that look wrong, and of their shutters."""
    warnings = []
    for i, camera in enumerate(scene.vehicle.cameras):
        facts = [
            *_check_size(camera),
            *_check_view(camera),
            *_check_centre(camera),
            *_check_aperture(camera),
            *_check_gain(camera),
        ]
        warnings += [f"vehicle.cameras.{i} ({camera.id}): {words}" for words in facts]
    return [*warnings, *_check_planar_depth(scene), *_check_shutters(scene), *_check_white_balance(scene)]


def _check_size(camera):
    width, height = camera.resolution
    if width * height * PIXEL_BYTES > MANY_BYTES:
        size = width * height * PIXEL_BYTES / 2**30
        yield f"{width} x {height} pixels take about {size:.0f} GiB of memory while A is rendered"


def _check_view(camera):
    """Pixels that are not square though nobody measured them so, and fields of view that few cameras have."""
    K, measured = intrinsics(camera), camera.intrinsics is not None
    if abs(K[0, 0] / K[1, 1] - 1.0) > 0.005 and not measured:
        yield (
            f"pixels are not square (fx = {K[0, 0]:.1f}, fy = {K[1, 1]:.1f}): resolution and sensor_mm differ in shape"
        )
    fov = camera_info(camera)["horizontal_fov_deg"]
    fisheye = camera.distortion is not None and camera.distortion.model in FISHEYES
    if not 5.0 <= fov <= (360.0 if fisheye else 130.0):
        keys = "intrinsics and resolution" if measured else "focal_mm and sensor_mm"
        yield f"a horizontal field of view of {fov:.0f} degrees; check {keys}"


def _check_centre(camera):
    """Principal points far off the middle of the image, for which it may be another image, or lie on its side."""
    centre, size = intrinsics(camera)[:2, 2], np.array(camera.resolution)
    off, swapped = np.abs(centre / size - 0.5), np.abs(centre / size[::-1] - 0.5)
    across, down = 100.0 * off
    where = f"its principal point is {across:.0f} % of the width and {down:.0f} % of the height off the middle"
    if off.max() > FARTHEST_SWAPPED and swapped.max() < 0.5 * off.max() and size[0] != size[1]:
        yield f"{where}; are width and height of resolution swapped?"
    elif off.max() > FARTHEST_CENTRE:
        yield f"{where}; are intrinsics and resolution of the same image?"


def _check_aperture(camera):
    if 0.0 < camera.f_stop < 0.7:
        yield f"no lens has f/{camera.f_stop:g}; f_stop is focal length over aperture diameter"
    if camera.f_stop > 0.0 and 1e3 * camera.focus_m <= camera.focal_mm:
        yield "focus_m lies within the focal length; it is in metres"


def _check_gain(camera):
    gain = camera.exposure.gain
    if isinstance(gain, float) and not 1e-4 <= gain <= 1e4:
        yield f"exposure.gain: a gain of {gain:g} makes the picture black or white"


def _check_planar_depth(scene):
    """Cameras that see behind their lens, where planar depth is below 0."""
    if DEPTH not in scene.render.outputs or scene.render.depth_kind != "z":
        return
    for i, camera in enumerate(scene.vehicle.cameras):
        width, height = camera.resolution
        x, y = np.meshgrid((np.arange(GRID) + 0.5) * width / GRID, (np.arange(GRID) + 0.5) * height / GRID)
        behind = camera_model(camera).rays(np.stack([x, y], -1)).direction[..., 2] <= 0.0
        if behind.any():
            yield (
                f"vehicle.cameras.{i} ({camera.id}): {behind.mean():.0%} of the image looks behind the "
                "lens, where planar depth is below 0 and D holds nothing; give render.depth_kind: range"
            )


def _check_shutters(scene):
    """Exposures that no camera makes, and strobes that a shutter misses."""
    period = 1.0 / scene.render.frame_rate_hz
    for i, camera in enumerate(scene.vehicle.cameras):
        for name, seconds in (("time_s", camera.exposure.time_s), ("readout_s", camera.exposure.readout_s)):
            if seconds > period * (1.0 + 1e-9):
                yield (
                    f"vehicle.cameras.{i} ({camera.id}): exposure.{name} = {seconds:g} is longer than the "
                    f"{period:.4g} s from frame to frame, which no camera can do"
                )
        yield from _check_strobes(scene.vehicle.lights, camera)


def _check_white_balance(scene):
    """Gains for lamps that are kept at their bounds; lamps that light nothing are refused."""
    for i, camera in enumerate(scene.vehicle.cameras):
        if white_balance_of(scene.render.exposure, camera.exposure, WATER) != "lamps":
            continue
        for channel, gain in zip(("red", "green", "blue"), lamp_gains(scene, camera), strict=True):
            if gain in (MOST_BALANCE, 1.0 / MOST_BALANCE):
                yield (
                    f"vehicle.cameras.{i} ({camera.id}): white balance for lamps at its focus_m, {camera.focus_m:g} m, "
                    f"asks for more than {MOST_BALANCE:g} between {channel} and green, and is kept at that"
                )


def _check_strobes(lights, camera):
    """Which rows are exposed while a strobe is on."""
    offset = row_offsets_s(camera)
    half = 0.5 * camera.exposure.time_s
    for i, light in enumerate(lights):
        if light.strobe is None:
            continue
        begin, end = light.strobe.delay_s - 0.5 * light.strobe.on_s, light.strobe.delay_s + 0.5 * light.strobe.on_s
        seconds = np.minimum(offset + half, end) - np.maximum(offset - half, begin)
        rows = np.flatnonzero(seconds > 0.0 if half else (begin <= offset) & (offset < end))
        if not rows.size:
            yield (
                f"vehicle.lights.{i}: its strobe is on from {begin:g} to {end:g} s about each frame, but "
                f"camera {camera.id} is exposed from {offset[0] - half + 0.0:g} to {offset[-1] + half:g} "
                "s: it never sees it"
            )
        elif len(rows) < len(offset):
            yield (
                f"vehicle.lights.{i}: its strobe lights only rows {rows[0]} to {rows[-1]} of the "
                f"{len(offset)} of camera {camera.id}, whose rolling shutter exposes the others at other "
                "times"
            )
