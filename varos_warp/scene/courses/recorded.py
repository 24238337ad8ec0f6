"""Poses of a recorded course: read once, checked, moved to our axes, and kept as arrays however many there are."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError, counted
from varos_warp.files import stamp_of
from varos_warp.limits import check_limit
from varos_warp.products.sensors.registry import BY_ID
from varos_warp.scene.block import QUATERNION_SLACK
from varos_warp.scene.courses import doubts
from varos_warp.scene.courses.axes import along_path, mount, vehicle_poses
from varos_warp.scene.courses.layout import Layout, layout_of
from varos_warp.scene.courses.lines import REMEDY, rows_of
from varos_warp.scene.courses.smoothing import smoothed, smoothed_attitudes
from varos_warp.scene.description import Scene
from varos_warp.scene.description.recorded import Read
from varos_warp.scene.description.vehicle import Pose, Trajectory

KEY = "trajectory.file"
FARTHEST_M = 1e9
"""Coordinates beyond are refused, as those of a scene file are."""
MOST_REMARKS = 100
"""Remarks above the poses that are kept, the last ones."""
MOST_SMOOTHED = 5000.0
"""Median steps in the period of smoothing, beyond which its equations lose digits that matter [1e-6 m]."""
OUR_FILES = re.compile(rf"(vehicle\w|vehicles\.\w|cam(?P<camera>\w\w)|(?P<sensor>{'|'.join(BY_ID)}))_poses_")
"""Names of files of poses in our datasets, which say whose they are."""
LARGEST_ANGLE = 1e6
"""The largest angle that is read [rad] or [degrees]; much larger ones would lose all digits to whole turns."""
WORDS = {"of": "vehicle", "frame": "enu", "attitude": "recorded"}
"""What holds where the scene does not say."""


@dataclass(frozen=True, eq=False)
class RecordedCourse(Sequence):
    """Poses of a vehicle from a file, in our axes; a sequence of `Pose` blocks, which are made when asked for."""

    file: Path
    about: dict[str, Any]
    """What it is, as plain types: ``format``, ``of``, ``frame``, ``body``, ``attitude``, ``poses``, ``step_s``, and
    what ``smoothing`` has done, ``moved_m`` and ``turned_deg``, each with ``rms`` and ``peak``."""
    time_ns: np.ndarray
    """int64 [N], increasing; the sequence begins at 0."""
    position: np.ndarray
    """float64 [N, 3] [m]."""
    attitude: Rotation
    """N attitudes, vehicle to world."""
    line: np.ndarray
    """Number of the line of each pose, int [N]."""
    used: slice
    """Rows of the poses that the sequence begins and ends between."""
    messages: tuple[str, ...]
    """What the user should know, in words."""

    def __len__(self) -> int:
        return len(self.time_ns)

    def __getitem__(self, k: Any) -> Any:
        if isinstance(k, slice):
            return [self[i] for i in range(*k.indices(len(self)))]
        if not -len(self) <= k < len(self):
            raise IndexError(k)
        return Pose.model_construct(  # before start_s its time is negative
            time_s=float(self.time_ns[k]) / 1e9,
            position=tuple(self.position[k].tolist()),
            quaternion=tuple(self.attitude[k].as_quat(canonical=True, scalar_first=True).tolist()),
        )


def read_course(scene: Scene) -> None:
    """Read the file of a scene's trajectory, if it has one; the trajectory keeps what is read while that is up to date.

    Raises:
        InputError: The file cannot be read exactly as its format says; names its line.
    """
    course = scene.trajectory
    if course.file is None:
        return
    path = scene.resolve(course.file)
    depends_on = path, stamp_of(path), course.model_dump(), mount(scene, course.of or WORDS["of"]).tolist()
    if course._read.course is not None and course._read.depends_on == depends_on:
        return
    try:
        course._read = Read(_read(scene, course, path), depends_on)  # a new one: copies of the trajectory share the old
    except InputError as error:
        raise error.at(scene.key_in_file(error.key or "")) from None


def _read(scene: Scene, course: Trajectory, path: Path) -> RecordedCourse:
    layout, lines, time_ns, values = _table(path, course)
    _check_times(layout, lines, time_ns)
    _check_axes(layout, course, path)
    _refuse(
        layout,
        lines,
        np.abs(values[:, :3]).max(axis=1) > FARTHEST_M,
        values[:, :3],
        f"its place is farther than {FARTHEST_M:g} m",
        "Positions are in metres.",
    )
    start_ns = round(1e9 * (course.start_s or 0.0))
    seconds, step_s = (time_ns - time_ns[0]) / 1e9, float(np.median(np.diff(time_ns))) / 1e9
    if start_ns >= time_ns[-1] - time_ns[0]:
        raise InputError(
            "is not before the last pose",
            key="trajectory.start_s",
            value=course.start_s,
            remedy=f"The poses of the file last {seconds[-1]:g} s.",
        )
    turned = _attitudes(layout, course, lines, values[:, 3:])
    told = [
        *layout.notes,
        *doubts.gaps(seconds, step_s, lines),
        *doubts.whole_times(layout, seconds, step_s),
        *doubts.odd_angles(layout, turned, values[:, 3:]),
        *doubts.whose_poses(layout, course),
    ]
    place, turned, changes = _poses(scene, layout, seconds, values[:, :3], turned)
    stated = _stated(course, layout)
    told += [*doubts.upside_down(turned, stated), *doubts.compass(layout, stated)]
    about = {"file": path.name, "format": layout.format, **stated, "poses": len(lines), "step_s": step_s, **changes}
    time_ns = time_ns - time_ns[0] - start_ns
    return RecordedCourse(
        path,
        about,
        time_ns,
        place,
        turned,
        lines,
        _used(time_ns, course.duration_s),
        tuple(f"{KEY}: {words}" for words in told),
    )


def _used(time_ns: np.ndarray, duration_s: float | None) -> slice:
    """Rows from the last time that is not after the beginning of the sequence to the first not before its end."""
    end_ns = 1e9 * duration_s if duration_s else time_ns[-1]
    first, last = np.searchsorted(time_ns, 0, "right") - 1, np.searchsorted(time_ns, end_ns, "left")
    return slice(int(first), min(int(last), len(time_ns) - 1) + 1)


def _table(path: Path, course: Trajectory) -> tuple[Layout, np.ndarray, np.ndarray, np.ndarray]:
    """Layout of a file, and of its rows the lines [N], times [N] [ns] and other numbers [N, k]."""
    layout, parts, count, before = None, [], 0, []
    for rows in rows_of(path, KEY):
        if layout is None:
            if all(row.is_comment for row in rows):
                before = [*before, *rows][-MOST_REMARKS:]
                continue
            layout = layout_of([*before, *rows], path, course, KEY)
        rows = [row for row in rows if not row.is_comment and row.number != layout.header]
        count += len(rows)
        check_limit("POSES", count, file=path, key=KEY)
        parts.append(layout.cells.read(rows))
    layout = layout or layout_of(before, path, course, KEY)
    if count < 2:
        raise InputError(f"has {counted(count, 'pose')}, but a course two at least", file=path, key=KEY, remedy=REMEDY)
    lines, time_ns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
    return layout, lines, time_ns, values


def _check_times(layout: Layout, lines: np.ndarray, time_ns: np.ndarray) -> None:
    """Refuse times that do not increase."""
    backward = np.flatnonzero(time_ns[1:] <= time_ns[:-1])
    if backward.size:
        i = int(backward[0])
        how = "is that of" if time_ns[i + 1] == time_ns[i] else "is before that of"
        raise layout.cells.problem(
            int(lines[i + 1]),
            f"its time {how} line {lines[i]}, the pose before it",
            "Give the poses in order of time, each its own time.",
        )


def _check_axes(layout: Layout, course: Trajectory, path: Path) -> None:
    """What the file itself says of its axes, and whose poses it has, is what the scene says."""
    problem = layout.cells.problem
    if layout.frame not in (None, _frame(course, layout)):
        raise problem(
            layout.header,
            f"its positions are {layout.frame} by the names of their columns, not {_frame(course, layout)}",
            f"Say trajectory.frame: {layout.frame}, if that is what its attitudes are in, too.",
        )
    if not layout.is_ours:
        return
    if course.frame == "ned" or course.body not in (None, "rfu"):
        raise problem(
            layout.header,
            f"{layout.format} are in our axes, frame enu and body rfu",
            "Leave trajectory.frame and trajectory.body out.",
        )
    if (name := OUR_FILES.match(path.name)) is None:
        return
    whose = name["camera"] or ("imu" if name["sensor"] == "imu0" else name["sensor"]) or "vehicle"
    if name["sensor"] not in (None, "imu0"):
        raise problem(
            None,
            f"by its name has poses of {whose}, from which no vehicle's follow",
            "Take the poses of the vehicle, a camera or the IMU.",
        )
    if whose != (course.of or WORDS["of"]):
        raise problem(
            None, f"by its name has poses of {whose}, not of {course.of or WORDS['of']}", f"Say trajectory.of: {whose}."
        )


def _attitudes(layout: Layout, course: Trajectory, lines: np.ndarray, values: np.ndarray) -> Rotation | None:
    """Attitudes as the file has them; None: it has none, or they are not asked for."""
    wanted = (course.attitude or WORDS["attitude"]) == "recorded"
    if layout.attitude == "none" and wanted:
        raise layout.cells.problem(
            layout.header,
            "has no attitudes",
            "Name their columns in trajectory.columns, or say trajectory.attitude: along_path, or unrotated.",
        )
    if not wanted:
        return None
    if layout.attitude == "quaternion":
        off = np.abs(np.linalg.norm(values, axis=1) - 1.0)
        _refuse(
            layout,
            lines,
            off > QUATERNION_SLACK,
            values,
            "the length of its quaternion is not 1",
            "A quaternion has four parts with a length of 1: check which columns they are.",
        )
        return Rotation.from_quat(values, scalar_first=True)
    if layout.attitude == "matrix":
        R = values.reshape(-1, 3, 3)
        off = np.abs(np.einsum("nij,nkj->nik", R, R) - np.eye(3)).max(axis=(1, 2))
        _refuse(
            layout,
            lines,
            (off > QUATERNION_SLACK) | (np.linalg.det(R) < 0.0),
            values,
            "its matrix is no rotation",
            "Its rows must be unit vectors at right angles.",
        )
        return Rotation.from_matrix(R)
    _refuse(
        layout,
        lines,
        np.abs(values).max(axis=1) > LARGEST_ANGLE,
        values,
        "its angles are too large",
        "Check which columns they are.",
    )
    return Rotation.from_euler(layout.euler_order, values, degrees=layout.attitude == "euler_deg")


def _refuse(
    layout: Layout, lines: np.ndarray, wrong: np.ndarray, values: np.ndarray, problem: str, remedy: str
) -> None:
    """Refuse the first of the rows that are ``wrong``, bool [N]."""
    if wrong.any():
        i = int(np.argmax(wrong))
        raise layout.cells.problem(int(lines[i]), f"{problem}: {', '.join(f'{x:.6g}' for x in values[i])}", remedy)


def _poses(
    scene: Scene, layout: Layout, seconds: np.ndarray, position: np.ndarray, turned: Rotation | None
) -> tuple[np.ndarray, Rotation, dict[str, dict]]:
    """Poses of the vehicle in our axes, smoothed where that is asked for, and how far that moves them."""
    course, about = scene.trajectory, _stated(scene.trajectory, layout)
    T_v_x = mount(scene, about["of"])
    place, attitude = vehicle_poses(
        position, turned, about["frame"], about.get("body", "rfu"), T_v_x, course.origin or (0.0, 0.0, 0.0)
    )
    raw = place, attitude
    if course.smoothing_s:
        place, attitude = _smoothed(layout, seconds, place, attitude, course.smoothing_s)
    changes = _changes(course, raw, (place, attitude))
    if attitude is None:
        # differences from the first place, or a spline of UTM coordinates would lose digits
        velocity = CubicSpline(seconds, place - place[0], bc_type="natural")(seconds, 1)
        attitude = along_path(velocity) if course.attitude == "along_path" else Rotation.identity(len(place))
        place = place - attitude.apply(T_v_x[:3, 3])
    return place, attitude, changes


def _smoothed(
    layout: Layout, seconds: np.ndarray, place: np.ndarray, attitude: Rotation | None, period_s: float
) -> tuple[np.ndarray, Rotation | None]:
    step = float(np.median(np.diff(seconds)))
    if period_s > MOST_SMOOTHED * step:
        raise InputError(
            f"is more than {MOST_SMOOTHED:g} of the {step:.3g} s between poses",
            key="trajectory.smoothing_s",
            value=period_s,
            remedy="Take less, or fewer of the poses.",
        )
    try:
        return (
            smoothed(seconds, place, period_s),
            None if attitude is None else smoothed_attitudes(seconds, attitude, period_s),
        )
    except np.linalg.LinAlgError:
        raise InputError(
            "cannot be smoothed: poses lie too near to each other in time",
            file=layout.cells.path,
            key=KEY,
            remedy="Leave out poses, or trajectory.smoothing_s.",
        ) from None


def _changes(course: Trajectory, raw: tuple, made: tuple) -> dict[str, dict]:
    """How far smoothing has moved [m] and turned [degrees] the poses, root mean square and most."""
    if not course.smoothing_s:
        return {}
    sizes = {"moved_m": np.linalg.norm(made[0] - raw[0], axis=1)}
    if raw[1] is not None:
        sizes["turned_deg"] = np.degrees((raw[1].inv() * made[1]).magnitude())
    return {
        "smoothing": {
            key: {"rms": float(np.sqrt(np.mean(size**2))), "peak": float(size.max())} for key, size in sizes.items()
        }
    }


def _frame(course: Trajectory, layout: Layout) -> str:
    """World axes of the file: where it has attitudes that count, names of columns of the position do not say theirs."""
    attitude = course.attitude or WORDS["attitude"]
    return course.frame or (layout.frame if attitude != "recorded" else None) or WORDS["frame"]


def _stated(course: Trajectory, layout: Layout) -> dict[str, str]:
    """What the poses are of and in which axes they are, with what holds where the scene does not say."""
    about = {key: getattr(course, key) or word for key, word in WORDS.items()} | {"frame": _frame(course, layout)}
    if about["of"] == "vehicle" and about["attitude"] == "recorded":
        usual = "rfu" if layout.is_ours else "flu" if about["frame"] == "enu" else "frd"
        about["body"] = course.body or usual
    return about
