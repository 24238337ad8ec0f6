"""How much an IMU is moved: without it, scale and biases of a visual-inertial estimator are not observable."""

import numpy as np

from varos_warp.dataset.reader.dataset import Dataset

VINS_LEAST = 0.25
"""m/s^2: below it, VINS-Mono says "IMU excitation not enough!" of the spread of the specific force between frames."""


def excitation(data: Dataset) -> dict | None:
    """Measure how much the IMU's readings vary over the frames; None if there is no IMU.

    Returns:
        angular_rate_rms [rad/s] and specific_force_rms [m/s^2] by axis, about their means; specific_force_of_frames
        [m/s^2], the standard deviation of the mean specific force between frames (all axes), and vins_excited, whether
        that reaches what VINS-Mono asks for.
    """
    if "imu0" not in data.recorded or len(data) < 3:
        return None
    times = data.views()[0]
    read = data.imu(int(times[0]), int(times[-1]) + 1)
    if len(read["time_ns"]) < 2:
        return None
    between = frame_means(read["time_ns"], read["acceleration"], times)
    spread = float(np.sqrt(((between - between.mean(0)) ** 2).sum() / max(len(between) - 1, 1)))
    return {
        "angular_rate_rms": read["angular_velocity"].std(0).tolist(),
        "specific_force_rms": read["acceleration"].std(0).tolist(),
        "specific_force_of_frames": spread,
        "vins_excited": spread >= VINS_LEAST,
    }


def frame_means(time_ns: np.ndarray, values: np.ndarray, frames_ns: np.ndarray) -> np.ndarray:
    """Means [M, 3] of values [N, 3] from each frame to the next, of the intervals that have any."""
    interval = np.searchsorted(frames_ns, time_ns, "right") - 1
    inside = (interval >= 0) & (interval < len(frames_ns) - 1)
    count = np.bincount(interval[inside], minlength=len(frames_ns) - 1)
    sums = np.stack([np.bincount(interval[inside], values[inside, i], len(frames_ns) - 1) for i in range(3)], -1)
    return sums[count > 0] / count[count > 0, None]
