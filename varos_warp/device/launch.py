"""Launching kernels: at once on a GPU, in tiles of rows from a thread pool on the CPU.

A CPU launch is serial and lets go of Python's lock, so that threads share the work.
"""

import contextlib
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, TypeVar

import warp as wp

from varos_warp.device.compile import block_dim, load_kernel
from varos_warp.device.devices import usable_cores

T, R = TypeVar("T"), TypeVar("R")
TILE_ROWS = 8
"""Rows of a CPU tile: enough tiles to keep every core busy to the end."""
CHUNK = 1 << 15
"""Threads of a CPU tile where there is one dimension; the cost of a launch is negligible beside them."""


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


def launch_rows(
    kernel: wp.Kernel,
    dim,
    arguments: Mapping[str, Any],
    device: str,
    *,
    rows: int = TILE_ROWS,
    threads: int | None = None,
) -> None:
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

    starts = range(0, dim[0], rows)
    if len(starts) == 1:  # a thread would take longer to start than most single tiles to run
        wp.launch(kernel, dim=dim, device=device, inputs=inputs)
        return

    def tile(row):
        wp.launch(
            kernel,
            dim=(min(rows, dim[0] - row), *dim[1:]),
            device=device,
            inputs=[*inputs[:at], row, *inputs[at + 1 :]],
        )

    in_threads(tile, starts, threads)


class _Gate:
    """A ``with`` statement that ends when all threads that have passed are back; none passes any more then.

    Else, after an interruption, threads would go on with memory that is given back.
    """

    def __init__(self):
        self._change, self._inside, self._is_open = threading.Condition(), 0, True

    @contextlib.contextmanager
    def passed(self) -> Iterator[bool]:
        """Enter the gate for what a thread does inside; yields whether it is open."""
        with self._change:
            is_open = self._is_open
            self._inside += is_open
        try:
            yield is_open
        finally:
            with self._change:
                self._inside -= is_open
                self._change.notify_all()

    def close(self) -> None:
        """Let no thread in any more."""
        with self._change:
            self._is_open = False

    def __enter__(self) -> "_Gate":
        return self

    def __exit__(self, *_) -> None:
        self.close()
        with self._change:
            self._change.wait_for(lambda: self._inside == 0)


def launch(kernel: wp.Kernel, count: int, arguments: Mapping[str, Any], device: str) -> None:
    """Run ``count`` threads of a kernel that takes the number of its first as `FIRST_ROW`."""
    if count:
        launch_rows(kernel, (count,), arguments, device, rows=CHUNK)


def tiles_of(count: int, size: int | None = None) -> list[slice]:
    """Slices of ``count`` things, ``size`` long at most (absent: `CHUNK`) and all about as long.

    The number of threads does not change them.
    """
    number = -(-count // (size or CHUNK))
    return [slice(count * i // number, count * (i + 1) // number) for i in range(number)]


@cache
def _helpers() -> ThreadPoolExecutor:
    """The threads that help whoever has work to share, as many as cores for the whole process."""
    return ThreadPoolExecutor(usable_cores(), "helper")


def in_threads(function: Callable[[T], R], some: Sequence[T], threads: int | None = None) -> list[R]:
    """What a function of Warp's or numpy's, which let go of Python's lock, makes of some things, in their order.

    The caller works itself and `_helpers` join it as they are free. So calls within calls neither wait for each other
    nor start threads of their own.

    Args:
        function: Called once for each.
        some: The things.
        threads: At most so many, the caller among them; absent: all cores that the process may use.
    """
    gate, left, made, failed = _Gate(), iter(range(len(some))), {}, {}

    def work():
        for i in left:  # which gives each number to one thread
            with gate.passed() as is_open:
                if not is_open:
                    return
                try:
                    made[i] = function(some[i])
                except Exception as error:
                    failed[i] = error
                    gate.close()

    with gate:
        helping = [_helpers().submit(work) for _ in range(min(threads or usable_cores(), len(some)) - 1)]
        work()
        for helper in helping:
            if not helper.cancel():
                helper.result()
    if failed:
        raise failed[min(failed)]  # what comes before it has all begun, so it is the same whichever thread was faster
    return [made[i] for i in range(len(some))]


def in_tiles(function: Callable[[slice], None], count: int, size: int | None = None) -> None:
    """Call a function of numpy's for slices of ``count`` things, in threads."""
    in_threads(function, tiles_of(count, size))
