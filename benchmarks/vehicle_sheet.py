"""Roll, pitch and heave of docs/vehicle.md: a ROV that does not control pitch, in still and in turbulent water.

    python -m benchmarks.vehicle_sheet [-o docs/images/vehicle.png]

Three lanes, twice: the second time the water is turbulent.
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from varos_warp.scene.file.load import scene_from_dict
from varos_warp.sim.trajectory import Simulation, simulate

ROOT = Path(__file__).parents[1]
TURBULENCE = {"rms": [0.06, 0.06, 0.04], "correlation_time_s": 5}


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
    return simulate(
        scene_from_dict(
            {
                "current": current,
                "trajectory": {"speed": 0.5, "pattern": lanes},
                "vehicle": {"mass_kg": 13.5, "metacentric_height": 0.06, "rigid_body": body},
            }
        )
    )


def main():
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "docs" / "images" / "vehicle.png")
    out = parser.parse_args().out
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
    figure.savefig(out, dpi=90)


if __name__ == "__main__":
    main()
