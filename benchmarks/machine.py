"""The machine of a measurement, and its clocks."""

import os
import platform
import subprocess
import time
from datetime import UTC, datetime
from pathlib import Path

import warp as wp

from varos_warp.device.devices import usable_cores


def commit() -> str:
    """Short hash of the checkout; without its history what VAROS_WARP_COMMIT says, or unknown."""
    given = os.environ.get("VAROS_WARP_COMMIT", "unknown")
    try:
        result = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=Path(__file__).parent
        )
    except OSError:
        return given
    return result.stdout.strip() or given


def cpu_name() -> str:
    """The CPU's name as /proc/cpuinfo has it; what Python knows elsewhere."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def machine(device: str) -> dict:
    """Facts that stand beside the numbers."""
    return {
        "device": device,
        "device_name": cpu_name() if device == "cpu" else wp.get_device(device).name,
        "cpu": cpu_name(),
        "cores": usable_cores(),
        "system": platform.system(),
        "warp": wp.__version__,
        "commit": commit(),
        "date": datetime.now(UTC).date().isoformat(),
    }


class Stopwatch:
    """Wall and CPU seconds (of all threads of the process) since it was made."""

    def __init__(self):
        self._wall, self._cpu = time.perf_counter(), time.process_time()

    @property
    def seconds(self) -> float:
        """On the clock on the wall."""
        return time.perf_counter() - self._wall

    @property
    def cpu_seconds(self) -> float:
        """Of all threads together; other work beside does not lengthen them much."""
        return time.process_time() - self._cpu


class Budget:
    """Seconds since it was made, as an idle machine would count them.

    Args:
        device: On a CPU it is CPU seconds, those of other programs that were waited for among them, over the cores:
            other work beside does not use it up. On a GPU it is the clock on the wall.
    """

    def __init__(self, device: str):
        self._on_cpu, self._start = device == "cpu", 0.0
        self._start = self.seconds

    @property
    def seconds(self) -> float:
        """What is used up."""
        now = sum(os.times()[:4]) / usable_cores() if self._on_cpu else time.perf_counter()
        return now - self._start
