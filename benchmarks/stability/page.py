"""The page and the figures of the stability map, from what was measured."""

from pathlib import Path

import numpy as np

from benchmarks.chart import plt, save_figure
from benchmarks.machine import markdown
from benchmarks.stability.entry import Sweep, sweep_of

COLUMNS = 3
SMALLEST = 1e-12
"""Errors below this are drawn there: a logarithmic axis has no zero."""

HEAD = Path(__file__).with_name("head.md")
"""What stands above the sections."""
TITLES = ("method", "parameter", "holds from .. to", "what fails beyond", "what the program does", "test")


def write_page(results: dict, said: dict, groups: dict[str, str], page: Path):
    """Write ``page`` and its figures into ``images`` beside it.

    Of records by key of a sweep, with ``group``, ``commit``, ``machine`` and ``seconds``, and what map.yaml says of
    each; by the titles of groups, in their order.
    """
    text = [HEAD.read_text(encoding="utf-8")]
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
            f"![{title}]({figure})\n",
            _measures(sweeps),
            _made(list(records.values())),
        ]
    page.write_text("\n".join(text))


def _table(sweeps: list[Sweep]) -> str:
    rows = [(s.method, s.parameter, s.limit, s.fails, s.program, _link(s.test)) for s in sweeps]
    return markdown(TITLES, [[_cell(text) for text in row] for row in rows])


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
    save_figure(figure, path, dpi=90)


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
