"""Launches on a CPU, by several threads."""

import threading
import time

import pytest
import warp as wp

from varos_warp.device import launch


@wp.kernel(enable_backward=False)
def mark(first_row: int, done: wp.array(dtype=int)):
    done[first_row + wp.tid()] = 1


@pytest.mark.parametrize(("given", "words"), [
    ({}, r"misses the arguments \['done'\]"), ({"done": None, "dome": 1}, r"no parameters \['dome'\]")])
def test_arguments_that_a_kernel_does_not_take_are_told_before_it_runs(given, words):
    with pytest.raises(TypeError, match=words):
        launch.launch_rows(mark, (64,), given, "cpu")


def test_when_an_interrupted_launch_ends_none_of_its_threads_is_at_work_any_more(monkeypatch):
    """As with Ctrl-C while the second thread starts, which its pool does not know then."""
    done, started, under_way = wp.zeros(64, dtype=int, device="cpu"), [], []
    start, launched = threading.Thread.start, wp.launch

    def interrupted(thread):
        start(thread)
        started.append(thread)
        if len(started) == 2:
            while not under_way:
                time.sleep(0.001)
            raise KeyboardInterrupt

    def slowly(*args, **how):
        under_way.append("begun")
        time.sleep(0.1)
        launched(*args, **how)
        under_way.append("done")

    monkeypatch.setattr(threading.Thread, "start", interrupted)
    monkeypatch.setattr(wp, "launch", slowly)
    with pytest.raises(KeyboardInterrupt):
        launch.launch_rows(mark, (64,), {"done": done}, "cpu", rows=1, threads=2)
    begun, finished = under_way.count("begun"), under_way.count("done")
    assert 0 < begun == finished
    time.sleep(0.3)
    assert under_way.count("begun") == begun
