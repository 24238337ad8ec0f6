"""Launching kernels: compiled once, at once on a GPU, in tiles of rows from a thread pool on the CPU.

What a host decides while it renders follows from what a GPU has computed. Functions that need such numbers are `Steps`:
they give up control until the numbers are there, and another frame's can go on meanwhile.
"""

import os
import time
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from functools import cached_property
from typing import TypeVar

import numpy as np
import warp as wp

from varos_warp.kernels.conventions import BLOCK_DIM

TILE_ROWS = 8
"""Rows of a CPU tile: enough tiles to keep every core busy to the end."""


KEPT_BYTES = 4 << 30
"""Free memory that a GPU keeps for the next arrays; without, all of it is given back whenever the GPU is waited for."""

T = TypeVar("T")
Steps = Generator[wp.Event, None, T]
"""Work that gives the event to wait for whenever it needs to; what it returns in the end is a T."""


def finish(steps: Steps[T], turn: Callable[[], AbstractContextManager] = nullcontext) -> T:
    """Do all steps.

    Args:
        steps: The work.
        turn: Makes what is held during every step, and not while the device is waited for: Warp's functions are not for
            several threads at once.
    """
    while True:
        with turn():
            try:
                event = next(steps)
            except StopIteration as end:
                return end.value
        wp.synchronize_event(event)


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
        if device != "cpu" and wp.is_mempool_enabled(device):
            wp.set_mempool_release_threshold(device, KEPT_BYTES)

    def load(self, kernel):
        """Compile a kernel before threads need it, and count the time apart."""
        if kernel not in self._loaded:
            start = time.perf_counter()
            # the block size is part of a binary's identity, and a CPU launch always has 1
            kernel.module.load(self.device, block_dim=1 if self.device == "cpu" else BLOCK_DIM)
            self.compile_seconds += time.perf_counter() - start
            self._loaded.add(kernel)

    def fetch(self, *arrays: wp.array) -> Steps[list[np.ndarray]]:
        """Arrays on the host, once the device has filled them."""
        if self.device == "cpu":
            return [array.numpy() for array in arrays]
        yield wp.get_stream(self.device).record_event()
        # on a stream of their own, or they would wait for all that was launched since
        on_host = [wp.empty(array.shape, dtype=array.dtype, device="cpu") for array in arrays]
        for array, copy in zip(arrays, on_host, strict=True):
            wp.copy(copy, array, stream=self._copies)
        wp.synchronize_stream(self._copies)
        return [copy.numpy() for copy in on_host]

    def upload(self, values: np.ndarray | int, array: wp.array):
        """Fill an array that nothing launched still needs, and that was there at the last `fetch` or before.

        The host does not wait for what was launched before.
        """
        if np.ndim(values) == 0:
            array.fill_(values)
            return
        on_host = wp.array(values, dtype=array.dtype, device="cpu")
        if self.device == "cpu":
            wp.copy(array, on_host)
        else:
            wp.copy(array, on_host, stream=self._copies)
            wp.synchronize_stream(self._copies)

    @cached_property
    def _copies(self) -> wp.Stream:
        return wp.Stream(self.device)

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
