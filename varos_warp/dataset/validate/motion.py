"""Poses in their three forms and the vehicle's states against each other, and what is mounted on the vehicle."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.dataset import files
from varos_warp.dataset.layout import POSE_FORMS
from varos_warp.dataset.reader import rows
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.validate.objects import check_moving
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.dataset.validate.sensors import check_sensors
from varos_warp.dataset.write.tables import pose_columns
from varos_warp.products.sensors.differences import bend, slope

EPS = np.finfo(float).eps
GIMBAL = 1e-6
"""cos(pitch) below which Euler angles lose digits: scipy puts one of them to 0 within 1e-7."""
PAIRS = ((1, 2), (2, 0), (0, 1))
"""Pairs of the three forms of poses: each leaves out the form in whose place it stands."""


# --------------------------------------------------------------------------------------------------------------- poses


def check_poses(data: Dataset, result: Validation) -> None:
    """Euler angles, quaternions and matrices are the same poses, and the matrices are rotations."""
    for name in (*data.recorded, *data.cameras, *data.moving):
        result.guard(_check_forms, data, result, name)


def _check_forms(data: Dataset, result: Validation, name: str) -> None:
    """The one of three that the other two outvote is named."""
    paths = [data.layout.poses(name, form) for form in POSE_FORMS]
    times, tables = zip(
        *((t, np.column_stack(columns).astype(float)) for t, *columns in map(files.read_numbers, paths)), strict=True
    )
    if _odd_times(result, paths, times):
        return
    _check_sign(result, paths[2], tables[2][:, 3:], 4)
    T = [_poses(form, table) for form, table in zip(POSE_FORMS, tables, strict=True)]
    steep = np.abs(np.cos(tables[0][:, 4])) < GIMBAL
    apart = [np.abs(T[i] - T[j])[:, :, :3].max((1, 2)) for i, j in PAIRS]
    differ = np.array(
        [
            (off > np.where(steep & (0 in pair), 4e-7, 1e-12)) | (T[pair[0]] != T[pair[1]])[:, :, 3].any(-1)
            for off, pair in zip(apart, PAIRS, strict=True)
        ]
    )
    for i, (form, table, (other, _)) in enumerate(zip(POSE_FORMS, tables, PAIRS, strict=True)):
        result.add_rows(
            paths[i],
            "is not the pose that the other two files of poses have",
            ~differ[i] & (differ.sum(0) == 2),
            table - _columns_near(form, T[other], table),
            range(1, 13),
        )
    if (all_three := np.flatnonzero(differ.all(0))).size:
        result.add(f"{result.name(paths[0])}:{all_three[0] + 2}: no two files of poses agree")
    near = np.concatenate([off[~steep] if 0 in pair else off for off, pair in zip(apart, PAIRS, strict=True)])
    result.measure(f"{name}: attitude, three forms", near.max(initial=0.0), 1e-12, "rad")
    R = T[1][:, :, :3]
    result.measure(f"{name}: rotation matrices", np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(), 1e-12, "")


def _check_sign(result: Validation, path: Path, quaternion: np.ndarray, column: int) -> None:
    """Files of poses hold quaternions of length 1, of the two of an attitude the one with w >= 0."""
    result.add_rows(
        path,
        "is negative; of q and -q files of poses hold that with w >= 0",
        quaternion[:, 0] < 0.0,
        quaternion[:, :1],
        [column],
    )
    off = np.abs(np.sum(quaternion**2, axis=1) - 1.0)
    result.add_rows(path, "is of a quaternion that is not of length 1", ~(off <= 1e-12), off[:, None], [column])


def _odd_times(result: Validation, paths: list, times: tuple) -> bool:
    """Name the file of poses whose time stamps the other two do not have; whether there is one."""
    same = [np.array_equal(times[i], times[j]) for i, j in PAIRS]
    if all(same):
        return False
    odd = same.index(True) if any(same) else 0
    other = PAIRS[odd][0]
    if len(times[odd]) != len(times[other]):
        where, what = result.name(paths[odd]), f"has {len(times[odd])} rows, not {len(times[other])} as"
    else:
        row = int(np.flatnonzero(times[odd] != times[other])[0])
        where, what = result.cell(paths[odd], row, 0), f"is not the time of that row, {times[other][row]}, in"
    result.add(f"{where}: {what} {paths[other].name}" + ("" if any(same) else "; no two files of poses agree"))
    return True


def _poses(form: str, columns: np.ndarray) -> np.ndarray:
    """[N, 3, 4] of the numbers in a file of poses."""
    if form == "transformation_matrix":
        return columns.reshape(-1, 3, 4)
    turn = columns[:, 3:]
    R = Rotation.from_euler("xyz", turn) if form == "euler" else Rotation.from_quat(turn, scalar_first=True)
    return np.dstack([R.as_matrix(), columns[:, :3]])


def _columns_near(form: str, T: np.ndarray, like: np.ndarray) -> np.ndarray:
    """Numbers of a file of poses; angles and quaternions as near to others as they may be written."""
    columns = pose_columns(form, T)
    if form == "euler":
        columns[:, 3:] += 2 * np.pi * np.rint((like - columns)[:, 3:] / (2 * np.pi))
    if form == "quaternion":
        columns[:, 3:] *= np.where(np.sum((columns * like)[:, 3:], axis=1, keepdims=True) >= 0, 1.0, -1.0)
    return columns


def check_mounting(data: Dataset, result: Validation) -> None:
    """Poses of cameras and sensors are the vehicle's times the mounting, or stand still in the world."""
    if not data.recorded:
        return
    mounts = {camera: data.camera(camera) for camera in data.cameras}
    mounts |= {name: {"T_v_c": data.meta["sensors"][name]["T_v_s"]} for name in data.meta["sensors"]}
    for name, about in mounts.items():
        result.guard(_check_mount, data, result, name, about)


def _check_mount(data: Dataset, result: Validation, name: str, about: dict) -> None:
    time_ns, T = data.poses(name)
    expected = (
        np.broadcast_to(about["T_w_c"], T.shape)
        if "T_w_c" in about
        else data.vehicle_at(time_ns) @ np.array(about["T_v_c"])
    )
    off = np.abs(T - expected).max((1, 2))
    limit = 1e-9 + 8 * EPS * np.abs(T).max(initial=0.0)
    told = result.add_rows(
        data.layout.poses(name, "transformation_matrix"),
        "is not the vehicle's with its mounting",
        ~(off <= limit),
        (T - expected)[:, :3].reshape(-1, 12),
        range(1, 13),
    )
    result.measure(f"{name}: pose against the vehicle's", off.max(initial=0.0), limit, "m", told)


def check_rows(data: Dataset, result: Validation) -> None:
    """Poses of rows are those of the vehicle's motion at their times; the middle rows, of the camera's pose."""
    for camera in data.cameras:
        if rows.is_rolling(data.camera(camera)):
            result.guard(_check_row_poses, data, result, camera)


def _check_row_poses(data: Dataset, result: Validation, camera: str) -> None:
    name, table = result.name(data.layout.row_poses(camera)), rows.read(data, camera)
    limit = 1e-9 + 8 * EPS * np.abs(data.views(camera)[1]).max(initial=0.0)
    problems, worst = [], 0.0
    for frame, row_poses in zip(data.frames, table, strict=True):
        square = np.sum(row_poses[:, 3:] ** 2, axis=1)
        if not (np.abs(square - 1.0) <= 1e-12).all() or (row_poses[:, 3] < 0.0).any():
            problems.append(f"{name}: frame {frame} has quaternions that are not of length 1 with w >= 0")
            continue
        off = _off_motion(data, frame, camera)
        worst = max(worst, off.max())
        if not off.max() <= limit:
            problems.append(f"{name}: row {np.argmax(off)} of frame {frame} is not where the vehicle's motion has it")
    result.add_all(problems, "poses of rows")
    result.measure(f"{camera}: poses of rows against the vehicle's motion", worst, limit, "m", told=True)


def _off_motion(data: Dataset, frame: int, camera: str) -> np.ndarray:
    """How far poses of rows [H] are off those of the vehicle's motion; where it is not on record, off the frame's."""
    T = rows.sight(data, frame, camera)
    if (expected := rows.by_motion(data, frame, camera)) is not None:
        return np.nan_to_num(np.abs(T - expected).max((1, 2)), nan=np.inf)
    two, off = slice((len(T) - 1) // 2, len(T) // 2 + 1), np.zeros(len(T))  # the frame's pose lies between these rows
    off[two] = np.abs(T[two].mean(0) - data.T_w_c(frame, camera)).max() - np.ptp(T[two], axis=0).max() / 2
    return off


def check_lights(data: Dataset, result: Validation) -> None:
    """Lights are on the vehicle where dataset.json has them."""
    if not data.meta["lights"] or not data.recorded or not data.frames:
        return
    table = files.read_numbers(data.layout.lights)
    count = len(data.meta["lights"])
    if len(table[0]) != len(data.frames) * count:
        result.add(f"{data.layout.lights.name}: {len(table[0])} rows, not {len(data.frames) * count}")
        return
    T_v_light = np.array([light["T_v_light"] for light in data.meta["lights"]])[table[2].astype(int)]
    T = data.vehicle_at(table[0]) @ T_v_light
    there = np.column_stack(table[3:9]).astype(float)
    off = np.abs(there - np.hstack([T[:, :3, 3], T[:, :3, 2]])).max(1)
    result.measure("lights: against the vehicle's poses", off.max(), 1e-9 + 8 * EPS * np.abs(T).max(), "m")


def check_states(data: Dataset, result: Validation) -> None:
    """The vehicle's states are at the times, places and attitudes of its poses, and its velocity is their slope."""
    if not data.recorded:
        return
    states, (time_ns, T), path = data.states(), data.poses("vehicle"), data.layout.states
    if not np.array_equal(states["time_ns"], time_ns):
        result.add(f"{path.name}: does not agree with the poses of the vehicle: other time stamps")
        return
    here = np.hstack([states["position"], states["quaternion"]])
    apart = np.abs(_poses("quaternion", here) - T[:, :3])
    result.add_rows(
        path,
        "does not agree with the poses of the vehicle",
        apart[:, :, 3].any(-1) | (apart[:, :, :3].max((1, 2)) > 1e-12),
        here - _columns_near("quaternion", T, here),
        [1, 2, 3, 10, 11, 12, 13],
    )
    if len(time_ns) < 5:
        return
    h = (time_ns[1] - time_ns[0]) * 1e-9
    p, v = T[:, :3, 3] - T[0, :3, 3], states["velocity"]
    apart = np.pad(v[2:-2] - slope(p, h), ((2, 2), (0, 0)))
    off = np.linalg.norm(apart[2:-2], axis=1)
    # between neighbours the velocity changes more than the difference errs: by the bends within two samples
    uneven = np.lib.stride_tricks.sliding_window_view(np.pad(bend(p), 1, mode="edge"), 5).max(-1) / h
    allowed = 1e-6 + 4 * EPS * np.abs(T[:, :3, 3]).max() / h + uneven
    result.measure("vehicle: velocity against poses, median", np.median(off), 1e-6 + np.median(allowed), "m/s")
    result.add_rows(path, "its velocity is not that of the poses", np.pad(off > allowed, 2), apart, [4, 5, 6])


CHECKS = (check_poses, check_moving, check_mounting, check_rows, check_lights, check_states, check_sensors)
