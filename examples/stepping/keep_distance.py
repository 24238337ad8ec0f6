"""Keep 2 m from a wall in a current, by a DVL that looks ahead or by rendered depth, five times per second.

    python examples/stepping/keep_distance.py --by dvl
    python examples/stepping/keep_distance.py --by depth

The exit status is 0 if the vehicle stays within 5 cm of that in the last three seconds, else 1.
"""

import argparse
import sys

import numpy as np

import varos_warp as vw

WALL_M, ASKED_M, WITHIN_M = 5.0, 2.0, 0.05
PERIOD_S = 0.2
GAINS = 60.0, 70.0
"""Force by distance [N/m] and by speed [N s/m]."""
SCENE = {
    "name": "keep_distance",
    "objects": [
        {
            "kind": "calibration_board",
            "pattern": "checkerboard",
            "rows": 6,
            "columns": 8,
            "square_m": 1.0,
            "thickness_m": 0.1,
            "position": [0, WALL_M, 0],
        }
    ],
    "current": {"velocity": [0, 0.1, 0], "fluctuation": 0.02},
    "vehicle": {
        "mass_kg": 12,
        # turned by 90 degrees about x, its -z looks ahead, along the vehicle's y
        "dvl": {"rate_hz": 1 / PERIOD_S, "rotation_euler_deg": [90, 0, 0]},
        "cameras": [{"id": "M0", "resolution": [16, 9]}],
        "lights": [{"kind": "spot", "position": [0.2, 0, 0], "direction": [0, 1, 0], "intensity": [30, 30, 30]}],
    },
    "trajectory": {"waypoints": [{"position": [0, 1, 0]}]},
}


def by_dvl(state: vw.Step) -> float | None:
    """Distance [m] to the wall, if the DVL read it in this tick."""
    assert state.dvl is not None
    return float(state.dvl.altitude[-1]) if len(state.dvl.altitude) else None


def by_depth(scene: vw.Scene, simulator: vw.Simulator):
    """The same of the image that a camera at the vehicle's origin has of the wall."""
    renderer = vw.FrameRenderer(scene, device="cpu")

    def distance(state: vw.Step) -> float | None:
        if state.time_ns % round(1e9 * PERIOD_S):
            return None
        return float(np.median(renderer.render(simulator.pose, "M0", outputs="D").D.depth))

    return distance


def main(arguments: list[str] | None = None) -> int:
    """Run the loop and print the distance once a second."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--by", choices=("dvl", "depth"), default="dvl")
    parser.add_argument("--seconds", type=float, default=20.0)
    asked = parser.parse_args(arguments)

    scene = vw.Scene(**SCENE)
    simulator = vw.Simulator(scene)
    measure = by_dvl if asked.by == "dvl" else by_depth(scene, simulator)
    push, before, late = 0.0, None, []
    while simulator.time_ns < 1e9 * asked.seconds:
        state = simulator.step(force=(0.0, push, 0.0))
        if (distance := measure(state)) is not None and np.isfinite(distance):
            closing = 0.0 if before is None else (before - distance) / PERIOD_S
            push, before = GAINS[0] * (distance - ASKED_M) - GAINS[1] * closing, distance
        true = WALL_M - state.position[1]
        if state.time_ns % 1_000_000_000 == 0:
            print(f"{1e-9 * state.time_ns:5.1f} s  {true:6.3f} m", flush=True)
        if state.time_ns > 1e9 * (asked.seconds - 3.0):
            late.append(abs(true - ASKED_M))
    return 0 if max(late, default=np.inf) < WITHIN_M else 1


if __name__ == "__main__":
    sys.exit(main())
