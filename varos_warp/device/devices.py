"""Which devices there are, and arrays on them."""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator

import numpy as np
import warp as wp

from varos_warp.errors import InputError

wp.config.log_level = wp.LOG_WARNING  # no banner, no line per compiled module


def _has_cuda_driver() -> bool:
    """Return whether Warp will find a CUDA driver, by the names that it looks for."""
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


def resolve_device(name: str = "auto") -> str:
    """``auto`` is the first CUDA device, else the CPU; an unknown name is an InputError."""
    known = [str(device) for device in wp.get_devices()]
    if name == "auto":
        return next((device for device in known if device.startswith("cuda")), "cpu")
    found = "cuda:0" if name == "cuda" else name
    if found not in known:
        raise InputError(
            "no such device here", key="--device", value=name, remedy=f"Use auto or one of: {', '.join(known)}."
        )
    return found


def kind_of(device: str) -> str:
    """``cpu`` or ``cuda``."""
    return device.split(":", maxsplit=1)[0]


def usable_cores() -> int:
    """Cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def upload(array: np.ndarray, dtype, device: str) -> wp.array:
    """An array on the device; on a CPU the array itself, where it is laid out alike."""
    return wp.array(np.ascontiguousarray(array), dtype=dtype, device=device, copy=False)
