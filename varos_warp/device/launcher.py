"""Launching kernels for frames: compiled once, results fetched while the host goes on.

What a host decides while it renders follows from what a GPU has computed. Threads that render take turns: one that
waits for such numbers, or works on them without the device, lets another use the device (`Launcher.aside`).
"""

import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
import warp as wp

from varos_warp.device.compile import block_dim, load_kernel
from varos_warp.device.devices import kind_of, usable_cores
from varos_warp.device.launch import TILE_ROWS, in_order, launch_rows

AT_ONCE = {"cpu": 1, "cuda": 4}
"""Images under way on a device, by its kind: a GPU works on one while the host decides for others, or copies them."""
KEPT_BYTES = 4 << 30
"""Free memory that a GPU keeps for the next arrays; without, all of it is given back whenever the GPU is waited for."""

T = TypeVar("T")


def at_once(device: str, function: Callable[..., T], *items: Iterable) -> Iterator[T]:
    """``map`` for functions that render, with as many threads as images may be under way."""
    count = AT_ONCE[kind_of(device)]
    if count == 1:
        yield from map(function, *items)
        return
    with ThreadPoolExecutor(count, "render") as pool:
        yield from pool.map(function, *items)


def timed(renderer: Any, make: Callable[[], T]) -> tuple[T, float]:
    """What is made, and the seconds that it took, without those of compiling (``compile_seconds`` of the renderer)."""
    start, compiled = time.perf_counter(), renderer.compile_seconds
    made = make()
    return made, time.perf_counter() - start - (renderer.compile_seconds - compiled)


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
        self.turn = threading.Lock()
        """Held by the thread that uses the device: Warp's functions are not for several at once."""
        self._loaded: set = set()
        self._unused: dict[tuple, list[tuple[wp.array, wp.Event | None]]] = defaultdict(list)
        """Pinned memory by shape and type, with the event after which it may be used."""
        if device != "cpu" and wp.is_mempool_enabled(device):
            wp.set_mempool_release_threshold(device, KEPT_BYTES)

    def load(self, kernel: wp.Kernel) -> None:
        """Compile a kernel before threads need it, and count the time apart."""
        if kernel not in self._loaded:
            start = time.perf_counter()
            load_kernel(kernel, self.device)
            self.compile_seconds += time.perf_counter() - start
            self._loaded.add(kernel)

    @contextmanager
    def aside(self) -> Iterator[None]:
        """A ``with`` statement, within ``turn``, that waits for the device or does without it: others may use it.

        Hold no lock across it that another frame may ask for: that one has the turn then.
        """
        self.turn.release()
        try:
            yield
        finally:
            self.turn.acquire()

    @contextmanager
    def meanwhile(self, make: Callable[[], T]) -> Iterator[Callable[[], T]]:
        """A ``with`` statement, within ``turn``, during which a thread uses the device whenever this one is `aside`.

        Yields a function that waits for what the thread makes, and returns it.
        """

        def made_in_turn() -> T:
            with self.turn:
                return make()

        def waited_for() -> T:
            with self.aside():
                return made.result()

        pool = ThreadPoolExecutor(1, "meanwhile")
        made = pool.submit(made_in_turn)
        try:
            yield waited_for
        finally:
            with self.aside():
                pool.shutdown(cancel_futures=True)

    def fetch(self, *arrays: wp.array) -> list[np.ndarray]:
        """Arrays on the host, once the device has filled them; others may use a GPU until then (`aside`)."""
        if self.device == "cpu":
            return [array.numpy() for array in arrays]
        # through pinned memory, or the host would wait here for all that was launched
        staged = [self._pinned(array) for array in arrays]
        for array, copy in zip(arrays, staged, strict=True):
            wp.copy(copy, array)
        done, views = wp.get_stream(self.device).record_event(), [copy.numpy() for copy in staged]
        with self.aside():
            wp.synchronize_event(done)
            on_host = [view.copy() for view in views]  # many megabytes
        for copy in staged:
            self._unused[copy.shape, copy.dtype].append((copy, None))
        return on_host

    def upload(self, values: np.ndarray | int, array: wp.array):
        """Fill an array; the host does not wait for it, nor for what was launched before."""
        if np.ndim(values) == 0:
            array.fill_(values)
        elif self.device == "cpu":
            array.assign(values)
        else:
            staged = self._pinned(array)
            staged.numpy()[...] = values
            wp.copy(array, staged)
            self._unused[staged.shape, staged.dtype].append((staged, wp.get_stream(self.device).record_event()))

    def _pinned(self, like: wp.array) -> wp.array:
        """Pinned memory of the host for an array, which nothing uses: making some takes longer than filling it."""
        unused = self._unused[like.shape, like.dtype]
        for i, (_, event) in enumerate(unused):
            if event is None or event.is_complete:
                return unused.pop(i)[0]
        return wp.empty(like.shape, dtype=like.dtype, device="cpu", pinned=True)

    def run(self, kernel: wp.Kernel, dim, arguments: Mapping[str, Any]):
        """Run a kernel as a whole; arguments by the names of its parameters."""
        self.load(kernel)
        wp.launch(kernel, dim=dim, inputs=in_order(kernel, arguments), device=self.device, block_dim=block_dim(kernel))

    def blocks(self, kernel: wp.Kernel, dim, arguments: Mapping[str, Any]):
        """Run a kernel whose threads work in blocks, ``dim`` of them; a block of a CPU is one thread."""
        self.load(kernel)
        inputs = in_order(kernel, arguments)
        wp.launch_tiled(kernel, dim=dim, inputs=inputs, device=self.device, block_dim=block_dim(kernel))

    def rows(self, kernel: wp.Kernel, dim, arguments: Mapping[str, Any], tile_rows: int | None = None):
        """Run a kernel over rows ``dim[0]``, in tiles on a CPU: `launch_rows`."""
        self.load(kernel)
        launch_rows(kernel, dim, arguments, self.device, rows=tile_rows or TILE_ROWS, threads=self.threads)
