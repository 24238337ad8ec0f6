"""Tables and the page of readiness: of one dataset over its frames, of several against optical depth."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from varos_warp.dataset.readiness.measure import Readiness
from varos_warp.dataset.readiness.odometry import Odometry
from varos_warp.dataset.report import facts, write_page
from varos_warp.dataset.report.curves import curve

SHOWN = {
    "orb_count": "ORB keypoints", "orb_per_mpx": "ORB keypoints [1/Mpx]", "orb_repeatability": "ORB repeatability",
    "orb_chance": "of it by chance", "orb_matches": "ORB matches", "orb_inlier_share": "ORB inlier share",
    "sift_count": "SIFT keypoints", "sift_per_mpx": "SIFT keypoints [1/Mpx]",
    "sift_repeatability": "SIFT repeatability", "sift_chance": "of it by chance", "sift_matches": "SIFT matches",
    "sift_inlier_share": "SIFT inlier share", "contrast": "RMS contrast of A",
    "direct_contrast": "RMS contrast of the direct layer", "veil_over_signal": "veil over signal",
    "median_range_m": "median range [m]", "optical_depth": "optical depth (green)",
}
"""Names of the measures by frame, for people, in order."""
COMPARED = ("optical_depth", "orb_per_mpx", "orb_repeatability", "orb_inlier_share", "sift_repeatability",
            "sift_inlier_share", "contrast", "veil_over_signal")
PLOTS = (("Keypoints", "", ("orb_count", "sift_count")),
         ("Repeatability", "", ("orb_repeatability", "sift_repeatability", "orb_chance", "sift_chance")),
         ("Inlier share of matches", "", ("orb_inlier_share", "sift_inlier_share")),
         ("RMS contrast", "", ("contrast", "direct_contrast")), ("Veil over signal", "", ("veil_over_signal",)),
         ("Median range", "m", ("median_range_m",)), ("Optical depth", "", ("optical_depth",)))
MEASURES, ODOMETRY = ("measure", "median", "least", "greatest"), (
    "odometry", "ATE [m]", "ATE [% of path]", "drift [%]", "lost frames")


def text(value: float | None, digits: int = 3) -> str:
    """A number for a table; a dash for none."""
    return "–" if value is None else f"{value:.{digits}g}"


def spread(mean: float | None, std: float | None, scale: float = 1.0) -> str:
    """Mean and standard deviation over seeds; a dash for none."""
    return "–" if mean is None or std is None else f"{scale * mean:.3g} ± {scale * std:.1g}"


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
    return [f"{kind}, {' and '.join(run.cameras)}", *shares[:3], f"{shares[3]} of {run.frames - 1}"]


def sentences(found: Readiness) -> list[str]:
    """What stands below the tables."""
    said = []
    if found.excitation:
        e = found.excitation
        axes = [", ".join(f"{v:.3g}" for v in e[name]) for name in ("angular_rate_rms", "specific_force_rms")]
        said.append(f"IMU excitation about its mean, x, y, z: {axes[0]} rad/s, {axes[1]} m/s^2; between frames "
                    f"{e['specific_force_of_frames']:.3g} m/s^2"
                    + ("" if e["vins_excited"] else "; VINS-Mono would say: IMU excitation not enough!"))
    if found.loop_closures is not None:
        pairs = found.loop_closures
        said.append("loop closures: " + ("none" if not pairs else f"{len(pairs)} frames see a place again, frame "
                                                                   f"{pairs[0][0]} first, that of frame {pairs[0][1]}"))
    return said + [f"left out: {words}" for words in found.left_out]


def by_depth(found: Sequence[Readiness]) -> list[Readiness]:
    """Datasets in order of their optical depth; those without one last."""
    def depth(each: Readiness) -> float:
        value = each.medians().get("optical_depth")
        return np.inf if value is None else value

    return sorted(found, key=depth)


def comparison(found: Sequence[Readiness]) -> tuple[list[str], list[list[str]]]:
    """Header and rows of the table of several datasets, by optical depth."""
    kinds = [kind for kind in ("mono", "stereo") if any(kind in each.odometry for each in found)]
    header = ["dataset", *(SHOWN[name] for name in COMPARED)]
    header += [words for kind in kinds for words in (f"{kind} ATE [%]", "lost")]
    rows = []
    for each in by_depth(found):
        medians, row = each.medians(), [str(each.root)]
        row += [text(medians.get(name)) for name in COMPARED]
        for kind in kinds:
            row += odometry_row(kind, each.odometry[kind])[2::2] if kind in each.odometry else ["–", "–"]
        rows.append(row)
    return header, rows


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
    tables = facts.table(measures(found), MEASURES, "numbers")
    runs = [odometry_row(kind, run) for kind, run in found.odometry.items()]
    odometry = facts.table(runs, ODOMETRY, "numbers") if runs else "<p class=empty>None.</p>"
    said = "".join(facts.note(words) for words in sentences(found))
    sections = [("curves", "Over the frames", '<div id="plots"></div>'),
                ("measures", "Measures", f'<div class="card">{tables}</div>'),
                ("odometry", "Odometry", f'<div class="card">{odometry}{said}</div>')]
    return write_page(path, title=f"Readiness of {found.root.absolute().name}", root=found.root.absolute().name,
                      tiles=[(str(len(found.frames)), "frames"), (found.camera, "camera"),
                             (text(found.medians().get("optical_depth")), "optical depth")],
                      notes="", content=_content(found.frames, x.tolist(), plots), sections=sections)


def _of_several(found: Sequence[Readiness], path: Path) -> Path:
    header, rows = comparison(found)
    sections = [("curves", "Over optical depth", '<div id="plots"></div>'),
                ("table", "By optical depth", f'<div class="card">{facts.table(rows, header, "numbers")}</div>')]
    deep = [each for each in by_depth(found) if each.medians().get("optical_depth") is not None]
    return write_page(path, title="Readiness against optical depth", root=f"{len(found)} datasets",
                      tiles=[(str(len(found)), "datasets")], notes="", sections=sections,
                      content=_content([], [], _against_depth(deep) if len(deep) > 1 else []))


def _against_depth(found: Sequence[Readiness]) -> list[dict]:
    x, medians = np.array([each.medians()["optical_depth"] for each in found], float), [e.medians() for e in found]
    plots = []
    for title, unit, names in PLOTS[:-2]:
        shown = [name for name in names if any(m.get(name) is not None for m in medians)]
        if shown:
            columns = np.array([[m.get(name) for name in shown] for m in medians], float)
            plots.append(curve(title, unit, x, columns, [SHOWN[n] for n in shown], distance=True, x_unit="", zero=True))
    for kind in ("mono", "stereo"):
        runs = [each.odometry[kind].plain() if kind in each.odometry else {} for each in found]
        pairs = np.array([[run.get("ate_share_mean"), run.get("ate_share_std")] for run in runs], float) * 100
        if np.isfinite(pairs).any():
            mean, std = pairs.T
            plots.append(curve(f"ATE, {kind}", "% of the path", x, np.column_stack([mean, mean - std, mean + std]),
                               ("mean", "less one deviation over seeds", "more"), distance=True, x_unit="", zero=True))
    return plots


def _content(frames: list[int], times: list[float], plots: list[dict]) -> dict:
    return {"frames": frames, "times": times, "cameras": [], "images": {}, "outputs": [], "plots": plots,
            "attenuation": None}
