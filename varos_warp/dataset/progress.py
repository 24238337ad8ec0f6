"""How far a long job is: a bar on a terminal, a line now and then in a log, nothing when quiet. All on stderr."""

import math
import sys
import time

LINE_SECONDS = 15.0
"""At most one line in this time where there is no terminal."""


class Progress:
    """Counts steps of a job; use it in a ``with`` statement.

    Args:
        label: What is counted.
        total: Steps of the whole job.
        unit: Of one step, in the plural.
        quiet: Say nothing.
    """

    def __init__(self, label: str, total: int, unit: str = "frames", quiet: bool = False):
        self.label, self.total, self.unit, self.quiet = label, total, unit, quiet
        self.done = self._at_first = 0
        self._bar = None

    def __enter__(self) -> "Progress":
        self._start = self._last = time.monotonic()
        if self.quiet or not self.total or not sys.stderr.isatty():
            return self
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        self._bar = Bar(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(),
                        TextColumn("{task.fields[rate]}"), TextColumn("elapsed"), TimeElapsedColumn(),
                        TextColumn("left"), TimeRemainingColumn(), console=Console(stderr=True))
        self._bar.start()
        self._task = self._bar.add_task(self.label, total=self.total, rate="")
        return self

    def __exit__(self, kind, value, trace) -> None:
        if self._bar is not None:
            self._bar.stop()
        elif not self.quiet and self.done and kind is None and time.monotonic() - self._start >= 1.0:
            self._say()

    @property
    def rate(self) -> float:
        """Steps per second so far; once there are more, without those counted first: they wait for compilers."""
        first = self._at_first if self.done > self._at_first else 0
        since = self._first if first else self._start
        return (self.done - first) / max(time.monotonic() - since, 1e-9)

    def advance(self, steps: int = 1) -> None:
        """Count steps that were done."""
        self.done += steps
        if not self._at_first:
            self._at_first, self._first = self.done, time.monotonic()
        if self._bar is not None:
            self._bar.update(self._task, advance=steps, rate=f"{self.rate:.3g} {self.unit}/s")
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


class Steps:
    """Shows which step of a job is at work and how far it is; use it in a ``with`` statement.

    Args:
        label: The job.
        names: Its steps, in order.
        quiet: Say nothing.
    """

    def __init__(self, label: str, names, quiet: bool = False):
        self.label, self.names, self.quiet = label, list(names), quiet
        self._bar, self._said = None, None

    def __enter__(self) -> "Steps":
        if not self.quiet and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
            from rich.progress import Progress as Bar

            self._bar = Bar(TextColumn("{task.description}"), BarColumn(), TextColumn("elapsed"), TimeElapsedColumn(),
                            console=Console(stderr=True))
            self._bar.start()
            self._task = self._bar.add_task(self.label, total=len(self.names))
        self._start = time.monotonic()
        return self

    def __exit__(self, kind, value, trace) -> None:
        if self._bar is not None:
            self._bar.stop()

    def reach(self, name: str, share: float) -> None:
        """Tell that a share of a step is done, 0 to 1; a log gets a line when a step begins."""
        if self._bar is not None:
            self._bar.update(self._task, completed=self.names.index(name) + share, description=f"{self.label}: {name}")
        elif not self.quiet and name != self._said and time.monotonic() - self._start >= 1.0:
            self._said = name
            print(f"{self.label}: {name} after {_clock(time.monotonic() - self._start)}", file=sys.stderr, flush=True)


def _clock(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
