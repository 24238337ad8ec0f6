"""Launching kernels: compiled once, at once on a GPU, in tiles of rows from a thread pool on the CPU."""

import os
import time
from concurrent.futures import ThreadPoolExecutor

import warp as wp

from varos_warp.kernels.conventions import BLOCK_DIM

TILE_ROWS = 8
"""Rows of a CPU tile: enough tiles to keep every core busy to the end."""


def usable_cores() -> int:
    """Cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Launcher:
    """Runs kernels on one device.

    Args:
        device: ``cpu`` or ``cuda:N``.
        threads: CPU threads; absent: all that the process may use. Does not change a byte of any result.
    """

    def __init__(self, device: str, threads: int | None = None):
        self.device = device
        self.threads = threads or usable_cores()
        self.compile_seconds = 0.0
        self._loaded: set = set()

    def load(self, kernel):
        """Compile a kernel before threads need it, and count the time apart."""
        if kernel not in self._loaded:
            start = time.perf_counter()
            # the block size is part of a binary's identity, and a CPU launch always has 1
            kernel.module.load(self.device, block_dim=1 if self.device == "cpu" else BLOCK_DIM)
            self.compile_seconds += time.perf_counter() - start
            self._loaded.add(kernel)

    def run(self, kernel, dim, inputs, outputs):
        """Run a kernel as a whole."""
        self.load(kernel)
        wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=self.device, block_dim=BLOCK_DIM)

    def rows(self, kernel, dim, before, after, tile_rows: int | None = None):
        """Run a kernel over rows ``dim[0]``, which takes the first row of its tile between ``before`` and ``after``."""
        if self.device != "cpu":
            self.run(kernel, dim, [*before, 0, *after], [])
            return
        self.load(kernel)
        tile_rows = tile_rows or TILE_ROWS

        def tile(row):
            rows = min(tile_rows, dim[0] - row)
            wp.launch(kernel, dim=(rows, *dim[1:]), inputs=[*before, row, *after], device="cpu")

        starts = range(0, dim[0], tile_rows)
        if self.threads == 1:
            for row in starts:
                tile(row)
            return
        with ThreadPoolExecutor(self.threads) as pool:
            list(pool.map(tile, starts))
