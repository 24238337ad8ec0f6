"""Poses, the sensors' readings and the vehicle's states against each other."""

import itertools
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.dataset import files
from varos_warp.dataset.geometry import rebuilt
from varos_warp.dataset.layout import POSE_FORMS, READINGS
from varos_warp.dataset.noise_pass import is_repeatable, noise_of, noisy_readings
from varos_warp.dataset.reader import rows
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.validate.objects import check_moving, solid
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.dataset.write.texts import pose_columns
from varos_warp.errors import InputError
from varos_warp.scene.description.noise_profile import SENSOR_BLOCKS
from varos_warp.sim.clock import times_ns
from varos_warp.sim.companions import companions
from varos_warp.sim.sensors.dvl import Dvl, bottom_track
from varos_warp.sim.sensors.readings import met_by_beams

EPS = np.finfo(float).eps
WINDOW_S = 2.0
"""Time over which the IMU is integrated from a pose."""
GIMBAL = 1e-6
"""cos(pitch) below which Euler angles lose digits: scipy puts one of them to 0 within 1e-7."""
PAIRS = ((1, 2), (2, 0), (0, 1))
"""Of three forms of poses: each pair leaves out the form in whose place it stands."""


# --------------------------------------------------------------------------------------------------------------- poses


def check_poses(data: Dataset, result: Validation) -> None:
    """Euler angles, quaternions and matrices are the same poses, and the matrices are rotations."""
    for name in (*data.recorded, *data.cameras, *data.moving):
        result.guard(_check_forms, data, result, name)


def _check_forms(data: Dataset, result: Validation, name: str) -> None:
    """The one of three that the other two outvote is named."""
    paths = [data.layout.poses(name, form) for form in POSE_FORMS]
    times, tables = zip(*((t, np.column_stack(columns).astype(float))
                          for t, *columns in map(files.read_numbers, paths)), strict=True)
    if _odd_times(result, paths, times):
        return
    _check_sign(result, paths[2], tables[2][:, 3:], 4)
    T = [_poses(form, table) for form, table in zip(POSE_FORMS, tables, strict=True)]
    steep = np.abs(np.cos(tables[0][:, 4])) < GIMBAL
    apart = [np.abs(T[i] - T[j])[:, :, :3].max((1, 2)) for i, j in PAIRS]
    differ = np.array([(off > np.where(steep & (0 in pair), 4e-7, 1e-12))
                       | (T[pair[0]] != T[pair[1]])[:, :, 3].any(-1) for off, pair in zip(apart, PAIRS, strict=True)])
    for i, (form, table, (other, _)) in enumerate(zip(POSE_FORMS, tables, PAIRS, strict=True)):
        result.add_rows(paths[i], "is not the pose that the other two files of poses have",
                        ~differ[i] & (differ.sum(0) == 2), table - _columns_near(form, T[other], table), range(1, 13))
    if (all_three := np.flatnonzero(differ.all(0))).size:
        result.add(f"{result.name(paths[0])}:{all_three[0] + 2}: no two files of poses agree")
    near = np.concatenate([off[~steep] if 0 in pair else off for off, pair in zip(apart, PAIRS, strict=True)])
    result.measure(f"{name}: attitude, three forms", near.max(initial=0.0), 1e-12, "rad")
    R = T[1][:, :, :3]
    result.measure(f"{name}: rotation matrices", np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(), 1e-12, "")


def _check_sign(result: Validation, path: Path, quaternion: np.ndarray, column: int) -> None:
    """Of the two quaternions of an attitude, files of poses hold the one with w >= 0, of length 1."""
    result.add_rows(path, "is negative; of q and -q files of poses hold that with w >= 0", quaternion[:, 0] < 0.0,
                    quaternion[:, :1], [column])
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
    expected = (np.broadcast_to(about["T_w_c"], T.shape) if "T_w_c" in about else
                data.vehicle_at(time_ns) @ np.array(about["T_v_c"]))
    off = np.abs(T - expected).max((1, 2))
    limit = 1e-9 + 8 * EPS * np.abs(T).max(initial=0.0)
    told = result.add_rows(data.layout.poses(name, "transformation_matrix"), "is not the vehicle's with its mounting",
                           ~(off <= limit), (T - expected)[:, :3].reshape(-1, 12), range(1, 13))
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
    result.add_rows(path, "does not agree with the poses of the vehicle",
                    apart[:, :, 3].any(-1) | (apart[:, :, :3].max((1, 2)) > 1e-12),
                    here - _columns_near("quaternion", T, here), [1, 2, 3, 10, 11, 12, 13])
    if len(time_ns) < 5:
        return
    h = (time_ns[1] - time_ns[0]) * 1e-9
    p, v = T[:, :3, 3] - T[0, :3, 3], states["velocity"]
    apart = np.pad(v[2:-2] - _slope(p, h), ((2, 2), (0, 0)))
    off = np.linalg.norm(apart[2:-2], axis=1)
    # between neighbours the velocity changes more than the difference errs: by the bends within two samples
    uneven = np.lib.stride_tricks.sliding_window_view(np.pad(_bend(p), 1, mode="edge"), 5).max(-1) / h
    allowed = 1e-6 + 4 * EPS * np.abs(T[:, :3, 3]).max() / h + uneven
    result.measure("vehicle: velocity against poses, median", np.median(off), 1e-6 + np.median(allowed), "m/s")
    result.add_rows(path, "its velocity is not that of the poses", np.pad(off > allowed, 2), apart, [4, 5, 6])


# --------------------------------------------------------------------------------------------------------- differences


def _slope(x: np.ndarray, h: float) -> np.ndarray:
    """First derivative at x[2:-2], of fourth order."""
    return (x[:-4] - 8 * x[1:-3] + 8 * x[3:-1] - x[4:]) / (12 * h)


def _difference2(x: np.ndarray, h: float) -> np.ndarray:
    """Second derivative at x[2:-2], of fourth order."""
    return (-x[4:] + 16 * x[3:-1] - 30 * x[2:-2] + 16 * x[1:-3] - x[:-4]) / (12 * h * h)


def _bend(x: np.ndarray) -> np.ndarray:
    """Length of the second difference at x[1:-1]."""
    return np.linalg.norm(x[2:] - 2 * x[1:-1] + x[:-2], axis=1)


def _changes(x: np.ndarray) -> np.ndarray:
    """Largest change [N] between neighbours of x [N, 3] within three samples of each."""
    steps = np.pad(np.linalg.norm(np.diff(x, axis=0), axis=1), 3)
    return np.lib.stride_tricks.sliding_window_view(steps, 6)[: len(x)].max(-1)


# ----------------------------------------------------------------------------------------------------------------- IMU


def check_imu(data: Dataset, result: Validation) -> None:
    """Readings without noise against differences of the poses, the states and an integration; then the noise."""
    if (T := _poses_in_step(data, result, "imu0")) is None:
        return
    imu, h = data.imu(truth=True), 1.0 / data.meta["sensors"]["imu0"]["rate_hz"]
    result.guard(_against_states, data, result, imu)
    if len(T) >= 5:
        _against_differences(data, result, imu, T, h)
        _strapdown(data, result, imu, T, h)
    if data.has_noise("imu0"):
        result.guard(_check_imu_noise, data, result, imu)


def _poses_in_step(data: Dataset, result: Validation, name: str) -> np.ndarray | None:
    """Poses [N, 4, 4] of a sensor where they are at the times of its readings, evenly spaced at its rate, else None."""
    if name not in data.recorded:
        return None
    time_ns, T = data.poses(name)
    if not np.array_equal(time_ns, data.readings(name)["time_ns"]):
        result.add(f"{name}: poses and readings have different time stamps")
        return None
    step = np.diff(times_ns(len(time_ns), rate := data.meta["sensors"][name]["rate_hz"]))
    wrong = np.diff(time_ns) != step
    uneven = result.add_rows(data.layout.sensor(name), f"the next sample is not {1e9 / rate:.0f} ns later", wrong,
                             wrong[:, None], [0])
    return None if uneven else T


def _against_states(data: Dataset, result: Validation, imu: dict) -> None:
    """Eq. (2) of the paper with the vehicle's states, exact at every sample."""
    there, T_v_s = data.trajectory().at(imu["time_ns"]), np.array(data.meta["sensors"]["imu0"]["T_v_s"])
    w, alpha, lever = there.angular_velocity, there.angular_acceleration, T_v_s[:3, 3]
    felt = there.rotation().inv().apply(there.acceleration - data.meta["gravity"])
    felt = (felt + np.cross(w, np.cross(w, lever)) + np.cross(alpha, lever)) @ T_v_s[:3, :3]
    off = np.abs(np.hstack([felt - imu["acceleration"], w @ T_v_s[:3, :3] - imu["angular_velocity"]]))
    told = result.add_rows(data.layout.sensor("imu0"), f"is not what {data.layout.states.name} makes it",
                           ~(off.max(1) <= 1e-9), off, _columns(data, "imu0"))
    result.measure("imu0: readings against the vehicle's states", off.max(), 1e-9, "m/s^2, rad/s", told)


def _against_differences(data: Dataset, result: Validation, imu: dict, T: np.ndarray, h: float) -> None:
    """Medians, since exact poses given by hand may have corners; rows where the course is even enough to tell.

    Limits: 1e-3 for the difference's own error (h^4 / 90 times the sixth derivative), the rounding of positions far
    from the origin, and for single rows twice as much as the acceleration changes about them: a corner is no flaw.
    """
    force, rate = imu["acceleration"], imu["angular_velocity"]
    R, position = Rotation.from_matrix(T[:, :3, :3]), T[:, :3, 3] - T[0, :3, 3]
    acceleration = _difference2(position, h)
    felt = R[2:-2].inv().apply(acceleration - data.meta["gravity"])
    limit = 1e-3 + 6 * EPS * np.abs(T[:, :3, 3]).max() / h**2
    apart = np.pad(force[2:-2] - felt, ((2, 2), (0, 0)))
    off = np.linalg.norm(apart[2:-2], axis=1)
    result.measure("imu0: specific force against poses, median", np.median(off), limit, "m/s^2")
    turned = (R[:-1].inv() * R[1:]).as_rotvec() / h
    turn_apart = (rate[:-1] + rate[1:]) / 2 - turned
    turn_off = np.linalg.norm(turn_apart, axis=1)
    result.measure("imu0: angular velocity against poses, median", np.median(turn_off), 1e-3, "rad/s")
    path, columns = data.layout.sensor("imu0"), _columns(data, "imu0")
    result.add_rows(path, "its specific force is not that of the poses",
                    np.pad(off > limit + 2 * _changes(acceleration), 2), apart, columns[:3])
    result.add_rows(path, "its angular velocity is not that of the poses",
                    turn_off > 1e-3 + 2 * _changes(turned), turn_apart, columns[3:])


def _strapdown(data: Dataset, result: Validation, imu: dict, T: np.ndarray, h: float) -> None:
    """Integrate the IMU from a pose, and see how far off the pose after two seconds is; the worst such window.

    Trapezoids err by h/12 times the second differences of what they integrate, in each step. Those of the turns and
    of the acceleration between poses therefore bound the drift: of the attitude (theta), of the velocity (g theta and
    the acceleration's own) and of the position, each the sum of the one before. Twice that is allowed.
    """
    length = min(round(WINDOW_S / h), len(T) - 5)
    starts = np.arange(2, max(3, len(T) - 2 - length), length)
    if length < 1:
        return
    R, p = Rotation.from_matrix(T[:, :3, :3]), T[:, :3, 3] - T[0, :3, 3]
    turned, g = (R[:-1].inv() * R[1:]).as_rotvec() / h, np.array(data.meta["gravity"])
    slope4, slope2 = _slope(p, h), (p[3:-1] - p[1:-3]) / (2 * h)
    end_R, end_p = _integrate(imu, g, R[starts], slope4[starts - 2], p[starts], starts, length, h)
    far = EPS * np.abs(T[:, :3, 3]).max()
    bend_w = np.pad(_bend(turned), 2, mode="edge")
    bend_a = np.pad(_bend(np.pad(_difference2(p, h), ((2, 2), (0, 0)), mode="edge")), 1, mode="edge")
    span = starts[:, None] + np.arange(length)
    theta = np.cumsum(h / 12 * bend_w[span], axis=1) + 8 * EPS * np.arange(length)
    start = np.linalg.norm(slope4 - slope2, axis=1)[starts - 2] + 2 * far / h
    velocity = start[:, None] + np.cumsum(h * np.linalg.norm(g) * theta + h / 12 * bend_a[span], axis=1)
    bound_p, bound_R = 2 * (h * velocity.sum(axis=1) + far), 2 * theta[:, -1]
    off_p = np.linalg.norm(end_p - p[starts + length], axis=1)
    off_R = (end_R.inv() * R[starts + length]).magnitude()
    for name, off, bound, scale, unit in (("position", off_p, bound_p, 1e3, "mm"),
                                          ("attitude", off_R, bound_R + 1e-12, 1e6, "urad")):
        worst = int(np.argmax(off / bound))
        result.measure(f"imu0: integrated from {starts[worst] * h:.4g} s for {length * h:.4g} s, {name} against poses "
                       "(worst)", scale * off[worst], scale * bound[worst], unit)


def _integrate(imu: dict, g: np.ndarray, attitude: Rotation, v: np.ndarray, p: np.ndarray, starts: np.ndarray,
               length: int, h: float) -> tuple[Rotation, np.ndarray]:
    """Attitude and position [W, 3] after ``length`` steps of trapezoids from each of W starting samples."""
    i = starts + np.arange(length + 1)[:, None]
    w, f = imu["angular_velocity"][i], imu["acceleration"][i]
    turn = h / 2 * (w[:-1] + w[1:]) + h * h / 12 * np.cross(w[:-1], w[1:])
    steps = Rotation.from_rotvec(turn.reshape(-1, 3)).as_matrix().reshape(*turn.shape, 3)
    R = np.array(list(itertools.accumulate(steps, np.matmul, initial=attitude.as_matrix())))
    a = np.einsum("twij,twj->twi", R, f) + g
    velocity = v + h / 2 * np.cumsum(np.concatenate([0 * a[:1], a[:-1] + a[1:]]), axis=0)
    p = p + np.sum(h * velocity[:-1] + h * h / 6 * (2 * a[:-1] + a[1:]), axis=0)
    return Rotation.from_matrix(R[-1]), p


def _check_imu_noise(data: Dataset, result: Validation, truth: dict) -> None:
    """Readings are truth, bias and white noise of the density that dataset.json names, or of its profile and seed."""
    about, imu, bias = data.meta["sensors"]["imu0"], data.imu(), data.imu_bias()
    for name, sensor, unit, columns in (("acceleration", "accelerometer", "m/s^2", range(1, 4)),
                                        ("angular_velocity", "gyroscope", "rad/s", range(4, 7))):
        white = imu[name] - truth[name] - bias[name]
        sigma = about["noise"][f"{sensor}_noise_density"] * np.sqrt(about["rate_hz"])
        # the standard error of a variance over 5: less than one false alarm in a million
        result.measure(f"imu0: white noise of the {sensor}, off by", abs(white.std() - sigma),
                       5 * sigma / np.sqrt(2 * white.size) + 1e-9, unit)
        result.add_rows(data.layout.sensor("imu0"), f"its {name} is off by more than noise can be",
                        np.abs(white).max(1) > 8 * sigma + 1e-9, white, columns)
    _check_repeated(data, result, "imu0", 1e-9, "m/s^2, rad/s")


# ------------------------------------------------------------------------------------------------------ other sensors


def check_depth_gauge(data: Dataset, result: Validation) -> None:
    """Readings without noise against the height of the gauge's own poses; then the noise."""
    if (T := _poses_in_step(data, result, "depth0")) is not None:
        expected = {"depth": data.meta["surface_depth_m"] - T[:, 2, 3]}
        _check_readings(data, result, "depth0", expected, 1e-9, "m", "its depth is not that of the poses")


def check_magnetometer(data: Dataset, result: Validation) -> None:
    """Readings without noise are the world's field in the axes of the sensor's own poses; then the noise."""
    if (T := _poses_in_step(data, result, "mag0")) is not None:
        field = np.array(data.meta["sensors"]["mag0"]["field_T"])
        _check_readings(data, result, "mag0", {"field": field @ T[:, :3, :3]}, 1e-9 * np.linalg.norm(field), "T",
                        "is not the field in the axes of the poses")


def _check_readings(data: Dataset, result: Validation, name: str, expected: dict, limit: float, unit: str,
                    problem: str) -> None:
    """Readings without noise are as expected; those with noise no farther off than it can be."""
    truth, noise = data.readings(name, truth=True), data.meta["sensors"][name].get("noise")
    off = _apart(truth, expected)
    told = result.add_rows(data.layout.sensor(name), problem, ~(off.max(1) <= limit), off, _columns(data, name))
    result.measure(f"{name}: against poses", off.max(initial=0.0), limit, unit, told)
    if not noise:
        return
    quantity, = expected
    reading, bias = data.readings(name)[quantity], data.bias(name)[quantity]
    slack = 1e-9 if name == "depth0" else 8 * EPS * max(np.abs(reading).max(), np.abs(bias).max())
    most = 8 * noise["noise_density"] * np.sqrt(data.meta["sensors"][name]["rate_hz"])
    result.measure(f"{name}: reading off truth and bias, at most", np.abs(reading - truth[quantity] - bias).max(),
                   most + noise.get("resolution", 0.0) / 2 + slack, unit)
    _check_repeated(data, result, name, slack, unit)


def check_dvl(data: Dataset, result: Validation) -> None:
    """What follows from ranges and the vehicle's states; ranges against the scene's meshes; then the noise."""
    if (T := _poses_in_step(data, result, "dvl0")) is None:
        return
    truth, about = Dvl(**data.dvl(truth=True)), data.meta["sensors"]["dvl0"]
    velocity = data.trajectory().at(truth.time_ns).velocity_of(np.array(about["T_v_s"])[:3, 3])
    beams, (least, most) = np.array(about["beams"]), about["range_m"]
    from_still = -(velocity[:, None] @ T[:, :3, :3])[:, 0] @ beams.T
    away = _check_ranges(data, result, truth, T, beams)
    expected = np.where(np.isnan(away), truth.beam_velocity, from_still + away)
    locked = np.where((truth.range >= least) & (truth.range <= most), truth.range, np.nan)
    off = _apart(vars(truth), vars(bottom_track(truth.time_ns, beams, locked, expected)))
    told = result.add_rows(data.layout.sensor("dvl0"), f"is not what its ranges and {data.layout.states.name} make it",
                           ~(off.max(1) <= 1e-9), off, _columns(data, "dvl0"))
    result.measure("dvl0: readings against ranges and states", off.max(), 1e-9, "m, m/s", told)
    if data.has_noise("dvl0"):
        _check_dvl_noise(data, result, truth, beams)


def _check_ranges(data: Dataset, result: Validation, truth: Dvl, T: np.ndarray, beams: np.ndarray) -> np.ndarray:
    """Ranges are those to the scene's meshes, where all of their files are at hand; beams at an edge may differ.

    Returns:
        Velocity along the beams [M, 4] [m/s] of what they meet, which may move; NaN where that is not known.
    """
    try:
        scene, parts = rebuilt(data)
    except InputError:
        return np.full(truth.range.shape, np.nan if solid(data) else 0.0)
    expected, away = met_by_beams(truth.time_ns, T, beams, data.meta["sensors"]["dvl0"]["range_m"], parts,
                                  companions(scene))
    same = np.isclose(truth.range, expected, rtol=1e-9, atol=1e-6, equal_nan=True)
    result.measure("dvl0: beams with another range than to the scene's meshes", np.mean(~same),
                   0.01 + 1.0 / same.size, "")
    return np.where(same | (not solid(data)), away, np.nan)


def _check_dvl_noise(data: Dataset, result: Validation, truth: Dvl, beams: np.ndarray) -> None:
    """Velocity and altitude are those of the beams, which are no farther off than their noise can be."""
    model, read = data.meta["sensors"]["dvl0"]["noise"], Dvl(**data.dvl())
    off = _apart(vars(read), vars(bottom_track(read.time_ns, beams, read.range, read.beam_velocity)))
    told = result.add_rows(data.layout.sensor("dvl0"), "is not what its beams make it", ~(off.max(1) <= 1e-9), off,
                           range(1, 13))
    result.measure("dvl0: readings against their own beams", off.max(), 1e-9, "m, m/s", told)
    exact = vars(truth) | {"beam_velocity": (1.0 + model["scale"]) * truth.beam_velocity}
    for name, quantity, std, unit in (("range", "range", model["range_std"], "m"),
                                      ("beam velocity", "beam_velocity", model["velocity_std"], "m/s")):
        off = _apart(vars(read), {quantity: exact[quantity]})
        result.measure(f"dvl0: {name} off the truth, at most", off.max(), 8 * std + 1e-9, unit)
    _check_repeated(data, result, "dvl0", 1e-9, "m, m/s")


def _check_repeated(data: Dataset, result: Validation, name: str, limit: float, unit: str) -> None:
    """Readings and bias are those of the profile and its seed, where NumPy can draw their noise again."""
    profile, seed = noise_of(data) or (None, 0)
    model = getattr(profile, SENSOR_BLOCKS[name], None)
    if model is None or not is_repeatable(data):
        return
    reading, bias = noisy_readings(data, name, model, seed)
    off = _apart(data.readings(name), reading).max()
    if bias is not None:
        off = max(off, _apart(data.bias(name), bias).max())
    result.measure(f"{name}: readings against profile and seed", off, limit, unit)


def _apart(found: dict, expected: dict) -> np.ndarray:
    """How far quantities are apart [N, k], in the order of their columns: 0 where neither has a number."""
    one, other = (np.column_stack([of[quantity] for quantity in expected if quantity != "time_ns"])
                  for of in (found, expected))
    off = np.where(np.isnan(one) & np.isnan(other), 0.0, np.abs(one - other))
    return np.where(np.isnan(off), np.inf, off)


def _columns(data: Dataset, name: str) -> range:
    """Where in a sensor's table its readings without noise are."""
    count = sum(map(len, READINGS[name].values()))
    return range(1 + count, 1 + 2 * count) if data.has_noise(name) else range(1, 1 + count)


CHECKS = (check_poses, check_moving, check_mounting, check_rows, check_lights, check_states, check_imu,
          check_depth_gauge, check_magnetometer, check_dvl)
