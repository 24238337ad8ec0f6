"""Run the sweeps, keep what they measured, and write docs/stability.md with its figures.

    python -m benchmarks.stability [KEY ...] [--only transport] [--list] [--page]

Without a key all of them run: minutes on two cores. What is measured goes into benchmarks/results/stability.json by its
key, so that a single entry can be measured again; ``--page`` only writes the page. Entries of map.yaml that no module
here sweeps are settled: their numbers stay, and tests guard them.
"""

import importlib
import json

from benchmarks.machine import RESULTS, ROOT, Stopwatch, command, commit, cpu_name, save
from benchmarks.stability.entry import Series, measured, record_of, words
from benchmarks.stability.page import write_page
from varos_warp.device.devices import usable_cores

MAP = RESULTS / "stability.json"
PAGE = ROOT / "docs" / "stability.md"
GROUPS = {
    "transport_media": "Light transport: water and phase functions",
    "transport_lamps": "Light transport: lights",
    "transport_surfaces": "Light transport: surfaces and coordinates",
    "transport_images": "Light transport: cameras, films and images",
    "dynamics": "Vehicle dynamics, control and sensors",
    "geometry": "Meshes, guidance and coordinates",
}
"""Groups of entries and the titles of their sections."""
MODULES = ("transport_media", "transport_lamps", "transport_surfaces", "transport_images", "dynamics")
"""Groups with a module of sweeps here."""


def sweeps() -> dict[str, tuple[str, Series]]:
    """Key -> (group, series) of every sweep there is."""
    found: dict = {}
    for group in MODULES:
        for key, series in importlib.import_module(f"benchmarks.stability.{group}").SWEEPS.items():
            if key in found:
                raise ValueError(f"two sweeps are called {key}")
            found[key] = (group, series)
    return found


def measure(key: str, group: str, series: Series) -> dict:
    """The record of one sweep: what came of it, and what made it."""
    watch = Stopwatch()
    return record_of(measured(words()[key]["values"], series)) | {
        "group": group,
        "seconds": round(watch.cpu_seconds, 1),
        "commit": commit(),
        "machine": f"{cpu_name()}, {usable_cores()} threads",
    }


def main():
    parser = command(__doc__, device=None)
    parser.add_argument("keys", nargs="*", metavar="KEY", help="entries to measure; absent: all")
    parser.add_argument("--only", help="groups that begin with this, such as transport or dynamics")
    parser.add_argument("--list", action="store_true", help="print the keys and end")
    parser.add_argument("--page", action="store_true", help="measure nothing, write the page again")
    arguments = parser.parse_args()
    found = sweeps()
    unknown = set(arguments.keys) - set(found)
    if unknown:
        parser.error(f"no such entry: {', '.join(sorted(unknown))}; --list prints them")
    for key, (group, series) in found.items():
        if (arguments.keys and key not in arguments.keys) or not group.startswith(arguments.only or ""):
            continue
        if arguments.list:
            print(f"{group:20} {key}")
        elif not arguments.page:
            record = measure(key, group, series)
            keep({key: record})
            print(f"{key}: {record['seconds']} s", flush=True)
    if not arguments.list:
        write_page(json.loads(MAP.read_text()), words(), GROUPS, PAGE)


def keep(measured: dict):
    """Add to the results, which other runs may have added to meanwhile; only what the map speaks of stays."""
    kept = json.loads(MAP.read_text()) | measured
    save(MAP, {key: kept[key] for key in words() if key in kept})


if __name__ == "__main__":
    main()
