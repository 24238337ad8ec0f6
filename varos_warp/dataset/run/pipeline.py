"""Rendering, with denoising and writing beside it.

The calling thread renders, or a few that take turns (`AT_ONCE`). A pool of threads denoises, encodes and writes, a task
for each image type: compression, EXR files and array arithmetic leave the interpreter free (measured: Pillow 13,
OpenEXR 3.5), so threads do, and nothing is copied to other processes. At most `room` frames are between the renderer
and the disk, which bounds the memory whichever the length of the sequence.
"""

import contextlib
import ctypes
import sys
import threading
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from varos_warp.dataset.timing import Clock
from varos_warp.dataset.write.images import ImageJob, Store, Stored
from varos_warp.device.devices import kind_of, usable_cores
from varos_warp.device.launcher import AT_ONCE, timed
from varos_warp.errors import InputError, counted
from varos_warp.render.decisions import Plan
from varos_warp.render.image import exposure
from varos_warp.render.moments import Motion, NextFrame
from varos_warp.render.options import of_run
from varos_warp.scene.description.image_types import OF_NEXT_FRAME, TWIN, WATER
from varos_warp.sim.clock import frame_time_ns

GIVE_UP = 3
"""Jobs in a row that cannot be made: something is broken for all of them."""


M_MMAP_THRESHOLD, LARGE = -3, 1 << 20
"""Number of a parameter of glibc, and its value [bytes]."""


def give_back_large_arrays() -> None:
    """Have glibc give large arrays back to the system when they are freed.

    It would come to keep most of them for later, in pieces that then do not fit: a run of 1280 x 720 on two cores takes
    a sixth more memory so, and no less time.
    """
    if sys.platform == "linux":
        with contextlib.suppress(AttributeError):  # another C library
            ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE)


SWITCH_S = 5e-4
"""How long one thread may keep Python's lock that another waits for [s]. With Python's own 5 ms those that encode keep
those that render from a GPU: Munkholmen's frames take 8 % longer on an H200."""


@contextlib.contextmanager
def taking_turns() -> Iterator[None]:
    """A ``with`` statement during which threads wait for each other no longer than that."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def room(cores: int) -> int:
    """Frames that may be waiting for the disk: enough to keep the cores busy, 1.4 GB at most at 1280 x 720."""
    return max(2, min(8, cores // 2))


@dataclass
class Rendered:
    """What is known after images were rendered and written."""

    statistics: dict[tuple[str, str, int], exposure.Statistics] = field(default_factory=dict)
    """What the exposure needs of A, B and P, by camera, letter and frame."""
    clamped: Counter[str] = field(default_factory=Counter)
    """Values that were cut to the largest half float, by letter."""
    empty: set[tuple[str, str, int]] = field(default_factory=set)
    """Images that show that no surface is in sight, by camera, letter and frame."""
    timings: list[dict] = field(default_factory=list)
    """Entries for the log, one for each image job."""
    failures: list[tuple[ImageJob, Exception]] = field(default_factory=list)
    """What could not be made, and why."""

    def add(self, other: "Rendered") -> None:
        """What a worker has rendered, too; its log and its failures it tells of itself."""
        self.statistics |= other.statistics
        self.clamped += other.clamped
        self.empty |= other.empty

    def of_nothing(self, cameras: Iterable[str]) -> Iterator[str]:
        """A sentence for each of the cameras that looked into open water, with the frames where it did."""
        for camera in cameras:
            frames = sorted({frame for name, _, frame in self.empty if name == camera})
            letters = sorted({letter for name, letter, _ in self.empty if name == camera})
            if frames:
                which = ", ".join(map(str, frames[:5])) + ", ..." * (len(frames) > 5)
                yield (
                    f"camera {camera} has no surface in sight in {counted(len(frames), 'frame')} "
                    f"({which}): {', '.join(letters)} hold nothing there"
                )


class _Threads(ThreadPoolExecutor):
    """Threads that render; when something goes wrong, what they have not begun they do not begin."""

    def __exit__(self, kind, error, trace) -> None:
        self.shutdown(cancel_futures=kind is not None)


class _HereAndNow(Executor):
    """Does what it is given in the calling thread, before it goes on."""

    def submit(self, function, /, *args):
        """A future that is done."""
        future = Future()
        try:
            future.set_result(function(*args))
        except Exception as error:
            future.set_exception(error)
        return future


@dataclass
class Pipeline:
    """Renders images and writes their files. Exposure is left to whoever knows all frames.

    An image that cannot be made is noted among the ``failures``, and the next one is tried, but `GIVE_UP` times in a
    row. Files get their names when they are whole, so whatever ends this, another call with what `Store.missing` then
    names goes on from there.
    """

    renderer: Any
    """The scene's `FrameRenderer`."""
    store: Store
    """Writes the images."""
    plan: Plan
    """Plan of the sequence."""
    T_w_v: Callable[[int], np.ndarray]
    """Pose [4, 4] of the vehicle at a frame, and for F at the one after the last."""
    motion: Callable[[int], Motion]
    """Motion of the vehicle around a frame, for shutters."""
    made: Rendered = field(default_factory=Rendered)
    """What is known already, to be added to; whole also when this is interrupted."""
    clock: Clock = field(default_factory=Clock)
    """Counts the time of the stages."""
    done: Callable[[], None] = lambda: None
    """Called after each image."""
    say: Callable[[str], None] = lambda message: None
    """Told what the user should know."""
    at_once: int | None = None
    """Images under way on the device; absent: those of `AT_ONCE`. With 1, the calling thread renders."""

    def __post_init__(self):
        self.noting = threading.Lock()
        self.in_a_row, self.last_done = 0, 0.0
        self.writers: Executor
        self.options = of_run(self.renderer.device, self.store.denoisers, self.store.render.linear_exr)

    def run(self, jobs: Iterable[ImageJob]) -> Rendered:
        """Render and write images.

        Raises:
            InputError: If the disk refuses a file.
            KeyboardInterrupt: As soon as the images under way are written.
        """
        cores, under_way = usable_cores(), deque()
        at_once = self.at_once or AT_ONCE[kind_of(self.renderer.device)]
        most = max(room(cores), at_once)
        with (
            taking_turns(),
            self.clock.rest("wait", "render"),
            ThreadPoolExecutor(cores, "write") as self.writers,
            _Threads(at_once, "render") if at_once > 1 else _HereAndNow() as pool,
        ):
            for job in jobs:
                if len(under_way) >= most:
                    self.collect(*under_way.popleft())
                under_way.append((job, pool.submit(self.render, job)))
                if under_way[-1][1].done() and under_way[-1][1].exception():
                    self.collect(*under_way.pop())
            while under_way:
                self.collect(*under_way.popleft())
        return self.made

    def render(self, job: ImageJob) -> list[Future]:
        """Render an image, and have it written."""
        try:
            with self.clock("render"):
                image, seconds = self.timed(job)
        except InputError:
            raise
        except Exception:
            with self.noting:
                self.done()
            raise
        writing = [
            self.writers.submit(self.store.write, job, letter, getattr(image, letter), self.clock)
            for letter in job.letters
        ]
        with self.noting:
            self.made.timings.append(
                {"frame": job.frame, "camera": job.camera, "outputs": job.letters, "seconds": round(seconds, 4)}
                | self.samples_of(job, image)
            )
            self.done()
        return writing

    def timed(self, job: ImageJob):
        """An image, and the seconds it took without those of compiling, nor those before the image before was done."""
        start = time.perf_counter()
        image, seconds = timed(
            self.renderer,
            lambda: self.renderer.render(
                self.T_w_v(job.frame),
                camera=job.camera,
                outputs=job.letters,
                frame=job.frame,
                following=self.following(job.frame) if not OF_NEXT_FRAME.isdisjoint(job.letters) else None,
                motion=self.motion(job.frame),
                time_ns=self.time_ns(job.frame),
                **self.plan.options_of(job.camera, job.frame),
                **self.options,
            ),
        )
        overlap = max(self.last_done - start, 0.0)
        self.last_done = time.perf_counter()
        return image, max(seconds - overlap, 0.0)

    def following(self, frame: int) -> NextFrame:
        """The next frame, for F."""
        return NextFrame(self.T_w_v(frame + 1), None, self.motion(frame + 1), self.time_ns(frame + 1))

    def time_ns(self, frame: int) -> int:
        """Time of a frame [ns]."""
        return frame_time_ns(frame, self.store.render.frame_rate_hz)

    def samples_of(self, job: ImageJob, image) -> dict:
        """What the log says of an image's samples; tells the user of any that were not numbers."""
        lost = {letter: getattr(getattr(image, letter, None), "lost_samples", 0) for letter in job.letters}
        lost = {letter: count for letter, count in lost.items() if count}
        for letter, count in lost.items():
            self.say(
                f"frame {job.frame}, camera {job.camera}: at least {count} samples of {letter} were infinite or "
                "not a number and count as black"
            )
        spp = getattr(getattr(image, WATER, None) or getattr(image, TWIN, None), "spp", None)
        return ({"spp": round(spp, 2)} if spp else {}) | ({"lost_samples": sum(lost.values())} if lost else {})

    def collect(self, job: ImageJob, rendering: Future) -> None:
        """Wait until an image is rendered and written, and note what is known of it."""
        failed = rendering.exception()
        futures = [rendering] if failed else rendering.result()
        errors = [error for error in map(Future.exception, futures) if error]
        for error in errors:
            if isinstance(error, InputError) or not isinstance(error, Exception):
                raise error
        for letter, future in zip(job.letters, () if failed else futures, strict=not failed):
            if not future.exception():
                stored: Stored = future.result()
                self.made.clamped[letter] += stored.clamped
                if stored.empty:
                    self.made.empty.add((job.camera, letter, job.frame))
                if stored.statistics is not None:
                    self.made.statistics[job.camera, letter, job.frame] = stored.statistics
        if errors:
            self.fail(job, *errors)
        else:
            self.in_a_row = 0

    def fail(self, job: ImageJob, *errors: Exception) -> None:
        """Note what kept a job from being made, or give up: jobs count, however many of their images fail."""
        for error in errors:
            traceback.clear_frames(error.__traceback__)  # which hold images, and buffers on the device
            self.made.failures.append((job, error))
            self.say(f"frame {job.frame}, camera {job.camera} failed: {error}")
        self.in_a_row += 1
        if self.in_a_row >= GIVE_UP:
            raise errors[0]
