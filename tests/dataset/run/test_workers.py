"""Worker processes: the bytes of one process, whoever dies; nothing listens, and nothing is left behind."""

import os
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
import worker_bodies
from standins import install, make_scene, tree
from worker_bodies import wait_for

from varos_warp.dataset.layout import Layout
from varos_warp.dataset.progress import Console
from varos_warp.dataset.run import produce as production
from varos_warp.dataset.run import workers
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.run.steps import Run
from varos_warp.dataset.run.workers import device_of_worker
from varos_warp.dataset.write.folder import claimed
from varos_warp.errors import InputError, RunFailed

posix = pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


def start(count, work, *arguments):
    """Results, steps done and what was told."""
    done, told = [], []
    return workers.run_in_workers(count, work, arguments, done=done.append, tell=told.append), sum(done), told


# ------------------------------------------------------------------------------------------------------ the processes


@linux
def test_workers_share_the_cores_tell_their_parent_and_hold_no_socket():
    """What several tell is told once; their steps add up."""
    results, done, told = start(2, worker_bodies.facts)
    assert [shard for shard, *_ in results] == [(0, 2), (1, 2)]
    assert len({os.getpid(), *(pid for _, pid, *_ in results)}) == 3
    cores = [cores for *_, cores, _ in results]
    if len(every := sorted(os.sched_getaffinity(0))) > 1:
        assert cores[0] + cores[1] == every
    assert [sockets for *_, sockets in results] == [[], []]
    assert done == 6
    assert sorted(told) == ["of 0", "of 1", "the same of all"]


@linux
@pytest.mark.parametrize(("count", "shares"), [(2, [[0, 1], [2, 3, 4]]), (7, [[0], [0], [1], [2], [2], [3], [4]])])
def test_each_worker_has_its_share_of_the_cores_and_at_least_one(monkeypatch, count, shares):
    taken = []
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(5)))
    monkeypatch.setattr(os, "sched_setaffinity", lambda _, cores: taken.append(cores))
    for index in range(count):
        workers._take_cores(index, count)
    assert len(taken) == count
    assert all(taken)
    if count < 5:
        assert taken == shares


@posix
@pytest.mark.parametrize(("how", "reason"), [("kill", "SIGKILL"), ("crash", "status 1")])
def test_a_worker_that_dies_is_started_again_three_times(tmp_path, how, reason, ready_workers):
    results, _, told = start(2, worker_bodies.dies, tmp_path, workers.RESTARTS, how)
    assert results == [0, workers.RESTARTS]
    assert told == [f"note: worker 1 of 2 died with {reason} ({k}) and is started again" for k in (1, 2, 3)]


@posix
def test_a_worker_that_dies_always_is_named_and_the_others_do_their_work(tmp_path, ready_workers):
    with pytest.raises(RunFailed, match=r"worker 1 of 2 died 4 times, the last time with SIGKILL"):
        start(2, worker_bodies.dies, tmp_path, 100, "kill")
    assert len(list(tmp_path.glob("0-*"))) == 1


def test_a_failure_of_a_worker_is_told_when_the_others_have_done_their_work():
    done = []
    with pytest.raises(RunFailed, match="frame 4"):
        workers.run_in_workers(2, worker_bodies.fails, ("run",), done=done.append, tell=print)
    assert done == [1]


def test_bad_input_met_by_a_worker_ends_the_others_and_is_the_same_here():
    begun = time.monotonic()
    with pytest.raises(InputError) as caught:
        start(2, worker_bodies.fails, "input")
    assert time.monotonic() - begun < 30.0
    assert vars(caught.value) == vars(InputError("no space", file="disk", remedy="Free some."))


def program(function, argument, tmp_path) -> subprocess.Popen:
    """A program that starts workers, in a session of its own."""
    script = tmp_path / "program.py"
    script.write_text(
        f"from pathlib import Path\nimport worker_bodies\nif __name__ == '__main__':\n"
        f"    worker_bodies.{function}(Path({str(argument)!r}))\n"
    )
    here = Path(__file__).parents[3]
    return subprocess.Popen(
        [sys.executable, script],
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (here, here / "tests")))},
    )


def members(group: int) -> list[str]:
    """Processes of a group."""
    found = subprocess.run(["ps", "-A", "-o", "pgid=,pid=,stat=,args="], capture_output=True, text=True, check=True)
    return [
        line
        for line in found.stdout.splitlines()
        if line.split()[0] == str(group) and not line.split()[2].startswith("Z")
    ]


def is_written(path: Path) -> bool:
    """Whether it is there, with something in it."""
    return path.exists() and path.stat().st_size > 0


@posix
@pytest.mark.parametrize("to", ["group", "parent"])
def test_an_interruption_lets_workers_end_what_is_under_way_and_leaves_no_process(tmp_path, to):
    """A terminal's Ctrl-C goes to all processes, the end of a cluster's time to one or all."""
    process = program("sleep_in_two_workers", tmp_path, tmp_path)
    wait_for(lambda: all(is_written(tmp_path / f"begun{i}") for i in (0, 1)))
    os.killpg(process.pid, signal.SIGINT) if to == "group" else os.kill(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert (tmp_path / "ended0").exists()
    assert (tmp_path / "ended1").exists()
    assert said.count("Traceback") == 1, said  # of the program, which handles nothing
    wait_for(lambda: not members(process.pid), 5.0)


@posix
def test_a_program_that_is_interrupted_while_its_workers_start_says_so_once_and_leaves_no_process(tmp_path):
    process = program("sleep_in_two_workers", tmp_path, tmp_path)
    wait_for(lambda: len(members(process.pid)) >= 3)  # one of them counts what all share
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert said.count("Traceback") == 1, said
    wait_for(lambda: not members(process.pid), 5.0)


@posix
def test_workers_of_a_parent_that_is_killed_end_by_themselves(tmp_path):
    process = program("sleep_in_two_workers", tmp_path, tmp_path)
    wait_for(lambda: all(is_written(tmp_path / f"begun{i}") for i in (0, 1)))
    process.kill()
    process.wait()
    wait_for(lambda: not members(process.pid), workers.GRACE_S)
    assert (tmp_path / "ended0").exists()
    assert (tmp_path / "ended1").exists()
    process.stderr.close()


# ---------------------------------------------------------------------------------------------------------- the dataset


@posix
def test_workers_make_the_bytes_of_one_process_though_one_is_killed_while_it_renders(
    written, tmp_path, monkeypatch, ready_workers
):
    monkeypatch.setattr(production, "render_shard", partial(worker_bodies.flat_floor_shard, "killed", tmp_path))
    summary = produce(make_scene(), tmp_path / "out", device="cpu", quiet=True, workers=2)
    assert (tmp_path / "killed").exists()
    assert tree(tmp_path / "out") == tree(written)
    assert summary.complete
    assert (summary.rendered, summary.kept) == (80, 0)
    assert summary.device == "2 x cpu (numpy)"
    assert summary.stages["encode"] > 0
    assert len(list((tmp_path / "out" / "log").glob("*.json"))) == 2  # one for each worker that came to its end
    again = produce(make_scene(), tmp_path / "out", device="cpu", quiet=True, workers=2)
    assert (again.rendered, again.kept, again.device) == (0, 80, None)


def test_a_worker_writes_what_says_whose_folder_it_is_and_leaves_the_tables_to_its_parent(tmp_path, monkeypatch):
    install(monkeypatch)
    scene, out = make_scene(), tmp_path / "out"
    out.mkdir()
    layout = Layout.of(scene, out)
    for index in (1, 0):
        production.render_shard(scene, out, "cpu", slice(None), shard=(index, 2), console=Console(True))
        assert layout.metadata.exists()
        assert not layout.states.exists()
        assert not layout.lights.exists()


@posix
def test_tables_are_written_once_and_while_workers_render(tmp_path, monkeypatch):
    monkeypatch.setattr(production, "render_shard", partial(worker_bodies.flat_floor_shard, "waiting", tmp_path))
    written, write = [], Run.write_tables
    monkeypatch.setattr(Run, "write_tables", lambda run, sensors: written.append(write(run, sensors)))
    scene = make_scene(render={"outputs": ["D"]})
    assert produce(scene, tmp_path / "out", device="cpu", quiet=True, workers=1).complete
    assert len(written) == 1


@posix
@pytest.mark.parametrize("count", [None, 1])
def test_tables_that_cannot_be_written_stop_the_run_at_once(tmp_path, monkeypatch, count, ready_workers):
    def full(run, sensors):
        raise InputError("cannot be written: No space left on device")

    monkeypatch.setattr(Run, "write_tables", full)
    monkeypatch.setattr(production, "render_shard", partial(worker_bodies.flat_floor_shard, "slow", tmp_path))
    install(monkeypatch)
    with pytest.raises(InputError, match="No space left"):
        produce(make_scene(), tmp_path / "out", device="cpu", quiet=True, workers=count)
    assert len(list((tmp_path / "out").rglob("D/*.png"))) in (range(1, 10) if count else (0,))


@posix
def test_workers_that_add_frames_leave_what_one_process_leaves(tmp_path, monkeypatch, ready_workers):
    monkeypatch.setattr(production, "render_shard", partial(worker_bodies.flat_floor_shard, "whole", tmp_path))
    install(monkeypatch)
    produce(make_scene(), tmp_path / "one", device="cpu", frames=slice(0, 4), quiet=True)
    shutil.copytree(tmp_path / "one", tmp_path / "two")
    for name, count in (("one", None), ("two", 2)):
        produce(make_scene(), tmp_path / name, device="cpu", frames=slice(0, 6), quiet=True, workers=count)
    assert tree(tmp_path / "one") == tree(tmp_path / "two")


def test_a_frame_that_fails_in_a_worker_is_named_and_all_others_are_made(written, tmp_path, monkeypatch, ready_workers):
    monkeypatch.setattr(production, "render_shard", partial(worker_bodies.flat_floor_shard, "failing", tmp_path))
    with pytest.raises(RunFailed, match=r"frame 5, camera L0 could not be made: CUDA error 700; 1 more failed"):
        produce(make_scene(), tmp_path / "out", device="cpu", quiet=True, workers=1)
    assert len(list((tmp_path / "out").rglob("D/*.png"))) == 18
    assert produce(make_scene(), tmp_path / "out", quiet=True).rendered == 8
    assert tree(tmp_path / "out") == tree(written)


@posix
def test_an_interrupted_command_has_status_130_and_leaves_whole_files_only(tmp_path):
    out = tmp_path / "out"
    process = program("slow_command", out, tmp_path)
    wait_for(lambda: len(list(out.rglob("D/*.png"))) >= 2)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130, said
    assert "interrupted; what is complete stays" in said
    assert "Traceback" not in said, said
    wait_for(lambda: not members(process.pid), 5.0)
    left = list(out.rglob("*"))
    assert 2 <= len([path for path in left if path.match("D/*.png")]) < 20
    assert not [path for path in left if path.name.startswith(".")]


def test_a_folder_at_which_workers_are_is_refused_to_others(tmp_path):
    with claimed(tmp_path, (2, 3)), claimed(tmp_path, (0, 3)), claimed(tmp_path, (1, 3)):
        for shard in ((0, 1), (0, 2), (1, 3), (2, 3), (0, 4)):
            with pytest.raises(InputError, match="another run is writing"), claimed(tmp_path, shard):
                pass


@pytest.mark.parametrize("how", [{"workers": 0}, {"workers": 2, "shard": (0, 3)}])
def test_what_cannot_be_meant_is_refused(tmp_path, how):
    with pytest.raises(InputError, match="--workers"):
        produce(make_scene(), tmp_path / "out", **how)
    assert not (tmp_path / "out").exists()


def test_each_worker_takes_the_next_gpu(monkeypatch):
    import warp as wp

    monkeypatch.setattr(wp, "get_cuda_device_count", lambda: 3)
    assert [device_of_worker("auto", i) for i in range(5)] == ["cuda:0", "cuda:1", "cuda:2", "cuda:0", "cuda:1"]
    assert device_of_worker("cpu", 1) == "cpu"
    monkeypatch.setattr(wp, "get_cuda_device_count", lambda: 0)
    assert device_of_worker("auto", 1) in ("cpu", "cuda:0")
