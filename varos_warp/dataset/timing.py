"""Times that the stages of a run took."""

import contextlib
import threading
import time
from collections.abc import Iterator

MAIN = ("simulate", "load", "plan", "render", "wait", "expose", "checksums")
"""Stages one after the other, in the order of the work. render: at least one image was under way; wait: none was, for
there was no room, or the last images were being written; expose: gains, PNG of the images that they decide, contact
sheet; checksums: SHA-256 of every new file."""
BESIDE = ("denoise", "encode")
"""What threads do beside them, the seconds of all threads added up. On a GPU that denoises, ``render`` has that.

With several workers, these are sums over all of them, and each stage of `MAIN` is the longest of any."""


class Clock:
    """Adds up the seconds of each stage; usable from any thread. Of those in `MAIN`, no moment counts twice."""

    def __init__(self):
        self.seconds = dict.fromkeys((*MAIN, *BESIDE), 0.0)
        self._lock = threading.Lock()
        self._within, self._since = dict.fromkeys(MAIN, 0), dict.fromkeys(MAIN, 0.0)
        """How many threads are in a stage, and since when there are any."""

    @contextlib.contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Count the time within a ``with`` statement."""
        start = time.perf_counter()
        with self._lock:
            if stage in MAIN:
                self._since[stage] = self._since[stage] if self._within[stage] else start
                self._within[stage] += 1
        try:
            yield
        finally:
            end = time.perf_counter()
            with self._lock:
                if stage in BESIDE:
                    self.seconds[stage] += end - start
                else:
                    self._within[stage] -= 1
                    self.seconds[stage] += 0.0 if self._within[stage] else end - self._since[stage]

    @contextlib.contextmanager
    def rest(self, stage: str, of: str) -> Iterator[None]:
        """Count the time within a ``with`` statement, less that of another stage."""
        start, before = time.perf_counter(), self.seconds[of]
        try:
            yield
        finally:
            self.add({stage: time.perf_counter() - start - (self.seconds[of] - before)})

    def add(self, seconds: dict[str, float]) -> None:
        """Count what was measured elsewhere."""
        with self._lock:
            for stage, more in seconds.items():
                self.seconds[stage] += more

    def beside(self, seconds: dict[str, float]) -> None:
        """Count what went on in a process beside this one and others: of stages in `MAIN`, the longest counts."""
        for stage, more in seconds.items():
            self.seconds[stage] = max(self.seconds[stage], more) if stage in MAIN else self.seconds[stage] + more

    def rounded(self) -> dict[str, float]:
        """Seconds of each stage, for the log."""
        return {stage: round(seconds, 3) for stage, seconds in self.seconds.items()}
