"""Reads a whole dataset back and checks it against itself: what does not agree is listed, the rest is measured.

Every check states its limit beside its measure. Limits come from rounding, quantisation or the order of a difference.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.dataset import files
from varos_warp.dataset.layout import POSE_FORMS, Dataset
from varos_warp.dataset.progress import Progress
from varos_warp.errors import InputError
from varos_warp.render.outputs import DEPTH_LEVELS, OUTPUTS

PAIRS = 8
"""Pairs of views compared per camera."""
MOST_PROBLEMS = 20
"""Of one kind that are listed singly."""


@dataclass
class Validation:
    """Outcome: it is valid when there are no problems."""

    problems: list[str] = field(default_factory=list)
    measures: list[dict] = field(default_factory=list)
    """name, value, limit, unit of each measured quantity."""
    files_read: int = 0

    def measure(self, name: str, value: float, limit: float, unit: str) -> None:
        """Note a quantity; above its limit (or NaN) it is a problem."""
        self.measures.append({"name": name, "value": float(value), "limit": float(limit), "unit": unit})
        if not value <= limit:
            self.problems.append(f"{name}: {value:.4g} {unit}, more than {limit:.4g}")


def validate(root, quiet: bool = False) -> Validation:
    """Read everything in a dataset back and check it against itself.

    Args:
        root: Folder of the dataset.
        quiet: No progress on stderr.

    Raises:
        InputError: If it is not a dataset at all.
    """
    data, result = Dataset(root), Validation()
    for check in (_check_remains, _check_times, _check_poses, _check_cameras, _check_states, _check_imu,
                  _check_depth_gauge, _check_exposure):
        _guard(result, check, data, result)
    _check_images(data, result, quiet)
    if "D" in data.outputs:
        _guard(result, _check_views, data, result)
    return result


def _guard(result: Validation, check: Callable, *args) -> None:
    """A damaged file is one problem, and the other checks go on."""
    try:
        check(*args)
    except InputError as error:
        result.problems.append(error.message)
    except (KeyError, IndexError, ValueError) as error:
        result.problems.append(f"{check.__name__.removeprefix('_check_')}: cannot be checked: {error!r}")


# ----------------------------------------------------------------------------------------------------- files and times


def _check_remains(data: Dataset, result: Validation) -> None:
    """Nothing half-written, and no image that no frame accounts for."""
    result.problems += [f"{p.relative_to(data.root)}: remains of an interrupted run" for p in data.root.rglob(".*.tmp")]
    for camera in data.cameras:
        for output in data.outputs:
            known = {data.layout.png(camera, output, frame).name for frame in data.frames}
            found = {p.name for p in (data.layout.camera_dir(camera) / output).glob("*.png")}
            result.problems += [f"{name}: no frame of dataset.json accounts for it" for name in sorted(found - known)]


def _check_times(data: Dataset, result: Validation) -> None:
    """Time stamps ascend in even steps, name their files, and the IMU goes on beyond the last frame."""
    for camera in data.cameras:
        path = data.layout.camera_file(camera, "_timestamps.csv")
        table = files.read_csv(path)
        time_ns = table["# timestamp [ns]"]
        if len(time_ns) != len(data.frames):
            result.problems.append(f"{path.name}: {len(time_ns)} rows for {len(data.frames)} frames")
            continue
        expected = np.rint(np.array(data.frames) * (1e9 / data.meta["frames"]["rate_hz"])).astype(np.int64)
        if (wrong := np.flatnonzero(time_ns != expected)).size:
            row = wrong[0]
            result.problems.append(f"{path.name}: row {row} is at {time_ns[row]} ns, not {expected[row]}")
        for output in data.outputs:
            if table[output].tolist() != [data.layout.png(camera, output, frame).name for frame in data.frames]:
                result.problems.append(f"{path.name}: column {output} does not name the files of its frames")
        if "imu0" in data.recorded and data.imu()["time_ns"][-1] <= time_ns[-1]:
            result.problems.append(f"{path.name}: the IMU has no sample after the last frame")


# ------------------------------------------------------------------------------------------------------ poses, sensors


def _check_poses(data: Dataset, result: Validation) -> None:
    """Euler angles, quaternions and matrices are the same poses, and the matrices are rotations."""
    for name in (*data.recorded, *data.cameras):
        paths = [data.layout.poses(name, form) for form in POSE_FORMS]
        euler, _, quaternion = (np.column_stack(list(files.read_csv(path).values())[1:]) for path in paths)
        T = data.poses(name)[1]
        R = T[:, :3, :3]
        others = (Rotation.from_euler("xyz", euler[:, 3:]), Rotation.from_quat(quaternion[:, 3:], scalar_first=True))
        worst = max(np.abs(other.as_matrix() - R).max() for other in others)
        result.measure(f"{name}: attitude, three forms", worst, 1e-12, "rad")
        result.measure(f"{name}: rotation matrices", np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(), 1e-12, "")
        if not (np.array_equal(euler[:, :3], T[:, :3, 3]) and np.array_equal(quaternion[:, :3], T[:, :3, 3])):
            result.problems.append(f"{name}: the pose files do not agree on the positions")


def _check_cameras(data: Dataset, result: Validation) -> None:
    """Camera poses are the vehicle's poses times the mounting, or stand still in the world."""
    if not data.recorded:
        return
    vehicle_time, T_w_v = data.poses("vehicle")
    for camera in data.cameras:
        time_ns, T_w_c = data.poses(camera)
        about = data.camera(camera)
        index = np.searchsorted(vehicle_time, time_ns)
        expected = np.array(about["T_w_c"]) if "T_w_c" in about else T_w_v[index] @ np.array(about["T_v_c"])
        limit = 1e-9 + 8 * np.finfo(float).eps * np.abs(T_w_c).max()
        result.measure(f"{camera}: pose against the vehicle's", np.abs(T_w_c - expected).max(), limit, "m")


def _check_states(data: Dataset, result: Validation) -> None:
    """The vehicle's states are at the times and places of its poses."""
    if not data.recorded:
        return
    states, (time_ns, T) = data.states(), data.poses("vehicle")
    if not (np.array_equal(states["time_ns"], time_ns) and np.array_equal(states["position"], T[:, :3, 3])):
        result.problems.append(f"{data.layout.states.name}: does not agree with the poses of the vehicle")


def _difference2(x: np.ndarray, h: float) -> np.ndarray:
    """Second derivative at x[2:-2], of fourth order."""
    return (-x[4:] + 16 * x[3:-1] - 30 * x[2:-2] + 16 * x[1:-3] - x[:-4]) / (12 * h * h)


def _check_imu(data: Dataset, result: Validation) -> None:
    """Readings against differences of the IMU's own poses.

    Medians, since exact poses given by hand may have corners. Limits: 1e-3 for the difference's own error (h^4 / 90
    times the sixth derivative), the rounding of positions far from the origin, and four times the noise.
    """
    if "imu0" not in data.recorded:
        return
    about, imu, bias = data.meta["sensors"]["imu0"], data.imu(), data.imu_bias()
    force = imu["acceleration"] - (bias["acceleration"] if bias else 0.0)
    rate = imu["angular_velocity"] - (bias["angular_velocity"] if bias else 0.0)
    time_ns, T = data.poses("imu0")
    if not np.array_equal(time_ns, imu["time_ns"]):
        result.problems.append("imu0: poses and readings have different time stamps")
        return
    if len(time_ns) < 5:
        return
    h, noise = 1.0 / about["rate_hz"], about["noise"] or {}
    R, position = Rotation.from_matrix(T[:, :3, :3]), T[:, :3, 3] - T[0, :3, 3]
    felt = R[2:-2].inv().apply(_difference2(position, h) - data.meta["gravity"])
    rounding = 6 * np.finfo(float).eps * np.abs(T[:, :3, 3]).max() / h**2
    white = 4 * np.sqrt(about["rate_hz"]) * np.array([noise.get("accelerometer_noise_density", 0.0),
                                                      noise.get("gyroscope_noise_density", 0.0)])
    result.measure("imu0: specific force against poses, median",
                   np.median(np.linalg.norm(force[2:-2] - felt, axis=1)), 1e-3 + rounding + white[0], "m/s^2")
    turned = (R[:-1].inv() * R[1:]).as_rotvec() / h
    result.measure("imu0: angular velocity against poses, median",
                   np.median(np.linalg.norm((rate[:-1] + rate[1:]) / 2 - turned, axis=1)), 1e-3 + white[1], "rad/s")


def _check_depth_gauge(data: Dataset, result: Validation) -> None:
    """Readings against the height of the gauge's own poses."""
    if "depth0" not in data.recorded:
        return
    gauge, (time_ns, T) = data.depth_gauge(), data.poses("depth0")
    if not np.array_equal(time_ns, gauge["time_ns"]):
        result.problems.append("depth0: poses and readings have different time stamps")
        return
    error = np.abs(gauge["depth"] - (data.meta["surface_depth_m"] - T[:, 2, 3])).max()
    result.measure("depth0: against poses", error, 1e-9, "m")


# -------------------------------------------------------------------------------------------------------------- images


def _check_exposure(data: Dataset, result: Validation) -> None:
    """Every frame has a finite gain."""
    for camera in data.cameras:
        for output in (o for o in data.outputs if OUTPUTS[o].is_color):
            gains = data.gains(output, camera)
            if list(gains) != data.frames or not all(0.0 < gain < np.inf for gain in gains.values()):
                result.problems.append(f"{camera} {output}: the exposure table lacks a positive gain for some frame")


def _check_images(data: Dataset, result: Validation, quiet: bool) -> None:
    """Every image decodes to its size and type; the 8 bit ones are their EXR exposed; C and D agree."""
    problems: list[str] = []
    angles: list[float] = []
    total = len(data.frames) * len(data.cameras)
    with Progress("reading", total, quiet=quiet) as progress:
        for frame in data.frames:
            for camera in data.cameras:
                for check in (_colors_agree, _geometry_agrees, _segments_agree):
                    try:
                        problems += check(data, result, frame, camera, angles)
                    except InputError as error:
                        problems.append(error.message)
                progress.advance()
    result.problems += problems[:MOST_PROBLEMS]
    if len(problems) > MOST_PROBLEMS:
        result.problems.append(f"... and {len(problems) - MOST_PROBLEMS} more images like these")
    if angles:
        result.measure("C against the slopes of D, median angle", np.median(angles), 30.0, "deg")


def _read(data: Dataset, result: Validation, output: str, frame: int, camera: str) -> np.ndarray:
    """Pixels of a PNG, of the size and type that they must have."""
    path, about, row = data.layout.png(camera, output, frame), data.camera(camera), OUTPUTS[output]
    pixels = files.read_png(path)
    result.files_read += 1
    shape = (about["height"], about["width"], 3)[:3 if row.channels == 3 else 2]
    if pixels.shape != shape or pixels.dtype != row.dtype:
        raise InputError(f"is {pixels.dtype} {pixels.shape}, not {np.dtype(row.dtype)} {shape}", file=path)
    return pixels


def _colors_agree(data: Dataset, result: Validation, frame: int, camera: str, _angles) -> list[str]:
    problems = []
    for output in (o for o in data.outputs if OUTPUTS[o].is_color):
        pixels, linear = _read(data, result, output, frame, camera), data.linear(output, frame, camera)
        result.files_read += 1
        name = data.layout.png(camera, output, frame).name
        if not np.isfinite(linear).all():
            problems.append(f"{name}: its EXR has values that are not finite")
        elif not np.array_equal(OUTPUTS[output].encode(linear, data.gain(output, frame, camera)), pixels):
            problems.append(f"{name}: is not its EXR with the gain of the exposure table")
    return problems


def _geometry_agrees(data: Dataset, result: Validation, frame: int, camera: str, angles: list[float]) -> list[str]:
    """Where C has no surface D has none within its range, C faces the camera, and D slopes as C says."""
    images = {o: _read(data, result, o, frame, camera) for o in "CD" if o in data.outputs}
    if len(images) < 2:
        return []
    name, problems = data.layout.png(camera, "C", frame).name, []
    normal, missing = data.image("C", frame, camera), ~np.any(images["C"], axis=-1)
    if (missing & (images["D"] < DEPTH_LEVELS)).any():
        problems.append(f"{name}: has no surface where D has one")
    points, rays = _back_project(data, frame, camera)
    away = np.einsum("...i,...i", normal, rays / np.linalg.norm(rays, axis=-1, keepdims=True)) > 0.2
    if away.mean() > 0.05:
        problems.append(f"{name}: {100 * away.mean():.0f} % of its normals point away from the camera")
    slope = _normals_of(points, rays)
    both = np.isfinite(slope).all(-1) & ~missing
    if both.any():
        cosine = np.einsum("...i,...i", slope[both], normal[both])
        angles.append(float(np.degrees(np.median(np.arccos(np.clip(cosine, -1, 1))))))
    return problems


def _segments_agree(data: Dataset, result: Validation, frame: int, camera: str, _angles) -> list[str]:
    """S numbers only what segments.json lists, and has something wherever D has."""
    if "S" not in data.outputs:
        return []
    name, pixels = data.layout.png(camera, "S", frame).name, _read(data, result, "S", frame, camera)
    problems = []
    if unknown := set(np.unique(pixels).tolist()) - {0, *(row["id"] for row in data.segments())}:
        problems.append(f"{name}: segments.json does not list {sorted(unknown)[:5]}")
    if "D" in data.outputs and ((pixels == 0) & (data.pixels("D", frame, camera) < DEPTH_LEVELS)).any():
        problems.append(f"{name}: has nothing where D has a surface")
    return problems


# ------------------------------------------------------------------------------------------------------ several views


def _pixel_rays(data: Dataset, camera: str) -> np.ndarray:
    """K^-1 (u, v, 1) [H, W, 3] of every pixel's centre, camera axes."""
    about = data.camera(camera)
    u, v = np.meshgrid(np.arange(about["width"]) + 0.5, np.arange(about["height"]) + 0.5)
    return np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(data.intrinsics(camera)).T


def planar_depth(data: Dataset, frame: int, camera: str) -> np.ndarray:
    """Depth [H, W] along the camera's z axis [m], whichever kind D holds; inf where there is none."""
    depth = data.depth(frame, camera).astype(float)
    if data.meta["depth"]["kind"] == "range":
        depth = depth / np.linalg.norm(_pixel_rays(data, camera), axis=-1)
    return depth


def _back_project(data: Dataset, frame: int, camera: str) -> tuple[np.ndarray, np.ndarray]:
    """Points [H, W, 3] of D in the world (inf where there are none) and the directions to them."""
    depth, T_w_c = planar_depth(data, frame, camera), data.T_w_c(frame, camera)
    rays = _pixel_rays(data, camera) @ T_w_c[:3, :3].T
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(depth)[..., None], rays * depth[..., None] + T_w_c[:3, 3], np.inf), rays


def _normals_of(points: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Unit normals [H, W, 3] towards the camera from central differences of points; NaN at borders and at edges."""
    normal = np.full(points.shape, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        across, down = points[1:-1, 2:] - points[1:-1, :-2], points[2:, 1:-1] - points[:-2, 1:-1]
        n = np.cross(across, down)
        n /= np.linalg.norm(n, axis=-1, keepdims=True)
        n *= -np.sign(np.einsum("...i,...i", n, rays[1:-1, 1:-1]))[..., None]
        # a step in depth between neighbours is an edge, not a slope
        second = np.linalg.norm(points[1:-1, 2:] + points[1:-1, :-2] - 2 * points[1:-1, 1:-1], axis=-1)
        smooth = second < 0.2 * np.linalg.norm(across, axis=-1)
    normal[1:-1, 1:-1] = np.where(smooth[..., None], n, np.nan)
    return normal


def _view_pairs(data: Dataset) -> Iterator[tuple[str, tuple[int, str], tuple[int, str]]]:
    """Pairs of views that see much the same: frames of one camera up to a second apart, and two cameras at once."""
    second = max(1, round(data.meta["frames"]["rate_hz"]))
    reach = min(second, len(data.frames) - 1)
    for camera in data.cameras:
        for step, name in {reach: f"D of frames {reach} apart", 1: "D of successive frames"}.items():
            known = set(data.frames)
            pairs = [(f, f + step) for f in data.frames if step > 0 and f + step in known]
            for i in np.unique(np.linspace(0, len(pairs) - 1, min(PAIRS, len(pairs))).astype(int)):
                yield f"{camera}: {name}", (pairs[i][0], camera), (pairs[i][1], camera)
    for one, other in zip(data.cameras, data.cameras[1:], strict=False):
        if data.camera(one)["mount"] == data.camera(other)["mount"]:
            for a in data.frames[::max(1, len(data) // PAIRS)]:
                yield f"{one}, {other}: D of the same moment", (a, one), (a, other)


def _check_views(data: Dataset, result: Validation) -> None:
    """Points of D seen in one view lie where D of another view has them.

    Limits: one step of D and half a pixel's footprint at the median distance; one pixel. On a plane nothing but the
    steps remains; half a footprint leaves room for a surface that is rough on the scale of a pixel.
    """
    errors: dict[str, list[np.ndarray]] = {}
    for name, first, second in _view_pairs(data):
        if all(data.layout.png(camera, "D", frame).exists() for frame, camera in (first, second)):
            errors.setdefault(name, []).append(_compare_views(data, first, second))
    for name, parts in errors.items():
        metres, pixels, footprint = np.concatenate(parts).T
        if len(metres):
            limit = data.meta["depth"]["scale_m"] + 0.5 * np.median(footprint)
            result.measure(f"{name}, median", 1000 * np.median(metres), 1000 * limit, "mm")
            result.measure(f"{name}, median", np.median(pixels), 1.0, "px")


def _compare_views(data: Dataset, first: tuple[int, str], second: tuple[int, str]) -> np.ndarray:
    """Rows (error in depth [m], error there and back [px], footprint of a pixel [m]) of the pixels seen in both."""
    points = _back_project(data, *first)[0].reshape(-1, 3)
    about, K = data.camera(second[1]), data.intrinsics(second[1])
    T_w_c = data.T_w_c(*second)
    u, v, z = _project(points[np.isfinite(points).all(-1)], K, T_w_c)
    row, col = v - 0.5, u - 0.5
    inside = (z > 0) & (row >= 0) & (col >= 0) & (row < about["height"] - 1) & (col < about["width"] - 1)
    u, v, z, row, col = (x[inside] for x in (u, v, z, row, col))
    seen = _interpolate_depth(planar_depth(data, *second), row, col)
    known = np.isfinite(seen)
    u, v, z, seen = (x[known] for x in (u, v, z, seen))
    rays = np.column_stack([u, v, np.ones_like(u)]) @ np.linalg.inv(K).T @ T_w_c[:3, :3].T
    view = data.intrinsics(first[1]), data.T_w_c(*first)
    there, back = (_project(rays * depth[:, None] + T_w_c[:3, 3], *view) for depth in (z, seen))
    moved = np.hypot(back[0] - there[0], back[1] - there[1])
    return np.column_stack([np.abs(seen - z), moved, z / K[0, 0]])


def _project(points: np.ndarray, K: np.ndarray, T_w_c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixel coordinates u, v (first centre at 0.5) and depth z [m] of world points [N, 3]."""
    p = (points - T_w_c[:3, 3]) @ T_w_c[:3, :3] @ K.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return p[:, 0] / p[:, 2], p[:, 1] / p[:, 2], p[:, 2]


def _interpolate_depth(depth: np.ndarray, row: np.ndarray, col: np.ndarray) -> np.ndarray:
    """Bilinear in 1 / z, which is exact on a plane; NaN next to an edge (10 %) or to nothing."""
    r, c = np.floor(row).astype(int), np.floor(col).astype(int)
    corners = np.stack([depth[r, c], depth[r, c + 1], depth[r + 1, c], depth[r + 1, c + 1]])
    fr, fc = row - r, col - c
    weights = np.stack([(1 - fr) * (1 - fc), (1 - fr) * fc, fr * (1 - fc), fr * fc])
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = corners.max(0) < 1.1 * corners.min(0)
        return np.where(np.isfinite(corners).all(0) & flat, 1.0 / np.sum(weights / corners, axis=0), np.nan)
