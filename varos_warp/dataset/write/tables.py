"""The tables of a dataset: poses, sensors, cameras and lights."""

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from varos_warp.dataset import files
from varos_warp.dataset.layout import POSE_FORMS, READINGS, STATES, TIME, Layout
from varos_warp.dataset.write.texts import describe_camera, light_pose
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.products.sensors.protocol import Samples, xyz
from varos_warp.products.sensors.registry import BY_ID, mounted
from varos_warp.scene.frames import camera_pose, euler_angles
from varos_warp.scene.optics.shutter import in_ns, row_offsets_s


def pose_columns(form: str, T: np.ndarray) -> np.ndarray:
    """The numbers [N, 6, 12 or 7] of a file of poses T_w_x [N, 3 or 4, 4]; Euler angles as in the paper, 4.1."""
    if form == "transformation_matrix":
        return T[:, :3].reshape(-1, 12)
    turn = Rotation.from_matrix(T[:, :3, :3])
    angles = euler_angles(turn) if form == "euler" else turn.as_quat(canonical=True, scalar_first=True)
    return np.hstack([T[:, :3, 3], angles])


def write_poses(layout: Layout, name: str, time_ns: np.ndarray, T_w_x: np.ndarray) -> None:
    """Poses [N, 4, 4] in each of the three forms."""
    for form, header in POSE_FORMS.items():
        files.write_csv(layout.poses(name, form), [TIME, *header], time_ns, pose_columns(form, T_w_x))


def write_sensors(layout: Layout, scene, simulation) -> None:
    """Vehicle and sensors: data and the pose of each at each of its samples."""
    trajectory = simulation.trajectory
    write_poses(layout, "vehicle", trajectory.time_ns, trajectory.poses())
    files.write_csv(
        layout.states,
        [TIME, *itertools.chain(*STATES.values())],
        trajectory.time_ns,
        *(getattr(trajectory, quantity) for quantity in STATES),
    )
    for product, block in mounted(scene.vehicle):
        reading, truth, bias = vars(getattr(simulation, product.key)), None, None
        if getattr(block, "noise", None) is not None:
            truth, bias = (
                {quantity: reading[key.format(quantity)] for quantity in product.columns}
                for key in ("true_{}", "{}_bias")
            )
        write_readings(layout, product.id, reading, truth, bias)
        time_ns = reading["time_ns"]
        write_poses(layout, product.id, time_ns, trajectory.at(time_ns).poses() @ product.mounting(block))


def write_readings(
    layout: Layout, name: str, reading: Samples, truth: Samples | None = None, bias: Samples | None = None
) -> None:
    """Readings of a sensor; where they have noise, what they would be without it beside them, and its bias.

    Each has ``time_ns`` int64 [N] and the quantities of `READINGS`, [N] or [N, k].
    """

    def write(path: Path, **parts: Samples | None) -> None:
        there = {prefix: part for prefix, part in parts.items() if part is not None}
        header = [prefix + column for prefix in there for columns in READINGS[name].values() for column in columns]
        files.write_csv(
            path,
            [TIME, *header],
            reading["time_ns"],
            *(part[quantity] for part in there.values() for quantity in READINGS[name]),
        )

    if BY_ID[name].bias_apart and bias is not None:
        write(layout.bias(name), b_=bias)
        bias = None
    write(layout.sensor(name), **{"": reading, "true_": truth, "b_": bias})


_PIXELS = "# The centre of the top left pixel is (0, 0) in K_opencv and (0.5, 0.5) in K_center_half.\n"


def write_camera(
    layout: Layout,
    camera,
    frames: list[int],
    time_ns: np.ndarray,
    T_w_v: np.ndarray,
    outputs: list[str],
    matrix: np.ndarray | None = None,
) -> None:
    """Calibration, with a colour matrix if there is one, time stamps and poses of one camera at its frames [N]."""
    path = layout.camera_file(camera.id, ".yaml")
    text = yaml.safe_dump(describe_camera(layout, camera, matrix), sort_keys=False, default_flow_style=None, width=120)
    files.write_bytes(path, (_PIXELS + text).encode())
    letters = [letter for letter, image in OUTPUTS.items() if image.released]
    letters += [letter for letter in outputs if letter not in letters]
    names = [
        [layout.image(camera.id, letter, frame).name if letter in outputs else "" for frame in frames]
        for letter in letters
    ]
    files.write_csv(layout.camera_file(camera.id, "_timestamps.csv"), [TIME, *letters], time_ns, *names)
    write_poses(layout, camera.id, time_ns, np.array([camera_pose(camera, T) for T in T_w_v]))


def write_row_poses(layout: Layout, camera, frames: list[int], motion: Callable[[int], Callable]) -> None:
    """Poses of every row of a rolling shutter, float64 [frames, rows, 7]: position, quaternion w x y z, w >= 0.

    A text of so many numbers would be larger than the images. ``motion(frame)``: of the vehicle around a
    frame, as `Simulation.motion` has it.
    """
    path, offset_ns = layout.row_poses(camera.id), in_ns(row_offsets_s(camera))
    with files.atomic(path) as temp:
        table = np.lib.format.open_memmap(temp, "w+", float, (len(frames), len(offset_ns), 7))
        for k, frame in enumerate(frames):
            table[k] = pose_columns("quaternion", camera_pose(camera, motion(frame)(offset_ns)))
        table.flush()
        del table


def write_lights(layout: Layout, scene, frames: list[int], time_ns: np.ndarray, T_w_v: np.ndarray) -> None:
    """Position and direction of every light in the world at every frame, a row each."""
    lights = scene.vehicle.lights
    if not lights:
        return
    T = (T_w_v[:, None] @ np.array([light_pose(light) for light in lights])).reshape(-1, 4, 4)
    direction = ["direction_w_x", "direction_w_y", "direction_w_z"]
    files.write_csv(
        layout.lights,
        [TIME, "frame", "light", *xyz("p_wl", "m"), *direction],
        np.repeat(time_ns, len(lights)),
        np.repeat(frames, len(lights)),
        np.tile(np.arange(len(lights)), len(frames)),
        T[:, :3, 3],
        T[:, :3, 2],
    )
