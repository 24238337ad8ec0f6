"""The forecast of `varos-warp readiness`: render scenes in several waters, fit it on some, test it on the others.

    python -m benchmarks.failure_forecast make OUT        # about 20 minutes of one core
    python -m benchmarks.failure_forecast table OUT       # benchmarks/results/failure_forecast.csv
    python -m benchmarks.failure_forecast fit             # varos_warp/data/readiness/forecast.json

What is forecast is whether the small monocular odometry fails at the step from a frame to the next, for half of three
seeds or more (`varos_warp.dataset.readiness.score.failed`); from what it is forecast, `forecast.SIGNS`. Which scenes
are held out was settled before any was measured; waters, and what a failure is, by those that it is fitted on. Frames
of a dataset are alike, so the bootstrap draws datasets, not frames.
"""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.stats import rankdata

from benchmarks.machine import RESULTS, ROOT
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.readiness.measure import by_frame
from varos_warp.dataset.readiness.odometry.forecast import SIGNS, Forecast, regressors
from varos_warp.dataset.readiness.odometry.odometry import odometries

TABLE = RESULTS / "failure_forecast.csv"
FORECAST = ROOT / "varos_warp" / "data" / "readiness" / "forecast.json"
WATERS = ("IB", "III", "1C", "3C", "7C")
COMMON = ("vehicle.cameras.0.resolution=[320,180]", "particles=[]", "render.max_triangles=250000")
LEFT = (
    "{id: L0, position: [-0.1, 0, 0], rotation_euler_deg: [-65, 0, 0], resolution: [320, 180], "
    "sensor_mm: [7.2, 4.05], focal_mm: 5.0}"
)
SCENES = {
    "pipeline_inspection": ("render.frame_rate_hz=4", "trajectory.duration_s=3.5"),
    "hull": ("render.frame_rate_hz=4",),
    "turbid_water": ("render.frame_rate_hz=4", "trajectory.duration_s=3.5"),
    "stereo_survey": ("render.frame_rate_hz=4", "trajectory.duration_s=3.5", f"vehicle.cameras=[{LEFT}]"),
    "harbour_wall": ("render.frame_rate_hz=3", "trajectory.duration_s=4.5"),
}
"""Templates, and what is changed in each: smaller pictures, without snow, with steps of some ten pixels."""
HELD_OUT = ("stereo_survey", "harbour_wall")
PENALTY = 1.0
"""Weight of the sum of squares of the coefficients, for regressors with a standard deviation of 1."""
DRAWS, SEEDS = 2000, 3


def make(out: Path) -> None:
    """Render every scene in every water, 12 frames of 2 samples, denoised; what is there is kept."""
    for name, changes in SCENES.items():
        scene = ROOT / "varos_warp" / "data" / "templates" / f"{name}.yaml"
        sweep = [sys.executable, "-m", "varos_warp", "sweep", str(scene), "-o", str(out / name)]
        waters = ["--over", f"water.jerlov.type={','.join(WATERS)}"]
        words = [f"--set={change}" for change in (*COMMON, *changes)]
        how = "--outputs A --frames 0:12 --spp 2 --integrator path --seed 1".split()
        subprocess.run([*sweep, *waters, *words, *how], check=True)


def table(out: Path) -> None:
    """Measure the datasets: a row for each step."""
    rows = []
    for name in SCENES:
        for root in sorted(path.parent for path in (out / name).glob("*/dataset.json")):
            data = Dataset(root)
            camera = data.cameras[0]
            found = by_frame(data, camera)
            for step, failed in enumerate(odometries(data, camera, SEEDS)[0]["mono"].failed_steps):
                signs = {sign: found[sign][step] if sign in found else None for sign in SIGNS}
                rows.append(
                    {
                        "scene": name,
                        "water": root.name,
                        "frame": data.frames[step],
                        **{k: "" if v is None else f"{v:.6g}" for k, v in signs.items()},
                        "failed": f"{failed:.6g}",
                    }
                )
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def read() -> list[dict[str, str]]:
    """Rows of the table."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def arrays(rows: list[dict[str, str]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Regressors [N, 5], whether the step failed [N], and the dataset that it is of [N]."""
    x = np.array([regressors({sign: float(row[sign] or 0.0) for sign in SIGNS}) for row in rows])
    return (
        x,
        np.array([float(row["failed"]) >= 0.5 for row in rows]),
        np.array([f"{row['scene']} {row['water']}" for row in rows]),
    )


def fitted(x: np.ndarray, failed: np.ndarray) -> Forecast:
    """Logistic regression with a quadratic penalty."""
    mean, scale = x.mean(0), x.std(0)
    z, sign = (x - mean) / scale, np.where(failed, 1.0, -1.0)

    def loss(w: np.ndarray) -> tuple[float, np.ndarray]:
        margin = sign * (z @ w[:-1] + w[-1])
        pull = -sign * np.exp(-np.logaddexp(0.0, margin))
        slope = np.append(z.T @ pull + PENALTY * w[:-1], pull.sum())
        return float(np.logaddexp(0.0, -margin).sum() + 0.5 * PENALTY * (w[:-1] ** 2).sum()), slope

    w = minimize(loss, np.zeros(x.shape[1] + 1), jac=True, method="L-BFGS-B", options={"ftol": 1e-15, "gtol": 1e-8}).x
    return Forecast(mean, scale, w[:-1], float(w[-1]))


def auc(score: np.ndarray, failed: np.ndarray) -> float:
    """Chance that a step that fails has a higher score than one that does not; ties count half; NaN of one kind."""
    count = int(failed.sum())
    if not 0 < count < len(failed):
        return float("nan")
    return float((rankdata(score)[failed].sum() - count * (count + 1) / 2) / (count * (len(failed) - count)))


def bootstrap(score: np.ndarray, failed: np.ndarray, dataset: np.ndarray) -> float:
    """Standard error of the AUC, over draws of whole datasets."""
    rng, groups = np.random.default_rng(1), [np.flatnonzero(dataset == name) for name in np.unique(dataset)]
    drawn = [np.concatenate([groups[i] for i in rng.integers(len(groups), size=len(groups))]) for _ in range(DRAWS)]
    return float(np.nanstd([auc(score[rows], failed[rows]) for rows in drawn]))


def tested(score: np.ndarray, failed: np.ndarray, dataset: np.ndarray) -> dict[str, float | int]:
    """How well a score tells the steps that fail from the others."""
    return {
        "datasets": len(np.unique(dataset)),
        "steps": len(failed),
        "failed": int(failed.sum()),
        "auc": round(auc(score, failed), 4),
        "auc_stderr": round(bootstrap(score, failed, dataset), 4),
        "brier": round(float(((score - failed) ** 2).mean()), 4),
        "mean_chance": round(float(score.mean()), 4),
    }


def result() -> dict:
    """The forecast, and its test on the scenes held out, from the table."""
    rows = read()
    parts = {held: [row for row in rows if (row["scene"] in HELD_OUT) == held] for held in (False, True)}
    x, failed, dataset = arrays(parts[False])
    model, (unseen_x, unseen, unseen_of) = fitted(x, failed), arrays(parts[True])
    chance = model.chance(unseen_x)
    by_scene = {
        name: tested(chance[of], unseen[of], unseen_of[of])
        for name in HELD_OUT
        if (of := np.char.startswith(unseen_of, name)).any()
    }
    numbers = {
        name: dict(zip(SIGNS, np.round(getattr(model, name), 6).tolist(), strict=True))
        for name in ("mean", "scale", "coefficients")
    }
    return {
        "made_by": "benchmarks/failure_forecast.py, from benchmarks/results/failure_forecast.csv",
        "forecasts": "that the mono odometry fails at the step to the next frame (readiness/score.py, failed)",
        "rendered": "templates, 12 frames of 320 x 180, 2 samples by path tracing, denoised by OIDN, no snow",
        "fitted_on": {
            "scenes": sorted({row["scene"] for row in parts[False]}),
            "waters": sorted({row["water"] for row in parts[False]}),
            **tested(model.chance(x), failed, dataset),
        },
        "held_out": {"scenes": list(HELD_OUT), **tested(chance, unseen, unseen_of), "by_scene": by_scene},
        "penalty": PENALTY,
        **numbers,
        "intercept": round(model.intercept, 6),
    }


def main(words: list[str]) -> None:
    """Fit or score the forecast, as the module's text tells."""
    if words[:1] == ["fit"]:
        FORECAST.write_text(json.dumps(result(), indent=1) + "\n", encoding="utf-8")
        print(FORECAST.read_text(encoding="utf-8"))
    elif len(words) == 2 and words[0] in ("make", "table"):
        {"make": make, "table": table}[words[0]](Path(words[1]))
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main(sys.argv[1:])
