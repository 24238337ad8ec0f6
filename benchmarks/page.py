"""Tables and charts of docs/benchmarks.md from the results of runs.

    python -m benchmarks.page [cpu=OUT] [gpu=OUT]

``cpu=OUT`` first copies bench.json of a run in folder OUT to benchmarks/results/bench_cpu.json; the page shows all runs
that there are.
"""

import re
import sys
from math import log
from pathlib import Path

from benchmarks import chart
from benchmarks.machine import RESULTS, ROOT, markdown
from varos_warp.dataset.files import read_json, write_bytes, write_json
from varos_warp.errors import InputError

PAGE, IMAGES = ROOT / "docs/benchmarks.md", ROOT / "docs/images"
RUNS = ("cpu", "gpu")
TARGETS = (0.1, 0.03, 0.01)
"""Relative RMSE that the page asks each method for."""


def take_over(run: str, folder: Path) -> None:
    """Keep the results of a run as those of ``cpu`` or ``gpu``."""
    if run not in RUNS:
        raise InputError("is not a run", key="run", value=run, remedy=f"Write one of {', '.join(RUNS)}, as cpu=OUT.")
    write_json(RESULTS / f"bench_{run}.json", read_json(folder / "bench.json"))


def update(page: Path = PAGE, results: Path = RESULTS, images: Path = IMAGES) -> None:
    """Draw the charts anew and fill in what stands between ``<!-- name -->`` and ``<!-- end -->`` in the page."""
    text = page.read_text(encoding="utf-8")
    for run in RUNS:
        result = read_json(results / f"bench_{run}.json")
        chart.radiance(result, "ref1", images / f"bench_{run}.png")
        chart.scenes(result, images / f"bench_{run}_scenes.png")
        for name, table in tables(result).items():
            text = fill(text, f"{run}: {name}", table)
    write_bytes(page, text.encode())


def fill(text: str, name: str, content: str) -> str:
    """The text with ``content`` between the markers of ``name``, where it has them."""
    pattern = re.compile(rf"(<!-- {re.escape(name)} -->\n).*?(<!-- end -->)", re.DOTALL)
    return pattern.sub(lambda match: match[1] + content + match[2], text)


def tables(result: dict) -> dict[str, str]:
    """The page's tables by name, in Markdown."""
    rows, device = result["A"], result["machine"]["device"]
    return {
        "machine": _machine(result),
        "ref1": _methods([row for row in rows if row["scene"] == "ref1"], device),
        "targets": _targets(rows, device),
        "own truth": _own_truth(rows),
        "left out": _left_out(result["scenes"]),
    }


def _error(row: dict, kind: str) -> str:
    """An error of a row, in brackets where the reference does not resolve it."""
    limit = f"{row[f'{kind}_limit']:.2g}"
    return limit if row[f"{kind}_resolved"] else f"(< {limit})"


def _median(row: dict) -> str:
    return " / ".join(f"{row[f'median_{channel}']:.2g}" for channel in "rgb")


def _percent_off(row: dict) -> str:
    return " / ".join(f"{100 * row[f'mean_off_{channel}']:.2f}" for channel in "rgb")


def _machine(result: dict) -> str:
    facts = result["machine"]
    compiled = [scene["compile_seconds"] for scene in result["scenes"].values() if "compile_seconds" in scene]
    apart = f" Compilation, counted apart: {sum(compiled):.0f} s in all." if compiled else ""
    return f"{chart.subtitle(result)}; {facts['system']}, {facts['date']}.{apart}\n"


def _methods(rows: list[dict], device: str) -> str:
    """The last point of every method: what its error comes down to and what it costs."""
    last = {row["method"]: row for row in rows if row["truth"] == "full"}
    unit = "CPU-s" if device == "cpu" else "s"
    return markdown(
        ["method", "samples", unit, "relative RMSE", "median R / G / B", "1 - SSIM", "set up [s]"],
        [
            [
                row["label"],
                row["spp"],
                f"{chart.seconds_of(row, device):.3g}",
                _error(row, "rmse"),
                _median(row),
                _error(row, "ssim"),
                f"{row['setup_seconds']:.2g}",
            ]
            for row in last.values()
        ],
    )


def seconds_to(rows: list[dict], target: float, device: str) -> str:
    """Seconds at which a series first has the RMSE asked for, interpolated in logarithms; > the last where it has not.

    No series is followed beyond its last point.
    """
    before = None
    for row in rows:
        at, error = chart.seconds_of(row, device), row["rmse_limit"]
        if error <= target:
            if before is None:
                return f"< {at:.2g}" if error < target else f"{at:.2g}"
            share = log(before[1] / target) / log(before[1] / error)
            return f"{before[0] * (at / before[0]) ** share:.2g}"
        before = (at, error)
    return f"> {before[0]:.2g}"


def _targets(rows: list[dict], device: str) -> str:
    """Seconds to an RMSE, a row for each scene and main method that has any."""
    lines = []
    for scene in dict.fromkeys(row["scene"] for row in rows):
        for method in chart.MAIN:
            series = [
                row for row in rows if row["scene"] == scene and row["method"] == method and row["truth"] == "full"
            ]
            cells = [seconds_to(series, target, device) for target in TARGETS if series]
            if not all(cell.startswith(">") for cell in cells):
                lines.append([scene, series[0]["label"], *cells])
    unit = "CPU-seconds" if device == "cpu" else "seconds"
    return markdown(["scene", "method", *(f"{unit} to RMSE {target:g}" for target in TARGETS)], lines)


def _own_truth(rows: list[dict]) -> str:
    """Direct light and single scattering against a reference of just these."""
    last = {row["scene"]: row for row in rows if row["truth"] == "single"}
    return markdown(
        ["scene", "samples", "relative RMSE", "median R / G / B", "image means off R / G / B [%]"],
        [[name, row["spp"], _error(row, "rmse"), _median(row), _percent_off(row)] for name, row in last.items()],
    )


def _left_out(scenes: dict[str, dict]) -> str:
    lines = [
        f"* {name}: {method}: {why.splitlines()[0]}\n"
        for name, scene in scenes.items()
        for method, why in scene.get("left_out", {}).items()
    ]
    return "".join(lines) or "* nothing\n"


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        run, folder = argument.split("=", 1)
        take_over(run, Path(folder))
    update()
