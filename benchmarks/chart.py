"""Charts of a run: error against time."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

COLOURS = {
    "direct": "#9a9a9a",
    "single": "#8c564b",
    "scatterings_1": "#d8b7e8",
    "scatterings_2": "#b07cc6",
    "scatterings_3": "#7b3f98",
    "reference": "#000000",
    "path": "#1f77b4",
    "field": "#ff7f0e",
    "mitsuba": "#2ca02c",
    "cycles": "#d62728",
}
HOLLOW = {"linestyle": "", "markerfacecolor": "white"}
MARKERS = {"none": "o", "oidn": "^", "nlm": "s"}
ERRORS = {"rmse": "relative RMSE", "median": "median relative error", "ssim": "1 - SSIM of the 8-bit image"}
MAIN = ("direct", "single", "reference", "path", "path+oidn", "field", "field+oidn", "mitsuba", "cycles", "cycles+oidn")
"""Methods that differ most: what is drawn where there is little room."""
DPI = 110


def seconds_of(row: dict, device: str) -> float:
    """What time a point is drawn at: CPU seconds of all threads on a CPU, seconds on the clock where a GPU works."""
    return row["cpu_seconds"] if device == "cpu" else row["seconds"]


def pareto(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points (time, error) that no other point beats in both, by ascending time."""
    front: list[tuple[float, float]] = []
    for time, error in sorted(points):
        if not front or error < front[-1][1]:
            front.append((time, error))
    return front


def _by(rows: list[dict], *names: str) -> dict:
    """Rows in groups of equal values, in their first order."""
    groups: dict = {}
    for row in rows:
        groups.setdefault(tuple(row.get(name) for name in names), []).append(row)
    return groups


def _readable(axis: Axis) -> None:
    """Labels of a logarithmic axis: decades; 1, 2 and 5 where there are few of them."""
    low, high = axis.get_view_interval()
    few = high / max(low, 1e-30) < 50.0
    axis.set_major_locator(MaxNLocator(5) if high < 5.0 * low else LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
    axis.set_minor_formatter(NullFormatter())
    if few:
        axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:,.5g}" if x < 1e4 else f"{x:,.0f}"))


def subtitle(result: dict) -> str:
    """The machine in words."""
    facts = result["machine"]
    cores = f"{facts['cores']} cores of {facts['cpu']}"
    return (f"{cores}" if facts["device"] == "cpu" else f"{facts['device_name']}, {cores}") + (
        f"; Warp {facts['warp']}, {facts['commit']}"
    )


def radiance(result: dict, scene: str, path: Path) -> None:
    """Error against time of one scene: a panel each for RMSE, median and SSIM; the Pareto front as a band beneath."""
    rows = [row for row in result["A"] if row["scene"] == scene and row["truth"] == "full"]
    figure, axes = plt.subplots(1, 3, figsize=(16, 7.6))
    for axis, (kind, title) in zip(axes, ERRORS.items(), strict=True):
        _radiance_panel(axis, rows, kind, result["machine"]["device"])
        axis.set_ylabel(title)
    handles, labels = axes[0].get_legend_handles_labels()
    about = result["scenes"][scene]
    width, height = about["resolution"]
    figure.suptitle(
        f"{scene}: {about['title']}; {width} x {height}, light of all orders as truth; numbers: samples "
        f"per pixel of the last point\n{subtitle(result)}",
        fontsize=11,
    )
    figure.legend(handles, labels, loc="lower center", ncols=6, fontsize=9, frameon=False)
    rows_of_legend = -(-len(labels) // 6)
    figure.subplots_adjust(left=0.055, right=0.985, top=0.89, bottom=0.13 + 0.032 * rows_of_legend, wspace=0.2)
    save_figure(figure, path)


def _radiance_panel(axis, rows: list[dict], kind: str, device: str) -> None:
    points = [(seconds_of(row, device), row[f"{kind}_limit"]) for row in rows if row[f"{kind}_limit"] > 0.0]
    front = pareto(points)
    axis.set(xscale="log", yscale="log", xlabel="CPU-seconds of an image" if device == "cpu" else "seconds of an image")
    band = {"color": "#ffe08a", "linewidth": 9, "solid_capstyle": "round"}
    axis.plot(*zip(*front, strict=True), "-", zorder=1, label="Pareto front", **band)
    for (name, label), series in _by(rows, "method", "label").items():
        first = series[0]
        colour = COLOURS.get(name, COLOURS.get(first["family"], "#e377c2"))
        style = "--" if first["peer"] else ":" if first["denoise"] != "none" else "-"
        x = np.array([seconds_of(row, device) for row in series])
        y = np.array([max(row[f"{kind}_limit"], 1e-9) for row in series])
        known = np.array([row[f"{kind}_resolved"] for row in series])
        marks = {"marker": MARKERS[first["denoise"]], "markersize": 6, "color": colour}
        axis.plot(x, y, style, linewidth=1.3, label=label, zorder=2, **marks)
        axis.plot(x[~known], y[~known], zorder=3, **marks, **HOLLOW)
        spp = str(series[-1]["spp"])
        axis.annotate(spp, (x[-1], y[-1]), textcoords="offset points", xytext=(5, 4), fontsize=7, color=colour)
    label = "hollow: within the reference's noise"
    axis.plot([1.0], [np.nan], marker="o", markersize=6, color="#555555", label=label, **HOLLOW)
    axis.grid(True, which="major", alpha=0.35)
    axis.grid(True, which="minor", alpha=0.12)
    for one in (axis.xaxis, axis.yaxis):
        _readable(one)


def scenes(result: dict, path: Path) -> None:
    """RMSE against time of every scene beside each other, the series that differ most."""
    names = list(dict.fromkeys(row["scene"] for row in result["A"]))
    columns = min(3, len(names))
    figure, axes = plt.subplots(
        -(-len(names) // columns), columns, figsize=(15, 4.3 * -(-len(names) // columns) + 0.9), squeeze=False
    )
    labels: dict = {}
    for axis, name in zip(axes.flat, names, strict=False):
        rows = [row for row in result["A"] if row["scene"] == name and row["truth"] == "full"]
        rows = [row for row in rows if row["method"] in MAIN] or rows
        _radiance_panel(axis, rows, "rmse", result["machine"]["device"])
        axis.set(title=f"{name}: {result['scenes'][name]['title']}", ylabel=ERRORS["rmse"])
        axis.title.set_fontsize(10)
        labels |= dict(zip(*reversed(axis.get_legend_handles_labels()), strict=True))
    for axis in axes.flat[len(names) :]:
        axis.set_visible(False)
    figure.suptitle(subtitle(result), fontsize=11)
    figure.tight_layout(rect=(0, 0.9 / figure.get_figheight(), 1, 0.99))
    figure.legend(labels.values(), labels, loc="lower center", ncols=6, fontsize=9, frameon=False)
    save_figure(figure, path)


def save_figure(figure, path: Path, dpi: int = DPI) -> None:
    """Write a figure to a file, whose folder is made, and close it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=dpi)
    plt.close(figure)
