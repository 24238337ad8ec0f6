"""The way from axes of a file to ours, in float64: world axes, axes of the body, and what is mounted on its vehicle.

    R_w_v = R_w_f R_f_b R_b_v        f: the file's world axes, b: the body whose attitude R_f_b it has
    p_w_v = R_w_f (p_f - origin) - R_w_v t_v_x        x: what the poses are of, at t_v_x on the vehicle

The permutations only reorder coordinates and change signs, so that they are exact.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.scene.description import Scene
from varos_warp.scene.frames import R_V_C, pose_matrix, transform

SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Swaps the first two axes and turns the third over, which is its own inverse."""
R_W_F = {"enu": np.eye(3), "ned": SWAP}
"""Rotations from the world axes of a file to ours, x east, y north, z up."""
R_B_V = {"rfu": np.eye(3), "flu": np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), "frd": SWAP}
"""Rotations from vehicle axes, x right, y forward, z up, to those of a body; their columns are our axes in its."""
STILL_M_S = 0.01
"""Slower than this the way has no direction [m/s]."""


def mount(scene: Scene, of: str) -> np.ndarray:
    """T_v_x [4, 4] of what the poses of a file are: the vehicle, its IMU, or a camera by its id, in optical axes."""
    if of == "vehicle":
        return np.eye(4)
    if of == "imu":
        return pose_matrix(scene.vehicle.imu)
    camera = next(camera for camera in scene.vehicle.cameras if camera.id == of)
    return pose_matrix(camera) @ transform(R_V_C)


def vehicle_poses(
    position: np.ndarray, turned: Rotation | None, frame: str, body: str, T_v_x: np.ndarray, origin=(0.0, 0.0, 0.0)
) -> tuple[np.ndarray, Rotation | None]:
    """Poses of a vehicle from those of a file, all in float64.

    Args:
        position: [N, 3] in the file's world axes [m].
        turned: N attitudes in them, of the body or of what is mounted; None: the file has none.
        frame: Its world axes, of `R_W_F`.
        body: Axes of the body, of `R_B_V`; of what is mounted, rfu.
        T_v_x: What the poses are of, `mount`.
        origin: Our origin in the file's coordinates [m].

    Returns:
        Places [N, 3] and attitudes of the vehicle; of a file without attitudes, places of what they are of, and None.
    """
    place = (position - np.asarray(origin, float)) @ R_W_F[frame].T
    if turned is None:
        return place, None
    R_w_v = Rotation.from_matrix(R_W_F[frame]) * turned * Rotation.from_matrix(R_B_V[body] @ T_v_x[:3, :3].T)
    return place - R_w_v.apply(T_v_x[:3, 3]), R_w_v


def along_path(velocity: np.ndarray) -> Rotation:
    """Attitudes that look along velocities [N, 3] [m/s], level across; where nothing moves on, that of before.

    Returns:
        N attitudes, as `look_at_matrix` has them; north where nothing moves at all.
    """
    moving = np.linalg.norm(velocity, axis=1) >= STILL_M_S
    if not moving.any():
        return Rotation.identity(len(moving))
    before = np.maximum.accumulate(np.where(moving, np.arange(len(moving)), -1))
    forward = velocity[np.where(before < 0, np.argmax(moving), before)]
    forward = forward / np.linalg.norm(forward, axis=1, keepdims=True)
    right = np.stack([forward[:, 1], -forward[:, 0], np.zeros(len(forward))], axis=1)
    upright = np.linalg.norm(right, axis=1) < 1e-9  # no heading then: right is the world's x, as look_at has it
    right[upright] = np.array([1.0, 0.0, 0.0]) - forward[upright, :1] * forward[upright]
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return Rotation.from_matrix(np.stack([right, forward, np.cross(right, forward)], axis=2))
