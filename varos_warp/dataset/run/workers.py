"""Worker processes of this host, each with a share of the work; a worker that dies is started again.

Nothing listens anywhere: a worker tells its parent how it goes through a pipe, and ends when the parent does.
"""

import _thread
import contextlib
import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from multiprocessing import connection, resource_tracker
from typing import Any

from varos_warp.dataset.progress import Console, Progress
from varos_warp.device.devices import resolve_device
from varos_warp.errors import InputError, RunFailed

RESTARTS = 3
"""A worker that dies is started again so often."""
GRACE_S = 10.0
"""What is under way when the parent is killed has so long to be written."""
SIGNALS = {signal.SIGINT, signal.SIGTERM}
_context = multiprocessing.get_context("spawn")


def device_of_worker(asked: str, index: int) -> str:
    """``auto`` is the next GPU for each worker, as long as there are some, and then the first one again."""
    import warp as wp

    gpus = wp.get_cuda_device_count() if asked == "auto" else 0
    return f"cuda:{index % gpus}" if gpus else resolve_device(asked)


def run_in_workers(
    count: int, work: Callable, arguments: tuple, *, done: Callable[[int], None], tell: Callable[[str], None]
) -> list[Any]:
    """What ``work(*arguments, shard=(i, count), console=...)`` returns in each of so many processes.

    ``work`` is a function of a module. ``done`` is told the steps that a worker has done, ``tell`` each message of any
    worker, once where several have the same.

    Raises an `InputError` of any worker, and a KeyboardInterrupt, when what was under way is done and all processes
    have ended; `RunFailed` if workers have failed, or died too often, when the others have done their work.
    """
    told: set[str] = set()

    def tell_once(words: str) -> None:
        if words not in told:
            told.add(words)
            tell(words)

    workers = [_Worker((i, count), work, arguments, {"done": done, "tell": tell_once}) for i in range(count)]
    try:
        for worker in workers:
            worker.start()
        while listening := {worker.pipe: worker for worker in workers if worker.pipe is not None}:
            for pipe in connection.wait(list(listening)):
                listening[pipe].listen()
    finally:
        _end([worker.process for worker in workers if worker.process is not None])
    failures = [str(worker.failure) for worker in workers if worker.failure is not None]
    if failures:
        raise RunFailed("; ".join(failures))
    return [worker.result for worker in workers]


class _Worker:
    """A worker as its parent sees it: the i-th of n; ``hear`` is what to call with each kind of message."""

    def __init__(self, shard: tuple[int, int], work: Callable, arguments: tuple, hear: dict[str, Callable]):
        self.shard, self.body, self.hear = shard, (work, arguments), hear
        self.process = self.pipe = self.result = self.failure = None
        self.deaths, self.ended = 0, False

    def start(self) -> None:
        """Start the process."""
        self.pipe, its_end = _context.Pipe(duplex=False)
        with _signals_held():
            self.process = _context.Process(target=_live, args=(its_end, self.shard, *self.body), daemon=True)
            self.process.start()
        its_end.close()

    def listen(self) -> None:
        """Take in one message, or that there will be no more."""
        try:
            kind, content = self.pipe.recv()
        except (EOFError, OSError):
            self._gone()
            return
        if kind in self.hear:
            self.hear[kind](content)
            return
        if isinstance(content, InputError):
            raise content
        self.ended = True
        setattr(self, kind, content)

    def _gone(self) -> None:
        """Start it again, unless it has done its work or died too often."""
        self.pipe.close()
        self.pipe = None
        self.process.join()
        if self.ended:
            return
        self.deaths += 1
        code, name = self.process.exitcode, f"worker {self.shard[0]} of {self.shard[1]}"
        reason = signal.Signals(-code).name if code < 0 else f"status {code}"
        if self.deaths > RESTARTS:
            self.failure = RunFailed(f"{name} died {self.deaths} times, the last time with {reason}")
            return
        self.hear["tell"](f"note: {name} died with {reason} ({self.deaths}) and is started again")
        self.start()


@contextlib.contextmanager
def _signals_held() -> Iterator[None]:
    """Hold interruptions back while a process starts; it begins with them held back.

    Ctrl-C stays so in it: the terminal sends it to all processes of a run, and it is for the parent to handle.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # where it is begun later, it lets them through
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end(processes: list) -> None:
    """Wait until all have ended what is under way; if that is interrupted, too, they are killed."""
    try:
        for process in processes:
            process.terminate()  # a signal, as for any run; one that has ended gets none
        for process in processes:
            process.join()
    finally:
        for process in processes:
            process.kill()
            process.join()


# ------------------------------------------------------------------------------------------------ in a worker's process


class _ToParent(Console):
    """Tells the parent what others tell the user."""

    def __init__(self, pipe: connection.Connection):
        super().__init__(quiet=True)
        self._pipe, self._turn = pipe, threading.Lock()

    def send(self, kind: str, content) -> None:
        """Send a message, from any thread."""
        with self._turn, contextlib.suppress(BrokenPipeError):  # without its parent, this process ends soon
            self._pipe.send((kind, content))

    def tell(self, words: str) -> None:
        """Have the parent tell the user."""
        self.send("tell", words)

    def progress(self, label: str, total: int, unit: str = "frames") -> Progress:
        """Have the parent count the steps."""
        return Progress(label, total, unit, quiet=True, also=lambda steps: self.send("done", steps))


def _live(pipe: connection.Connection, shard: tuple[int, int], work: Callable, arguments: tuple) -> None:
    """The life of a worker."""
    console = _ToParent(pipe)
    warnings.showwarning = lambda message, *_: console.tell(f"note: {message}")
    _take_cores(*shard)
    try:
        signal.signal(signal.SIGTERM, _interrupt)
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})  # which may have come already
        threading.Thread(target=_end_with_parent, daemon=True).start()
        try:
            message = "result", work(*arguments, shard=shard, console=console)
        except (InputError, RunFailed) as error:
            message = "failure", error
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # there is nothing left to interrupt
    except KeyboardInterrupt:
        sys.exit(130)
    console.send(*message)


def _interrupt(number: int, _frame) -> None:
    signal.signal(number, signal.SIG_IGN)  # once is enough
    raise KeyboardInterrupt


def _end_with_parent() -> None:
    """Interrupt the main thread when the parent has gone, and do not wait for it for ever."""
    multiprocessing.parent_process().join()
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident, signal.SIGTERM)  # which wakes it, too
    else:
        _thread.interrupt_main(signal.SIGTERM)
    time.sleep(GRACE_S)
    os._exit(1)


def _take_cores(index: int, count: int) -> None:
    """Run on a share of the cores that the parent may use, so that workers do not hinder one another."""
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        mine = cores[index * len(cores) // count : (index + 1) * len(cores) // count]
        os.sched_setaffinity(0, mine or cores[index % len(cores) :][:1])
