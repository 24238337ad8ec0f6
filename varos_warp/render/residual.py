"""What surfaces do to the light of open water in one frame: lit points, the grid of the veil, the residual of the glow.

The kernels are those of kernels/transport/virtual_lights.py, residual.py, veil.py and glow.py.
"""

import numpy as np
import warp as wp

from varos_warp.kernels.field.open_water import Tables
from varos_warp.kernels.film.film import Film
from varos_warp.kernels.glow import add_counts, add_residual, count_starts, list_starts, make_start_glow_kernel
from varos_warp.kernels.residual import list_walks, make_block_kernel, make_reflect_kernel
from varos_warp.kernels.transport.subpath import Walk
from varos_warp.kernels.transport.virtual_lights import LitPoint, make_lit_points_kernel
from varos_warp.kernels.veil import VeilGrid, average_slabs, make_start_veil_kernel, sum_slabs
from varos_warp.kernels.world.camera import Camera as CameraData
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.render.launch import Launcher, Steps
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import kind_of

LIT_POINTS = 1 << 14
CELLS = 16
"""Cells of the veil's grid along the longer side of an image, square ones, not smaller than a pixel."""
SLABS, SCALE_M, FARTHEST_M = 12, 1.0, 200.0
"""Slabs of a ray; they widen in proportion to the distance beyond SCALE_M, and end at FARTHEST_M."""
LEAST_SAMPLES, MOST_SAMPLES = 64, 512
"""Samples of every slab at every node: as many as of a pixel, within these bounds."""
MOST_STARTS = {"cpu": 1 << 20, "cuda": 1 << 22}
"""Walks at a time, by kind of device; each takes about 170 bytes. At the end of each lot, a GPU is less than full."""
MOST_LISTED = 1 << 30
"""Samples that are listed at once: their numbers have 32 bits."""
WALK_THREADS = 1 << 17
"""Threads that share them on a GPU, each taking the next one when it is done."""
BLOCKED_SHARE = 1.0 / 3.0
"""Share of a pixel's starts that look what is blocked, in scenes that are denoised: with all of them, a twentieth of
the noise that a denoiser leaves comes from there, for a fifth of the time (measured)."""
CPU_TILE = 1 << 10


def empty_veil_grid(launcher: Launcher, view: Camera) -> VeilGrid:
    """The grid that covers a camera's image, as it is without surfaces."""
    width, height = view.resolution
    cell = cell_size(view)
    nodes = tuple(max(2, int(np.ceil(side / cell)) + 1) for side in (height, width))
    grid = VeilGrid()
    grid.scale, grid.log_step = SCALE_M, float(np.log1p(FARTHEST_M / SCALE_M) / SLABS)
    grid.radiance = wp.zeros((SLABS, *nodes), dtype=wp.vec3, device=launcher.device)
    return grid


def cell_size(view: Camera) -> float:
    """Side of a cell of the veil's grid [pixels]."""
    return max(max(view.resolution) / CELLS, 1.0)


def halo_width(camera: CameraData, view: Camera) -> float:
    """Angle [rad] of a cell of the veil's grid, in the middle of the image."""
    return cell_size(view) * float(camera.pixel_angle)


class Residual:
    """Walks from what a camera sees, for one frame.

    Args:
        launcher: runs the kernels.
        scene: the scene, its lamps at the frame's pose.
        kinds: whether it has instances, and whether it has textures.
        tables: of the camera.
        max_bounces: most reflections on surfaces.
        key: of the random numbers.
        lost: counts samples that are not numbers, as of a film.
        filtered: whether the image is to be denoised.
    """

    def __init__(self, launcher: Launcher, scene: SceneData, kinds: tuple[bool, bool], tables: Tables,
                 max_bounces: int, key: int, lost: wp.array, filtered: bool):
        self.launcher, self.scene, self.kinds, self.tables = launcher, scene, kinds, tables
        self.blocked_share = BLOCKED_SHARE if filtered else 1.0
        self.max_bounces, self.lost = max_bounces, lost
        self.keys = [int(k) for k in np.random.SeedSequence(key).generate_state(4)]
        self.lit_points = wp.empty(LIT_POINTS, dtype=LitPoint, device=launcher.device)
        kernel = make_lit_points_kernel(*self.kinds)
        launcher.run(kernel, self.lit_points.shape, [scene, wp.uint32(self.keys[0])], [self.lit_points])

    def fill_veil(self, grid: VeilGrid, view: Camera, pinhole: CameraData, spp: float):
        """Fill the grid for an image of ``spp`` samples per pixel."""
        slabs, *nodes = grid.radiance.shape
        shape = (min(max(LEAST_SAMPLES, round(spp)), MOST_SAMPLES), *nodes, slabs)
        key = self.keys[1]
        starts = wp.empty(shape, dtype=Walk, device=self.launcher.device)
        places, points = (wp.empty(shape, dtype=int, device=self.launcher.device) for _ in "pp")
        before = [self.scene, pinhole]
        after = [grid, wp.vec2(*map(float, view.resolution)), wp.uint32(key), starts, places, points]
        self.launcher.rows(make_start_veil_kernel(self.kinds[0]), (*nodes, shape[0]), before, after, tile_rows=1)
        light = wp.zeros(shape, dtype=wp.vec3, device=self.launcher.device)
        flat = [array.flatten() for array in (starts, places, points, light)]
        self._walk(*flat, key, 1.0, pinhole.position, halo_width(pinhole, view))
        means = wp.empty((slabs, *nodes), dtype=wp.vec4, device=self.launcher.device)
        self.launcher.run(average_slabs, means.shape, [starts, light], [means, self.lost])
        self.launcher.run(sum_slabs, nodes, [self.scene, means], [grid])

    def add_glow(self, film: Film, view: Camera, camera: CameraData, more: np.ndarray | int, metal_samples: int,
                 level: float) -> Steps[None]:
        """Add samples of the glow's residual and the halo to a film.

        Args:
            film: the film.
            view: the camera.
            camera: its record.
            more: so many per pixel, int [side, tile row, tile column], or the same for all.
            metal_samples: that pixels with metal take for one of others.
            level: about the radiance of the image, for glow.thinned; 0: not known.
        """
        at_once = max(1, MOST_LISTED // (int(np.prod(view.resolution)) * metal_samples))
        while np.any(more):
            now = np.minimum(more, at_once)
            yield from self._add_glow(film, view, camera, now, metal_samples, level)
            more = more - now

    def _add_glow(self, film: Film, view: Camera, camera: CameraData, more, metal_samples, level: float) -> Steps[None]:
        """As add_glow, of a list of samples that is not too long."""
        width, height = view.resolution
        device, pixels = self.launcher.device, (height, width)
        self.launcher.upload(more, film.wanted)
        counts, ends = self.launcher.running_sum(count_starts, width * height, [film, metal_samples])
        last, = yield from self.launcher.fetch(ends[-1:])
        total, most = int(last[0]), MOST_STARTS[kind_of(device)]
        for begin in range(0, total, most):
            end = min(begin + most, total)
            places, points = (wp.empty(end - begin, dtype=int, device=device) for _ in "pp")
            self.launcher.run(list_starts, counts.shape, [ends, film.residual_count, begin, end], [places, points])
            light = self._glow(view, camera, level, places, points)
            self.launcher.run(add_residual, pixels, [ends, light, begin, end], [film])
        self.launcher.run(add_counts, pixels, [counts], [film])

    def _glow(self, view: Camera, camera: CameraData, level: float, places, points) -> wp.array:
        """Light of samples of the residual."""
        starts = wp.empty(places.shape, dtype=Walk, device=self.launcher.device)
        light = wp.empty(places.shape, dtype=wp.vec3, device=self.launcher.device)
        after = [view.resolution[0], halo_width(camera, view), level, wp.uint32(self.keys[2]), places, points, starts,
                 light]
        kernel = make_start_glow_kernel(*self.kinds)
        self.launcher.rows(kernel, places.shape, [self.scene, camera], after, tile_rows=CPU_TILE)
        self._walk(starts, places, points, light, self.keys[2], self.blocked_share)
        return light

    def _walk(self, starts, places, points, light, key: int, blocked_share: float, eye=(0.0, 0.0, 0.0), halo=0.0):
        """Add the light of walks from ``starts``, but for the halo; see kernels/residual.halo_share.

        Random numbers are those of the ``points`` of the ``places``' sequences; ``blocked_share`` of the starts look
        what is blocked.
        """
        walks, key = [starts, places, points], wp.uint32(key)
        block, reflect = make_block_kernel(self.kinds[0]), make_reflect_kernel(*self.kinds)
        self._over(block, walks, False, blocked_share, key, [blocked_share, key, light])
        how = [self.tables, self.lit_points, self.max_bounces, wp.vec3(*eye), halo, key, light]
        self._over(reflect, walks, True, 1.0, key, how)
        # the starts now are surfaces that walks met
        key = wp.uint32(self.keys[3])
        self._over(block, walks, False, 1.0, key, [1.0, key, light])

    def _over(self, kernel, walks: list[wp.array], metals: bool, share: float, key: wp.uint32, how: list):
        """Run a kernel over walks: all at once on the CPU, which has no threads that could wait for each other.

        Those from ``metals`` too, or not; and of all that there are only a ``share``.
        """
        count, device = walks[0].shape[0], self.launcher.device
        listed, number = wp.empty(count, dtype=int, device=device), wp.zeros(1, dtype=int, device=device)
        self.launcher.run(list_walks, (count,), [*walks, int(metals), share, key], [listed, number])
        threads = int(number.numpy()[0]) if device == "cpu" else min(count, WALK_THREADS)
        taken = wp.zeros(1, dtype=int, device=device)
        after = [threads, taken, listed, number, *walks, *how]
        self.launcher.rows(kernel, (threads,), [self.scene], after, tile_rows=CPU_TILE)
