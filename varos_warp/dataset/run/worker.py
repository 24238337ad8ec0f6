"""What a worker process of a cluster does: it holds one scene on its device and makes images of it (cluster.py).

Dask calls it from several threads: one renders, the others write what was rendered before.
"""

import os
import platform
import signal
import socket
import tempfile
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
from distributed import WorkerPlugin, get_worker
from filelock import FileLock, Timeout

from varos_warp.dataset import files
from varos_warp.dataset.run.engine import Engine, Stopped
from varos_warp.dataset.run.pipeline import Rendered
from varos_warp.dataset.run.timing import BESIDE, Clock
from varos_warp.dataset.write import texts as writers
from varos_warp.dataset.write.images import ImageJob, Store
from varos_warp.errors import InputError
from varos_warp.render.image.denoise import METHODS, available_method

_turn = threading.RLock()
"""Whose turn it is to use the device."""
_claimed: list[FileLock] = []
"""The device of this process, held as long as it lives."""
_device: str | None = None


def dask_setup(_worker) -> None:
    """As a local worker starts: Ctrl-C, which the terminal sends to all processes, is for the owner to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


# ------------------------------------------------------------------------------------------------- what a worker is


@dataclass(frozen=True)
class Facts:
    """What the owner wants to know of a worker."""

    host: str
    cores: int
    """That it may run on, together with the other workers there."""
    device: str
    model: str
    versions: dict[str, str]
    denoisers: dict[str, str]
    """What stands in for each denoiser."""
    sees: bool
    """Whether it has the owner's folder."""


def greet(token: Path, device: str) -> Facts:
    """Take a device, and tell.

    Args:
        token: A file in the owner's folder.
        device: ``auto``, ``cpu`` or ``cuda:N``.

    Raises:
        InputError: If there is no such device.
    """
    import warp as wp

    from varos_warp.render.launch import usable_cores

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the owner says what stands in for what
        denoisers = {method: available_method(method) for method in METHODS}
    name = take_device(device)
    return Facts(socket.gethostname(), usable_cores(), name, wp.get_device(name).name, writers.versions(), denoisers,
                 token.exists())


def take_device(asked: str) -> str:
    """The device of this process; ``auto`` is a GPU that no other worker of the host has, while there are such."""
    global _device
    import warp as wp

    from varos_warp.scene.device import resolve_device

    with _turn:
        gpus = wp.get_cuda_devices() if asked == "auto" else []
        if gpus and _device is None:
            _device = gpus[claim([device.uuid for device in gpus])].alias
        return _device if gpus else resolve_device(asked)


def claim(names: list[str]) -> int:
    """Which of the names this process takes: one that the fewest other processes of the host have taken."""
    folder = Path(tempfile.gettempdir()) / f"varos_warp-{platform.node()}-{os.getuid() if hasattr(os, 'getuid') else 0}"
    with suppress(OSError):
        folder.mkdir(exist_ok=True)
    for turn in count():
        for i, name in enumerate(names):
            lock = FileLock(folder / f"{name}.{turn}.lock")
            try:
                lock.acquire(timeout=0)
            except Timeout:
                continue
            _claimed.append(lock)
            return i


# ------------------------------------------------------------------------------------------------------ one run's work


class Site(WorkerPlugin):
    """What a worker must know of a run, sent once to each; and the scene on its device.

    Args:
        name: Of the run.
        scene: The scene.
        poses: T_w_v [4, 4] of every frame of the sequence.
        device: As it was asked for.
        kind: ``cpu`` or ``cuda``: what it must be.
        cores: That a worker of each host may use.
    """

    def __init__(self, name: str, scene, poses: list[np.ndarray], device: str, kind: str, cores: dict[str, int]):
        self.name, self.scene, self.poses, self.device, self.kind, self.cores = name, scene, poses, device, kind, cores
        self.versions, self.engine, self.stopped = writers.versions(), None, False

    def setup(self, worker) -> None:
        """Nothing yet: this runs where the worker talks to the scheduler."""

    def teardown(self, worker) -> None:
        """Leave the device to others."""
        self.engine = None

    def opened(self, path=None) -> tuple[Engine, list[str]]:
        """The engine, once its scene is on the device, and what looks wrong in the scene.

        Raises:
            Stopped: If the run has ended meanwhile.
        """
        with _turn:
            found = []
            if not self.stopped and self.engine is None:
                found = self._load(path)
            if self.stopped:
                raise Stopped
            return self.engine, found

    def _load(self, path) -> list[str]:
        """Bring the scene onto the device; see `Engine.load`."""
        from varos_warp.scene.device import kind_of

        check_versions(writers.versions(), files.HOST, self.versions)  # it may have come late
        device = take_device(self.device)
        if kind_of(device) != self.kind:
            raise different_kinds(f"{kind_of(device)} on {files.HOST}, {self.kind} elsewhere", self.device)
        engine = Engine(device, cores=self.cores.get(socket.gethostname()))
        found = engine.load(self.scene, self.poses, path)
        self.engine = engine
        return found

    def stop(self) -> None:
        """Begin no more images, and bring no scene to the device."""
        self.stopped = True
        if self.engine is not None:
            self.engine.stop()


def different_kinds(where: str, asked: str) -> InputError:
    """What a user is told of CPU and GPU side by side."""
    return InputError(f"the workers have different kinds of device: {where}", key="--device", value=asked,
                      remedy="Give cpu, or start workers with GPUs only: images must not differ in noise.")


def check_versions(worker: dict[str, str], host: str, owner: dict[str, str] | None = None) -> None:
    """Refuse a worker that would make other bytes.

    Raises:
        InputError: Naming the first package that differs.
    """
    for name, version in (owner or writers.versions()).items():
        if name != "python" and worker.get(name) != version:
            raise InputError(f"a worker on {host} has {name} {worker.get(name, 'absent')}, this process has {version}",
                             key="--scheduler", remedy="Install the same versions for the workers.")


def site_of(name: str) -> Site:
    """The site of a run on this worker."""
    return get_worker().plugins[name]


@dataclass
class Opened:
    """A scene on a worker's device."""

    segments: list[dict]
    warnings: list[str] = field(default_factory=list)


def open_site(name: str, path=None) -> Opened:
    """Bring the scene onto the device."""
    engine, found = site_of(name).opened(path)
    return Opened(list(engine.segments), found)


def plan_site(name: str):
    """The `Plan` of the sequence."""
    with _turn:
        return site_of(name).opened()[0].plan()


def stop_site(name: str, dask_worker) -> None:
    """Begin no more images of a run."""
    dask_worker.plugins[name].stop()


@dataclass
class Reply:
    """What became of an image job."""

    worker: str
    made: Rendered = field(default_factory=Rendered)
    seconds: dict[str, float] = field(default_factory=dict)
    messages: list[str] = field(default_factory=list)
    compile_seconds: float = 0.0
    """All that the worker has spent so far."""


def make_images(name: str, store: Store, plan: dict, job: ImageJob) -> Reply:
    """Render and write the images of a job.

    Raises:
        InputError: If the disk refuses a file, or the folder is not there.
    """
    if not store.layout.metadata.exists():
        raise InputError(f"is not there for a worker on {files.HOST}", file=store.layout.metadata,
                         remedy="Give a folder on a file system that all workers share.")
    engine, _ = site_of(name).opened()
    reply, clock = Reply(get_worker().address), Clock()
    engine.render(store, plan, [job], made=reply.made, clock=clock, say=reply.messages.append,
                  turn=partial(_caught, reply.messages))
    for entry in reply.made.timings:
        entry["worker"] = f"{files.HOST}-{os.getpid()}"
    reply.seconds = {stage: clock.seconds[stage] for stage in ("render", *BESIDE)}
    reply.compile_seconds = engine.compile_seconds
    return reply


@contextmanager
def _caught(messages: list[str]) -> Iterator[None]:
    """A turn at the device; what Python warns of meanwhile becomes messages to the owner."""
    with _turn, warnings.catch_warnings(record=True) as caught:
        yield
        messages += [str(warning.message) for warning in caught]
