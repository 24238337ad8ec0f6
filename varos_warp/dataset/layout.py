"""Where everything lies in a dataset, and `Dataset`, which reads it back.

Names and folders of the released VAROS sequence (paper 4.1.1, tables 5 and 6, figure 5)::

    dataset.json  README.txt  contact_sheet.png  segments.json
    vehicle0/cam0/{A,B,C,D,S}/seq01_veh0_camM0_A-00000000.png        also A_exr, B_exr, A_linear, D_exr
    vehicle0/cam0/camM0.yaml  camM0_timestamps.csv  camM0_exposure_A.csv  camM0_poses/camM0_poses_*.csv
    vehicle0/imu0/imu0_data.csv  imu0_bias.csv  imu0_poses/...     vehicle0/depth0/depth0_data.csv  depth0_poses/...
    vehicle0/ground_truth_vehicle0_poses/vehicle0_poses_*.csv  vehicle0_states.csv
    vehicle0/lights0/lights0_poses.csv
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from varos_warp.dataset import files, schema
from varos_warp.errors import InputError
from varos_warp.render.outputs import OUTPUTS

SCHEMA_VERSION = 1
"""Of dataset.json; raised when a key changes its meaning."""
POSE_FORMS = ("euler", "transformation_matrix", "quaternion")


@dataclass(frozen=True)
class Layout:
    """Paths of a dataset of one vehicle."""

    root: Path
    sequence: str
    vehicle: str
    cameras: tuple[str, ...]
    """Ids; their order numbers the folders."""

    @classmethod
    def of(cls, scene, root) -> "Layout":
        """Layout of what a scene makes."""
        vehicle = scene.vehicle
        return cls(Path(root), scene.sequence, vehicle.id, tuple(camera.id for camera in vehicle.cameras))

    @property
    def metadata(self) -> Path:
        """What the dataset is, for machines."""
        return self.root / "dataset.json"

    @property
    def segments(self) -> Path:
        """What the numbers of S stand for."""
        return self.root / "segments.json"

    @property
    def vehicle_dir(self) -> Path:
        """Folder of everything on the vehicle."""
        return self.root / f"vehicle{self.vehicle}"

    def camera_dir(self, camera: str) -> Path:
        """Folder of a camera."""
        return self.vehicle_dir / f"cam{self.cameras.index(camera)}"

    def camera_file(self, camera: str, suffix: str) -> Path:
        """A file that tells of a camera, such as ``camM0_timestamps.csv``."""
        return self.camera_dir(camera) / f"cam{camera}{suffix}"

    def image_name(self, camera: str, output: str, frame: int) -> str:
        """Name of an image without its extension (paper, table 5)."""
        return f"seq{self.sequence}_veh{self.vehicle}_cam{camera}_{output}-{frame:08d}"

    def png(self, camera: str, output: str, frame: int) -> Path:
        """The finished image."""
        return self.camera_dir(camera) / output / f"{self.image_name(camera, output, frame)}.png"

    def exr(self, camera: str, output: str, frame: int) -> Path:
        """Half floats of A or B before exposure; of D, float32 channels Z and range."""
        return self.camera_dir(camera) / f"{output}_exr" / f"{self.image_name(camera, output, frame)}.exr"

    def linear(self, camera: str, frame: int) -> Path:
        """A as it was rendered: float32 with standard error and layers."""
        return self.camera_dir(camera) / "A_linear" / f"{self.image_name(camera, 'A', frame)}.exr"

    def sensor(self, name: str) -> Path:
        """Data of ``imu0`` or ``depth0``."""
        return self.vehicle_dir / name / f"{name}_data.csv"

    @property
    def imu_bias(self) -> Path:
        """The slowly varying part of the IMU's noise, where it has any."""
        return self.sensor("imu0").with_name("imu0_bias.csv")

    def poses(self, name: str, form: str) -> Path:
        """Poses of a camera id, ``imu0``, ``depth0`` or ``vehicle``; the form is one of `POSE_FORMS`."""
        if name == "vehicle":
            folder, stem = self.vehicle_dir / f"ground_truth_vehicle{self.vehicle}_poses", f"vehicle{self.vehicle}"
        elif name in self.cameras:
            folder, stem = self.camera_dir(name) / f"cam{name}_poses", f"cam{name}"
        else:
            folder, stem = self.vehicle_dir / name / f"{name}_poses", name
        return folder / f"{stem}_poses_{form}.csv"

    @property
    def states(self) -> Path:
        """Position, velocity, acceleration, attitude and its rates of the vehicle at every tick."""
        return self.poses("vehicle", "euler").with_name(f"vehicle{self.vehicle}_states.csv")

    @property
    def lights(self) -> Path:
        """Where the lights are and point at every frame."""
        return self.vehicle_dir / "lights0" / "lights0_poses.csv"


def runs(frames) -> list[list[int]]:
    """Frame numbers as half-open ranges: [0, 1, 2, 7] -> [[0, 3], [7, 8]]."""
    result: list[list[int]] = []
    for frame in sorted(frames):
        if result and result[-1][1] == frame:
            result[-1][1] += 1
        else:
            result.append([frame, frame + 1])
    return result


def from_runs(ranges) -> list[int]:
    """Inverse of `runs`."""
    return [frame for start, stop in ranges for frame in range(start, stop)]


class Dataset:
    """A dataset on disk, opened for reading; images are decoded one at a time, when asked for.

    Args:
        root: Folder that holds ``dataset.json``.

    Raises:
        InputError: If there is no readable dataset; reading methods raise it for damaged or missing files.
    """

    def __init__(self, root):
        self.root, self._gains = Path(root), {}
        if not (self.root / "dataset.json").is_file():
            raise InputError("there is no dataset.json in it, so it is not a dataset", file=self.root,
                             remedy="Give the folder that `varos-warp run` wrote to.")
        self.meta = files.read_json(self.root / "dataset.json")
        if not isinstance(self.meta, dict) or self.meta.get("schema_version") != SCHEMA_VERSION:
            raise InputError(f"this is not a dataset of schema version {SCHEMA_VERSION}",
                             file=self.root / "dataset.json", remedy="Make it anew, or read it with the version of "
                             "varos_warp that made it.")
        if flaw := schema.first_flaw(self.meta):
            raise InputError(f"the entry {flaw} is missing or damaged", file=self.root / "dataset.json",
                             remedy="Make the dataset anew.")
        cameras = tuple(camera["id"] for camera in self.meta["cameras"])
        self.layout = Layout(self.root, self.meta["sequence"], self.meta["vehicle"], cameras)
        self.frames: list[int] = from_runs(self.meta["frames"]["ranges"])
        self.outputs: list[str] = self.meta["outputs"]

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.frames)

    def __iter__(self) -> Iterator[int]:
        """Frame numbers."""
        return iter(self.frames)

    def __repr__(self) -> str:
        what = f"{len(self)} frames, outputs {''.join(self.outputs)}, cameras {', '.join(self.cameras)}"
        return f"Dataset({str(self.root)!r}: {what})"

    @property
    def cameras(self) -> tuple[str, ...]:
        """Ids of the cameras."""
        return self.layout.cameras

    @property
    def recorded(self) -> list[str]:
        """``vehicle`` and the sensors on it where they were written; `varos-warp render` writes none of them."""
        folders = [self.layout.states.parent, *(self.layout.sensor(name).parent for name in self.meta["sensors"])]
        return ["vehicle", *self.meta["sensors"]] if any(map(Path.exists, folders)) else []

    def _camera(self, camera: str | None) -> str:
        if camera is not None and camera not in self.cameras:
            raise InputError("no such camera", key="camera", value=camera,
                             remedy=f"There are: {', '.join(self.cameras)}.")
        return self.cameras[0] if camera is None else camera

    def camera(self, camera: str | None = None) -> dict:
        """What dataset.json says of a camera; absent: the first."""
        return self.meta["cameras"][self.cameras.index(self._camera(camera))]

    def intrinsics(self, camera: str | None = None, convention: str = "center_half") -> np.ndarray:
        """K [3, 3] in pixels.

        Args:
            camera: Its id; absent: the first.
            convention: ``center_half``: the centre of the top left pixel is (0.5, 0.5), as in COLMAP; ``opencv``:
                it is (0, 0), as in OpenCV, Kalibr, ORB-SLAM3 and KITTI.
        """
        return np.array(self.camera(camera)["K_" + convention], float)

    # ---------------------------------------------------------------------------------------------------- images

    def image(self, output: str, frame: int, camera: str | None = None) -> np.ndarray:
        """A decoded image: linear radiance of A and B (from 8 bits), unit normals of C, metres of D, numbers of S."""
        return OUTPUTS[output].decode(self.pixels(output, frame, camera), self.scale(output, frame, camera))

    def pixels(self, output: str, frame: int, camera: str | None = None) -> np.ndarray:
        """Pixels of the PNG: uint8 [H, W, 3], of D and S uint16 [H, W]."""
        return files.read_png(self.layout.png(self._camera(camera), output, frame))

    def linear(self, output: str, frame: int, camera: str | None = None) -> np.ndarray:
        """Linear radiance float32 [H, W, 3] of A or B before exposure, from its EXR."""
        channels = files.read_exr(self.layout.exr(self._camera(camera), output, frame))
        return np.stack([channels[c] for c in "RGB"], -1).astype(np.float32)

    def segments(self) -> list[dict]:
        """What the numbers of S stand for: rows of ``id``, ``key``, ``kind``, ``material``, ``material_id``."""
        return files.read_json(self.layout.segments)["segments"]

    def depth(self, frame: int, camera: str | None = None) -> np.ndarray:
        """Metres [H, W] of D, of the kind that dataset.json names; inf at or beyond the end of the range."""
        return self.image("D", frame, camera)

    def scale(self, output: str, frame: int, camera: str | None = None):
        """What an image's pixels are decoded with: gain of A and B, range [m] of D, None for C."""
        if output == "D":
            return tuple(self.meta["depth"]["range_m"])
        return self.gain(output, frame, camera) if OUTPUTS[output].is_color else None

    def gain(self, output: str, frame: int, camera: str | None = None) -> float:
        """Exposure gain of A or B."""
        key = output, self._camera(camera)
        if key not in self._gains:
            self._gains[key] = self.gains(*key)
        if frame not in self._gains[key]:
            raise InputError(f"has no gain of frame {frame}", file=self._exposure_file(*key),
                             remedy="`run` again to make it anew.")
        return self._gains[key][frame]

    def _exposure_file(self, output: str, camera: str) -> Path:
        return self.layout.camera_file(camera, f"_exposure_{output}.csv")

    def gains(self, output: str, camera: str | None = None) -> dict[int, float]:
        """Exposure gain of every frame of A or B."""
        path = self._exposure_file(output, self._camera(camera))
        table = files.read_csv(path)
        if missing := {"frame", "gain"} - set(table):
            raise InputError(f"has no column {' and no column '.join(sorted(missing))}", file=path,
                             remedy="`run` again to make it anew.")
        return dict(zip(table["frame"].tolist(), table["gain"].tolist(), strict=True))

    @cached_property
    def _row(self) -> dict[int, int]:
        return {frame: row for row, frame in enumerate(self.frames)}

    # ------------------------------------------------------------------------------------------- poses and sensors

    def time_ns(self, camera: str | None = None) -> np.ndarray:
        """Time of every frame, int64 [N]."""
        return files.read_csv(self.layout.camera_file(self._camera(camera), "_timestamps.csv"))["# timestamp [ns]"]

    def poses(self, name: str | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Times int64 [N] and T_w_x float64 [N, 4, 4] of a camera id, ``imu0``, ``depth0`` or ``vehicle``."""
        table = list(files.read_csv(self.layout.poses(name or self.cameras[0], "transformation_matrix")).values())
        T = np.tile(np.eye(4), (len(table[0]), 1, 1))
        T[:, :3] = np.column_stack(table[1:13]).reshape(-1, 3, 4)
        return table[0], T

    @cached_property
    def _camera_poses(self) -> dict[str, np.ndarray]:
        return {camera: self.poses(camera)[1] for camera in self.cameras}

    def T_w_c(self, frame: int, camera: str | None = None) -> np.ndarray:
        """Pose [4, 4] of a camera (OpenCV axes) at a frame."""
        return self._camera_poses[self._camera(camera)][self._row[frame]]

    def states(self) -> dict[str, np.ndarray]:
        """The vehicle at every tick.

        Returns:
            time_ns int64 [N]; position, velocity, acceleration [N, 3] in world axes; quaternion [N, 4], w first;
            angular_velocity, angular_acceleration [N, 3] in vehicle axes.
        """
        table = list(files.read_csv(self.layout.states).values())
        names = {"position": 3, "velocity": 3, "acceleration": 3, "quaternion": 4, "angular_velocity": 3,
                 "angular_acceleration": 3}
        ends = np.cumsum([1, *names.values()])
        return {"time_ns": table[0]} | {
            name: np.column_stack(table[start:end]).astype(float)
            for name, start, end in zip(names, ends, ends[1:], strict=False)}

    def imu(self) -> dict[str, np.ndarray]:
        """time_ns int64 [N], acceleration (specific force) [m/s^2] and angular_velocity [rad/s] [N, 3]."""
        return self._imu(self.layout.sensor("imu0"))

    def imu_bias(self) -> dict[str, np.ndarray] | None:
        """The bias in the readings of `imu`, of the same form; None where they have no noise."""
        return self._imu(self.layout.imu_bias) if self.meta["sensors"]["imu0"].get("noise") else None

    @staticmethod
    def _imu(path: Path) -> dict[str, np.ndarray]:
        table = list(files.read_csv(path).values())
        return {"time_ns": table[0], "acceleration": np.column_stack(table[1:4]),
                "angular_velocity": np.column_stack(table[4:7])}

    def depth_gauge(self) -> dict[str, np.ndarray]:
        """time_ns int64 [N] and depth [m] below the surface [N]."""
        table = list(files.read_csv(self.layout.sensor("depth0")).values())
        return {"time_ns": table[0], "depth": table[1]}
