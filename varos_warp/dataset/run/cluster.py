"""Rendering on many workers with dask.distributed: processes of this host, one for each GPU, or those of a scheduler.

The owner, which is the process of the command, simulates, writes the tables and exposes; the workers load the scene
once each, the first of them plans, and every image job is a task. Workers write the images themselves, so they need the
owner's folder (and the scene's files) on a file system that all share.
"""

import contextlib
import importlib.util
import logging
import os
import re
import signal
import threading
import time
import uuid
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from multiprocessing import resource_tracker
from pathlib import Path

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.run.pipeline import GIVE_UP, Rendered, room
from varos_warp.dataset.run.timing import Clock
from varos_warp.dataset.write.images import ImageJob, Store
from varos_warp.errors import InputError, SchedulerGone
from varos_warp.render.planner.by_frame import PLANNED

CONNECT_S = 5.0
"""A scheduler answers in this time, or is not there."""
START_S = 60.0
"""Workers come within this time, at the start and after all have died."""
PATIENCE_S = 3.0
"""So long it is not said that they are waited for."""
SETTLE_S = 1.0
"""A scheduler's workers are taken for all when no more have come for so long; later ones get work, too."""
DRAIN_S = 10.0
"""What is under way at an interruption has so long to be written."""
POLL_S = 0.02
POSIX = hasattr(signal, "pthread_sigmask")
SILENT = logging.CRITICAL + 1
"""Level of Dask's log."""
HABITS = {"distributed.worker.profile.enabled": False,
          "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None}
"""Defaults of Dask that workers started here do without. Its profiler holds up all threads a hundred times a second.
Its threshold, as any would, keeps the C library from learning to reuse the memory of large arrays: writing a frame of
1280 x 720 meets 25 000 page faults instead of 800, and a worker makes an eighth fewer frames (docs/long_runs.md)."""
NEEDED = ("spp", "spp_by_frame", *PLANNED)
"""What workers need of a plan."""


@contextlib.contextmanager
def held_back() -> Iterator[None]:
    """Interruptions wait until processes have been started, for Dask cannot be interrupted then; a second one does not.

    The processes do not see the terminal's: they begin with SIGINT blocked, as the thread that starts them.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[int] = []

    def hold(number, _frame):
        held.append(number)
        if len(held) > 1:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, hold) for number in (signal.SIGINT, signal.SIGTERM)}
    if POSIX:
        resource_tracker.ensure_running()  # where it is begun later, it unblocks SIGINT
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        if POSIX:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in before.items():
            signal.signal(number, handler)
        if held:
            signal.raise_signal(held[0])


class Cluster:
    """Renders on many workers; in the place of an `Engine`.

    Args:
        device: ``auto``: a GPU for each worker, the CPU where there is none; ``cpu`` or ``cuda:N``: that for all.
        workers: Start so many processes on this host.
        scheduler: Use the workers of this scheduler, ``dask://HOST:PORT``.

    Raises:
        InputError: If dask.distributed is not installed, or there is no such scheduler.
    """

    def __init__(self, device: str = "auto", workers: int | None = None, scheduler: str | None = None):
        if importlib.util.find_spec("distributed") is None:
            raise InputError("dask.distributed is not installed", key="--workers" if workers else "--scheduler",
                             remedy="Install it with `pip install varos_warp[cluster]`.")
        if workers is not None and scheduler is not None:
            raise InputError("cannot be given together", key="--workers and --scheduler", remedy="Give one of them.")
        if workers is not None and workers < 1:
            raise InputError("must be at least 1", key="--workers", value=workers)
        if scheduler is not None and not re.search(r":\d+$", scheduler):
            raise InputError("names no port", key="--scheduler", value=scheduler,
                             remedy="Give the address that `dask scheduler` prints, as dask://HOST:PORT.")
        self.asked, self.workers, self.scheduler = device, workers, scheduler
        self.name = f"varos_warp-{uuid.uuid4().hex[:12]}"
        self.local = self.client = None
        self.facts: dict[str, object] = {}
        self.compiled: dict[str, float] = {}
        self._events: list[dict] = []
        self._watched = self._seen = time.monotonic()
        if scheduler is not None:
            self._connect(scheduler)

    def __enter__(self) -> "Cluster":
        return self

    def __exit__(self, *_) -> None:
        """Leave no process behind, and nothing of the run on workers that go on."""
        with contextlib.suppress(Exception):
            if self.client is not None and self.local is None:
                self.client.unregister_worker_plugin(self.name)
        with contextlib.suppress(Exception):
            if self.client is not None:
                self.client.close()
        if self.local is not None:
            self.local.close()
        self.client = self.local = None

    # ------------------------------------------------------------------------------------------------------- starting

    def _connect(self, address) -> None:
        """Connect to a scheduler."""
        from distributed import Client  # which sets its own levels of logs

        for name in ("distributed", "distributed.client"):
            logging.getLogger(name).setLevel(SILENT)  # what happens is told in our words
        try:
            where = address.replace("dask://", "tcp://", 1) if isinstance(address, str) else address
            self.client = Client(where, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError("no Dask scheduler answers there", key="--scheduler", value=address,
                             remedy="Start one with `dask scheduler`, and give the address that it prints, as "
                                    "dask://HOST:PORT.") from error
        self.client.subscribe_topic("all", lambda event: self._events.append(event[1]))

    def start(self, root: Path, say: Callable[[str], None] = lambda message: None) -> None:
        """Start or find the workers, and see that they can do the work.

        Args:
            root: The owner's folder.
            say: Told what the user should know.

        Raises:
            InputError: If there are none, or they cannot see the folder, or they are not alike.
        """
        from varos_warp.dataset.run import worker

        if self.scheduler is None:
            self._start_workers()
        self._wait_for_workers(say)
        token = root.resolve() / f".{self.name}.{files.HOST}-{os.getpid()}-0.tmp"  # a killed run's is swept
        with files.writing(token):
            token.touch()
        try:
            self.facts = self._ask_all(partial(worker.greet, token, self.asked))
        finally:
            token.unlink(missing_ok=True)
        self._check(root)
        self.order = sorted(self.facts, key=lambda address: (self.facts[address].device, address))
        """Addresses; the first one plans."""

    def _start_workers(self) -> None:
        """Start the processes; each writes while it renders, and is started again where it dies."""
        import dask
        from distributed import LocalCluster
        from distributed.gc import disable_gc_diagnosis

        from varos_warp.render.launch import usable_cores

        cores = max(1, usable_cores() // self.workers)
        # without the dashboard it still serves HTTP, at a port that another run would miss
        quiet = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
        with dask.config.set(HABITS), held_back():
            self.local = LocalCluster(
                n_workers=self.workers, threads_per_worker=1 + room(cores), processes=True, scheduler_kwargs=quiet,
                memory_limit=None, silence_logs=SILENT, preload=["varos_warp.dataset.run.worker"])
        # its hook on the garbage collection swallows a Ctrl-C that comes during one
        disable_gc_diagnosis()
        self._connect(self.local)

    def _wait_for_workers(self, say: Callable[[str], None]) -> None:
        """Wait for those that were started; of a scheduler's, until no more come."""
        start, settled, known, wanted, patient = time.monotonic(), 0.0, -1, self.workers or 1, True
        while known < wanted or (self.local is None and time.monotonic() < settled):
            time.sleep(POLL_S)
            number = len(self.addresses())
            if number != known:
                known, settled = number, time.monotonic() + SETTLE_S
            if patient and known < wanted and time.monotonic() > start + PATIENCE_S:
                say(f"waiting for workers of {self.scheduler or 'this host'}")
                patient = False
            if known < wanted and time.monotonic() > start + START_S:
                if self.local is not None:
                    raise RuntimeError(f"{known} of {wanted} workers have started within {START_S:.0f} s")
                raise InputError(f"has no workers after {START_S:.0f} s", key="--scheduler", value=self.scheduler,
                                 remedy="Start some with `dask worker`.")

    def _ask_all(self, function: Callable) -> dict:
        """What a function returns on every worker, by its address."""
        try:
            return self.client.run(function)
        except (ImportError, AttributeError) as error:
            raise InputError(f"a worker cannot do this work: {error}", key="--scheduler", value=self.scheduler,
                             remedy="Install varos_warp in the same version for the workers.") from error

    def _check(self, root: Path) -> None:
        from varos_warp.dataset.run.worker import check_versions, different_kinds
        from varos_warp.scene.device import kind_of

        for facts in self.facts.values():
            check_versions(facts.versions, facts.host)
            if not facts.sees:
                raise InputError(f"a worker on {facts.host} does not see this folder", file=root.resolve(),
                                 remedy="Give a folder on a file system that all workers share, under the same path.")
        kinds = {kind_of(facts.device): facts.host for facts in self.facts.values()}
        if len(kinds) > 1:
            where = " and ".join(f"{kind} on {host}" for kind, host in kinds.items())
            raise different_kinds(where, self.asked)

    # ---------------------------------------------------------------------------------------------- as an engine does

    def available_method(self, asked: str) -> str:
        """The denoiser that stands in for another one on the workers, or this one itself."""
        return self.facts[self.order[0]].denoisers[asked]

    @property
    def devices(self) -> list[dict[str, str]]:
        """Name and model of every device that renders; the first is the one that plans."""
        return [{"name": self.facts[a].device, "model": self.facts[a].model} for a in self.order]

    @property
    def compile_seconds(self) -> float:
        """Spent so far on compiling kernels, by all workers together."""
        return sum(self.compiled.values())

    def load(self, scene, poses: Sequence[np.ndarray], path=None) -> list[str]:
        """Bring the scene to every worker and onto its device; see `Engine.load`."""
        from distributed import fire_and_forget

        from varos_warp.dataset.run import worker
        from varos_warp.scene.device import kind_of

        workers = Counter(facts.host for facts in self.facts.values())
        cores = {facts.host: max(1, facts.cores // workers[facts.host]) for facts in self.facts.values()}
        site = worker.Site(self.name, scene, list(poses), self.asked, kind_of(self.devices[0]["name"]), cores)
        self.client.register_plugin(site, name=self.name)
        tasks = [self.submit(worker.open_site, self.name, *(() if i else (path,)), at=address)
                 for i, address in enumerate(self.order)]
        fire_and_forget(tasks[1:])  # they need not be done when the first worker plans
        opened = self.result(tasks[0])
        self.segments = opened.segments
        return opened.warnings

    def plan(self):
        """The `Plan` of the sequence, from the first worker."""
        from varos_warp.dataset.run import worker

        return self.result(self.submit(worker.plan_site, self.name, at=self.order[0]))

    def render(self, store: Store, plan: dict, jobs: Sequence[ImageJob], *, made: Rendered, clock: Clock,
               done: Callable[[], None] = lambda: None, say: Callable[[str], None] = lambda message: None) -> None:
        """Render images on the workers; the arguments are those of `render_frames`.

        Raises:
            InputError: If the disk refuses a file.
            RuntimeError: If `GIVE_UP` images in a row fail on every worker, or there is no worker left.
            KeyboardInterrupt: As soon as the images under way are written.
        """
        store = replace(store, layout=replace(store.layout, root=store.layout.root.resolve()))
        needed = {key: plan[key] for key in NEEDED if key in plan}
        run = _Run(self, store, needed, made, clock, done, say)
        try:
            with clock("wait"):
                run.all(list(jobs))
        finally:
            files.sweep(store.layout.root)  # what killed workers of this host left

    # -------------------------------------------------------------------------------------------------------- helpers

    def submit(self, function: Callable, *args, at: str | None = None):
        """A task; ``at`` a worker, if it lives."""
        where = {} if at is None else {"workers": [at], "allow_other_workers": True}
        return self.client.submit(function, *args, pure=False, **where)

    def result(self, future):
        """What a task returned; what Dask raises becomes words."""
        from distributed import CancelledError, KilledWorker
        from distributed.comm import CommClosedError

        try:
            while not future.done():
                self.watch()
                time.sleep(POLL_S)
            return future.result()
        except (CancelledError, CommClosedError) as error:
            raise SchedulerGone("the scheduler has gone; the same command goes on") from error
        except KilledWorker as error:
            raise RuntimeError(f"{error.allowed_failures + 1} workers died of it") from error

    def watch(self) -> None:
        """See that there are workers.

        Raises:
            SchedulerGone: If there have been none for a while.
        """
        now = time.monotonic()
        if now - self._watched < 1.0:
            return
        self._watched = now
        if self.addresses():
            self._seen = now
        elif now - self._seen > START_S:
            raise SchedulerGone(f"there has been no worker for {START_S:.0f} s; the same command goes on")

    def addresses(self) -> list[str]:
        """Of the workers there are."""
        return list(self.client.scheduler_info(n_workers=-1)["workers"])

    def deaths(self) -> Iterator[str]:
        """Addresses of workers that died since it was asked last."""
        while self._events:
            event = self._events.pop(0)
            if event.get("action") == "remove-worker" and not event.get("expected"):
                yield event["worker"]


class _Run:
    """State of `Cluster.render`."""

    def __init__(self, cluster: Cluster, store: Store, plan: dict, made: Rendered, clock: Clock, done, say):
        from varos_warp.dataset.run.worker import make_images

        self.cluster, self.made, self.clock, self.done, self.say = cluster, made, clock, done, say
        self.call = partial(make_images, cluster.name, store, plan)
        self.jobs: dict[str, tuple[object, ImageJob]] = {}
        """Futures by their keys."""
        self.failed: dict[str | None, list[ImageJob]] = defaultdict(list)
        """In a row, by the address of the worker; None: of those that died of them."""
        self.retired: set[str] = set()
        self.counted: set[ImageJob] = set()
        self.said: set[str] = set()

    def all(self, jobs: list[ImageJob]) -> None:
        """The first image alone, which compiles the kernels for all; then the rest, as workers have time for it."""
        from distributed import as_completed

        self.queue = as_completed(loop=self.cluster.client.loop)
        self.submit(jobs[0])
        try:
            for number, future in enumerate(self.completed()):
                self.collect(future)
                if number == 0:
                    for job in jobs[1:]:
                        self.submit(job)
        except SchedulerGone:
            raise
        except BaseException:
            self.drain()
            raise

    def submit(self, job: ImageJob) -> None:
        """Queue a job."""
        future = self.cluster.submit(self.call, job)
        self.jobs[future.key] = (future, job)
        self.queue.add(future)

    def completed(self) -> Iterator:
        """Futures as they end."""
        while not self.queue.is_empty():
            batch = self.queue.next_batch(block=False)
            for address in self.cluster.deaths():
                if address not in self.retired:
                    self.tell(f"the worker {address} died; its images are made again")
            if not batch:
                self.cluster.watch()
                time.sleep(POLL_S)
            yield from batch

    def collect(self, future) -> None:
        """What became of a job."""
        job = self.jobs.pop(future.key)[1]
        try:
            reply = self.cluster.result(future)
        except (InputError, SchedulerGone):
            raise
        except Exception as error:
            self.tell(f"frame {job.frame}, camera {job.camera} failed: {error}")
            self.fail(job, [(job, error)], None)
            return
        self.cluster.compiled[reply.worker] = reply.compile_seconds
        self.clock.add(reply.seconds)
        for message in reply.messages:
            self.tell(message)
        failures, reply.made.failures = reply.made.failures, []
        self.made.add(reply.made)
        if failures:
            self.fail(job, failures, reply.worker)
        else:
            self.failed[reply.worker].clear()
            self.count(job)

    def fail(self, job: ImageJob, failures: list, address: str | None) -> None:
        """Note a failure; a worker that fails and fails is sent away, and others try what it could not do."""
        self.made.failures += failures
        self.failed[address].append(job)
        self.count(job)
        if len(self.failed[address]) < GIVE_UP and address not in self.retired:
            return
        if address not in self.retired:
            self.retire(address, failures[0][1])
        again = set(self.failed.pop(address))
        self.made.failures = [failure for failure in self.made.failures if failure[0] not in again]
        for job in again:
            self.submit(job)

    def retire(self, address: str | None, error: Exception) -> None:
        """Send a worker away.

        Raises:
            Exception: The error, if there is no other.
        """
        if address is None or set(self.cluster.addresses()) <= {address, *self.retired}:
            raise error
        self.retired.add(address)
        self.tell(f"the worker {address} failed {GIVE_UP} times in a row and is left out; others try: {error}")
        self.cluster.client.retire_workers([address], close_workers=True, remove=True)

    def count(self, job: ImageJob) -> None:
        """Advance once for each job."""
        if job not in self.counted:
            self.counted.add(job)
            self.done()

    def tell(self, message: str) -> None:
        """Say what was not said before."""
        if message not in self.said:
            self.said.add(message)
            self.say(message)

    def drain(self) -> None:
        """Begin nothing more, and wait for what is under way."""
        from varos_warp.dataset.run import worker

        client, deadline = self.cluster.client, time.monotonic() + DRAIN_S
        self.say("ending; what is under way is written first")
        with contextlib.suppress(Exception):  # workers have more images than are under way on their devices
            client.run(worker.stop_site, self.cluster.name, on_error="ignore")
        begun = {key for keys in client.processing().values() for key in keys}
        client.cancel([future for key, (future, _) in self.jobs.items() if key not in begun])
        begun = [self.jobs[key][0] for key in begun & self.jobs.keys()]
        while not all(future.done() for future in begun) and time.monotonic() < deadline:
            time.sleep(POLL_S)
