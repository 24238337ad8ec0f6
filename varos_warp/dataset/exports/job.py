"""What every export does: link images, encode depth anew, print numbers without losing digits."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.dataset import files
from varos_warp.dataset.layout import Dataset
from varos_warp.dataset.progress import Progress
from varos_warp.errors import InputError


@dataclass(frozen=True)
class Job:
    """An export under way."""

    data: Dataset
    out: Path
    """Folder to write to, with nothing in it."""
    images: str
    """Letter of the colour images."""
    cameras: tuple[str, ...]
    """Ids of the cameras to export."""
    quiet: bool = True
    """No progress on stderr."""

    def link(self, camera: str, letter: str, frame: int, name: str | Path) -> None:
        """An image of the dataset under another name: a hard link, or a copy where there can be none."""
        files.link(self.data.layout.png(camera, letter, frame), self.out / name)

    def text(self, name: str | Path, lines: Iterable[str]) -> None:
        """A file of lines, each ended by one newline character."""
        files.write_bytes(self.out / name, "".join(f"{line}\n" for line in lines).encode())

    def depths(self, camera: str, name: Callable[[int], str], per_metre: float) -> None:
        """D of every frame as uint16 of planar z, 0 where there is none or the format's range ends.

        Args:
            camera: Its id.
            name: File name of a frame's image by the frame's place among the frames.
            per_metre: Units of the format in a metre.
        """
        def encode(index: int) -> None:
            z = planar_depth(self.data, self.data.frames[index], camera)
            files.write_png(self.out / name(index), to_units(z, per_metre))

        count = len(self.data)
        with (ThreadPoolExecutor(os.cpu_count()) as pool,
              Progress(f"depth {camera}", count, quiet=self.quiet) as progress):
            for _ in pool.map(encode, range(count)):
                progress.advance()

    @property
    def has_depth(self) -> bool:
        """Whether the dataset has D."""
        return "D" in self.data.outputs

    def poses(self, camera: str) -> tuple[np.ndarray, np.ndarray]:
        """Times int64 [N] and T_w_c [N, 4, 4] of a camera at its frames."""
        time_ns, T_w_c = self.data.poses(camera)
        if not np.array_equal(time_ns, self.data.time_ns(camera)) or len(time_ns) != len(self.data):
            raise InputError("poses, time stamps and frames differ", file=self.data.layout.camera_dir(camera),
                             remedy="Check it with `varos-warp validate`, then `run` again.")
        return time_ns, T_w_c

    def has_sensor(self, name: str) -> bool:
        """Whether ``imu0`` or ``depth0`` was recorded; if its file is gone since, reading it says so."""
        return name in self.data.recorded


def planar_depth(data: Dataset, frame: int, camera: str) -> np.ndarray:
    """Metres [H, W] along the camera's z axis, whichever kind D has; inf where it has none."""
    depth = data.depth(frame, camera).astype(float)
    if data.meta["depth"]["kind"] == "z":
        return depth
    K = data.intrinsics(camera)
    row, col = np.indices(depth.shape) + 0.5
    return depth / np.sqrt(1 + ((col - K[0, 2]) / K[0, 0]) ** 2 + ((row - K[1, 2]) / K[1, 1]) ** 2)


def to_units(z: np.ndarray, per_metre: float) -> np.ndarray:
    """uint16 of depth [m], rounded; 0 where it is not finite or too large for 16 bit."""
    units = np.rint(z * per_metre)
    return np.where(units <= 65535, units, 0).astype(np.uint16)


def seconds(time_ns: int) -> str:
    """Nanoseconds as seconds with nine decimals, exactly: a float64 of nanoseconds since 1970 is good to 256 ns."""
    sign, time_ns = "-" if time_ns < 0 else "", abs(int(time_ns))
    return f"{sign}{time_ns // 10**9}.{time_ns % 10**9:09d}"


def numbers(values) -> str:
    """Floats with one blank between them that read back to the same float64."""
    return " ".join(map(repr, np.asarray(values, float).ravel().tolist()))


def quaternion(T: np.ndarray, scalar_first: bool) -> np.ndarray:
    """Hamilton quaternions [N, 4] with w >= 0 of poses [N, 4, 4]."""
    return Rotation.from_matrix(T[:, :3, :3]).as_quat(canonical=True, scalar_first=scalar_first)
