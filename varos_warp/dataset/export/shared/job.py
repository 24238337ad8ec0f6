"""What every export does: link images, encode depth anew, print numbers without losing digits."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.dataset import files
from varos_warp.dataset.progress import in_threads
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.errors import InputError
from varos_warp.products.sensors.registry import SENSORS
from varos_warp.scene.description.image_types import DEPTH, WATER
from varos_warp.scene.optics.camera import CameraModel
from varos_warp.scene.optics.distortion import Lens

NO_NOISE = "without noise"
PROFILE_BLOCKS = {sensor.id: sensor.key for sensor in SENSORS} | {WATER: "camera"}
"""Block of a noise profile by what has the noise."""
EXPORTED = ("imu0", "depth0")
"""Sensors whose readings most formats have."""


class Clocked(Dataset):
    """A dataset whose clock is set: ``start_ns`` is added to all of its times."""

    def __init__(self, root, start_ns: int):
        super().__init__(root)
        self.start_ns = start_ns

    def time_ns(self, camera: str | None = None) -> np.ndarray:
        """Time of every frame, int64 [N]."""
        return super().time_ns(camera) + self.start_ns

    def poses(self, name: str | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Times and poses, as those of `Dataset`."""
        time_ns, T = super().poses(name)
        return time_ns + self.start_ns, T

    def _samples(self, *args) -> dict[str, np.ndarray]:
        samples = super()._samples(*args)
        return samples | {"time_ns": samples["time_ns"] + self.start_ns}


@dataclass(frozen=True)
class Job:
    """An export under way."""

    data: Clocked
    out: Path
    """Folder to write to, with nothing in it."""
    images: str
    """Letter of the colour images; empty where the format has no images."""
    cameras: tuple[str, ...]
    """Ids of the cameras to export."""
    quiet: bool = True
    """No progress on stderr."""
    raw: bool = False
    """MCAP: uncompressed images beside the compressed ones."""
    sensors: tuple[str, ...] = EXPORTED
    """Whose readings the format has."""
    scene_dir: Path = Path(".")
    """Folder of the dataset's scene file, to which its meshes are relative."""

    def link_images(self, camera: str, names: Iterable[str]) -> None:
        """The colour images under other names, frame by frame: hard links, or copies where there can be none."""
        for frame, name in zip(self.data.frames, names, strict=True):
            files.link(self.data.layout.image(camera, self.images, frame), self.out / name)

    def names(self, camera: str) -> list[str]:
        """Names of the files of the colour images in the dataset."""
        return [self.data.layout.image(camera, self.images, frame).name for frame in self.data.frames]

    def fx_fy_cx_cy(self, camera: str, convention: str = "opencv") -> list[float]:
        """Focal lengths and principal point [px]; `Dataset.intrinsics` has the conventions of pixels."""
        return self.data.intrinsics(camera, convention)[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()

    def text(self, name: str | Path, lines: Iterable[str]) -> None:
        """A file of lines, each ended by one newline character."""
        files.write_bytes(self.out / name, "".join(f"{line}\n" for line in lines).encode())

    def each(self, what: str, make: Callable, *items: Iterable) -> list:
        """What ``make(frame, ...)`` gives for every frame, several at a time; ``what`` names the progress bar.

        ``items`` have one for each frame, too.
        """
        return list(in_threads(what, make, self.data.frames, *items, quiet=self.quiet))

    def depths(self, camera: str, names: Iterable[str], per_metre: float) -> tuple[float, float]:
        """Write D of every frame as uint16 of planar z in so many units a metre, 0 where it is none or too far.

        Returns the nearest and the farthest depth that was written [m]; inf and 0 if there is none.
        """

        def encode(frame: int, name: str) -> tuple[float, float]:
            units = to_units(self.data.planar_depth(frame, camera), per_metre)
            files.write_png(self.out / name, units)
            there = units[units > 0] / per_metre
            return there.min(initial=np.inf), there.max(initial=0.0)

        nearest, farthest = np.transpose(self.each(f"depth {camera}", encode, names))
        return float(nearest.min()), float(farthest.max())

    def greys(self, camera: str, names: Iterable[str]) -> None:
        """The colour images in grey (ITU-R 601 luma of the 8 bit values), for formats that ask for it."""
        from PIL import Image

        def encode(frame: int, name: str) -> None:
            pixels = self.data.pixels(self.images, frame, camera)
            files.write_png(self.out / name, np.asarray(Image.fromarray(pixels).convert("L")))

        self.each(f"grey {camera}", encode, names)

    @property
    def has_depth(self) -> bool:
        """True if the dataset has D."""
        return DEPTH in self.data.outputs

    def noise(self, name: str) -> str:
        """What noise the readings of a sensor such as ``imu0``, or the images of a letter, have, in words."""
        if name not in (*self.data.meta["sensors"], WATER) or not self.data.has_noise(name):
            return NO_NOISE
        about = self.data.meta.get("noise")
        if about and about["profile"].get(PROFILE_BLOCKS[name]) and not self.data.has_scene_noise:
            return f"with the noise of profile {about['profile']['name']}, seed {about['seed']}"
        return "with the noise of the scene"

    @property
    def noises(self) -> dict[str, str]:
        """What noise each sensor and the images have, in words."""
        sensors = [name for name in self.sensors if name in self.data.recorded]
        return {name: self.noise(name) for name in (*sensors, *self.images)}


def lens_of(job: Job, camera: str, form: str, *models: str) -> tuple[str, list[float]]:
    """Model of a camera's distortion, ``none`` or one of ``models``, and its coefficients in OpenCV's order.

    It is the simplest model that says the same. The coefficients of ``brown_conrady`` end before k3 where the format
    has no place for it: say ``brown_conrady without k3``. Those of ``double_sphere`` are xi and alpha.
    ``port`` among the models says that the format has ports, too.

    Raises:
        InputError: If the format cannot state the camera.
    """
    model, place = job.data.camera_model(camera), f"cameras.{job.data.cameras.index(camera)}"
    remedy = f"docs/exports.md says which formats can{_instead(job, camera, models)}."
    if model.port is not None and "port" not in models:
        raise InputError(f"{form} cannot state a port", file=job.data.root, key=f"{place}.port", remedy=remedy)
    name, k = _simplest(model.lens)
    if name == "brown_conrady" and f"{name} without k3" in models and k[4] == 0.0:
        return name, k[:4]
    if name not in ("none", *models):
        raise InputError(
            f"{form} cannot state this distortion",
            file=job.data.root,
            key=f"{place}.distortion",
            value=f"{name} {k}",
            remedy=remedy,
        )
    return name, k


def _instead(job: Job, camera: str, models: tuple[str, ...]) -> str:
    """What to choose instead of a camera that a format cannot state: others of the dataset that it can."""
    others = [
        other for other in job.data.cameras if other != camera and _is_stated(job.data.camera_model(other), models)
    ]
    return f"; it can state {', '.join(others)}: choose with --camera {others[0]}" if others else ""


def _is_stated(model: CameraModel, models: tuple[str, ...]) -> bool:
    """Return whether a format that has some models of distortion, and perhaps ports, has a camera."""
    return (model.port is None or "port" in models) and _simplest(model.lens)[0] in ("none", *models)


def _simplest(lens: Lens) -> tuple[str, list[float]]:
    """The simplest model that says the same as a lens, and its coefficients."""
    name, k = lens.model, list(lens.k)
    if name == "rational" and not any(k[5:]):
        name, k = "brown_conrady", k[:5]
    return ("none", []) if name == "brown_conrady" and not any(k) else (name, k)


def baseline(job: Job, left: str, right: str) -> float | None:
    """Metres from one camera to the other along x, where the pair is rectified; None where it is not."""
    if not np.allclose(job.data.intrinsics(left), job.data.intrinsics(right), rtol=1e-12):
        return None
    T = np.linalg.inv(job.data.views(left)[1]) @ job.data.views(right)[1]
    shape = np.eye(4)
    shape[0, 3] = T[0, 0, 3]
    size = 1.0 + np.abs(job.data.views(left)[1][:, :3, 3]).max()
    return float(T[0, 0, 3]) if T[0, 0, 3] > 0 and np.allclose(T, shape, rtol=0, atol=1e-12 * size) else None


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
