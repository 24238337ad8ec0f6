"""Whatever ends a run, what it left under final names is whole, and the same command completes it to the same bytes."""

import os
import random
import signal
import subprocess
import sys
import time
from multiprocessing import get_context
from types import SimpleNamespace

import pytest
import standins
from standins import FlatFloorRenderer, make_scene, tree

from benchmarks.soak import small_scene
from varos_warp.dataset import files
from varos_warp.dataset.run import pipeline
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.write import folder
from varos_warp.dataset.write import images as store
from varos_warp.errors import InputError

KILLS = 20
FRAMES = 24
processes = pytest.mark.skipif(sys.platform == "win32", reason="needs fork, signals and limits")


# ------------------------------------------------------------------- runs of their own, with the real renderer


def real_run(out, message=None, size=(16, 9), limit=None, **render):
    """The body of a process; it ends with status 3 and a message in a file if the disk refuses a file."""
    if limit is not None:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    settings = {"integrator": "path", "max_scatterings": 1, "denoise": "none", "denoise_b": "none", **render}
    try:
        produce(small_scene(FRAMES, size, **settings), out, device="cpu", quiet=True)
    except InputError as error:
        message.write_text(error.message)
        sys.exit(3)


def quick_run(out):
    """The body of a process: `written` anew, with the stand-ins, which leave nearly all of its time to the files."""
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(make_scene(), out, quiet=True)


@pytest.fixture(scope="module")
def start():
    """Starts `real_run`, or another, in a process that has imported everything and shares nothing with other ones."""
    context = get_context("forkserver")
    context.set_forkserver_preload([
        "varos_warp.dataset.run.produce", "varos_warp.dataset.report", "varos_warp.render.renderer",
        "varos_warp.render.planner.plan", "varos_warp.sim.trajectory",
        "benchmarks.soak", "PIL.PngImagePlugin", "standins"])

    def started(*args, body=real_run, **options):
        process = context.Process(target=body, args=args, kwargs=options)
        process.start()
        return process

    return started


@pytest.fixture(scope="module")
def whole(start, tmp_path_factory):
    """Bytes of every file of an uninterrupted run."""
    out = tmp_path_factory.mktemp("whole") / "out"
    process = start(out)
    process.join()
    assert process.exitcode == 0
    return tree(out)


def visible(out):
    """Bytes of the files that have their final names."""
    return {name: data for name, data in tree(out).items() if not os.path.basename(name).startswith(".")
            } if out.exists() else {}


def kill_after(process, out, count: int) -> bool:
    """Kill a run once so many files are there; whether it was still running."""
    while process.is_alive() and sum(len(names) for *_, names in os.walk(out)) < count:
        time.sleep(0.001)
    process.kill()
    process.join()
    return process.exitcode == -signal.SIGKILL


@processes
def test_a_run_killed_at_random_moments_is_completed_to_the_bytes_of_an_uninterrupted_one(start, written, tmp_path):
    """And at each of these moments what has its name is what it will be in the end."""
    rng, kills, datasets, whole = random.Random(7), 0, 0, tree(written)
    while kills < KILLS:
        out, datasets = tmp_path / str(datasets), datasets + 1
        while True:
            process = start(out, body=quick_run)
            count = len(visible(out))
            time.sleep(rng.uniform(0.0, 0.05))
            if not kill_after(process, out, count + rng.randrange(len(whole) // 5)):
                break  # it was quicker
            kills += 1
            left = visible(out)
            assert left == {name: whole[name] for name in left}
            if rng.random() < 0.15:
                process = start(out, body=quick_run)
                process.join()
                break
        assert process.exitcode == 0
        assert tree(out) == whole
    assert datasets > 1


@processes
def test_files_that_cannot_grow_are_refused_in_one_message_and_the_rest_is_made_later(start, tmp_path):
    """The limit of a file's size, below that of A's EXR with all its layers."""
    how = {"size": (64, 36), "linear_exr": True}
    start(tmp_path / "plain", **how).join()
    process = start(tmp_path / "out", tmp_path / "message", limit=90_000, **how)
    process.join()
    assert process.exitcode == 3
    assert "cannot be written" in (tmp_path / "message").read_text()
    expected = tree(tmp_path / "plain")
    left = tree(tmp_path / "out")
    assert 0 < len(left) < len(expected)
    assert left == {name: expected[name] for name in left}
    start(tmp_path / "out", **how).join()
    assert tree(tmp_path / "out") == expected


@processes
@pytest.mark.parametrize("size", ["600k", "1m"])
def test_a_disk_that_is_full_is_refused_in_one_message_and_the_rest_is_made_when_there_is_space(
        start, whole, tmp_path, size):
    """A disk of memory, where mounting one is permitted; it fills up among the tables, or among the images."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if sys.platform != "linux" or subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", disk],
                                                 capture_output=True, check=False).returncode:
        pytest.skip("mounting is not permitted")
    try:
        process = start(disk / "out", tmp_path / "message")
        process.join()
        assert process.exitcode == 3
        assert "No space left" in (tmp_path / "message").read_text()
        left = tree(disk / "out")
        assert 0 < len(left) < len(whole)
        assert any(name.endswith(".exr") for name in left) == (size == "1m")
        assert left == {name: whole[name] for name in left}
        subprocess.run(["mount", "-o", "remount,size=50m", disk], check=True)
        process = start(disk / "out")
        process.join()
        assert process.exitcode == 0
        assert tree(disk / "out") == whole
    finally:
        subprocess.run(["umount", disk], check=True)


@processes
def test_shards_that_start_together_plan_once_and_make_the_bytes_of_a_plain_run(tmp_path, written):
    context = get_context("forkserver")
    plans = tmp_path / "plans"
    plans.mkdir()
    shards = [context.Process(target=slow_shard, args=(tmp_path / "out", plans, i)) for i in range(3)]
    for process in shards:
        process.start()
    for process in shards:
        process.join()
        assert process.exitcode == 0
    assert len(list(plans.iterdir())) == 1
    assert tree(tmp_path / "out") == tree(written)


def slow_shard(out, plans, index):
    """The body of a process: one of three shards, whose planner takes half a second and tells."""
    plan_render = standins.plan_render

    def slow(*args, **options):
        (plans / str(index)).touch()
        time.sleep(0.5)
        return plan_render(*args, **options)

    standins.plan_render = slow
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(make_scene(), out, quiet=True, shard=(index, 3))


# --------------------------------------------------------------------------------- failures within a run


class Failing(FlatFloorRenderer):
    """Cannot render some frames."""

    def __init__(self, scene, frames):
        super().__init__(scene)
        self.frames = frames

    def render(self, *args, frame, **options):
        if frame in self.frames:
            self.calls.append((frame,))
            raise RuntimeError("CUDA error 700: an illegal memory access was encountered")
        return super().render(*args, frame=frame, **options)


def test_a_frame_whose_kernel_fails_stops_no_other_and_is_made_by_the_next_run(written, tmp_path):
    scene = make_scene()
    with pytest.raises(RuntimeError, match=r"frame 4, camera L0 could not be made: CUDA error 700.*1 more failed"):
        produce(scene, tmp_path, quiet=True, renderer=Failing(scene, {4}))
    assert len(list(tmp_path.rglob("cam1/D/*.png"))) == 9
    renderer = FlatFloorRenderer(scene)
    assert produce(scene, tmp_path, quiet=True, renderer=renderer).complete
    assert [call[0] for call in renderer.calls] == [4, 4]
    assert tree(tmp_path) == tree(written)


def test_a_device_that_fails_at_every_frame_is_given_up(tmp_path):
    scene = make_scene()
    renderer = Failing(scene, set(range(2, 10)))
    with pytest.raises(RuntimeError, match="illegal memory access"):
        produce(scene, tmp_path, quiet=True, renderer=renderer)
    assert len(renderer.calls) == 4 + pipeline.GIVE_UP
    assert len(list(tmp_path.rglob("D/*.png"))) == 4


def test_a_writer_that_dies_loses_its_image_only_and_the_next_run_makes_it(written, tmp_path, monkeypatch):
    write = store.Store.write

    def dying(self, job, letter, *rest):
        if (job.frame, job.camera, letter) == (3, "R0", "A"):
            raise MemoryError("cannot allocate")
        return write(self, job, letter, *rest)

    monkeypatch.setattr(store.Store, "write", dying)
    with pytest.raises(RuntimeError, match=r"frame 3, camera R0 could not be made: cannot allocate\. All others are"):
        produce(make_scene(), tmp_path, quiet=True)
    monkeypatch.undo()
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        assert produce(make_scene(), tmp_path, quiet=True).rendered == 1
    assert tree(tmp_path) == tree(written)


def test_an_interruption_while_images_are_exposed_is_made_good_by_the_next_run(written, tmp_path, monkeypatch):
    develop, count = store.develop, []

    def interrupted(letter, *rest):
        count.append(letter)
        if count.count("A") == 4:
            raise KeyboardInterrupt
        return develop(letter, *rest)

    monkeypatch.setattr("varos_warp.dataset.write.expose.develop", interrupted)
    with pytest.raises(KeyboardInterrupt):
        produce(make_scene(), tmp_path, quiet=True)
    monkeypatch.setattr("varos_warp.dataset.write.expose.develop", develop)
    assert 0 < len(list(tmp_path.rglob("A/*.png"))) < 20
    assert produce(make_scene(), tmp_path, quiet=True).rendered == 0
    assert tree(tmp_path) == tree(written)


def test_what_tells_what_segments_mean_never_stands_in_a_folder_without_a_dataset(tmp_path, monkeypatch):
    """A run killed between the two would leave a folder that is refused."""
    write_json = files.write_json

    def killed(path, content):
        if path.name == "segments.json":
            raise KeyboardInterrupt
        return write_json(path, content)

    monkeypatch.setattr(files, "write_json", killed)
    with pytest.raises(KeyboardInterrupt):
        produce(make_scene(render={"outputs": ["S"]}), tmp_path, quiet=True)
    assert (tmp_path / "dataset.json").is_file()
    monkeypatch.setattr(files, "write_json", write_json)
    assert produce(make_scene(render={"outputs": ["S"]}), tmp_path, quiet=True).complete


def test_what_killed_runs_of_other_hosts_left_goes_when_nobody_else_can_be_at_work(tmp_path):
    left = tmp_path / ".a.png.otherhost-123-0.tmp"
    scene = make_scene(render={"outputs": ["D"]})
    layout = SimpleNamespace(root=tmp_path, metadata=tmp_path / "dataset.json")
    left.touch()
    folder.open_folder(scene, layout, alone=False)
    assert left.exists()
    folder.open_folder(scene, layout, alone=True)
    assert not left.exists()
