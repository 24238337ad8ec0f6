"""Kernels are compiled in threads while something else goes on, each of them once."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from varos_warp.device import compile as module
from varos_warp.device.compile import beside, compiling, load_kernel


class Module:
    """Stands in for Warp's: knows when it is loaded, but not when it is being compiled."""

    def __init__(self, error=None):
        self.error, self.compiled, self.is_loaded = error, 0, False
        self.begun, self.go = threading.Event(), threading.Event()

    def load(self, device, block_dim):
        if self.is_loaded:
            return
        self.compiled += 1
        self.begun.set()
        assert self.go.wait(60.0)
        if self.error:
            raise self.error
        self.is_loaded = True


def waiting(count, **how):
    """Kernels whose modules are not compiled before they may `go`."""
    return [SimpleNamespace(module=Module(**how)) for _ in range(count)]


def test_each_kernel_is_compiled_once_begun_or_not():
    kernels = waiting(3)
    with compiling(kernels, "cpu"), compiling(reversed(kernels), "cpu"), ThreadPoolExecutor() as pool:
        assert kernels[0].module.begun.wait(60.0)
        loading = [pool.submit(load_kernel, kernel, "cpu") for kernel in kernels]
        for kernel in kernels:
            kernel.module.go.set()
        for job in loading:
            job.result()
    assert [kernel.module.compiled for kernel in kernels] == [1, 1, 1]


def test_a_kernel_that_is_needed_does_not_wait_for_those_before_it(monkeypatch):
    """With fewer threads than kernels, the one that is needed may not have begun."""
    monkeypatch.setattr(module, "usable_cores", lambda: 2)
    *before, needed_now = waiting(3)
    needed_now.module.go.set()
    with compiling([*before, needed_now], "cpu"):
        load_kernel(needed_now, "cpu")
        assert needed_now.module.is_loaded
        assert not any(kernel.module.is_loaded for kernel in before)
    for kernel in before:
        kernel.module.go.set()


def test_nobody_waits_for_what_is_compiled_but_not_needed(monkeypatch):
    """What has begun goes on after the end, and what has not is left to those who need it."""
    monkeypatch.setattr(module, "usable_cores", lambda: 2)
    kernels = waiting(3)
    with compiling(kernels, "cpu"):
        assert all(kernel.module.begun.wait(60.0) for kernel in kernels[:2])
    for kernel in kernels:
        kernel.module.go.set()
    for kernel in kernels:
        load_kernel(kernel, "cpu")
    assert [kernel.module.compiled for kernel in kernels] == [1, 1, 1]


def test_an_error_does_not_wait_for_what_goes_on_beside():
    go, begun = threading.Event(), time.monotonic()
    with pytest.raises(ZeroDivisionError), beside(go.wait, 60.0):
        raise ZeroDivisionError
    assert time.monotonic() - begun < 30.0
    go.set()
    with beside(max, 3, 4) as larger:
        assert larger.result() == 4


def test_what_a_thread_failed_to_compile_is_tried_again_where_it_is_needed():
    (kernel,) = waiting(1, error=RuntimeError("no compiler"))
    kernel.module.go.set()
    with compiling([kernel], "cpu"):
        assert kernel.module.begun.wait(60.0)
        with pytest.raises(RuntimeError, match="no compiler"):
            load_kernel(kernel, "cpu")
