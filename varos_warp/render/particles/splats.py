"""Lists of splats: those of all cells that a camera may see, sorted by the tiles of the image."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from varos_warp.device.launcher import Launcher
from varos_warp.kernels.particles.bodies import Cells
from varos_warp.kernels.particles.bodies import Particles as ParticleData
from varos_warp.kernels.particles.draw import Cone, count_bodies
from varos_warp.kernels.particles.gather import find_tiles
from varos_warp.kernels.particles.splat import TILE, Splat, SplatList
from varos_warp.render.particles.cells import cells_of, cone_of, field_of, size_classes, slack_of
from varos_warp.render.particles.exposure import Open, View
from varos_warp.scene.water.particles import ParticleLaw

ROWS = 1 << 13
"""Cells or bodies that a CPU's thread visits at a time."""


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
        kernel: Counts or lists the splats of bodies.
        known: Its arguments that are the same for all cells.
        seen: The cells.
        resolution: Width and height of the image.
    """
    device, lists = launcher.device, []
    for some, count in zip(seen, _count(launcher, seen), strict=True):
        listed = SplatList()
        listed.counts, listed.ends, listed.tiles = _integers(count, device), _integers(0, device), _integers(0, device)
        listed.splats = wp.empty(0, dtype=Splat, device=device)
        arguments = {**known, **some._asdict(), "listed": listed}
        launcher.rows(kernel, (count,), arguments, tile_rows=ROWS)
        listed.ends = _ends(listed.counts)
        lists.append((listed, arguments))
    totals = _totals(launcher, [listed.ends for listed, _ in lists])
    if not (count := sum(totals)):
        return None
    tiles, splats, first = _integers(2 * count, device), wp.empty(count, dtype=Splat, device=device), 0
    for (listed, arguments), total in zip(lists, totals, strict=True):
        if total:
            part = slice(first, first + total)
            listed.tiles, listed.splats = tiles[part], splats[part]
            launcher.rows(kernel, listed.counts.shape, arguments, tile_rows=ROWS)
        first += total
    return {"splats": splats, **_sorted(launcher, tiles, count, resolution)}


def _count(launcher: Launcher, seen: Sequence[Seen]) -> list[int]:
    """How many bodies there are of each class; cells then know where theirs end."""
    for some in seen:
        counts = _integers(int(np.prod(some.cells.size)), launcher.device)
        launcher.rows(count_bodies, counts.shape, {**some._asdict(), "counts": counts}, tile_rows=ROWS)
        some.cells.ends = _ends(counts)
    return _totals(launcher, [some.cells.ends for some in seen])


def _ends(counts: wp.array) -> wp.array:
    """Sums of counts up to each."""
    ends = wp.empty_like(counts)
    if len(counts):
        wp.utils.array_scan(counts, ends, inclusive=True)
    return ends


def _totals(launcher: Launcher, ends: Sequence[wp.array]) -> list[int]:
    """The last of each list, 0 of an empty one."""
    last = iter(launcher.fetch(*(each[-1:].contiguous() for each in ends if len(each))))
    return [int(next(last)[0]) if len(each) else 0 for each in ends]


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
