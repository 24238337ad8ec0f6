"""Lists of splats: those of all cells that a camera may see, sorted by the tiles of the image."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from varos_warp.device.launcher import Launcher
from varos_warp.kernels.particles.bodies import Cells
from varos_warp.kernels.particles.bodies import Particles as ParticleData
from varos_warp.kernels.particles.draw import Cone
from varos_warp.kernels.particles.gather import find_tiles
from varos_warp.kernels.particles.splat import TILE, Splat, SplatList
from varos_warp.render.particles.cells import cells_of, cone_of, field_of, size_classes, slack_of
from varos_warp.render.particles.exposure import Open, View
from varos_warp.scene.water.particles import ParticleLaw

CELL_ROWS = 1 << 12
"""Cells that a CPU's thread visits at a time."""


class Seen(NamedTuple):
    """The cells of one class of sizes that a camera may see."""

    particles: ParticleData
    cone: Cone
    cells: Cells


def seen_cells(
    law: ParticleLaw, record: ParticleData, here: View, shutter: Open, way: np.ndarray, seeds: np.random.SeedSequence
) -> Iterator[Seen]:
    """The cells of each class of sizes of a block.

    Args:
        law: The block's bodies.
        record: The same as kernels know them.
        here: The camera.
        shutter: While it is open.
        way: How far the bodies have drifted since time 0 [m].
        seeds: Of the random numbers, of which each class has its own.
    """
    speed = np.linalg.norm(np.array(shutter.exposure.current) + np.array(record.drift))
    slack = slack_of(law, here.view, float(speed) * shutter.longest_s)
    cone = cone_of(shutter.T_w_c, here.world.origin, field_of(here.view), slack)
    sizes = size_classes(law)
    for size, key in zip(sizes, seeds.generate_state(len(sizes)), strict=True):
        reach = min(record.reach, size.r_high / record.least_angle)
        cells = cells_of(size, cone, reach, here.world.origin, way)
        cells.slope, cells.key = law.block.slope, wp.uint32(int(key))
        yield Seen(record, cone, cells)


def splats_by_tiles(
    launcher: Launcher, kernel: wp.Kernel, known: dict[str, Any], seen: Sequence[Seen], resolution: tuple[int, int]
) -> dict[str, wp.array] | None:
    """The splats of all bodies, as `gather_splats` takes them; None if there is none.

    Args:
        launcher: Of the device.
        kernel: Counts or lists the splats of cells.
        known: Its arguments that are the same for all cells.
        seen: The cells.
        resolution: Width and height of the image.
    """
    device = launcher.device
    lists = []
    for some in seen:
        listed = SplatList()
        listed.counts = _integers(int(np.prod(some.cells.size)), device)
        listed.ends, listed.tiles = _integers(0, device), _integers(0, device)
        listed.splats = wp.empty(0, dtype=Splat, device=device)
        launcher.rows(kernel, listed.counts.shape, {**known, **some._asdict(), "listed": listed}, tile_rows=CELL_ROWS)
        listed.ends = wp.empty_like(listed.counts)
        wp.utils.array_scan(listed.counts, listed.ends, inclusive=True)
        lists.append(listed)
    totals = [int(total[0]) for total in launcher.fetch(*(listed.ends[-1:].contiguous() for listed in lists))]
    if not (count := sum(totals)):
        return None
    tiles, splats, first = _integers(2 * count, device), wp.empty(count, dtype=Splat, device=device), 0
    for some, listed, total in zip(seen, lists, totals, strict=True):
        if total:
            part = slice(first, first + total)
            listed.tiles, listed.splats = tiles[part], splats[part]
            launcher.rows(
                kernel, listed.counts.shape, {**known, **some._asdict(), "listed": listed}, tile_rows=CELL_ROWS
            )
        first += total
    return {"splats": splats, **_sorted(launcher, tiles, count, resolution)}


def _integers(count: int, device: str) -> wp.array:
    return wp.empty(count, dtype=int, device=device)


def _sorted(launcher: Launcher, tiles: wp.array, count: int, resolution: tuple[int, int]) -> dict[str, wp.array]:
    """The order of splats by their tiles, and where each tile begins in it; sorting keeps the order within a tile."""
    order = _integers(2 * count, launcher.device)
    launcher.upload(np.arange(2 * count, dtype=np.int32), order)
    wp.utils.radix_sort_pairs(tiles, order, count)
    across, down = (-(-side // TILE) for side in resolution)
    starts = _integers(across * down + 1, launcher.device)
    launcher.run(find_tiles, starts.shape, {"tiles": tiles, "count": count, "starts": starts})
    return {"order": order, "starts": starts}
