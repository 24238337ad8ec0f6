"""The stages of a frame before its pixels: lit points, and the grid of the veil (kernels/lit_points.py, veil.py)."""

import numpy as np
import warp as wp

from varos_warp.kernels.lit_points import LitPoint, make_lit_points_kernel
from varos_warp.kernels.open_water import Tables
from varos_warp.kernels.veil import VeilGrid, make_veil_kernel, sum_slabs
from varos_warp.render.launch import Launcher
from varos_warp.scene.description import Camera
from varos_warp.scene.device import DeviceScene

LIT_POINTS = 1 << 14
CELL_PX = 8
"""Pixels between nodes of the grid."""
SLABS, SCALE_M, FARTHEST_M = 16, 1.0, 200.0
"""Slabs of a ray; they widen in proportion to the distance beyond SCALE_M, and end at FARTHEST_M."""
LEAST_SAMPLES = 8
"""Samples of every slab at every node: half as many as of a pixel, but not fewer than these."""


def find_lit_points(launcher: Launcher, world: DeviceScene, key: int) -> wp.array:
    """Where the lamps' rays meet surfaces in this frame."""
    points = wp.empty(LIT_POINTS, dtype=LitPoint, device=launcher.device)
    kernel = make_lit_points_kernel(world.has_instances, world.has_textures)
    launcher.run(kernel, points.shape, [world.data, wp.uint32(key)], [points])
    return points


def empty_veil_grid(launcher: Launcher, view: Camera) -> VeilGrid:
    """The grid that covers a camera's image, as it is without surfaces."""
    width, height = view.resolution
    nodes = tuple(max(2, -(-side // CELL_PX) + 1) for side in (height, width))
    grid = VeilGrid()
    grid.scale, grid.log_step = SCALE_M, float(np.log1p(FARTHEST_M / SCALE_M) / SLABS)
    grid.radiance = wp.zeros((SLABS, *nodes), dtype=wp.vec3, device=launcher.device)
    return grid


def fill_veil_grid(
    launcher: Launcher,
    world: DeviceScene,
    view: Camera,
    T_w_v,
    grid: VeilGrid,
    tables: Tables,
    lit_points: wp.array,
    spp: int,
    max_bounces: int,
    key: int,
):
    """Fill the grid for a frame that is rendered with ``spp`` samples per pixel."""
    samples, nodes = max(LEAST_SAMPLES, spp // 2), grid.radiance.shape[1:]
    slabs = wp.empty((samples, *nodes, SLABS), dtype=wp.vec4, device=launcher.device)
    launcher.rows(
        make_veil_kernel(world.has_instances, world.has_textures),
        (*nodes, samples),
        [world.data, world.camera(view, T_w_v, pinhole=True)],
        [tables, lit_points, grid, wp.vec2(*map(float, view.resolution)), max_bounces, wp.uint32(key), slabs],
        tile_rows=1,
    )
    launcher.run(sum_slabs, nodes, [world.data, slabs], [grid])
