"""Launches on a CPU, by several threads."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
import warp as wp

from varos_warp.device import launch


@wp.kernel(enable_backward=False)
def mark(first_row: int, done: wp.array(dtype=int)):
    done[first_row + wp.tid()] = 1


@pytest.mark.parametrize(
    ("given", "words"),
    [({}, r"misses the arguments \['done'\]"), ({"done": None, "dome": 1}, r"no parameters \['dome'\]")],
)
def test_arguments_that_a_kernel_does_not_take_are_told_before_it_runs(given, words):
    with pytest.raises(TypeError, match=words):
        launch.launch_rows(mark, (64,), given, "cpu")


def test_when_an_interrupted_launch_ends_none_of_its_threads_is_at_work_any_more(monkeypatch):
    """As with Ctrl-C while the second thread starts, which its pool does not know then."""
    helpers = ThreadPoolExecutor(2)
    monkeypatch.setattr(launch, "_helpers", lambda: helpers)
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
        launch.launch_rows(mark, (64,), {"done": done}, "cpu", rows=1, threads=3)
    begun, finished = under_way.count("begun"), under_way.count("done")
    assert 0 < begun == finished
    time.sleep(0.3)
    assert under_way.count("begun") == begun


@pytest.mark.parametrize("count", [0, 1, 8, 9, 1000])
def test_tiles_cover_everything_once_and_are_about_as_long(count):
    tiles = launch.tiles_of(count, 8)
    assert [i for tile in tiles for i in range(tile.start, tile.stop)] == list(range(count))
    lengths = [tile.stop - tile.start for tile in tiles]
    assert max(lengths, default=0) <= 8
    assert max(lengths, default=0) - min(lengths, default=0) <= 1


def test_what_fails_in_a_tile_is_told():
    def fail(tile):
        if tile.start:
            raise ValueError("the second tile")

    with pytest.raises(ValueError, match="the second tile"):
        launch.in_tiles(fail, 16, 8)


def test_calls_within_calls_start_no_more_threads_than_cores(monkeypatch):
    helpers, at_work = ThreadPoolExecutor(3), set()
    monkeypatch.setattr(launch, "_helpers", lambda: helpers)
    monkeypatch.setattr(launch, "usable_cores", lambda: 3)

    def leaf(value):
        at_work.add(threading.get_ident())
        time.sleep(0.002)
        return value

    def branch(value, depth):
        if depth == 0:
            return leaf(value)
        return launch.in_threads(lambda i: branch(10 * value + i, depth - 1), range(4))

    found = branch(0, 3)
    assert found == [[[100 * i + 10 * j + k for k in range(4)] for j in range(4)] for i in range(4)]
    assert 1 < len(at_work) <= 3 + 1  # and whoever called


def test_what_is_left_of_a_failed_call_is_not_begun(monkeypatch):
    monkeypatch.setattr(launch, "usable_cores", lambda: 1)
    begun = []

    def fail(i):
        begun.append(i)
        raise ValueError(i)

    with pytest.raises(ValueError, match="0"):
        launch.in_threads(fail, range(5))
    assert begun == [0]


def test_an_error_in_any_thread_ends_a_call_and_the_first_of_them_is_told():
    done, started = [], threading.Barrier(2)

    def make(i):
        if i < 2:
            started.wait(10.0)
            time.sleep(0.05 * (1 - i))  # the later one fails first
            raise ValueError(str(i))
        time.sleep(0.02)
        done.append(i)

    with pytest.raises(ValueError, match="0"):
        launch.in_threads(make, range(200), threads=2)
    assert len(done) < 100
