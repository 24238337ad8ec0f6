"""Frames and rigid transforms in float64. ``T_a_b`` maps b-coordinates to a-coordinates; all are [4, 4].

World w and vehicle v are z up (vehicle: x right, y forward). A camera c is OpenCV optical: x right, y down, z forward.
"""

import warnings
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError

R_V_C = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""An unrotated camera on the vehicle looks along +y, its image upright."""
RIGID = 1e-5
"""How far a pose that is given may be from a rotation: ten times what six decimals or single precision leave."""
MATRIX = "A pose is a matrix [4, 4] of a rotation and a position [m]"


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
    """Rotation [3, 3] of a block with ``position``, by its ``look_at``, ``rotation_euler_deg`` or ``quaternion``."""
    if getattr(pose, "look_at", None) is not None:
        return look_at_matrix(pose.position, pose.look_at)
    if getattr(pose, "quaternion", None) is not None:
        return Rotation.from_quat(pose.quaternion, scalar_first=True).as_matrix()
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
        elif stop.quaternion is not None:
            result.append(Rotation.from_quat(stop.quaternion, scalar_first=True))
        else:
            result.append(result[-1] if result else Rotation.identity())
    return result


def pose_matrix(pose) -> np.ndarray:
    """T [4, 4] of a waypoint, pose, sensor or placed object (without its scale)."""
    return transform(attitude(pose), pose.position)


def camera_pose(camera, T_w_v: np.ndarray) -> np.ndarray:
    """T_w_c of a scene's camera block, on the vehicle at ``T_w_v`` [..., 4, 4] or standing in the world; as many."""
    T_mount_c = mounted(camera)
    return np.broadcast_to(T_mount_c, T_w_v.shape) if camera.mount == "world" else T_w_v @ T_mount_c


@lru_cache(maxsize=64)
def mounted(camera) -> np.ndarray:
    """T_v_c of a scene's camera block, or T_w_c of one that stands in the world; not to be written to."""
    T_mount_c = pose_matrix(camera) @ transform(R_V_C)
    T_mount_c.setflags(write=False)
    return T_mount_c


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


def numeric(name: str, values, remedy: str) -> np.ndarray:
    """Real numbers as float64, of any shape.

    Raises:
        InputError: If they are something else, by the argument's name.
    """
    try:
        array = np.asarray(values)
        if array.dtype.kind in "fiu":
            return array.astype(np.float64, copy=False)
    except (ValueError, TypeError):  # of unlike lengths, or of a library that refuses
        pass
    raise InputError(f"is not made of real numbers, it is of the type {type(values).__name__}", key=name, remedy=remedy)


def checked_pose(name: str, T) -> np.ndarray:
    """A pose [4, 4] that a caller gives, as float64.

    Raises:
        InputError: If it is no rigid transform, by the argument's name.
    """
    pose = numeric(name, T, f"{MATRIX}.")
    if pose.shape != (4, 4):
        raise InputError(f"has the shape {pose.shape}, not (4, 4)", key=name, remedy=_missing(pose.shape))
    if flaw := _flaw(pose):
        raise InputError(flaw[0], key=name, remedy=flaw[1])
    return pose


def checked_poses(name: str, T, count: int | None = None) -> np.ndarray:
    """Poses [N, 4, 4] that a caller gives, as float64; ``count``: how many they must be.

    Raises:
        InputError: If they are no rigid transforms, by the argument's name and the number of the first that is none.
    """
    remedy = f"{MATRIX}; give one for each."
    poses = numeric(name, T, remedy)
    if poses.ndim != 3 or poses.shape != (len(poses) if count is None else count, 4, 4):
        raise InputError(
            f"has the shape {poses.shape}, not ({'N' if count is None else count}, 4, 4)", key=name, remedy=remedy
        )
    for i in np.flatnonzero(~_are_rigid(poses))[:1]:
        problem, remedy = _flaw(poses[i])
        raise InputError(problem, key=f"{name}[{i}]", remedy=remedy)
    return poses


def _are_rigid(T: np.ndarray) -> np.ndarray:
    """Return whether each of poses [..., 4, 4] is finite, and a rotation with a position; bool [...]."""
    R = T[..., :3, :3]
    with np.errstate(all="ignore"):
        off = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)).max((-1, -2))
        last = np.abs(T[..., 3, :] - [0.0, 0.0, 0.0, 1.0]).max(-1)
        return np.isfinite(T).all((-1, -2)) & (off <= RIGID) & (last <= RIGID) & (np.linalg.det(R) > 0.0)


def _flaw(T: np.ndarray) -> tuple[str, str] | None:
    """What is wrong with a pose [4, 4], and what to do; None if nothing is."""
    if _are_rigid(T):
        return None
    if not np.isfinite(T).all():
        return "has numbers that are not finite", f"{MATRIX}."
    if np.abs(T[3] - [0.0, 0.0, 0.0, 1.0]).max() > RIGID:
        return (
            f"has the last row {T[3].tolist()}, not 0 0 0 1",
            "It maps columns, p_w = T_w_v @ p_v: transpose it if it maps rows.",
        )
    R = T[:3, :3]
    lengths = np.linalg.norm(R, axis=0)
    if np.abs(lengths - 1.0).max() > RIGID:
        return (
            f"scales: its axes have the lengths {lengths.round(6).tolist()}, not 1",
            "Divide the first three columns by them; a scene file has the scale of objects.",
        )
    if np.linalg.det(R) < 0.0:
        return "mirrors: its determinant is -1", "Axes are right-handed here; turn the sign of one column."
    return "has axes that are not at right angles", "Give a rotation, as scipy's Rotation.as_matrix makes them."


def _missing(shape: tuple[int, ...]) -> str:
    """What to do with numbers that are no matrix [4, 4]."""
    return {
        (3, 4): "Add the last row 0 0 0 1.",
        (3, 3): "Add a position, and the last row 0 0 0 1.",
        (4,): f"{MATRIX}; of a quaternion scipy's Rotation.from_quat(q).as_matrix() makes the rotation.",
        (7,): f"{MATRIX}; of a quaternion scipy's Rotation.from_quat(q).as_matrix() makes the rotation.",
    }.get(shape, f"{MATRIX}.")
