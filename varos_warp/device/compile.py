"""Compiling kernels: when a launch needs one, or ahead in threads while something else goes on."""

import contextlib
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import warp as wp

from varos_warp.device.devices import usable_cores
from varos_warp.kernels.conventions import BLOCK_DIM

CORES_TO_COMPILE = 2
"""Cores to a thread that compiles: code is generated in Python, under locks that what goes on meanwhile needs, too."""
_loading: dict[tuple[wp.Module, str], threading.Lock] = {}
"""Held by whoever loads a module on a device: Warp would compile it in each of several threads."""


def block_dim(kernel: wp.Kernel) -> int:
    """Threads per block of a kernel on a GPU."""
    bounds = kernel.options.get("launch_bounds")
    return bounds[0] if bounds else BLOCK_DIM


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
    if device != "cpu":
        wp.empty(1, dtype=wp.int32, device=device)  # makes the context here: Warp lets several threads make it at once
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
