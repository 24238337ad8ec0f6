"""Whatever ends a run, what it left under final names is whole, and the same command completes it to the same bytes."""

import errno
import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import time

import filelock
import pytest
import standins
from standins import FlatFloorRenderer, make_scene, tree

from benchmarks.soak import small_scene
from varos_warp.dataset import files
from varos_warp.dataset.run import pipeline
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.write import checksums, expose
from varos_warp.dataset.write import images as store
from varos_warp.errors import InputError

KILLS = 12
FRAMES = 24
posix = pytest.mark.skipif(sys.platform == "win32", reason="needs fork, signals and limits")


# ------------------------------------------------------------------- runs of their own, with the real renderer


def real_run(out, message=None, size=(16, 9), limit=None, frames=FRAMES, **render):
    """The body of a process; it ends with status 3 and a message in a file if the disk refuses a file."""
    if limit is not None:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    settings = {"integrator": "path", "max_scatterings": 1, "denoise": "none", "denoise_b": "none", **render}
    try:
        produce(small_scene(frames, size, **settings), out, device="cpu", quiet=True)
    except InputError as error:
        message.write_text(error.message)
        sys.exit(3)


def quick_run(out):
    """The body of a process: `written` anew, with the stand-ins, which leave nearly all of its time to the files."""
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(make_scene(), out, quiet=True)


@pytest.fixture(scope="module")
def start(processes):
    """Starts `real_run`, or another, in a process that has imported everything and shares nothing with other ones."""

    def started(*args, body=real_run, **options):
        process = processes.Process(target=body, args=args, kwargs=options)
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
    return (
        {name: data for name, data in tree(out).items() if not os.path.basename(name).startswith(".")}
        if out.exists()
        else {}
    )


def kill_after(process, out, count: int) -> bool:
    """Kill a run once so many files are there; whether it was still running."""
    while process.is_alive() and sum(len(names) for *_, names in os.walk(out)) < count:
        time.sleep(0.001)
    process.kill()
    process.join()
    return process.exitcode == -signal.SIGKILL


@posix
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


@posix
def test_files_that_cannot_grow_are_refused_in_one_message_and_the_rest_is_made_later(start, tmp_path):
    """The limit of a file's size, below that of A's EXR with all its layers: of the first frame already."""
    how = {"size": (64, 36), "linear_exr": True, "frames": 6}
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


@posix
@pytest.mark.parametrize("size", ["600k", "1m"])
def test_a_disk_that_is_full_is_refused_in_one_message_and_the_rest_is_made_when_there_is_space(
    start, whole, tmp_path, size
):
    """A disk of memory, where mounting one is permitted; it fills up among the tables, or among the images."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if (
        sys.platform != "linux"
        or subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", disk], capture_output=True, check=False
        ).returncode
    ):
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


@posix
def test_shards_that_start_together_plan_once_and_make_the_bytes_of_a_plain_run(processes, tmp_path, written):
    plans = tmp_path / "plans"
    plans.mkdir()
    shards = [processes.Process(target=slow_shard, args=(tmp_path / "out", plans, i)) for i in range(3)]
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
        patch.setenv("VAROS_WARP_CACHE", str(out.parent / "cache"))  # no other test has made the plan
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
    read, count = expose._read_half, []

    def interrupted(*image):
        count.append(image)
        if len(count) == 4:
            raise KeyboardInterrupt
        return read(*image)

    monkeypatch.setattr(expose, "_read_half", interrupted)
    with pytest.raises(KeyboardInterrupt):
        produce(make_scene(), tmp_path, quiet=True)
    monkeypatch.setattr(expose, "_read_half", read)
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


# ------------------------------------------------------------------------------ whose folder it is, and what is damaged


def test_a_run_goes_on_where_one_was_killed_before_its_first_file_had_a_name(written, tmp_path, monkeypatch):
    """Its sum is noted before: nothing else is there yet."""
    with monkeypatch.context() as patch:

        def note(record, name, value, vouch=checksums.Record.vouch):
            vouch(record, name, value)
            raise KeyboardInterrupt

        patch.setattr(checksums.Record, "vouch", note)
        standins.install(patch)
        with pytest.raises(KeyboardInterrupt):
            produce(make_scene(), tmp_path / "out", quiet=True)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["log"]
    standins.install(monkeypatch)
    produce(make_scene(), tmp_path / "out", quiet=True)
    assert tree(tmp_path / "out") == tree(written)


def test_a_folder_that_is_not_ours_is_refused_before_anything_in_it_is_touched(written, tmp_path):
    """A folder above datasets, with what live and killed runs of any host hide below it."""
    shutil.copytree(written, tmp_path / "below")
    for name in (".run.otherhost.1-0.0of1.lock", ".x.otherhost-1-0.tmp", f"below/.y.{files.HOST}-999999999-0.tmp"):
        (tmp_path / name).touch()
    before = {path: path.stat().st_mtime_ns for path in sorted(tmp_path.rglob("*"))}
    with pytest.raises(InputError, match="holds no dataset"):
        produce(make_scene(), tmp_path, quiet=True)
    assert {path: path.stat().st_mtime_ns for path in sorted(tmp_path.rglob("*"))} == before


@pytest.fixture
def copy(written, tmp_path):
    return shutil.copytree(written, tmp_path / "copy")


def flip(path):
    """Turn over a bit in the middle of a file."""
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


DAMAGED = [
    "vehicle0/cam0/A_exr/seq01_veh0_camL0_A-00000004.exr",
    "vehicle0/cam0/A/seq01_veh0_camL0_A-00000004.png",
    "vehicle0/cam1/D/seq01_veh0_camR0_D-00000002.png",
    "vehicle0/cam0/camL0_exposure_A.csv",
    "vehicle0/imu0/imu0_data.csv",
    "vehicle0/cam0/camL0_timestamps.csv",
    "README.txt",
    "contact_sheet.png",
]


@pytest.mark.parametrize("name", DAMAGED)
@pytest.mark.parametrize("damage", [flip, os.unlink])
def test_run_names_what_was_damaged_and_makes_it_again(written, copy, name, damage):
    """Though the damage is newer than the checksums."""
    damage(copy / name)
    summary = produce(make_scene(), copy, quiet=True)
    assert any(f"1 damaged or missing file, to be made again: {name}" in words for words in summary.messages)
    assert tree(copy) == tree(written)


def test_a_damaged_description_is_refused_for_all_else_follows_from_it(copy):
    text = (copy / "dataset.json").read_text()
    (copy / "dataset.json").write_text(text.replace('"spp": 8', '"spp": 9', 1))
    before = tree(copy)
    with pytest.raises(InputError, match=r"dataset\.json: is not as a run wrote it"):
        produce(make_scene(), copy, quiet=True)
    assert tree(copy) == before


@pytest.mark.parametrize("damage", [os.unlink, flip, lambda path: path.write_bytes(path.read_bytes()[:60])])
def test_run_makes_the_table_of_segments_again(tmp_path, damage):
    scene = make_scene(render={"outputs": ["S"]})
    produce(scene, tmp_path, quiet=True)
    whole = tree(tmp_path)
    damage(tmp_path / "segments.json")
    assert produce(scene, tmp_path, quiet=True).rendered == 0
    assert tree(tmp_path) == whole


def test_what_somebody_else_put_there_is_neither_vouched_for_nor_removed(copy):
    (copy / "notes.txt").write_text("mine")
    produce(make_scene(), copy, quiet=True)
    assert "notes.txt" not in (copy / "checksums").read_text()
    assert (copy / "notes.txt").read_text() == "mine"


def test_damage_in_a_dataset_that_is_not_complete_is_found_too(written, tmp_path):
    """Its sums stand in the log until the last run."""
    produce(make_scene(), tmp_path, quiet=True, shard=(0, 2))
    flip(tmp_path / DAMAGED[0])
    assert any(DAMAGED[0] in words for words in produce(make_scene(), tmp_path, quiet=True).messages)
    assert tree(tmp_path) == tree(written)


def test_an_image_that_no_run_wrote_is_made_again(written, tmp_path):
    """A whole image of the right name, whose sum nobody has noted."""
    produce(make_scene(), tmp_path, quiet=True, frames=slice(0, 4))
    source, target = (tmp_path / f"vehicle0/cam0/D/seq01_veh0_camL0_D-0000000{i}.png" for i in (1, 5))
    shutil.copyfile(source, target)
    produce(make_scene(), tmp_path, quiet=True)
    assert tree(tmp_path) == tree(written)


def test_a_shard_that_ends_a_damaged_dataset_vouches_for_nothing(tmp_path):
    produce(make_scene(), tmp_path, quiet=True, shard=(0, 2))
    name = tmp_path / DAMAGED[2]
    shutil.copyfile(name.with_name(name.name.replace("2.png", "4.png")), name)
    with pytest.raises(InputError, match=r"D-00000002\.png: is not as a run wrote it.*`run` again"):
        produce(make_scene(), tmp_path, quiet=True, shard=(1, 2))
    assert not (tmp_path / "checksums").exists()
    assert produce(make_scene(), tmp_path, quiet=True).complete


@pytest.mark.skipif(sys.platform == "win32", reason="permissions of folders")
def test_a_finished_dataset_on_a_disk_that_cannot_be_written_is_complete(copy, monkeypatch):
    """Every attempt to write fails as it does there."""
    os_access = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK and os_access(path, mode))

    def refused(*_, **__):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    for where, name in (
        (os, "replace"),
        (os, "unlink"),
        (pathlib.Path, "write_bytes"),
        (pathlib.Path, "mkdir"),
        (pathlib.Path, "unlink"),
        (filelock.FileLock, "acquire"),
    ):
        monkeypatch.setattr(where, name, refused)
    summary = produce(make_scene(), copy, quiet=True)
    assert summary.complete
    assert summary.rendered == 0
    monkeypatch.undo()
    (copy / DAMAGED[0]).unlink()
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        patch.setattr(os, "access", lambda path, mode: mode != os.W_OK and os_access(path, mode))
        patch.setattr(os, "replace", refused)
        with pytest.raises(InputError, match=r"cannot be written: Read-only file system"):
            produce(make_scene(), copy, quiet=True)
