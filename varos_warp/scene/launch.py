"""Launching kernels: at once on a GPU, in tiles of rows from a thread pool on the CPU.

A CPU launch is serial and lets go of Python's lock, so that threads share the work.
"""

import contextlib
import ctypes
import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
import warp as wp

from varos_warp.kernels.conventions import BLOCK_DIM

wp.config.log_level = wp.LOG_WARNING  # no banner, no line per compiled module


def _has_cuda_driver() -> bool:
    """Whether Warp will find a CUDA driver, by the names that it looks for."""
    for name in ("nvcuda.dll",) if sys.platform == "win32" else ("libcuda.so", "libcuda.so.1"):
        with contextlib.suppress(OSError):
            ctypes.CDLL(name)
            return True
    return False


@contextlib.contextmanager
def _without_stderr() -> Iterator[None]:
    """Drops what native code writes to stderr."""
    if sys.stderr is not None:
        sys.stderr.flush()
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


if not _has_cuda_driver():  # Warp warns of that in native code, though a machine without a GPU is no mistake
    with contextlib.suppress(OSError), _without_stderr():  # closed by whoever started this: nothing to keep clean
        wp.init()

TILE_ROWS = 8
"""Rows of a CPU tile: enough tiles to keep every core busy to the end."""
CHUNK = 1 << 15
"""Threads of a CPU launch over one dimension, likewise; the cost of a launch is negligible beside them."""


def usable_cores() -> int:
    """Cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def block_dim(kernel: wp.Kernel) -> int:
    """Threads per block of a kernel on a GPU."""
    bounds = kernel.options.get("launch_bounds")
    return bounds[0] if bounds else BLOCK_DIM


CORES_TO_COMPILE = 2
"""Cores to a thread that compiles: code is generated in Python, under locks that what goes on meanwhile needs, too."""
_loading: dict[tuple[wp.Module, str], threading.Lock] = {}
"""Held by whoever loads a module on a device: Warp would compile it in each of several threads."""


def load_kernel(kernel: wp.Kernel, device: str) -> None:
    """Compile a kernel before threads need it, or wait for the thread that is at it."""
    with _loading.setdefault((kernel.module, device), threading.Lock()):
        # the block size is part of a binary's identity
        kernel.module.load(device, block_dim=1 if device == "cpu" else block_dim(kernel))


@contextlib.contextmanager
def compiling(kernels: Iterable[wp.Kernel], device: str) -> Iterator[None]:
    """A ``with`` statement during which threads compile kernels, each module once.

    What has not begun at its end is compiled when it is needed; what has begun goes on.
    """
    with _threads(max(2, usable_cores() // CORES_TO_COMPILE)) as pool:
        for kernel in kernels:
            pool.submit(load_kernel, kernel, device)
        yield


@contextlib.contextmanager
def beside(function: Callable[..., Any], *arguments) -> Iterator[Future]:
    """A ``with`` statement during which a thread calls a function; an error or interruption does not wait for it."""
    with _threads(1) as pool:
        yield pool.submit(function, *arguments)


@contextlib.contextmanager
def _threads(count: int) -> Iterator[ThreadPoolExecutor]:
    """Threads that nobody waits for at the end; what they have not begun they do not begin."""
    pool = ThreadPoolExecutor(count, "unawaited")  # by this name the command line knows that it need not wait
    try:
        yield pool
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


FIRST_ROW = "first_row"
"""Parameter of kernels that run in tiles: the first row of the tile, or its first thread where there is one dimension.
"""


def in_order(kernel: wp.Kernel, arguments: Mapping[str, Any]) -> list:
    """Arguments of a kernel in the order of its parameters.

    Raises:
        TypeError: One is missing, or the kernel has no parameter of that name.
    """
    names = [parameter.label for parameter in kernel.adj.args]
    if {*names} != {*arguments}:
        missing, unknown = sorted({*names} - {*arguments}), sorted({*arguments} - {*names})
        raise TypeError(f"{kernel.key} misses the arguments {missing} and has no parameters {unknown}")
    return [arguments[name] for name in names]


def launch_rows(kernel: wp.Kernel, dim, arguments: Mapping[str, Any], device: str, *, rows: int = TILE_ROWS,
                threads: int | None = None) -> None:
    """Run a kernel that takes the first row of its tile as `FIRST_ROW`.

    Args:
        kernel: The kernel.
        dim: Threads; ``dim[0]`` are the rows.
        arguments: All others, by the names of its parameters.
        device: ``cpu`` or ``cuda:N``.
        rows: Of a tile on the CPU.
        threads: On the CPU; absent: all cores that the process may use. Does not change a byte of any result.
    """
    inputs = in_order(kernel, {**arguments, FIRST_ROW: 0})
    at = next(i for i, parameter in enumerate(kernel.adj.args) if parameter.label == FIRST_ROW)
    load_kernel(kernel, device)
    if device != "cpu":
        wp.launch(kernel, dim=dim, inputs=inputs, device=device, block_dim=block_dim(kernel))
        return

    gate = _Gate()

    def tile(row):
        with gate.passed() as is_open:
            if is_open:
                wp.launch(kernel, dim=(min(rows, dim[0] - row), *dim[1:]), device=device,
                          inputs=[*inputs[:at], row, *inputs[at + 1:]])

    with ThreadPoolExecutor(threads or usable_cores()) as pool, gate:
        list(pool.map(tile, range(0, dim[0], rows)))


class _Gate:
    """A ``with`` statement that ends when all threads that have passed are back; none passes any more then.

    A pool knows no thread in whose start it was interrupted: that would go on with memory that is given back.
    """

    def __init__(self):
        self._change, self._inside, self._is_open = threading.Condition(), 0, True

    @contextlib.contextmanager
    def passed(self) -> Iterator[bool]:
        """For what a thread does inside, if the gate is open."""
        with self._change:
            is_open = self._is_open
            self._inside += is_open
        try:
            yield is_open
        finally:
            with self._change:
                self._inside -= is_open
                self._change.notify_all()

    def __enter__(self) -> "_Gate":
        return self

    def __exit__(self, *_) -> None:
        with self._change:
            self._is_open = False
            self._change.wait_for(lambda: self._inside == 0)


def launch(kernel: wp.Kernel, count: int, arguments: Mapping[str, Any], device: str) -> None:
    """Run ``count`` threads of a kernel that takes the number of its first as `FIRST_ROW`."""
    if count:
        launch_rows(kernel, (count,), arguments, device, rows=CHUNK)


def upload(array: np.ndarray, dtype, device: str) -> wp.array:
    """An array on the device; on a CPU the array itself, where it is laid out alike."""
    return wp.array(np.ascontiguousarray(array), dtype=dtype, device=device, copy=False)
