"""Warnings before rendering where bands are too few, or chosen for other ways of light, or colours not told apart."""

from collections.abc import Iterator

import numpy as np

from varos_warp.scene.camera_checks import GRID
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.frames import camera_pose
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.geometry.query import ranges
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.passes import backscatter_error
from varos_warp.scene.spectra.bands import rms_over, scene_bands
from varos_warp.scene.spectra.matrix import color_matrix
from varos_warp.scene.spectra.water import water_spectra

LEAST_COLOUR = 1e-3
"""Singular values of a colour matrix below this count as 0."""
MOST_STOPS = 8
"""Stops from which ways are looked for."""
LEFT = 1e-3
"""Share of light that the clearest wavelength leaves on the longest way that counts."""
ENDS = (0.02, 0.98)
"""Shares of the ways that are shorter than those that are told."""
WORSE = 1.5
"""Times the error that is stated, or allowed, from which a warning is due."""


def check_bands(scene: Scene, parts: list[Part | Instances], poses: np.ndarray) -> list[str]:
    """Warnings of cameras in water by wavelength: of their colours, of backscattered light, of the ways of light.

    Args:
        poses: Of the vehicle at its stops, float64 [N, 4, 4].
    """
    if not scene.is_spectral:
        return []
    warnings = [*_grey(scene), *_backscatter(scene)]
    if not scene.vehicle.lights or not parts:
        return warnings
    for i, camera in enumerate(scene.vehicle.cameras):
        ways = ways_of_light(scene, camera, parts, poses)
        if ways is None:
            continue
        bands, low, high = scene_bands(scene, camera), *ways
        error = float(rms_over(scene, camera, ways).max())
        if error > WORSE * max(float(bands.rms.max()), scene.render.tolerance):
            near, far = bands.range_m
            warnings.append(
                f"vehicle.cameras.{i} ({camera.id}): light goes {low:.2g} to {high:.2g} m from lamps over surfaces to "
                f"it, and its bands are chosen for {near:g} to {far:g} m: over those ways their error is "
                f"{100 * error:.2g} % (root mean square of the worst channel); give render.bands_range_m: "
                f"[{low:.2g}, {high:.2g}]"
            )
    return warnings


def _grey(scene: Scene) -> Iterator[str]:
    """Warnings of matrices fitted to channels that do not tell three colours apart."""
    for i, camera in enumerate(scene.vehicle.cameras):
        if camera.color_matrix == "auto":
            rank = np.linalg.matrix_rank(color_matrix(scene, camera), tol=LEAST_COLOUR)
            if rank < 3:
                yield (
                    f"vehicle.cameras.{i}.color_matrix (camera {camera.id}): auto: the channels of its response see "
                    f"alike, and the matrix that is fitted to them has rank {rank}, so that images are "
                    f"{'grey' if rank == 1 else 'of two colours'}; leave it out, or give its rows"
                )


def _backscatter(scene: Scene) -> Iterator[str]:
    """Warnings of cameras whose bands are too few for light that is scattered straight back."""
    if not scene.lights:
        return
    for i, camera in enumerate(scene.vehicle.cameras):
        error, bands = float(backscatter_error(scene, camera).max()), scene_bands(scene, camera)
        if error > WORSE * max(float(bands.rms.max()), scene.render.tolerance):
            yield (
                f"vehicle.cameras.{i} ({camera.id}): backscattered light is off by up to {100 * error:.2g} % with "
                f"{len(bands.wavelength_nm)} bands, for three at a time share a phase function; raise render.bands, "
                "or leave it to auto"
            )


def ways_of_light(
    scene: Scene, camera: Camera, parts: list[Part | Instances], poses: np.ndarray
) -> tuple[float, float] | None:
    """Shortest and longest way [m] from the vehicle's lamps over surfaces to a camera, but for 2 % at either end.

    Along a grid of the camera's rays, over the nearest lamp, at a few stops; ways on which hardly any light is left do
    not count. None: there are none.
    """
    reach = float(np.log(1.0 / LEFT) / water_spectra(scene).c.min())
    chosen = poses[np.unique(np.linspace(0, len(poses) - 1, MOST_STOPS).astype(int))]
    model, (width, height) = camera_model(camera), camera.resolution
    x, y = ((np.arange(GRID) + 0.5) * side / GRID for side in (width, height))
    rays = model.rays(np.stack(np.meshgrid(x, y), -1).reshape(-1, 2))
    seen, lamps, ways = rays.weight > 0.0, np.array([light.position for light in scene.vehicle.lights]), []
    for T_w_v in chosen:
        T_w_c = camera_pose(camera, T_w_v)
        start = rays.origin[seen] @ T_w_c[:3, :3].T + T_w_c[:3, 3]
        along = rays.direction[seen] @ T_w_c[:3, :3].T
        t = ranges(parts, start, along, reach)
        hit = np.isfinite(t)
        points = start[hit] + t[hit, None] * along[hit]
        from_lamps = np.linalg.norm(points[:, None] - (lamps @ T_w_v[:3, :3].T + T_w_v[:3, 3]), axis=-1)
        ways.append(t[hit] + from_lamps.min(axis=1, initial=np.inf))
    found = np.concatenate(ways)
    found = found[found < reach]
    if not len(found):
        return None
    low, high = np.quantile(found, ENDS)
    return float(low), float(max(high, 1.01 * low))
