"""How far a long job is: a bar on a terminal, a line now and then in a log, nothing when quiet. All on stderr."""

import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

LINE_SECONDS = 15.0
"""Seconds in which there is at most one line where there is no terminal."""


class Progress:
    """Counts steps of a job, ``unit`` in the plural, and tells ``also``; use it in a ``with`` statement."""

    def __init__(
        self,
        label: str,
        total: int,
        unit: str = "frames",
        quiet: bool = False,
        also: Callable[[int], None] = lambda steps: None,
    ):
        self.label, self.total, self.unit, self.quiet, self.also = label, total, unit, quiet, also
        self.done = self._at_first = 0
        self._bar = None

    def __enter__(self) -> "Progress":
        self._start = self._last = time.monotonic()
        if not self.quiet and self.total and sys.stderr.isatty():
            self._bar = self._new_bar()
            self._task = self._bar.add_task(self.label, total=self.total, rate="")
            self._bar.start()
        return self

    def __exit__(self, kind, value, trace) -> None:
        if self._bar is not None:
            self._bar.stop()
        elif not self.quiet and self.done and kind is None and time.monotonic() - self._start >= 1.0:
            self._say()

    def _new_bar(self):
        from rich.console import Console as Terminal
        from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        return Bar(
            "{task.description}",
            BarColumn(),
            TextColumn("{task.fields[rate]}"),
            "elapsed",
            TimeElapsedColumn(),
            "left",
            TimeRemainingColumn(),
            console=Terminal(stderr=True),
        )

    @property
    def rate(self) -> float:
        """Steps per second so far; once there are more, without those counted first: they wait for compilers."""
        first = self._at_first if self.done > self._at_first else 0
        since = self._first if first else self._start
        return (self.done - first) / max(time.monotonic() - since, 1e-9)

    def advance(self, steps: int = 1) -> None:
        """Count steps that were done."""
        self.done += steps
        self.also(steps)
        if not self._at_first:
            self._at_first, self._first = self.done, time.monotonic()
        if self._bar is not None:
            words = f"{self.done}/{self.total} {self.rate:.3g} {self.unit}/s"
            self._bar.update(self._task, completed=self.done, rate=words)
        elif not self.quiet and self.done < self.total and time.monotonic() - self._last >= LINE_SECONDS:
            self._last = time.monotonic()
            self._say()

    def reach(self, share: float) -> None:
        """Count all steps up to a share of the job, 0 to 1."""
        if (steps := math.ceil(share * self.total) - self.done) > 0:
            self.advance(steps)

    def _say(self) -> None:
        """How far it is, and, once it is known, when it will end."""
        words = f"{self.label}: {self.done}/{self.total} {self.unit}"
        if self.done == self.total:
            words += f", {self.rate:.3g} {self.unit}/s in {_clock(time.monotonic() - self._start)}"
        elif self.done > self._at_first:
            words += f", {self.rate:.3g} {self.unit}/s, {_clock((self.total - self.done) / self.rate)} left"
        print(words, file=sys.stderr, flush=True)


class NamedSteps(Progress):
    """Shows which of the named steps of a job is at work and how far it is; use it in a ``with`` statement."""

    def __init__(self, label: str, names, quiet: bool = False):
        self.names, self._said = list(names), None
        super().__init__(label, len(self.names), quiet=quiet)

    def reach(self, name: str, share: float) -> None:
        """Tell that a share of a step is done, 0 to 1; a log gets a line when a step begins, and now and then."""
        now = time.monotonic()
        if self._bar is not None:
            self._bar.update(self._task, completed=self.names.index(name) + share, description=f"{self.label}: {name}")
        elif not self.quiet and now - self._start >= 1.0 and (name != self._said or now - self._last >= LINE_SECONDS):
            self._said, self._last = name, now
            done = f" {share:.0%}" if share > 0.0 else ""
            print(f"{self.label}: {name}{done} after {_clock(now - self._start)}", file=sys.stderr, flush=True)


class Console:
    """What a job tells the user while it goes on; nothing when quiet."""

    def __init__(self, quiet: bool = False):
        self.quiet = quiet

    def tell(self, words: str) -> None:
        """Print a line."""
        if not self.quiet:
            print(words, file=sys.stderr, flush=True)

    def progress(self, label: str, total: int, unit: str = "frames") -> Progress:
        """Show how far something is."""
        return Progress(label, total, unit, self.quiet)


def in_threads(label: str, make: Callable, *items, unit: str = "frames", quiet: bool = False) -> Iterator:
    """What ``make`` gives for each item, of one or more sequences of one length, in their order.

    Several are made at a time, with a progress bar that counts them by ``unit``, in the plural.
    """
    with ThreadPoolExecutor(os.cpu_count()) as pool, Progress(label, len(items[0]), unit, quiet) as progress:
        for result in pool.map(make, *items):
            yield result
            progress.advance()


def _clock(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
