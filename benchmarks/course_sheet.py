"""The patterns of docs/trajectories.md from above, as they are driven, coloured by speed.

    python -m benchmarks.course_sheet [-o docs/images/trajectories.png]

An arrow shows where the vehicle looks, a dot where it begins.
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from varos_warp.scene.file.load import load_scene
from varos_warp.sim.trajectory import course_facts, simulate

ROOT = Path(__file__).parents[1]
NAMES = ("lawn_mower", "orbit", "spiral", "there_and_back", "hull_following")
FASTEST = 0.55
"""Upper end of the colours [m/s]."""
LOOKS_S = 4.0
"""Time between two arrows that show where the vehicle looks [s]."""


def panel(axis, name: str):
    """Draw a course; returns what the colours stand for."""
    run = simulate(load_scene(ROOT / "examples" / "trajectories" / f"{name}.yaml"))
    facts, step = course_facts(run), run.trajectory
    place, speed = step.position, np.linalg.norm(step.velocity, axis=1)
    shown = axis.scatter(place[::10, 0], place[::10, 1], c=speed[::10], s=5, vmin=0.0, vmax=FASTEST, cmap="viridis")
    rows = np.flatnonzero(step.time_ns % round(LOOKS_S * 1e9) == 0)
    forward = step.rotation().as_matrix()[rows, :, 1]
    axis.quiver(
        place[rows, 0],
        place[rows, 1],
        forward[:, 0],
        forward[:, 1],
        color="0.35",
        angles="xy",
        scale_units="xy",
        scale=1.6,
        width=0.006,
    )
    axis.plot(*place[0, :2], "o", color="crimson", markersize=6)
    axis.set_title(f"{name}: {facts['length_m']:.0f} m in {facts['duration_s']:.0f} s", fontsize=10)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("x, east [m]")
    axis.margins(0.12)
    return shown


def main():
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "docs" / "images" / "trajectories.png")
    out = parser.parse_args().out
    figure, axes = plt.subplots(1, len(NAMES), figsize=(16, 3.6), layout="constrained")
    for axis, name in zip(axes, NAMES, strict=True):
        shown = panel(axis, name)
    axes[0].set_ylabel("y, north [m]")
    figure.colorbar(shown, ax=axes, label="speed [m/s]")
    figure.savefig(out, dpi=90)


if __name__ == "__main__":
    main()
