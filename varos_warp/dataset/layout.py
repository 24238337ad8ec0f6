"""Paths of everything in a dataset.

Names and folders of the released VAROS sequence (paper 4.1.1, tables 5 and 6, figure 5)::

    dataset.json  README.txt  contact_sheet.png  segments.json
    vehicle0/cam0/{A,B,C,D,S,P,F}/seq01_veh0_camM0_A-00000000.png      also A_exr, B_exr, A_linear, D_exr ...
    vehicle0/cam0/camM0.yaml  camM0_timestamps.csv  camM0_exposure_A.csv  camM0_poses/camM0_poses_*.csv
                  camM0_rays.exr (behind a port, or distorted)  camM0_poses/camM0_poses_rows.npy (rolling shutter)
    vehicle0/imu0/imu0_data.csv  imu0_bias.csv  imu0_poses/...     vehicle0/depth0/depth0_data.csv  depth0_poses/...
    vehicle0/mag0/mag0_data.csv  mag0_poses/...                    vehicle0/dvl0/dvl0_data.csv  dvl0_poses/...
    vehicle0/ground_truth_vehicle0_poses/vehicle0_poses_*.csv  vehicle0_states.csv
    vehicle0/lights0/lights0_poses.csv
    objects/objects.3_poses/objects.3_poses_*.csv (of what moves; vehicles.2_poses/... of the body of another vehicle)
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from varos_warp.products.images.registry import OUTPUTS
from varos_warp.products.sensors.protocol import xyz
from varos_warp.products.sensors.registry import SENSORS
from varos_warp.scene.description.image_types import WATER

TIME = "# timestamp [ns]"
"""Header of the first column of every table."""
POSE_FORMS = {
    "euler": "s_x_vw s_y_vw s_z_vw theta_x_vw theta_y_vw theta_z_vw".split(),
    "transformation_matrix": "r11 r12 r13 s_x_vw r21 r22 r23 s_y_vw r31 r32 r33 s_z_vw".split(),
    "quaternion": "s_x_vw s_y_vw s_z_vw q_w q_x q_y q_z".split(),
}
"""Columns after the time, by the form of a file of poses; the matrices are authoritative."""


STATES = {
    "position": xyz("p_wv", "m"),
    "velocity": xyz("v_wv", "m s^-1"),
    "acceleration": xyz("a_wv", "m s^-2"),
    "quaternion": ["q_wv_w", "q_wv_x", "q_wv_y", "q_wv_z"],
    "angular_velocity": xyz("w_wv_v", "rad s^-1"),
    "angular_acceleration": xyz("alpha_wv_v", "rad s^-2"),
}
"""Columns of the vehicle's states after the time, by quantity."""
READINGS = {sensor.id: sensor.columns for sensor in SENSORS}
"""Columns of the readings of each sensor after the time, by quantity.

Where the readings have noise, columns of those without it follow, with ``true_`` before their names, and then those of
the bias, with ``b_``; that of the IMU has a file of its own, and of a DVL there is none."""


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

    def rays(self, camera: str) -> Path:
        """Rays of every pixel, of a camera with a port or distortion."""
        return self.camera_file(camera, "_rays.exr")

    def row_poses(self, camera: str) -> Path:
        """Poses of every row of every frame, of a camera on the vehicle with a rolling shutter."""
        return self.poses(camera, "quaternion").with_name(f"cam{camera}_poses_rows.npy")

    def exposures(self, camera: str, output: str) -> Path:
        """Gains of A, B or P, and the statistics that they follow from."""
        return self.camera_file(camera, f"_exposure_{output}.csv")

    def image_name(self, camera: str, output: str, frame: int) -> str:
        """Name of an image without its extension (paper, table 5)."""
        return f"seq{self.sequence}_veh{self.vehicle}_cam{camera}_{output}-{frame:08d}"

    def image(self, camera: str, output: str, frame: int) -> Path:
        """Path of the finished image."""
        return self._image_file(camera, output, frame, "")

    def exr(self, camera: str, output: str, frame: int) -> Path:
        """Half floats of A, B or P before exposure; of D and F, float32 channels."""
        return self._image_file(camera, output, frame, "_exr")

    def clean(self, camera: str, frame: int) -> Path:
        """A without camera noise, where `png` has it."""
        return self.camera_dir(camera) / f"{WATER}_clean" / self.image(camera, WATER, frame).name

    def linear(self, camera: str, frame: int, output: str = WATER) -> Path:
        """A or P as it was rendered: float32 with standard error and layers."""
        return self._image_file(camera, output, frame, "_linear")

    def image_files(self, camera: str, output: str, frame: int, render: Mapping[str, Any]) -> dict[str, Path]:
        """All files of an image that a scene's block ``render`` asks for, by the endings of their folders."""
        return {folder: self._image_file(camera, output, frame, folder) for folder in OUTPUTS[output].wanted(render)}

    def rendered(self, camera: str, output: str, frame: int, render: Mapping[str, Any]) -> list[Path]:
        """Files of an image that only rendering can make; the PNG of A, B and P follow from their EXR."""
        files = self.image_files(camera, output, frame, render)
        return [path for folder, path in files.items() if folder or not OUTPUTS[output].is_color]

    def _image_file(self, camera: str, output: str, frame: int, folder: str) -> Path:
        name = self.image_name(camera, output, frame) + (".exr" if folder else OUTPUTS[output].suffix)
        return self.camera_dir(camera) / f"{output}{folder}" / name

    def sensor(self, name: str) -> Path:
        """Data of a sensor, such as ``imu0``."""
        return self.vehicle_dir / name / f"{name}_data.csv"

    def bias(self, name: str) -> Path:
        """The slowly varying part of a sensor's noise, where that has a file of its own."""
        return self.sensor(name).with_name(f"{name}_bias.csv")

    def poses(self, name: str, form: str) -> Path:
        """Poses of a camera id, a sensor, ``vehicle`` or what moves, as ``objects.3``; the form is of `POSE_FORMS`."""
        if name == "vehicle":
            folder, stem = self.vehicle_dir / f"ground_truth_vehicle{self.vehicle}_poses", f"vehicle{self.vehicle}"
        elif name in self.cameras:
            folder, stem = self.camera_dir(name) / f"cam{name}_poses", f"cam{name}"
        elif name.startswith(("objects.", "vehicles.")):
            folder, stem = self.root / "objects" / f"{name}_poses", name
        else:
            folder, stem = self.vehicle_dir / name / f"{name}_poses", name
        return folder / f"{stem}_poses_{form}.csv"

    @property
    def states(self) -> Path:
        """Position, velocity, acceleration, attitude and its rates of the vehicle at every tick."""
        return self.poses("vehicle", "euler").with_name(f"vehicle{self.vehicle}_states.csv")

    @property
    def lights(self) -> Path:
        """Table of the lights' positions and directions at every frame."""
        return self.vehicle_dir / "lights0" / "lights0_poses.csv"


def folder_of_vehicle(out: Path, vehicle: str) -> Path:
    """Folder of the dataset of one of several vehicles, in that of their run."""
    return out / f"veh{vehicle}"


def datasets_in(out: Path) -> list[Path]:
    """Folders of the datasets that a run of several vehicles made; of a dataset, the folder itself."""
    return sorted(path.parent for path in out.glob("veh?/dataset.json")) or [out]


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
