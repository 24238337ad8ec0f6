"""Rendering goes on while images are written, but never further ahead than the room there is."""

import gc
import sys
import threading
import time
import weakref
from types import SimpleNamespace

import numpy as np
import pytest
from standins import FlatFloorRenderer, make_scene, plan_render

from varos_warp.dataset.layout import Layout
from varos_warp.dataset.run.pipeline import GIVE_UP, SWITCH_S, Pipeline, Rendered, room
from varos_warp.dataset.timing import Clock
from varos_warp.dataset.write.develop import develop
from varos_warp.dataset.write.images import ImageJob, Store, Stored
from varos_warp.device.devices import usable_cores
from varos_warp.device.launcher import Launcher
from varos_warp.errors import InputError
from varos_warp.products.images.radiance import encode_color

JOBS = [ImageJob(frame, "L0", "D") for frame in range(12)]
PLAN = plan_render(make_scene(), None, [])


class Image:
    """Of a frame."""

    def __init__(self, frame):
        self.frame = frame


class Renderer(FlatFloorRenderer):
    """Takes a while, and knows which of its images are still held by anybody."""

    def __init__(self, seconds=0.0):
        super().__init__(make_scene())
        self.seconds, self.alive, self.most = seconds, weakref.WeakSet(), 0

    def render(self, T_w_v, camera, outputs, *, frame, **options):
        time.sleep(self.seconds)
        image = Image(frame)
        self.alive.add(image)
        self.most = max(self.most, len(self.alive))
        return SimpleNamespace(C=image, D=image, S=image)


class Writer:
    """Takes a while for each image."""

    def __init__(self, seconds=0.0, fail=()):
        self.render, self.denoisers = make_scene().render, {"A": "none", "B": "none"}
        self.seconds, self.fail, self.written, self.threads = seconds, fail, [], set()

    def write(self, job, letter, image, clock):
        with clock("encode"):
            time.sleep(self.seconds)
        if job.frame in self.fail:
            raise self.fail[job.frame]
        self.written.append(image.frame)
        self.threads.add(threading.current_thread())
        return Stored()


both = pytest.mark.parametrize("at_once", [1, 2])


def go(renderer, writer, jobs=JOBS, **options):
    return Pipeline(renderer, writer, PLAN, lambda frame: np.eye(4), lambda frame: None, **options).run(jobs)


def test_images_are_written_while_the_next_one_is_rendered():
    """Beside each other they take half of the sum and one image more."""
    start, clock = time.perf_counter(), Clock()
    writer = Writer(0.04)
    go(Renderer(0.04), writer, clock=clock)
    assert time.perf_counter() - start < 0.8 * (clock.seconds["render"] + clock.seconds["encode"])
    assert sorted(writer.written) == list(range(12))
    assert threading.current_thread() not in writer.threads


def test_a_slow_disk_holds_the_renderer_and_no_more_images_than_there_is_room_for():
    renderer, clock = Renderer(), Clock()
    go(renderer, Writer(0.05 * usable_cores()), clock=clock)
    gc.collect()
    assert renderer.most <= room(usable_cores()) + 1
    assert clock.seconds["wait"] > 0.4
    assert not renderer.alive


def test_a_fast_disk_never_holds_the_renderer():
    """Only the last image is waited for."""
    clock = Clock()
    go(Renderer(0.05), Writer(0.02), clock=clock)
    assert clock.seconds["wait"] < 0.4 * clock.seconds["render"]


def test_room_is_bounded_on_large_machines():
    assert [room(cores) for cores in (1, 2, 8, 16, 128)] == [2, 2, 4, 8, 8]


@both
def test_a_full_disk_ends_the_run_at_once(at_once):
    renderer = Renderer()
    with pytest.raises(InputError, match="no space"):
        go(
            renderer,
            Writer(fail={2: InputError("no space")}),
            [ImageJob(f, "L0", "D") for f in range(100)],
            at_once=at_once,
        )
    assert len(renderer.calls) < 10


@both
def test_failures_are_noted_and_the_rest_is_written(at_once):
    writer, said = Writer(fail={2: OSError("odd"), 7: MemoryError("none left")}), []
    made = go(Renderer(), writer, say=said.append, at_once=at_once)
    assert [(job.frame, str(error)) for job, error in made.failures] == [(2, "odd"), (7, "none left")]
    assert sorted(writer.written) == [0, 1, 3, 4, 5, 6, 8, 9, 10, 11]
    assert said == ["frame 2, camera L0 failed: odd", "frame 7, camera L0 failed: none left"]


def test_a_frame_of_which_no_image_can_be_written_counts_once():
    writer = Writer(fail={4: OSError("odd")})
    made = go(Renderer(), writer, [ImageJob(frame, "L0", "CDS") for frame in range(12)])
    assert [job.frame for job, _ in made.failures] == [4, 4, 4]
    assert len(writer.written) == 33


@both
def test_images_that_can_never_be_written_are_given_up(at_once):
    renderer = Renderer()
    with pytest.raises(OSError, match="odd"):
        go(renderer, Writer(fail=dict.fromkeys(range(12), OSError("odd"))), at_once=at_once)
    assert len(renderer.calls) <= GIVE_UP + room(usable_cores())


def test_two_images_are_under_way_and_only_one_of_them_uses_the_device():
    """While one waits for what it asked of the device, the other goes on; results are those of one by one."""
    using, waiting, most, launcher = set(), set(), [], Launcher("cpu")

    class Waiting(Renderer):
        def render(self, T_w_v, camera, outputs, *, frame, **options):
            with launcher.turn:
                for _ in range(3):
                    using.add(frame)
                    most.append((len(using), len(waiting)))
                    time.sleep(0.002)
                    using.remove(frame)
                    with launcher.aside():
                        waiting.add(frame)
                        time.sleep(0.01)
                        waiting.remove(frame)
                return super().render(T_w_v, camera, outputs, frame=frame, **options)

    writer = Writer()
    made = go(Waiting(), writer, at_once=2)
    assert sorted(writer.written) == list(range(12))
    assert sorted(entry["frame"] for entry in made.timings) == list(range(12))
    assert max(users for users, _ in most) == 1
    assert max(others for _, others in most) == 1


def test_what_failed_holds_no_buffers():
    """The frames of its traceback would, for as long as the failure is told of at the end."""
    renderer, held = Renderer(), []

    class Buffer:
        pass

    def render(*_, frame, **__):
        buffer = Buffer()
        held.append(weakref.ref(buffer))
        raise MemoryError(f"none left for {frame}")

    renderer.render = render
    made = Rendered()
    with pytest.raises(MemoryError, match="none left"):
        go(renderer, Writer(), made=made)
    gc.collect()
    assert len(made.failures) == len(held) == GIVE_UP
    assert all(ref() is None for ref in held[:-1])  # the last one is the exception that pytest holds


def test_an_interrupted_run_ends_with_what_is_under_way_written_and_known():
    made, writer = Rendered(), Writer(0.01)

    def stop():
        if len(made.timings) == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        go(Renderer(), writer, made=made, done=stop)
    assert sorted(writer.written) == [0, 1, 2, 3, 4]
    assert [entry["frame"] for entry in made.timings] == [0, 1, 2, 3, 4]


def test_each_image_type_is_written_by_itself(tmp_path):
    """Types of one frame go to different threads, so that a frame does not wait for its slowest file."""
    scene = make_scene()
    seen = []

    class Noted(Store):
        def write(self, job, letter, image, clock):
            seen.append((job.frame, letter))
            return super().write(job, letter, image, clock)

    noted = Noted(Layout.of(scene, tmp_path), scene, {"A": "none", "B": "none"})
    made = go(FlatFloorRenderer(scene), noted, [ImageJob(3, "L0", "ABCD")])
    assert sorted(seen) == [(3, "A"), (3, "B"), (3, "C"), (3, "D")]
    assert set(made.statistics) == {("L0", "A", 3), ("L0", "B", 3)}
    assert list(noted.missing([3])) == [ImageJob(3, "R0", "ABCD")]


@pytest.mark.parametrize("gain", [1.0, 0.013, 3217.5])
def test_looking_pixels_up_gives_what_computing_each_gives(gain):
    """Every half float but NaN, negative ones and infinity among them."""
    half = np.arange(1 << 16, dtype=np.uint16).view(np.float16)
    half = np.resize(half[~np.isnan(half)], (120, 177, 3))
    np.testing.assert_array_equal(develop(half, gain), encode_color(half, gain))


def test_how_long_threads_wait_for_each_other_is_as_before_once_a_run_ends():
    """Also one that fails: it holds for the whole process."""
    during = []

    class Noting(Renderer):
        def render(self, *args, **options):
            during.append(sys.getswitchinterval())
            return super().render(*args, **options)

    def stop():
        raise KeyboardInterrupt

    before = sys.getswitchinterval()
    with pytest.raises(KeyboardInterrupt):
        go(Noting(), Writer(), done=stop)
    assert during == [pytest.approx(SWITCH_S)]
    assert sys.getswitchinterval() == before
