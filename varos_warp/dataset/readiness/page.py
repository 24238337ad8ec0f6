"""Tables and the page of readiness: of one dataset over its frames, of several against optical depth."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from varos_warp.dataset.readiness.measure import Readiness
from varos_warp.dataset.readiness.odometry.odometry import Odometry
from varos_warp.dataset.readiness.seeds import compared, groups
from varos_warp.dataset.report import write_page
from varos_warp.dataset.report.curves import curve
from varos_warp.dataset.report.facts import Note, Table
from varos_warp.errors import counted

SHOWN = {
    "orb_count": "ORB keypoints",
    "orb_per_mpx": "ORB keypoints [1/Mpx]",
    "orb_repeatability": "ORB repeatability",
    "orb_chance": "ORB by chance",
    "orb_matches": "ORB matches",
    "orb_inlier_share": "ORB inlier share",
    "sift_count": "SIFT keypoints",
    "sift_per_mpx": "SIFT keypoints [1/Mpx]",
    "sift_repeatability": "SIFT repeatability",
    "sift_chance": "SIFT by chance",
    "sift_matches": "SIFT matches",
    "sift_inlier_share": "SIFT inlier share",
    "contrast": "RMS contrast of A",
    "direct_contrast": "RMS contrast of the direct layer",
    "veil_over_signal": "veil over signal",
    "verified_matches": "ORB matches that agree with one motion",
    "verified_share": "share of ORB matches",
    "tracked": "corners followed",
    "tracked_share": "share of corners",
    "black_level": "black level of A",
    "failure_chance": "chance of failure",
    "median_range_m": "median range [m]",
    "optical_depth": "optical depth (green)",
}
"""Names of the measures by frame, for people, in order."""
COMPARED = (
    "optical_depth",
    "orb_per_mpx",
    "orb_repeatability",
    "orb_inlier_share",
    "sift_repeatability",
    "sift_inlier_share",
    "contrast",
    "veil_over_signal",
    "failure_chance",
)
PLOTS = (
    ("Keypoints", "", ("orb_count", "sift_count")),
    ("Repeatability", "", ("orb_repeatability", "sift_repeatability", "orb_chance", "sift_chance")),
    ("Inlier share of matches", "", ("orb_inlier_share", "sift_inlier_share")),
    ("RMS contrast", "", ("contrast", "direct_contrast")),
    ("Veil over signal", "", ("veil_over_signal",)),
    ("Median range", "m", ("median_range_m",)),
    ("Optical depth", "", ("optical_depth",)),
)
MEASURES, ODOMETRY = (
    ("measure", "median", "least", "greatest"),
    ("odometry", "ATE [m]", "ATE [% of path]", "drift [%]", "lost frames", "failed steps [%]"),
)


def text(value: float | None, digits: int = 3) -> str:
    """A number for a table; a dash for none."""
    if value is None:
        return "–"
    return f"{value:.0f}" if abs(value) >= 10**digits - 0.5 else f"{value:.{digits}g}"


def spread(mean: float | None, std: float | None, scale: float = 1.0) -> str:
    """Mean and standard deviation over seeds; a dash for none."""
    return "–" if mean is None or std is None else f"{text(scale * mean)} ± {text(scale * std, 1)}"


def measures(found: Readiness) -> list[list[str]]:
    """Rows of `MEASURES`."""
    rows = []
    for name, words in SHOWN.items():
        values = [v for v in found.by_frame.get(name, ()) if v is not None]
        if values:
            rows.append([words, text(float(np.median(values))), text(min(values)), text(max(values))])
    return rows


def odometry_row(kind: str, run: Odometry) -> list[str]:
    """A row of `ODOMETRY`."""
    plain = run.plain()
    pairs = [(plain[f"{name}_mean"], plain[f"{name}_std"]) for name in ("ate_m", "ate_share", "drift", "lost")]
    shares = [spread(*pair, scale) for pair, scale in zip(pairs, (1.0, 100.0, 100.0, 1.0), strict=True)]
    return [
        f"{kind}, {' and '.join(run.cameras)}",
        *shares[:3],
        f"{shares[3]} of {run.frames - 1}",
        text(100.0 * plain["failed_share"]),
    ]


def sentences(found: Readiness) -> list[str]:
    """What stands below the tables."""
    said = []
    if found.excitation:
        e = found.excitation
        axes = [", ".join(f"{v:.3g}" for v in e[name]) for name in ("angular_rate_rms", "specific_force_rms")]
        said.append(
            f"IMU excitation about its mean, x, y, z: {axes[0]} rad/s, {axes[1]} m/s^2; between frames "
            f"{e['specific_force_of_frames']:.3g} m/s^2"
            + ("" if e["vins_excited"] else "; VINS-Mono would say: IMU excitation not enough!")
        )
    if found.loop_closures is not None:
        pairs = found.loop_closures
        seen = f"{counted(len(pairs), 'frame')} see{'s' * (len(pairs) == 1)} a place again, frame "
        said.append(
            "loop closures: " + ("none" if not pairs else f"{seen}{pairs[0][0]} first, that of frame {pairs[0][1]}")
        )
    return said + [f"left out: {words}" for words in found.left_out]


def comparison(found: Sequence[Readiness]) -> tuple[list[str], list[list[str]]]:
    """Header and rows of the table of several datasets, by optical depth; those that differ in their seed are a row."""
    kinds = [kind for kind in ("mono", "stereo") if any(kind in each.odometry for each in found)]
    header = ["dataset", *(SHOWN[name] for name in COMPARED)]
    header += [words for kind in kinds for words in (f"{kind} ATE [%]", "lost", "failed steps [%]")]
    rows = []
    for name, of in groups(found):
        told = compared(of)
        rows.append([name, *(give(told.get(measure)) for measure in COMPARED)])
        for kind in kinds:
            rows[-1] += _odometry_cells(kind, of, told)
    return header, rows


def give(pair: tuple[float | None, float | None] | None, scale: float = 1.0) -> str:
    """Mean and, where there is one, standard error."""
    mean, error = pair or (None, None)
    return spread(mean, error, scale) if error is not None else text(None if mean is None else scale * mean)


def _odometry_cells(
    kind: str, of: Sequence[Readiness], told: dict[str, tuple[float | None, float | None]]
) -> list[str]:
    """Return the cells of one dataset with the spread over runs of RANSAC, of several with their standard error."""
    if len(of) == 1:
        run = of[0].odometry.get(kind)
        return ["–"] * 3 if run is None else [odometry_row(kind, run)[i] for i in (2, 4, 5)]
    return [
        give(told.get(f"{kind}_ate_share"), 100.0),
        give(told.get(f"{kind}_lost")),
        give(told.get(f"{kind}_failed_share"), 100.0),
    ]


def write(found: Sequence[Readiness], path: Path) -> Path:
    """Write the page: of one dataset its curves over frames, of several their table and curves over optical depth."""
    return _of_one(found[0], path) if len(found) == 1 else _of_several(found, path)


def _of_one(found: Readiness, path: Path) -> Path:
    x, plots = np.array(found.time_s), []
    for title, unit, names in PLOTS:
        shown = [name for name in names if name in found.by_frame]
        if shown:
            columns = np.array([found.by_frame[name] for name in shown], float).T
            plots.append(curve(title, unit, x, columns, [SHOWN[n] for n in shown], x, zero=True))
    plots.append(_failing(found, x))
    runs = [odometry_row(kind, run) for kind, run in found.odometry.items()]
    odometry = Table(runs, ODOMETRY, "numbers") if runs else Note("None.", "empty")
    return write_page(
        path,
        "readiness.html",
        title=f"Readiness of {found.root.absolute().name}",
        root=found.root.absolute().name,
        tiles=[
            (str(len(found.frames)), "frames"),
            (found.camera, "camera"),
            (text(found.medians().get("optical_depth")), "optical depth"),
            (text(found.failure_chance(), 2), "mean chance of failure"),
        ],
        content=_content(found.frames, x.tolist(), plots),
        sections={"curves": "Over the frames", "measures": "Measures", "odometry": "Odometry"},
        blocks={
            "measures": [Table(measures(found), MEASURES, "numbers")],
            "odometry": [odometry, *map(Note, sentences(found))],
        },
    )


def _failing(found: Readiness, x: np.ndarray) -> dict:
    """The forecast over the frames and, where the odometry ran, the share of its runs that failed there."""
    columns = {"forecast": found.by_frame["failure_chance"]}
    columns |= {f"seen, {kind}": [*run.failed_steps, None] for kind, run in found.odometry.items()}
    return curve(
        "Chance of a failing step", "", x, np.array(list(columns.values()), float).T, list(columns), x, zero=True
    )


def _of_several(found: Sequence[Readiness], path: Path) -> Path:
    header, rows = comparison(found)
    deep = [of for _, of in groups(found) if compared(of).get("optical_depth", (None,))[0] is not None]
    return write_page(
        path,
        "readiness.html",
        title="Readiness against optical depth",
        root=f"{len(found)} datasets",
        tiles=[(str(len(found)), "datasets")],
        sections={"curves": "Over optical depth", "table": "By optical depth"},
        blocks={"table": [Table(rows, header, "numbers")]},
        content=_content([], [], _against_depth(deep) if len(deep) > 1 else []),
    )


def _against_depth(found: Sequence[Sequence[Readiness]]) -> list[dict]:
    """Curves over groups that have an optical depth."""
    told, plots = [compared(of) for of in found], []
    x = np.array([one["optical_depth"][0] for one in told], float)

    def add(title: str, unit: str, columns: list[np.ndarray], names: Iterable[str]) -> None:
        plots.append(curve(title, unit, x, np.column_stack(columns), names, distance=True, x_unit="", zero=True))

    def column(name: str, i: int = 0) -> np.ndarray:
        return np.array([one.get(name, (None, None))[i] for one in told], float)

    for title, unit, names in PLOTS[:-2]:
        shown = [name for name in names if np.isfinite(column(name)).any()]
        if shown:
            add(title, unit, [column(name) for name in shown], [SHOWN[n] for n in shown])
    add(
        "Share of failing steps",
        "",
        [column("failure_chance"), column("mono_failed_share")],
        ("forecast", "seen, mono"),
    )
    for kind in ("mono", "stereo"):
        mean, error = 100 * column(f"{kind}_ate_share"), 100 * column(f"{kind}_ate_share", 1)
        if np.isfinite(mean).any():
            runs = [of[0].odometry[kind].plain()["ate_share_std"] if kind in of[0].odometry else None for of in found]
            error = np.where(np.isfinite(error), error, 100 * np.array(runs, float))
            names = ("mean", "less its spread over seeds", "more")
            add(f"ATE, {kind}", "% of the path", [mean, mean - error, mean + error], names)
    return plots


def _content(frames: list[int], times: list[float], plots: list[dict]) -> dict:
    return {
        "frames": frames,
        "times": times,
        "cameras": [],
        "images": {},
        "outputs": [],
        "plots": plots,
        "attenuation": None,
    }
