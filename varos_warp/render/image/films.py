"""Films: the sums of an image's samples, on the device, and taking more of them.

Pixels may want very unlike numbers of samples. So they are taken in batches, lists of which are made anew whenever
samples are taken, and the sums of the batches are added up in a fixed order: neither the number of threads nor the size
of the lists changes a byte.
"""

import functools
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from varos_warp.device.devices import kind_of
from varos_warp.device.launcher import Launcher
from varos_warp.kernels.conventions import RESIDENT_THREADS
from varos_warp.kernels.film.adapt import average_tiles, pixel_statistics
from varos_warp.kernels.film.film import (
    BLOCK,
    IN_BLOCK,
    SUMS,
    TILE,
    Batch,
    Film,
    add_batches,
    count_batches,
    list_batches,
    note_samples,
    weigh_batches,
)

MOST_SAMPLES = {"cpu": 256, "cuda": 4}
"""Most samples of a batch, by kind of device: threads side by side of a GPU then take about equally many."""
GPU_THREADS = 1 << 19
"""Threads that fill a large GPU: batches are smaller where there would be fewer of them."""
MOST_BATCHES = {"cpu": 1 << 16, "cuda": 1 << 22}
"""Batches at a time; each takes up to 160 bytes. At the end of each lot a GPU is less than full, and all pixels are
visited."""
PIXEL_TILE = 1 << 16
"""Pixels that a CPU's thread visits at a time."""
MOST_LISTED = 1 << 28
"""Batches are larger where there would be more of them in all: their numbers have 32 bits."""


class Films:
    """The films of one device."""

    def __init__(self, launcher: Launcher):
        self.launcher, self.device = launcher, launcher.device
        self._unused: dict[tuple, list[wp.array]] = defaultdict(list)
        """Sums by their shape: those of A serve B, too."""
        self.keeps = self.device != "cpu"
        """True if sums are kept for other images."""
        processors = wp.get_device(self.device).sm_count
        self._resident = processors * RESIDENT_THREADS if processors else MOST_LISTED
        """Threads of a path kernel that a GPU holds at once; on a CPU each takes one batch."""

    def black(self, resolution, adapts: bool = False, sums: int = SUMS, key: int = 0) -> Film:
        """A film without samples for an image of width and height, until it is given to `keep`.

        Args:
            resolution: Width and height.
            adapts: Whether tiles have two sides, see render/image/adapt.py.
            sums: Of each pixel: SUMS or CORRECTION_SUMS.
            key: Of the random numbers that tell where samples are where they are fewer than pixels.
        """
        film = Film()
        film.key = wp.uint32(key)
        unused = self._unused[sums, *resolution[::-1]]
        film.sums = unused.pop() if unused else self.buffer(sums, *resolution[::-1])
        tiles = (1 + adapts, *(-(-side // TILE) for side in resolution[::-1]))
        film.count, film.wanted = (wp.empty(tiles, dtype=int, device=self.device) for _ in "cw")
        film.lost = wp.empty(1, dtype=int, device=self.device)
        for buffer in (film.sums, film.count, film.lost):
            buffer.zero_()
        return film

    def keep(self, film: Film):
        """Take a film's sums back for another image; a CPU lets go of them, for a denoiser wants the memory."""
        if self.keeps:
            self._unused[film.sums.shape].append(film.sums)
        film.sums = None

    def buffer(self, *shape: int) -> wp.array:
        """Sums, or anything else with a float64 for each channel."""
        return wp.empty(shape, dtype=wp.vec3d, device=self.device)

    def take(
        self,
        film: Film,
        kernel: wp.Kernel,
        arguments: Mapping[str, Any],
        samples: int | np.ndarray,
        queued: bool = False,
        share: wp.array | None = None,
        before: int | np.ndarray = 0,
    ):
        """Take more samples.

        Args:
            film: The film.
            kernel: Takes the samples of ``film.batches`` from its first row on.
            arguments: All others, by the names of its parameters.
            samples: How many, of each block of IN_BLOCK pixels, or [side, tile row, tile column].
            queued: Whether its threads go on to the `next_batch`.
            share: Of the light that reaches each pixel, float64 [height, width]; None: all.
            before: How many the film has, alike.
        """
        self.launcher.upload(samples, film.wanted)
        blocks, cut = tile_blocks(film.sums.shape[1:], len(film.count))
        samples, before = (np.broadcast_to(number, film.count.shape) for number in (samples, before))
        # of the pixels of whole blocks, and of each that is cut
        of_pixels = [(samples + i) // IN_BLOCK for i in range(IN_BLOCK)]
        of_cut = -(-(before + samples) // IN_BLOCK) + before // -IN_BLOCK
        most = self._batch_size(int((samples * blocks + of_cut * cut).sum()))
        places = int(np.prod(film.count.shape[1:])) * TILE**2
        counts, ends = (wp.empty(places, dtype=int, device=self.device) for _ in "ce")  # of batches, tile by tile
        self.launcher.run(count_batches, counts.shape, {"film": film, "most": most, "counts": counts})
        wp.utils.array_scan(counts, ends, inclusive=True)
        batches_of = sum(-(-number // most) for number in of_pixels) * blocks - (-of_cut // most) * cut
        total, lot = int(batches_of.sum()), MOST_BATCHES[kind_of(self.device)]
        for begin in range(0, total, lot):
            batches = min(lot, total - begin)
            film.batches = wp.empty(batches, dtype=Batch, device=self.device)
            film.batch_sums = self.buffer(len(film.sums), batches)
            listed = {"ends": ends, "begin": begin, "film": film}
            self.launcher.rows(list_batches, ends.shape, listed, tile_rows=PIXEL_TILE)
            threads = min(batches, self._resident) if queued else batches
            film.next = wp.full(int(threads < batches), threads, dtype=int, device=self.device)
            tile_rows = int(np.clip(batches // 32, 64, 1024))
            self.launcher.rows(kernel, (threads,), {**arguments, "film": film}, tile_rows=tile_rows)
            if share is not None:
                weighed = {"share": share, "film": film}
                self.launcher.rows(weigh_batches, (len(film.sums), batches), weighed, tile_rows=1)
            self.launcher.rows(add_batches, (len(film.sums), *ends.shape), listed, tile_rows=1)
        film.batches = film.batch_sums = film.next = None
        self.launcher.run(note_samples, film.count.shape, {"film": film})

    def _batch_size(self, samples: int) -> int:
        """Most samples of a batch, where there are so many in all."""
        most = MOST_SAMPLES[kind_of(self.device)]
        if self.device != "cpu":
            most = min(most, max(1, samples // GPU_THREADS))
        return max(most, samples // MOST_LISTED)

    def tile_statistics(self, films: Sequence[Film], denoised: float = 1.0) -> tuple[wp.array, wp.array]:
        """Mean and variance of one sample, each vec3d [film, side, tile row, tile column].

        Args:
            films: Whose sum is an image.
            denoised: All but one part in so many of the correction's variance is taken away later.
        """
        of_tiles = [self.buffer(len(films), *films[0].count.shape) for _ in "mv"]
        for i, film in enumerate(films):
            mean, variance = (self.buffer(*film.sums.shape[1:]) for _ in "mv")
            pixels = {"mean": mean, "variance": variance}
            self.launcher.run(pixel_statistics, mean.shape, {"film": film, "denoised": denoised, **pixels})
            tiles = dict(zip(("mean_of_tiles", "variance_of_tiles"), (array[i] for array in of_tiles), strict=True))
            self.launcher.run(average_tiles, film.count.shape, pixels | tiles)
        return of_tiles[0], of_tiles[1]


def tile_pixels(height: int, width: int) -> np.ndarray:
    """Pixels of the tiles of an image [tile row, tile column], of which the last ones may be smaller."""
    rows, cols = (np.diff(np.minimum(TILE * np.arange(-(-side // TILE) + 1), side)) for side in (height, width))
    return np.outer(rows, cols)


@functools.lru_cache(maxsize=16)
def tile_blocks(shape: tuple[int, int], sides: int) -> tuple[np.ndarray, np.ndarray]:
    """Count whole blocks, and pixels of cut ones, for each side of each tile, [side, row, column]."""
    row, col = np.indices(shape)
    side = (row // BLOCK + col // BLOCK) % sides
    cut = (row ^ 1 >= shape[0]) | (col ^ 1 >= shape[1])
    tiles = (sides, *tile_pixels(*shape).shape)
    places = np.ravel_multi_index((side, row // TILE, col // TILE), tiles)
    whole, apart = (np.bincount(places[where], minlength=np.prod(tiles)).reshape(tiles) for where in (~cut, cut))
    return whole // IN_BLOCK, apart
