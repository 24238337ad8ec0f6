"""One run at a time in a folder, or shards of one; a run that was killed keeps nobody out."""

import os
import random
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from filelock import FileLock

from varos_warp.dataset.write.folder import claimed, planning, sweep
from varos_warp.errors import InputError


def hidden(root):
    return [path for path in root.rglob("*") if path.name.startswith(".")]


def test_a_second_run_is_refused_naming_the_first(tmp_path):
    with claimed(tmp_path):
        with (
            pytest.raises(InputError, match=rf"another run is writing to this folder: process {os.getpid()} on"),
            claimed(tmp_path),
        ):
            pass
        with pytest.raises(InputError, match="another run"), claimed(tmp_path, (0, 2)):
            pass
    assert not hidden(tmp_path)


def test_shards_of_one_division_work_beside_each_other(tmp_path):
    with claimed(tmp_path, (0, 3)), claimed(tmp_path, (2, 3)):
        for other in ((0, 3), (2, 3), (1, 2), (0, 1)):
            with pytest.raises(InputError, match=r"shard \d/3, since \d{4}-.*--shard I/N"), claimed(tmp_path, other):
                pass
        with claimed(tmp_path, (1, 3)):
            pass
    assert not hidden(tmp_path)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_process_keeps_others_out_until_it_is_killed(tmp_path):
    code = (
        "import sys, time; from pathlib import Path; from varos_warp.dataset.write.folder import claimed\n"
        "with claimed(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code, tmp_path], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "held\n"
        with pytest.raises(InputError, match=f"process {process.pid} on"), claimed(tmp_path):
            pass
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
    assert hidden(tmp_path)
    with claimed(tmp_path):
        sweep(tmp_path)
    assert not hidden(tmp_path)


def test_leftovers_go_by_the_lock_of_their_owner_alone(tmp_path):
    """Of whatever host: a lock that nobody holds gives its process's files free; without one, they stay."""
    lock, left = tmp_path / ".run.other.123-0.0of1.lock", tmp_path / "a" / ".a.png.other-123-7.tmp"
    unknown = tmp_path / ".b.png.other-124-0.tmp"
    left.parent.mkdir()
    for path in (left, unknown, lock):
        path.touch()
    with FileLock(lock):
        sweep(tmp_path)
        assert left.exists()
        assert lock.exists()
    sweep(tmp_path)
    assert hidden(tmp_path) == [unknown]


def test_the_folder_is_free_after_a_failure_within(tmp_path):
    with pytest.raises(ZeroDivisionError), claimed(tmp_path / "new"):
        raise ZeroDivisionError
    assert not hidden(tmp_path)
    with claimed(tmp_path / "new"):
        pass


def test_never_are_two_in_the_folder_however_many_try_at_once(tmp_path):
    inside, outcomes = [], []

    def attempt(number):
        rng = random.Random(number)
        for _ in range(30):
            try:
                with claimed(tmp_path / "new"):
                    inside.append(number)
                    time.sleep(rng.uniform(0.0, 0.002))
                    outcomes.append(inside == [number])
                    inside.clear()
            except InputError:
                time.sleep(rng.uniform(0.0, 0.01))

    with ThreadPoolExecutor(5) as pool:
        list(pool.map(attempt, range(5)))
    assert len(outcomes) > 5
    assert all(outcomes)
    sweep(tmp_path / "new")
    assert not hidden(tmp_path)


def test_who_plans_second_is_told_and_waits(tmp_path):
    order, told = [], []
    with claimed(tmp_path, (0, 2)):
        with planning(tmp_path):

            def second():
                with planning(tmp_path, lambda: told.append(1)):
                    order.append("second")

            thread = threading.Thread(target=second)
            thread.start()
            while not told:
                pass
            order.append("first")
        thread.join()
    assert order == ["first", "second"]
    assert not hidden(tmp_path)


@pytest.mark.skipif(sys.platform != "linux", reason="needs a folder in which nothing can be made")
def test_a_folder_that_cannot_be_made_is_bad_input_and_no_endless_loop():
    with pytest.raises(InputError, match="cannot be written"), claimed(Path("/proc/nothing"), (0, 1)):
        pass
