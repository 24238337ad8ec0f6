"""Tables along a camera's rays: for which cameras there are some, their nodes, and whether they are right."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import warp as wp

from varos_warp.device.launcher import Launcher
from varos_warp.kernels.field.along_camera import AlongCamera
from varos_warp.kernels.field.open_water import LightField
from varos_warp.kernels.field.tabulate import (
    compare_single_along_camera,
    tabulate_multiple_along_camera,
    tabulate_single_along_camera,
)
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.medium import Medium
from varos_warp.scene.description import Scene
from varos_warp.scene.description.optics import resized
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import camera_record, optics_spec
from varos_warp.scene.frames import camera_pose, intrinsics
from varos_warp.scene.lights.records import Lights, light_position, radius_of

FARTHEST_M = 200.0
"""Last distance of the tables."""
PIXELS = (1024, 1024)
"""Pixels that places in the image are counted in; any number gives the same rays."""
IN_VIEW = 0.75
"""Lights within so many widths and heights of the image's centre are in view, or so near that its rays pass them."""
LARGEST_DISK = 0.3
"""Largest radius of a disk over its distance from the camera: nearer, its few points in the tables are too few. Up to
there they are within `MOST_ERROR` (tests/render/field/test_disks_along_camera.py)."""
MOST_ERROR, MOST_ERROR_AT_A_POINT = 1e-3, 2e-2
"""Largest errors accepted of a table of what lamps send, relative to the layer's root mean square: of its root mean
square error, and of the largest at any point. Tables of the templates and of coastal water with four tilted lamps have
up to 0.06 % and 1.1 % (at 16 384 points); narrow beams of sharp edge across the view exceed this, and keep the
quadrature."""
POINTS = 1 << 12
"""Number of points at which the error is measured: at random places of the image, with random distances, evenly in the
logarithm."""


class Nodes(NamedTuple):
    """The nodes of a table."""

    name: str
    """What it is of: light scattered once, more than once, or by bodies."""
    counts: tuple[int, int, int]
    """Number of nodes of the distance, and of rows and columns of the image."""
    nearest_m: float
    """First of the distances; nearer, what is scattered is in proportion."""
    farthest_m: float = FARTHEST_M
    """Last of them."""
    judged_m: tuple[float, float] = (0.2, 40.0)
    """Least and greatest distance of the points at which the error is measured."""

    def table(self, radiance: wp.array) -> AlongCamera:
        """The table of some values."""
        table = AlongCamera()
        table.radiance, table.nearest = radiance, self.nearest_m
        table.log_step = float(np.log(self.farthest_m / self.nearest_m) / (self.counts[0] - 1))
        return table


MULTIPLE = Nodes("multiple", (64, 19, 33), 0.02)
SINGLE = Nodes("single", (192, 46, 81), 0.1)


def along_camera(scene: Scene, view: Camera) -> bool:
    """Return whether there are tables along a camera's rays: they are straight, move with all lights, and see none.

    Nor is a light a disk as large as it is near.
    """
    if view.mount == "world" or optics_spec(view).bends or len(scene.lights) > len(scene.vehicle.lights):
        return False
    T_c_v, K = np.linalg.inv(camera_pose(view, np.eye(4))), intrinsics(view)
    for light in scene.vehicle.lights:
        p = T_c_v[:3, :3] @ light_position(light, np.eye(4)) + T_c_v[:3, 3]
        if radius_of(light) > LARGEST_DISK * np.linalg.norm(p):
            return False
        col, row = (K @ p)[:2] / max(p[2], 1e-9) / view.resolution
        if p[2] > 0.0 and abs(col - 0.5) < IN_VIEW and abs(row - 0.5) < IN_VIEW:
            return False
    return True


@lru_cache(maxsize=16)
def as_pinhole(view: Camera) -> tuple[Camera, dict]:
    """A camera with the rays of a pinhole, whatever its pixels, and what they depend on, which is not to be changed."""
    view = resized(view, *PIXELS)
    return view, view.model_dump(mode="json", exclude={"id", "f_stop", "focus_m", "vignetting", "exposure"})


class Kernels(NamedTuple):
    """Fills a table, and compares it with what it stands for."""

    tabulate: wp.Kernel
    compare: wp.Kernel
    along_ray: bool
    """True if one thread fills all distances of a ray, and not one of them only."""


OF_SINGLE = Kernels(tabulate_single_along_camera, compare_single_along_camera, False)


def tabulated(
    launcher: Launcher, view: Camera, nodes: Nodes, medium: Medium, lights: Lights, fields: wp.array | None
) -> np.ndarray:
    """Radiance [distance, row, column, 3] added up to each distance, of a vehicle at rest; empty if it is not right.

    Args:
        launcher: Of the device.
        view: The camera, as `as_pinhole` gives it.
        nodes: Those of the table.
        medium: The water.
        lights: Those of the scene.
        fields: What is known around each light, for light that is scattered more than once.
    """
    known = seen_at_rest(view, medium, lights)
    if nodes.name != MULTIPLE.name:
        return checked(launcher, nodes, OF_SINGLE, known).radiance.numpy()
    table = nodes.table(wp.empty(nodes.counts, dtype=wp.vec3, device=launcher.device))
    of_points = wp.array(fields.numpy()[lights.of_points], dtype=LightField, device=launcher.device)
    launcher.rows(
        tabulate_multiple_along_camera, nodes.counts[1:], known | {"table": table, "lights": of_points}, tile_rows=1
    )
    return table.radiance.numpy()


def seen_at_rest(view: Camera, medium: Medium, lights: Lights) -> dict:
    """Water, lights and camera of a vehicle at rest, as arguments of kernels that fill tables.

    Tables hold means over disks: each is some points.
    """
    T_w_v, origin = np.eye(4), np.zeros(3)
    scene = SceneData()
    scene.medium, scene.lights = medium, lights.points_at(T_w_v, origin)
    return {
        "scene": scene,
        "camera": camera_record(view, T_w_v, origin, pinhole=True),
        "size": wp.vec2(*map(float, view.resolution)),
    }


def checked(launcher: Launcher, nodes: Nodes, kernels: Kernels, known: dict) -> AlongCamera:
    """A table that agrees between its nodes with what it stands for, in every channel; empty if it does not."""
    table = nodes.table(wp.empty(nodes.counts, dtype=wp.vec3, device=launcher.device))
    launcher.rows(kernels.tabulate, nodes.counts[kernels.along_ray :], known | {"table": table}, tile_rows=1)
    if not _is_right(launcher, nodes, kernels.compare, known | {"table": table}):
        table.radiance = wp.empty((0, 0, 0), dtype=wp.vec3, device=launcher.device)
    return table


def _is_right(launcher: Launcher, nodes: Nodes, compare: wp.Kernel, known: dict) -> bool:
    """Return whether a table agrees with what it stands for at random points."""
    rng = np.random.default_rng(0)
    distances = np.exp(rng.uniform(*np.log(nodes.judged_m), POINTS))
    points = np.column_stack((rng.random((POINTS, 2)), distances))
    found = {name: wp.empty(POINTS, dtype=wp.vec3, device=launcher.device) for name in ("known", "tabulated")}
    launcher.rows(
        compare,
        (POINTS,),
        known | found | {"points": wp.array(points, dtype=wp.vec3, device=launcher.device)},
        tile_rows=1024,
    )
    truth, error = found["known"].numpy().astype(float), found["tabulated"].numpy() - found["known"].numpy()
    scale = np.sqrt(np.mean(truth**2, axis=0))
    rms, most = np.sqrt(np.mean(np.square(error, dtype=float), axis=0)), np.abs(error).max(axis=0)
    return bool((rms <= MOST_ERROR * scale).all() and (most <= MOST_ERROR_AT_A_POINT * scale).all())
