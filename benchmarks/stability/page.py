"""The page and the figures of the stability map, from what was measured."""

from pathlib import Path

import matplotlib
import numpy as np

from benchmarks.stability.entry import Sweep, sweep_of

matplotlib.use("Agg")
import matplotlib.pyplot as plt

COLUMNS = 3
SMALLEST = 1e-12
"""Errors below this are drawn there: a logarithmic axis has no zero."""

HEAD = """# Where the methods fail

Each method is swept over a parameter until it fails, or until the values leave what a scene file may contain. You need
none of it to make a dataset: `varos-warp info` warns, and what cannot be done is refused with a message.

## In short

| a scene with | what happens |
| --- | --- |
| disks, sheets, strobes, cones below 20 or above 179 degrees | is rendered by `path`: as right, but slower |
| one channel of the water much more turbid than another, or light scattered mostly backwards | likewise |
| depths beyond 25 m | their D is 65535; widen `render.depth_range_m`, or take `render.depth_exr` |
| a course wider than 3 km | D loses half of its step of 0.38 mm; a warning says to divide the course |
| objects below 2 mm or above 100 m, a terrain above 50 km | a warning: the unit may be wrong, or digits are lost |
| tens of millions of triangles | takes 500 bytes for each; `varos-warp preprocess --vertices` decimates |
| a course too fast for its vehicle, or a stronger current | is reported; the vehicle lags, the course still ends |
| drag, righting moment or thrusters too stiff for steps of 5 ms | is refused, with what makes it so |

## How to read the entries

An entry states the measured error, where the method ends ("holds from .. to"), what fails beyond, and what the program
does there. A test guards each boundary on both sides. What was swept without an end in sight has tests, but no entry:
attitudes beside the pole and half a turn away, a million steps, waypoints that coincide, needle triangles. In the
figures a vertical line is the boundary, a horizontal one the error promised within it, and a cross at the top a value
that is refused or gives no result. Under them stands the largest error of each line within the boundary. *Ours* is what
varos_warp does, beside other methods for the same; a tick is a step of the simulation, 5 ms, and h its length.
`python -m benchmarks.stability` makes this page.
"""
TITLES = ("method", "parameter", "holds from .. to", "what fails beyond", "what the program does", "test")


def write_page(results: dict, said: dict, groups: dict[str, str], page: Path):
    """Write ``page`` and its figures into ``images`` beside it.

    Of records by key of a sweep, with ``group``, ``commit``, ``machine`` and ``seconds``, and what map.yaml says of
    each; by the titles of groups, in their order.
    """
    text = [HEAD]
    for group, title in groups.items():
        records = {key: record for key, record in results.items() if record["group"] == group}
        if not records:
            continue
        sweeps = [sweep_of(key, record, said[key]) for key, record in records.items()]
        figure = f"images/stability_{group}.png"
        draw(sweeps, page.parent / figure)
        text += [
            f"## {title}\n",
            _table(sweeps),
            f"\n![{title}]({figure})\n",
            _measures(sweeps),
            _made(list(records.values())),
        ]
    page.write_text("\n".join(text))


def _table(sweeps: list[Sweep]) -> str:
    rows = [TITLES, ("---",) * len(TITLES)]
    for sweep in sweeps:
        rows.append((sweep.method, sweep.parameter, sweep.limit, sweep.fails, sweep.program, _link(sweep.test)))
    return "\n".join(f"| {' | '.join(_cell(text) for text in row)} |" for row in rows)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _link(node: str) -> str:
    """A node of pytest as a link to its file; its name in words, which fit a column."""
    file, name = node.split("::", 1)
    return f"[{name.removeprefix('test_').replace('_', ' ')}](../{file})"


def _measures(sweeps: list[Sweep]) -> str:
    """What the errors are, and the worst one within the boundary."""
    lines = ["What the panels show:\n"]
    for sweep in sweeps:
        worst = ", ".join(f"{name} {error:.1e}" for name, error in _worst(sweep).items())
        told = f" Largest within the boundary: {worst}." if worst else ""
        lines.append(f"* **{sweep.title}.** {sweep.measure}{told}")
    return "\n".join(lines) + "\n"


def _worst(sweep: Sweep) -> dict[str, float]:
    """Largest error of each series at values where the method holds."""
    low, high = sweep.holds
    within = [(low is None or low <= value) and (high is None or value <= high) for value in sweep.values]
    errors = {name: np.array(series, float)[within] for name, series in sweep.errors.items()}
    return {name: float(np.nanmax(series)) for name, series in errors.items() if np.isfinite(series).any()}


def _made(records: list[dict]) -> str:
    made = sorted({f"commit {record['commit']}, {record['machine']}" for record in records})
    return f"Measured in {sum(record['seconds'] for record in records):.0f} CPU-seconds at {'; '.join(made)}.\n"


def draw(sweeps: list[Sweep], path: Path):
    """A panel for each sweep."""
    rows, columns = -(-len(sweeps) // COLUMNS), min(COLUMNS, len(sweeps))
    figure, axes = plt.subplots(rows, columns, figsize=(4.6 * columns, 3.2 * rows), squeeze=False, layout="constrained")
    for axis, sweep in zip(axes.flat, sweeps, strict=False):
        _panel(axis, sweep)
    for axis in axes.flat[len(sweeps) :]:
        axis.axis("off")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def _panel(axis, sweep: Sweep):
    for name, errors in sweep.errors.items():
        errors = np.array(errors, float)
        (line,) = axis.plot(sweep.values, np.maximum(errors, SMALLEST), ".-", label=name, linewidth=1)
        nothing = np.isnan(errors)
        axis.plot(
            np.array(sweep.values)[nothing],
            np.full(nothing.sum(), 0.97),
            "x",
            color=line.get_color(),
            transform=axis.get_xaxis_transform(),
        )
    scale = {"linthresh": min(abs(v) for v in sweep.values if v)} if sweep.scale == "symlog" else {}
    axis.set_xscale(sweep.scale, **scale)
    axis.set_yscale("log")
    for end in sweep.holds:
        if end is not None:
            axis.axvline(end, color="black", linewidth=1, linestyle="--")
    if sweep.bound is not None:
        axis.axhline(sweep.bound, color="black", linewidth=0.7, linestyle=":")
    axis.set_title(sweep.title, fontsize=9)
    axis.set_xlabel(sweep.parameter, fontsize=8)
    axis.set_ylabel("error", fontsize=8)
    axis.tick_params(labelsize=7)
    axis.grid(True, alpha=0.3)
    if len(sweep.errors) > 1:
        axis.legend(fontsize=7)
