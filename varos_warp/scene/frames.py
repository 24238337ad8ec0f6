"""Frames and rigid transforms in float64. ``T_a_b`` maps b-coordinates to a-coordinates; all are [4, 4].

World w and vehicle v are z up (vehicle: x right, y forward). A camera c is OpenCV optical: x right, y down, z forward.
"""

import warnings

import numpy as np
from scipy.spatial.transform import Rotation

R_V_C = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""An unrotated camera on the vehicle looks along +y, its image upright."""


def euler_to_matrix(angles_deg) -> np.ndarray:
    """Rotation [3, 3] about the fixed axes x, then y, then z (Blender's 'XYZ'), angles in degrees."""
    return Rotation.from_euler("xyz", np.asarray(angles_deg, float), degrees=True).as_matrix()


def euler_angles(rotation: Rotation) -> np.ndarray:
    """Angles [N, 3] [rad] of N rotations about the fixed axes x, then y, then z, each in (-pi, pi]."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # at ty = +-90 deg only tx -+ tz is defined; tz is then 0
        angles = rotation.as_euler("xyz")
    return np.where(angles <= -np.pi, np.pi, angles)


def look_at_matrix(position, target) -> np.ndarray:
    """Attitude [3, 3] whose +y points from ``position`` to ``target`` and whose x stays horizontal.

    Straight up or down, where the heading is undefined, x is the world's x.
    """
    forward = np.asarray(target, float) - np.asarray(position, float)
    if not forward.any():
        raise ValueError("look_at must differ from the position")
    forward /= np.abs(forward).max()  # or the squares of a very short or long one would be 0 or infinite
    forward /= np.linalg.norm(forward)
    right = np.array([forward[1], -forward[0], 0.0])
    if np.linalg.norm(right) < 1e-9:
        right = np.array([1.0, 0.0, 0.0]) - forward[0] * forward
    right /= np.linalg.norm(right)
    return np.column_stack([right, forward, np.cross(right, forward)])


def transform(rotation=None, position=None) -> np.ndarray:
    """Homogeneous matrix [..., 4, 4] from a rotation [..., 3, 3] and a position [..., 3]."""
    many = np.broadcast_shapes(np.shape(rotation)[:-2], np.shape(position)[:-1])
    T = np.tile(np.eye(4), (*many, 1, 1))
    if rotation is not None:
        T[..., :3, :3] = rotation
    if position is not None:
        T[..., :3, 3] = position
    return T


def inverse(T: np.ndarray) -> np.ndarray:
    """Inverse of a rigid transform."""
    R = T[:3, :3]
    return transform(R.T, -R.T @ T[:3, 3])


def attitude(pose) -> np.ndarray:
    """Rotation [3, 3] of a block with ``position`` and either ``look_at`` or ``rotation_euler_deg`` (or neither)."""
    if getattr(pose, "look_at", None) is not None:
        return look_at_matrix(pose.position, pose.look_at)
    return euler_to_matrix(pose.rotation_euler_deg or (0.0, 0.0, 0.0))


def attitudes(stops) -> list[Rotation]:
    """Attitude of each waypoint or pose; where none is given, that of the one before, at first identity.

    Angles do not go through a matrix: a half turn must keep the sign that the user gave it.
    """
    result = []
    for stop in stops:
        if stop.look_at is not None:
            result.append(Rotation.from_matrix(look_at_matrix(stop.position, stop.look_at)))
        elif stop.rotation_euler_deg is not None:
            result.append(Rotation.from_euler("xyz", stop.rotation_euler_deg, degrees=True))
        else:
            result.append(result[-1] if result else Rotation.identity())
    return result


def pose_matrix(pose) -> np.ndarray:
    """T [4, 4] of a waypoint, pose, sensor or placed object (without its scale)."""
    return transform(attitude(pose), pose.position)


def camera_pose(camera, T_w_v: np.ndarray) -> np.ndarray:
    """T_w_c of a scene's camera block, on the vehicle at ``T_w_v`` [..., 4, 4] or standing in the world; as many."""
    T_mount_c = pose_matrix(camera) @ transform(R_V_C)
    return np.broadcast_to(T_mount_c, T_w_v.shape) if camera.mount == "world" else T_w_v @ T_mount_c


def intrinsics(camera) -> np.ndarray:
    """K [3, 3] in pixels with the centre of the top left pixel at (0.5, 0.5); OpenCV's has 0.5 less in cx and cy."""
    if camera.intrinsics is not None:
        fx, fy, cx, cy = (number for _, number in camera.intrinsics)
        return np.array([[fx, 0.0, cx + 0.5], [0.0, fy, cy + 0.5], [0.0, 0.0, 1.0]])
    width, height = camera.resolution
    fx = camera.focal_mm / camera.sensor_mm[0] * width
    fy = camera.focal_mm / camera.sensor_mm[1] * height
    return np.array([[fx, 0.0, width / 2], [0.0, fy, height / 2], [0.0, 0.0, 1.0]])


def opencv_intrinsics(camera) -> np.ndarray:
    """K [3, 3] in pixels with the centre of the top left pixel at (0, 0): measured ones to the last digit."""
    K = intrinsics(camera)
    K[:2, 2] = K[:2, 2] - 0.5 if camera.intrinsics is None else (camera.intrinsics.cx, camera.intrinsics.cy)
    return K
