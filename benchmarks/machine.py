"""What measurements share: the machine they ran on, clocks, the command line, how results are kept and tabled."""

import argparse
import json
import os
import platform
import subprocess
import time
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import warp as wp

from varos_warp.device.devices import resolve_device, usable_cores

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
MUNKHOLMEN = ROOT / "examples" / "munkholmen" / "scene.yaml"
"""What most measurements of speed render."""


def commit() -> str:
    """Short hash of the checkout; without its history what VAROS_WARP_COMMIT says, or unknown."""
    given = os.environ.get("VAROS_WARP_COMMIT", "unknown")
    try:
        result = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=ROOT)
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


def command(text: str, device: str | None = "auto") -> argparse.ArgumentParser:
    """A command line that is described by a module's docstring; with ``--device``, where there is one by default."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    if device is not None:
        parser.add_argument("--device", type=resolve_device, default=device, help="auto, cpu or cuda:N")
    return parser


def words(text: str) -> list[str]:
    """Words between commas."""
    return [word.strip() for word in text.split(",") if word.strip()]


def counts(text: str) -> list[int]:
    """Whole numbers between commas."""
    return [int(number) for number in text.split(",")]


def numbers(text: str) -> list[float]:
    """Numbers between commas."""
    return [float(number) for number in text.split(",")]


def size(text: str) -> tuple[int, ...]:
    """Width and height of ``WIDTHxHEIGHT``."""
    return tuple(int(number) for number in text.split("x"))


def save(path: Path | None, result) -> None:
    """Write a result as JSON into a folder that is made; nothing where there is no path."""
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(result, indent=1) + "\n")


def markdown(header: Sequence, rows: Iterable[Sequence]) -> str:
    """A table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(str(cell) for cell in line)} |\n" for line in lines)


class Stopwatch:
    """Wall and CPU seconds (of all threads of the process) since it was made."""

    def __init__(self):
        self._wall, self._cpu = time.perf_counter(), time.process_time()

    @property
    def seconds(self) -> float:
        """Seconds on the clock on the wall."""
        return time.perf_counter() - self._wall

    @property
    def cpu_seconds(self) -> float:
        """CPU seconds of all threads together; other work beside does not lengthen them much."""
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
