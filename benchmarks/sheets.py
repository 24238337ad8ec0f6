"""Pictures of docs/trajectories.md and docs/vehicle.md: courses from above, and an ROV's roll, pitch and depth.

    python -m benchmarks.sheets [-o docs/images]

``trajectories.png``: the patterns as they are driven, coloured by speed; an arrow shows where the vehicle looks, a dot
where it begins. ``vehicle.png``: an ROV that does not control pitch on three lanes, in still and in turbulent water.
"""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from benchmarks.machine import command
from varos_warp.scene.file.load import load_scene, scene_from_dict
from varos_warp.sim.trajectory import Simulation, course_facts, simulate

ROOT = Path(__file__).parents[1]
NAMES = ("lawn_mower", "orbit", "spiral", "there_and_back", "hull_following")
FASTEST = 0.55
"""Upper end of the colours [m/s]."""
LOOKS_S = 4.0
"""Time between two arrows that show where the vehicle looks [s]."""
TURBULENCE = {"rms": [0.06, 0.06, 0.04], "correlation_time_s": 5}


def courses(out: Path) -> None:
    """Write the picture of the patterns."""
    figure, axes = plt.subplots(1, len(NAMES), figsize=(16, 3.6), layout="constrained")
    shown = [_course(axis, name) for axis, name in zip(axes, NAMES, strict=True)]
    axes[0].set_ylabel("y, north [m]")
    figure.colorbar(shown[-1], ax=axes, label="speed [m/s]")
    figure.savefig(out / "trajectories.png", dpi=90)


def _course(axis, name: str):
    """Draw a course; returns what the colours stand for."""
    scene = load_scene(ROOT / "examples" / "trajectories" / f"{name}.yaml")
    run = simulate(scene)
    facts, step = course_facts(run, scene), run.trajectory
    place, speed = step.position, np.linalg.norm(step.velocity, axis=1)
    shown = axis.scatter(place[::10, 0], place[::10, 1], c=speed[::10], s=5, vmin=0.0, vmax=FASTEST, cmap="viridis")
    rows = np.flatnonzero(step.time_ns % round(LOOKS_S * 1e9) == 0)
    forward = step.rotation().as_matrix()[rows, :, 1]
    drawn = {"color": "0.35", "angles": "xy", "scale_units": "xy", "scale": 1.6, "width": 0.006}
    axis.quiver(*place[rows, :2].T, *forward[:, :2].T, **drawn)
    axis.plot(*place[0, :2], "o", color="crimson", markersize=6)
    axis.set_title(f"{name}: {facts['length_m']:.0f} m in {facts['duration_s']:.0f} s", fontsize=10)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("x, east [m]")
    axis.margins(0.12)
    return shown


def survey(current: dict) -> Simulation:
    """Three lanes at 0.5 m/s with six thrusters, the horizontal ones 4 cm above the centre of mass."""
    vectored = [
        {"position": [x * 0.11, y * 0.16, 0.04], "direction": [-x, y, 0], "max_force": 40}
        for x in (1, -1)
        for y in (1, -1)
    ]
    upwards = [{"position": [x * 0.12, 0, 0], "direction": [0, 0, 1], "max_force": 40} for x in (1, -1)]
    body = {
        "inertia": [0.26, 0.23, 0.37],
        "added_mass": [7.1, 6.4, 18.7, 0.19, 0.12, 0.22],
        "linear_drag": [18, 14, 60, 1.1, 0.9, 1.2],
        "quadratic_drag": [60, 40, 90, 1.6, 1.3, 1.6],
        "thrusters": vectored + upwards,
    }
    lanes = {"kind": "lawn_mower", "centre": [0, 0, 2], "length_m": 6, "width_m": 2, "spacing_m": 1}
    vehicle = {"mass_kg": 13.5, "metacentric_height": 0.06, "rigid_body": body}
    return simulate(
        scene_from_dict({"current": current, "trajectory": {"speed": 0.5, "pattern": lanes}, "vehicle": vehicle})
    )


def attitudes(out: Path) -> None:
    """Write the picture of roll, pitch and depth."""
    figure, axes = plt.subplots(3, 1, figsize=(8, 5.4), sharex=True, layout="constrained")
    for name, current in (("still water", {}), ("turbulent", {"turbulence": TURBULENCE})):
        run = survey(current).trajectory
        t, angles = run.time_ns * 1e-9, run.rotation().as_euler("ZXY", degrees=True)
        for axis, values in zip(axes, (angles[:, 2], angles[:, 1], run.position[:, 2]), strict=True):
            axis.plot(t, values, label=name, lw=1.2)
    for axis, label in zip(axes, ("roll [deg]", "pitch [deg]", "z [m]"), strict=True):
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[0].legend(ncols=2)
    axes[-1].set_xlabel("time [s]")
    figure.savefig(out / "vehicle.png", dpi=90)


def main() -> None:
    parser = command(__doc__, device=None)
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "docs" / "images")
    out = parser.parse_args().out
    courses(out)
    attitudes(out)


if __name__ == "__main__":
    main()
