"""What looks wrong in a recorded course but may be meant, in words."""

import re

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.errors import counted
from varos_warp.scene.courses.layout import Layout
from varos_warp.scene.description.vehicle import Trajectory

GAP = 10.0
"""How many median steps the way from one pose to the next may take unsaid."""
USUAL = {"TUM": "camera", "EuRoC": "IMU"}
"""Whose poses files of a format mostly are."""
UPSIDE_DOWN = -0.5
"""Height of the tip of the vehicle's upward axis below which it is upside down: 120 degrees."""


def gaps(seconds: np.ndarray, usual: float, lines: np.ndarray) -> list[str]:
    """Return a remark on gaps between poses that are much longer than the usual step [s], if there are any."""
    steps = np.diff(seconds)
    wide = np.flatnonzero(steps > GAP * usual)
    if not wide.size:
        return []
    worst = int(wide[np.argmax(steps[wide])])
    return [
        f"{counted(len(wide), 'gap')} of more than {GAP:g} times the usual {usual:.3g} s, the longest of "
        f"{steps[worst]:.3g} s after line {lines[worst]}, {seconds[worst]:.6g} s from the first pose; there the "
        "course is what a spline makes of the poses around it"
    ]


def whole_times(layout: Layout, seconds: np.ndarray, step: float) -> list[str]:
    """Times that may well be in milliseconds."""
    if layout.unit_is_stated or step < 2.0 or (seconds % 1.0).any():
        return []
    return [
        f"its times are whole numbers, {step:g} apart, and taken for seconds, for nothing says otherwise; "
        "trajectory.columns.time_unit states their unit"
    ]


def odd_angles(layout: Layout, turned: Rotation | None, values: np.ndarray) -> list[str]:
    """Angles that may well be in radians where degrees are said, or the other way round."""
    if turned is None or layout.attitude not in ("euler", "euler_deg") or not values.any():
        return []
    most, degrees = float(np.abs(values).max()), layout.attitude == "euler_deg"
    if degrees == (most > 2.0 * np.pi):
        return []
    said, other, key = ("degrees", "radians", "euler") if degrees else ("radians", "degrees", "euler_deg")
    return [f"its angles are up to {most:.3g} {said}; if they are in {other}, name them in columns.{key}"]


def whose_poses(layout: Layout, course: Trajectory) -> list[str]:
    """What is taken for granted of a format whose poses are mostly those of a camera or an IMU."""
    whose = USUAL.get(layout.format)
    if whose is None or course.of is not None or course.body is not None or course.attitude not in (None, "recorded"):
        return []
    say = "imu" if whose == "IMU" else "ID"
    return [
        f"poses of {layout.format} are mostly those of a {whose}, and taken for the vehicle's in axes "
        f"{'frd' if course.frame == 'ned' else 'flu'}, for nothing says otherwise; trajectory.of: {say} says that "
        f"they are the {whose}'s, of: vehicle that they are not".replace("a IMU", "an IMU")
    ]


def upside_down(turned: Rotation, about: dict[str, str]) -> list[str]:
    """Warn if the vehicle is upside down over most of the course, as other axes than those meant make it be."""
    share = float(np.mean(turned.apply([0.0, 0.0, 1.0])[:, 2] < UPSIDE_DOWN))
    if share <= 0.5 or about["attitude"] != "recorded":
        return []
    axes = f"trajectory.body ({about['body']})" if "body" in about else f"how the {about['of']} is mounted"
    return [
        f"the vehicle is upside down at {share:.0%} of the poses; if it was not, look at {axes} and "
        f"trajectory.frame ({about['frame']})"
    ]


def compass(layout: Layout, about: dict[str, str]) -> list[str]:
    """A heading, which mostly counts clockwise from north, in a frame whose yaw counts the other way from east."""
    cells = layout.cells
    names = [cells.names[i] for i in cells.columns[3:]] if layout.attitude.startswith("euler") else []
    called = [name for name in names if re.search(r"heading|hdg|azimuth", name, re.IGNORECASE)]
    if about["frame"] != "enu" or about["attitude"] != "recorded" or not called:
        return []
    return [
        f"its column '{called[0]}' is read as a yaw, anticlockwise from east, as frame enu has it; a compass's "
        "headings are clockwise from north, as in frame: ned"
    ]
