"""What the tests of the exports share: plain readers of text tables, and poses as matrices."""

import numpy as np
from scipy.spatial.transform import Rotation

ROUNDING = 1e-14
"""Of a rotation matrix to a quaternion and back, and of products of a few transforms: tens of 2^-53."""


def matrices(position, quaternion, scalar_first):
    """T [N, 4, 4]."""
    T = np.tile(np.eye(4), (len(position), 1, 1))
    T[:, :3, 3] = position
    T[:, :3, :3] = Rotation.from_quat(quaternion, scalar_first=scalar_first).as_matrix()
    return T


def rows(path, separator=" "):
    """Words of the lines that are no remarks."""
    return [line.split(separator) for line in path.read_text().splitlines() if line and not line.startswith("#")]


def largest_ape(course, time_ns, T):
    """Largest absolute pose error [m and rad mixed, as the norm of T_ref^-1 T_est - 1] that evo finds, unaligned."""
    from evo.core import metrics
    from evo.core.trajectory import PosePath3D, PoseTrajectory3D

    if time_ns is None:
        native = PosePath3D(poses_se3=list(T))
    else:
        native = PoseTrajectory3D(poses_se3=list(T), timestamps=np.array(time_ns) / 1e9)
        np.testing.assert_allclose(course.timestamps, native.timestamps, rtol=0, atol=5e-10)  # half a nanosecond
    error = metrics.APE(metrics.PoseRelation.full_transformation)
    error.process_data((native, course))
    assert len(error.error) == len(T)
    return error.get_statistic(metrics.StatisticsType.max)
