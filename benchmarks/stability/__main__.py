"""Run the sweeps, keep what they measured, and write docs/stability.md with its figures.

    python -m benchmarks.stability [KEY ...] [--only transport] [--list] [--page]

Without a key all of them run: minutes on two cores. What is measured goes into benchmarks/results/stability.json by its
key, so that a single entry can be measured again; ``--page`` only writes the page.
"""

import argparse
import importlib
import importlib.util
import json
import platform
import subprocess
import time
from pathlib import Path

from benchmarks.stability.entry import Sweep
from benchmarks.stability.page import write_page

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "benchmarks" / "results" / "stability.json"
PAGE = ROOT / "docs" / "stability.md"
GROUPS = {
    "transport_media": "Light transport: water and phase functions",
    "transport_lamps": "Light transport: lights",
    "transport_surfaces": "Light transport: surfaces and coordinates",
    "transport_images": "Light transport: cameras, films and images",
    "dynamics": "Vehicle dynamics, control and sensors",
    "geometry": "Meshes, guidance and coordinates",
}
"""Modules of sweeps here and the titles of their sections."""


def sweeps() -> dict[str, tuple[str, object]]:
    """Key -> (group, function) of every sweep there is."""
    found = {}
    for group in GROUPS:
        name = f"benchmarks.stability.{group}"
        for function in importlib.import_module(name).SWEEPS if importlib.util.find_spec(name) else ():
            if function.__name__ in found:
                raise ValueError(f"two sweeps are called {function.__name__}")
            found[function.__name__] = (group, function)
    return found


def measure(group: str, function) -> dict:
    """The record of one sweep: what it says, and what made it."""
    start = time.process_time()
    sweep: Sweep = function()
    if sweep.key != function.__name__:
        raise ValueError(f"{function.__name__} made a sweep called {sweep.key}")
    return sweep.record() | {
        "group": group,
        "seconds": round(time.process_time() - start, 1),
        "commit": commit(),
        "machine": machine(),
    }


def commit() -> str:
    """Short hash of the checkout, or unknown."""
    result = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=ROOT)
    return result.stdout.strip() or "unknown"


def machine() -> str:
    """Processor and how many of its threads the process may use."""
    from varos_warp.device.launcher import Launcher

    names = (
        [
            line.split(":")[1].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if line.startswith("model name")
        ]
        if Path("/proc/cpuinfo").exists()
        else []
    )
    return f"{(names or [platform.processor() or platform.machine()])[0]}, {Launcher('cpu').threads} threads"


def main():
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stability", description=__doc__.splitlines()[0])
    parser.add_argument("keys", nargs="*", metavar="KEY", help="entries to measure; absent: all")
    parser.add_argument("--only", help="groups that begin with this, such as transport or dynamics")
    parser.add_argument("--list", action="store_true", help="print the keys and end")
    parser.add_argument("--page", action="store_true", help="measure nothing, write the page again")
    arguments = parser.parse_args()
    found = sweeps()
    unknown = set(arguments.keys) - set(found)
    if unknown:
        parser.error(f"no such entry: {', '.join(sorted(unknown))}; --list prints them")
    for key, (group, function) in found.items():
        if (arguments.keys and key not in arguments.keys) or not group.startswith(arguments.only or ""):
            continue
        if arguments.list:
            print(f"{group:20} {key}")
        elif not arguments.page:
            record = measure(group, function)
            keep({key: record}, found)
            print(f"{key}: {record['seconds']} s", flush=True)
    if not arguments.list:
        keep({}, found)
        write_page(json.loads(RESULTS.read_text()), GROUPS, PAGE)


def keep(measured: dict, found: dict):
    """Add to the results, which other runs may have added to meanwhile; only entries that there still are stay."""
    kept = (json.loads(RESULTS.read_text()) if RESULTS.exists() else {}) | measured
    kept = {key: kept[key] for key, (group, _) in found.items() if key in kept and kept[key]["group"] == group}
    RESULTS.with_suffix(".tmp").write_text(json.dumps(kept, indent=1) + "\n")
    RESULTS.with_suffix(".tmp").replace(RESULTS)


if __name__ == "__main__":
    main()
