"""Rendering on many workers: the bytes of a single run, whoever dies; real processes of dask.distributed."""

import os
import pickle
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from standins import tree

from benchmarks.soak import small_scene
from varos_warp.dataset.run.engine import Stopped
from varos_warp.dataset.run.pipeline import GIVE_UP, Rendered
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.run.timing import Clock
from varos_warp.dataset.write.images import ImageJob
from varos_warp.errors import InputError, SchedulerGone

distributed = pytest.importorskip("distributed")
from varos_warp.dataset import files
from varos_warp.dataset.run import (
    cluster,
    worker,
)

FRAMES = 24
QUICK = {"integrator": "path", "max_scatterings": 1, "denoise": "none", "denoise_b": "none"}
posix = pytest.mark.skipif(sys.platform == "win32", reason="needs signals")


@pytest.fixture(autouse=True)
def stand_ins():
    """None: workers are processes, with the real renderer."""


@pytest.fixture(autouse=True)
def impatience(monkeypatch):
    """The workers of the tests are all there at once."""
    monkeypatch.setattr(cluster, "SETTLE_S", 0.1)


@pytest.fixture(scope="module")
def scheduler():
    """Address of a scheduler with two workers."""
    with distributed.LocalCluster(n_workers=2, threads_per_worker=2, dashboard_address=None, memory_limit=None,
                                  silence_logs=cluster.SILENT) as local:
        yield local.scheduler_address.replace("tcp://", "dask://")


def scene(frames=FRAMES, **render):
    return small_scene(frames, (16, 9), **{**QUICK, **render})


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Bytes of every file of a run in one process."""
    out = tmp_path_factory.mktemp("whole") / "out"
    produce(scene(), out, device="cpu", quiet=True)
    return tree(out)


@posix
def test_workers_make_the_bytes_of_a_single_run_though_one_is_killed_while_it_renders(scheduler, whole, tmp_path):
    """The worker that rendered last is killed at the sixth image; Dask starts another one in its place."""
    with distributed.Client(scheduler.replace("dask", "tcp"), set_as_default=False) as client:
        pids = client.run(os.getpid)

        class Killer(cluster._Run):
            def collect(self, future):
                super().collect(future)
                if len(self.made.timings) == 6 and pids:
                    os.kill(pids.pop(self.cluster.order[0]), signal.SIGKILL)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(cluster, "_Run", Killer)
            summary = produce(scene(), tmp_path / "out", device="cpu", quiet=True, scheduler=scheduler)
    assert len(pids) == 1
    assert tree(tmp_path / "out") == whole
    assert summary.complete
    assert summary.rendered == 4 * FRAMES
    assert [message for message in summary.messages if "died; its images are made again" in message]
    assert summary.device == "2 x cpu (CPU)"


def test_a_run_on_workers_that_was_interrupted_leaves_whole_files_and_goes_on(scheduler, whole, tmp_path):
    out, stopped = tmp_path / "out", {}

    class Interrupted(cluster._Run):
        def collect(self, future):
            super().collect(future)
            if len(self.made.timings) == 8:
                raise KeyboardInterrupt

        def drain(self):
            super().drain()
            name, ask = self.cluster.name, self.cluster.client.run
            stopped.update(ask(lambda dask_worker: dask_worker.plugins[name].stopped))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cluster, "_Run", Interrupted)
        with pytest.raises(KeyboardInterrupt):
            produce(scene(), out, device="cpu", quiet=True, scheduler=scheduler)
    assert list(stopped.values()) == [True, True]  # threads that wait for the device begin nothing
    left = tree(out)
    assert left == {name: whole[name] for name in left}
    images = [name for name in left if name.endswith(".exr")]
    assert 2 * 8 <= len(images) < 2 * FRAMES
    summary = produce(scene(), out, device="cpu", quiet=True, scheduler=scheduler)
    assert summary.rendered == 4 * FRAMES - 2 * len(images)
    assert tree(out) == whole


def test_at_an_interruption_what_is_under_way_is_ended_and_nothing_more_begun(scheduler, tmp_path):
    def slow(job):
        (tmp_path / f"{job.frame}.begun").touch()
        time.sleep(0.3)
        (tmp_path / f"{job.frame}.ended").touch()
        return worker.Reply("a worker")

    def stop():
        if len(list(tmp_path.glob("*.begun"))) > 5:
            raise KeyboardInterrupt

    with cluster.Cluster("cpu", scheduler=scheduler) as workers:
        run = cluster._Run(workers, None, {}, Rendered(), Clock(), stop, print)
        run.call = slow
        with pytest.raises(KeyboardInterrupt):
            run.all([ImageJob(frame, "M0", "D") for frame in range(40)])
        begun = {path.stem for path in tmp_path.glob("*.begun")}
        assert begun == {path.stem for path in tmp_path.glob("*.ended")}
        time.sleep(0.5)
        assert begun == {path.stem for path in tmp_path.glob("*.begun")}
    assert 5 < len(begun) < 20


def test_stages_are_summed_over_workers_in_one_log(scheduler, tmp_path):
    import json

    summary = produce(scene(8), tmp_path, device="cpu", quiet=True, scheduler=scheduler)
    log, = (tmp_path / "log").iterdir()
    content = json.loads(log.read_text())
    assert content["stages"]["render"] == pytest.approx(summary.stages["render"])
    timings = content["frames"]
    assert sorted(entry["frame"] for entry in timings) == list(range(8))
    rounding = 0.5e-3 + 8 * 0.5e-4
    assert content["stages"]["render"] + rounding >= sum(entry["seconds"] for entry in timings) > 0
    assert all(entry["worker"].startswith(f"{files.HOST}-") for entry in timings)
    assert content["devices"] == [{"name": "cpu", "model": "CPU"}] * 2
    assert content["stages"]["encode"] > 0


def interrupted(tmp_path, out, when) -> None:
    """A command with two workers gets a terminal's Ctrl-C, which goes to all processes of the group, and ends well."""
    script = tmp_path / "run.py"
    script.write_text(
        "import signal\nimport sys\nimport varos_warp.cli as cli\nfrom varos_warp.scene import load\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # shells let jobs in the background ignore it\n"
        "from test_cluster import scene\nload.load_scene = lambda *_: scene(400)\n"
        "if __name__ == '__main__':\n    sys.argv[0] = 'varos-warp'\n    cli.main()\n")
    here = Path(__file__).parents[3]
    paths = [here, here / "tests", here / "tests" / "dataset"]
    process = subprocess.Popen(
        [sys.executable, script, "run", "scene.yaml", "-o", out, "--device", "cpu", "--workers", "2"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths))}, start_new_session=True,
        stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120
    while not when(process.pid) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    assert len(members(process.pid)) >= 3
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130, said
    assert "interrupted; what is complete stays" in said
    assert "Traceback" not in said, said
    deadline = time.monotonic() + 5
    while members(process.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not members(process.pid)


@posix
def test_an_interrupted_command_leaves_no_process_and_no_half_written_file(tmp_path):
    out = tmp_path / "out"
    interrupted(tmp_path, out, lambda _: len(list(out.rglob("D/*.png"))) >= 5)
    left = list(out.rglob("*"))
    assert 5 <= len([path for path in left if path.match("D/*.png")]) < 400
    assert not [path for path in left if path.name.startswith(".")]


@posix
@pytest.mark.parametrize("processes", [3, 4])
def test_a_command_that_is_interrupted_while_its_workers_start_says_so_and_no_more(tmp_path, processes):
    """Of the processes one is the command, one counts what all share, and the others are to be workers."""
    interrupted(tmp_path, tmp_path / "out", lambda pid: len(members(pid)) >= processes)
    assert not (tmp_path / "out").exists()


def test_dask_swallows_no_ctrl_c_here_and_does_not_have_workers_give_memory_back(tmp_path):
    """What is raised in a hook on garbage collections, as by a signal that came meanwhile, is printed and ignored."""
    script = tmp_path / "habits.py"
    script.write_text(
        "import gc, os\nfrom pathlib import Path\nfrom varos_warp.dataset.run.cluster import Cluster\n"
        "def trim():\n    return os.environ.get('MALLOC_TRIM_THRESHOLD_')\n"
        "if __name__ == '__main__':\n    with Cluster('cpu', workers=1) as cluster:\n"
        "        cluster.start(Path('.'))\n"
        "        print('hooks', gc.callbacks, 'trim', *cluster.client.run(trim).values())\n")
    environ = {key: value for key, value in os.environ.items() if not key.startswith("MALLOC")}  # Dask leaves its own
    made = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, timeout=120,
                          env=environ)
    assert "hooks [] trim None" in made.stdout, made.stdout + made.stderr


def members(group: int) -> list[str]:
    """Processes of a group."""
    found = subprocess.run(["ps", "-A", "-o", "pgid=,pid=,args="], capture_output=True, text=True, check=True)
    return [line for line in found.stdout.splitlines() if line.split()[0] == str(group)]


def test_a_scheduler_that_goes_is_told_of_as_such():
    """The connection breaks while a task's result is waited for, or its future is cancelled."""
    def broken():
        raise distributed.comm.CommClosedError("in <TCP (closed)>: ConnectionResetError")

    def cancelled():
        raise distributed.CancelledError("key")

    for result in (broken, cancelled):
        with pytest.raises(SchedulerGone, match="the same command goes on"):
            cluster.Cluster.result(None, SimpleNamespace(done=lambda: True, result=result))


def test_an_address_without_a_port_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"dask://localhost.*names no port\. Give the address that `dask scheduler`"):
        produce(scene(), tmp_path / "out", scheduler="dask://localhost", quiet=True)


def test_an_address_without_a_scheduler_is_refused_within_seconds(tmp_path):
    start = time.monotonic()
    with pytest.raises(InputError, match=r"no Dask scheduler answers there.*dask://HOST:PORT") as caught:
        produce(scene(), tmp_path / "out", scheduler="dask://127.0.0.1:9", quiet=True)
    assert caught.value.key == "--scheduler"
    assert time.monotonic() - start < 2 * cluster.CONNECT_S
    assert not (tmp_path / "out").exists()


def test_a_scheduler_without_workers_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cluster, "START_S", 0.5)
    monkeypatch.setattr(cluster, "PATIENCE_S", 0.1)
    with distributed.LocalCluster(n_workers=0, dashboard_address=":0") as local, \
            pytest.raises(InputError, match="has no workers after"):
        produce(scene(), tmp_path / "out", scheduler=local.scheduler_address)
    assert capsys.readouterr().err.count("waiting for workers of tcp://") == 1


def test_workers_that_do_not_see_the_folder_are_refused(scheduler, tmp_path, monkeypatch):
    """Their file system has the folder, but not what the owner wrote there."""
    greet = worker.greet
    monkeypatch.setattr(worker, "greet", lambda token, device: greet(token.with_name("elsewhere"), device))
    with pytest.raises(InputError, match=r"a worker on .* does not see this folder\. Give a folder on a file system"):
        produce(scene(), tmp_path / "out", device="cpu", scheduler=scheduler, quiet=True)


def test_without_dask_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"dask\.distributed is not installed\. .*varos_warp\[cluster\]"):
        produce(scene(), tmp_path / "out", workers=2)


@pytest.mark.parametrize("how", [{"workers": 0}, {"workers": 2, "scheduler": "dask://localhost:1"}])
def test_what_cannot_be_meant_is_refused(tmp_path, how):
    with pytest.raises(InputError, match="--workers"):
        produce(scene(), tmp_path / "out", **how)


def test_workers_of_another_version_are_refused():
    with pytest.raises(InputError, match=r"a worker on far has numpy 1\.0, this process has 2\.0"):
        worker.check_versions({"python": "3.11", "numpy": "1.0"}, "far", {"python": "3.12", "numpy": "2.0"})


def test_a_worker_with_another_kind_of_device_that_comes_late_is_refused():
    site = worker.Site("run", scene(), [], "cpu", "cuda", {})
    with pytest.raises(InputError, match=r"different kinds of device: cpu on .*, cuda elsewhere"):
        site.opened()


@pytest.mark.parametrize("when", ["before", "while", "after"])
def test_a_worker_that_is_to_stop_begins_nothing_also_when_its_scene_comes_later(monkeypatch, when):
    site, loaded = worker.Site("run", scene(), [], "cpu", "cpu", {}), []
    stop = partial(worker.stop_site, "run", SimpleNamespace(plugins={"run": site}))

    def load(*_, **__):
        loaded.append(True)
        if when == "while":
            stop()

    monkeypatch.setattr(worker.Engine, "load", load)
    if when == "before":
        stop()
    if when == "after":
        engine, _ = site.opened()
        stop()
        with pytest.raises(Stopped), engine._places:
            pytest.fail("an image was begun")
    with pytest.raises(Stopped):
        site.opened()
    assert len(loaded) == (when != "before")


def test_workers_with_different_kinds_of_device_are_refused(scheduler, tmp_path, monkeypatch):
    """One of them says that it has a GPU."""
    ask = cluster.Cluster._ask_all

    def differing(self, function):
        first, *others = ask(self, function).items()
        return dict([(first[0], replace(first[1], device="cuda:0")), *others])

    monkeypatch.setattr(cluster.Cluster, "_ask_all", differing)
    with pytest.raises(InputError, match=r"different kinds of device: cuda on .* and cpu on"):
        produce(scene(), tmp_path / "out", device="cpu", scheduler=scheduler, quiet=True)
    assert not (tmp_path / "out").exists()


def test_bad_input_met_by_a_worker_is_the_same_here():
    error = InputError("is odd", file="scene.yaml", line=3, key="a.b", value=[1], remedy="Mend it.")
    copy = pickle.loads(pickle.dumps(error))
    assert vars(copy) == vars(error)
    assert str(copy) == str(error)


def test_each_process_takes_a_gpu_that_the_fewest_others_have(tmp_path, monkeypatch):
    """Locks stand for processes: what is claimed stays so until the process ends."""
    monkeypatch.setattr(worker.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(worker, "_claimed", [])
    assert [worker.claim(["a", "b", "c"]) for _ in range(7)] == [0, 1, 2, 0, 1, 2, 0]
    worker._claimed.pop(1).release()
    assert worker.claim(["a", "b", "c"]) == 1


# --------------------------------------------------------------------------------- failures, without processes


class Here:
    """Stands in for a `Cluster`: workers that answer at once."""

    name = "here"

    def __init__(self, answer, workers=("w0", "w1")):
        self.answer, self.workers, self.compiled, self.asked, self.gone = answer, list(workers), {}, [], []
        self.client = SimpleNamespace(loop=None, retire_workers=self.retire)

    def retire(self, addresses, **_):
        self.gone += addresses
        self.workers = [w for w in self.workers if w not in addresses]

    def addresses(self):
        return self.workers

    def submit(self, call, job):
        address = self.workers[len(self.asked) % len(self.workers)]
        self.asked.append((address, job.frame))
        return SimpleNamespace(key=f"{len(self.asked)}", answer=self.answer(address, job))

    def result(self, future):
        if isinstance(future.answer, Exception):
            raise future.answer
        return future.answer


def go(here, frames=12):
    """Collects the answers in the order of the jobs; what was made, and what was said."""
    made, said, done = Rendered(), [], []
    run = cluster._Run(here, None, {}, made, Clock(), lambda: done.append(1), said.append)
    waiting = []
    run.queue = SimpleNamespace(add=waiting.append)
    for frame in range(frames):
        run.submit(ImageJob(frame, "M0", "D"))
    while waiting:
        run.collect(waiting.pop(0))
    assert len(done) == frames
    return made, said


def reply(address, job, error=None):
    failures = [(job, error)] if error else []
    return worker.Reply(address, Rendered(timings=[] if error else [{"frame": job.frame}], failures=failures))


def test_what_a_broken_worker_could_not_do_others_do():
    """Three failures in a row, and it gets nothing more."""
    here = Here(lambda address, job: reply(address, job, RuntimeError("CUDA error 700") if address == "w1" else None))
    made, said = go(here)
    assert not made.failures
    assert sorted(entry["frame"] for entry in made.timings) == list(range(12))
    assert here.gone == ["w1"]
    assert [words for words in said if "the worker w1 failed 3 times in a row and is left out" in words]


def test_what_fails_on_every_worker_is_given_up():
    here = Here(lambda address, job: reply(address, job, RuntimeError("CUDA error 700")))
    with pytest.raises(RuntimeError, match="CUDA error 700"):
        go(here)
    assert len(here.gone) == 1


def test_a_frame_that_fails_is_noted_and_the_rest_is_made():
    made, _ = go(Here(lambda address, job: reply(address, job, RuntimeError("odd") if job.frame == 4 else None)))
    assert [(job.frame, str(error)) for job, error in made.failures] == [(4, "odd")]
    assert len(made.timings) == 11


def test_frames_that_kill_their_workers_are_noted_but_not_without_end():
    def answer(address, job):
        return RuntimeError("4 workers died of it") if job.frame in deadly else reply(address, job)

    deadly = {2, 7}
    made, said = go(Here(answer))
    assert [job.frame for job, _ in made.failures] == [2, 7]
    assert "frame 2, camera M0 failed: 4 workers died of it" in said
    deadly = set(range(GIVE_UP))
    with pytest.raises(RuntimeError, match="4 workers died"):
        go(Here(answer))


def test_a_full_disk_met_by_a_worker_ends_the_run():
    with pytest.raises(InputError, match="No space left"):
        go(Here(lambda address, job: InputError("No space left") if job.frame == 3 else reply(address, job)))
