"""Where the time of a run went."""

import contextlib
import threading
import time
from collections.abc import Iterator

MAIN = ("simulate", "load", "plan", "render", "wait", "expose", "checksums")
"""Stages one after the other, in the order of the work. wait: there was no room, or the last images were being written;
expose: gains, PNG of the images that they decide, contact sheet; checksums:
SHA-256 of every new file."""
BESIDE = ("denoise", "encode")
"""What threads do beside them, the seconds of all threads added up. On a GPU that denoises, ``render`` has that.

With several workers, ``render`` and these are sums over workers, and ``wait`` is the time until all images
were there."""


class Clock:
    """Adds up the seconds of each stage; usable from any thread."""

    def __init__(self):
        self.seconds = dict.fromkeys((*MAIN, *BESIDE), 0.0)
        self._lock = threading.Lock()

    @contextlib.contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Count the time within a ``with`` statement."""
        start = time.perf_counter()
        try:
            yield
        finally:
            seconds = time.perf_counter() - start
            with self._lock:
                self.seconds[stage] += seconds

    def add(self, seconds: dict[str, float]) -> None:
        """Count what was measured elsewhere."""
        with self._lock:
            for stage, more in seconds.items():
                self.seconds[stage] += more

    def rounded(self) -> dict[str, float]:
        """Seconds of each stage, for the log."""
        return {stage: round(seconds, 3) for stage, seconds in self.seconds.items()}
