"""`Dataset`: a dataset on disk, opened for reading."""

import bisect
import operator
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.layout import Layout, from_runs, runs
from varos_warp.dataset.reader import rows
from varos_warp.dataset.reader.exposures import read_gains
from varos_warp.dataset.reader.frame import Frame
from varos_warp.dataset.reader.points import along_axis
from varos_warp.dataset.reader.readings import Readings
from varos_warp.dataset.reader.schema import read_metadata
from varos_warp.errors import InputError, counted, require_known
from varos_warp.products.images.flow import FlowImage
from varos_warp.products.images.radiance import decode_color
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.products.images.snow import Snow
from varos_warp.render.image.exposure import FrameGain
from varos_warp.scene.description.image_types import DEPTH, FLOW, SNOW, WATER
from varos_warp.scene.optics.camera import CameraModel, Rays, channel_number, described_camera, pixel_centres
from varos_warp.sim.motion import Trajectory

if TYPE_CHECKING:
    from varos_warp.dataset.reader.torch import TorchDataset

_CHECK, _ANEW = "Check it with `varos-warp validate`, then `run` again.", "`run` again to make it anew."
CONVENTIONS = ("center_half", "opencv")
"""Conventions of intrinsics: where the centre of the top left pixel is."""


class Dataset(Readings):
    """A dataset on disk, opened for reading; images are decoded one at a time, when asked for.

    It is a sequence of `Frame`: ``data[i]``, ``data[-1]``, ``data[2:8]``, ``data[i, "R0"]`` for another camera than the
    first, ``len(data)`` and ``for frame in data``. Small tables are kept once they are read, images are not. Threads
    may share it; it pickles as its path, so worker processes may have it, too. In all methods ``camera`` is the id of a
    camera, by default the first; ``frame`` the number of a frame in the sequence, as in the names of its files;
    ``output`` the letter of an image.

    Args:
        root: Folder that holds ``dataset.json``.

    Raises:
        InputError: If there is no readable dataset; reading methods raise it for damaged or missing files, and
            IndexError for a frame that the dataset has not.
    """

    def __init__(self, root: str | Path):
        self.root = Path(root)
        self._kept: dict[Any, Any] = {}
        self.meta = read_metadata(self.root)
        cameras = tuple(camera["id"] for camera in self.meta["cameras"])
        self.layout = Layout(self.root, self.meta["sequence"], self.meta["vehicle"], cameras)
        self.frames: list[int] = from_runs(self.meta["frames"]["ranges"])
        self.outputs: list[str] = self.meta["outputs"]

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.frames)

    def __iter__(self) -> Iterator[Frame]:
        """Every frame, through the first camera."""
        return (self[index] for index in range(len(self)))

    @overload
    def __getitem__(self, key: int | tuple[int, str | None]) -> Frame: ...
    @overload
    def __getitem__(self, key: slice | tuple[slice, str | None]) -> list[Frame]: ...
    def __getitem__(self, key: Any) -> Frame | list[Frame]:
        """``data[index]``, ``data[start:stop]`` or either with a camera's id, ``data[index, "R0"]``.

        Raises:
            IndexError: If there are not so many frames.
            TypeError: If the index is neither a whole number nor a slice of such.
            InputError: If there is no such camera.
        """
        index, camera = key if isinstance(key, tuple) and len(key) == 2 else (key, None)
        try:
            place = range(*index.indices(len(self))) if isinstance(index, slice) else operator.index(index)
        except TypeError:
            example = index if isinstance(index, str) and index in self.cameras else self.cameras[0]
            raise TypeError(
                f"{key!r} is no place of a frame: give a whole number or a slice, data[0] or data[2:8], or "
                f"either with a camera, data[0, {example!r}]"
            ) from None
        camera = self._camera(camera)
        if isinstance(place, range):
            return [Frame(self, i, camera) for i in place]
        if not -len(self) <= place < len(self):
            raise IndexError(f"there is no index {place}: the dataset has {counted(len(self), 'frame')}")
        return Frame(self, place % len(self), camera)

    def frame(self, number: int, camera: str | None = None) -> Frame:
        """The frame with a number of the sequence, which is that of its files; raises IndexError if there is none."""
        return self[self._index(number), camera]

    def _index(self, number: int) -> int:
        index = bisect.bisect_left(self.frames, number)
        if number not in self.frames[index : index + 1]:
            known = ", ".join(f"{a} to {b - 1}" if b - a > 1 else f"{a}" for a, b in runs(self.frames)) or "none"
            raise IndexError(f"there is no frame {number}: the dataset has {known}; data[0] is the first that is there")
        return index

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.root.absolute(),)

    def __repr__(self) -> str:
        what = f"{counted(len(self), 'frame')}, outputs {''.join(self.outputs)}, cameras {', '.join(self.cameras)}"
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
        if camera is not None:
            require_known(camera, self.cameras, "no such camera", key="camera")
        return self.cameras[0] if camera is None else camera

    def camera(self, camera: str | None = None) -> dict:
        """What dataset.json says of a camera; absent: the first."""
        return self.meta["cameras"][self.cameras.index(self._camera(camera))]

    def intrinsics(self, camera: str | None = None, convention: str = "center_half") -> np.ndarray:
        """K [3, 3] in pixels, by a convention.

        ``center_half``: the centre of the top left pixel is (0.5, 0.5), as in COLMAP; ``opencv``: it is (0, 0), as in
        OpenCV, Kalibr, ORB-SLAM3 and KITTI.

        Raises:
            InputError: If there is no such camera or convention.
        """
        require_known(convention, CONVENTIONS, "no such convention", key="convention")
        return np.array(self.camera(camera)["K_" + convention], float)

    def color_matrix(self, camera: str | None = None) -> np.ndarray | None:
        """Matrix from a camera's own channels to linear sRGB, float64 [3, 3]; None: its 8 bits are of its channels."""
        matrix = self.camera(camera).get("color_matrix")
        return None if matrix is None else np.array(matrix)

    def camera_model(self, camera: str | None = None) -> CameraModel:
        """Rays in the water of image points, and image points of points, in camera axes: lens and port with K.

        ``rays`` and ``project`` take the centre of the top left pixel for (0.5, 0.5).
        """
        return described_camera(self.camera(camera))

    def rays(self, camera: str | None = None, channel: str = "green") -> Rays:
        """Rays [H, W] in the water of the pixels' centres, in camera axes; float32, from the camera's file of rays.

        A camera without port and distortion has no file: its rays follow from K, in float64. Rays of the channels red,
        green and blue differ where the water's index does.
        """
        about, number = self.camera(camera), channel_number(channel)
        if "rays" not in about:
            return described_camera(about).rays(pixel_centres(about["width"], about["height"]), number)
        path = self.layout.rays(about["id"])
        planes = files.read_exr(path)
        name = channel if f"{channel}.weight" in planes else "green"
        wanted = (f"{name}.{part}" for part in (*"ox oy oz dx dy dz".split(), "weight"))
        parts = files.channels_of(path, planes, *wanted)
        return Rays(np.stack(parts[:3], -1), np.stack(parts[3:6], -1), parts[6])

    # ---------------------------------------------------------------------------------------------------- images

    def image(self, output: str, frame: int, camera: str | None = None) -> np.ndarray:
        """A decoded image: linear radiance of A, B and P (from 8 bits), unit normals of C, metres of D, numbers of S.

        Of F the flow [H, W, 2] [pixels], good to 1/128, NaN where it is not known. Of others what their files hold.
        Radiance is that of the camera's own channels, also where 8 bits are made by a colour matrix.
        """
        require_known(output, OUTPUTS, "no such image", key="output")
        pixels = self.pixels(output, frame, camera)
        if OUTPUTS[output].is_color:
            return decode_color(pixels, self.gain(output, frame, camera), self.color_matrix(camera))
        return OUTPUTS[output].decode(pixels, self.scale(output, frame, camera))

    def pixels(self, output: str, frame: int, camera: str | None = None, truth: bool = False) -> np.ndarray:
        """What the finished image holds: uint8 [H, W, 3], of D and S uint16 [H, W], of F uint16 [H, W, 3].

        Of a type without a PNG, float32 of its EXR.

        ``truth``: of A, without the camera noise that it may have.
        """
        camera, _ = self._camera(camera), self._index(frame)
        clean = truth and output == WATER and self.has_noise(WATER)
        return files.read_image(self.layout.clean(camera, frame) if clean else self.layout.image(camera, output, frame))

    def require_images(self, outputs: Iterable[str] | None = None, cameras: Iterable[str] | None = None) -> None:
        """Refuse to go on where a finished image is not there, or not whole; absent: of all outputs, all cameras.

        Raises:
            InputError: Naming the first such file.
        """
        paths = [
            self.layout.image(camera, output, frame)
            for camera in cameras or self.cameras
            for output in outputs or self.outputs
            for frame in self.frames
        ]
        missing = [path for path in paths if not files.is_complete(path)]
        if missing:
            more = f" and {len(missing) - 1} more are" if len(missing) > 1 else " is"
            raise InputError(
                f"this image{more} missing or damaged", file=missing[0], remedy="`run` again to complete the dataset."
            )

    def linear(self, output: str, frame: int, camera: str | None = None) -> np.ndarray:
        """Linear radiance float32 [H, W, 3] of A, B or P before exposure, from its EXR."""
        return np.stack(self._channels(output, frame, camera, *"RGB"), -1).astype(np.float32)

    def stderr(self, frame: int, camera: str | None = None) -> np.ndarray:
        """Standard error float32 [H, W, 3] [W/sr/m^2] of each pixel of A before denoising.

        Raises:
            InputError: The run did not keep it; it does with ``render.linear_exr``.
        """
        self._index(frame)
        path = self.layout.linear(self._camera(camera), frame, WATER)
        if not path.exists():
            raise InputError(
                "is not there: standard errors were not kept",
                file=path,
                remedy="`run` again with --linear-exr, which adds them.",
            )
        return np.stack(files.channels_of(path, files.read_exr(path), "stderr.R", "stderr.G", "stderr.B"), -1)

    def flow(self, frame: int, camera: str | None = None) -> FlowImage:
        """F with all its digits, what hides and the scene flow, from its EXR."""
        u, v, x, y, z, occluded = self._channels(
            FLOW, frame, camera, "flow.u", "flow.v", "motion.x", "motion.y", "motion.z", "occluded"
        )
        return FlowImage(np.stack([u, v], -1), occluded > 0.5, np.stack([x, y, z], -1))

    def snow(self, frame: int, camera: str | None = None) -> Snow:
        """What bodies in the water add to linear A, what they let pass, their cover and flow, from the files of N."""
        r, g, b, passed, u, v = self._channels(SNOW, frame, camera, *"RGB", "passed", "flow.x", "flow.y")
        return Snow(np.stack([r, g, b], -1), passed, self.image(SNOW, frame, camera), np.stack([u, v], -1))

    def _channels(self, output: str, frame: int, camera: str | None, *names: str) -> list[np.ndarray]:
        """Channels [H, W] of an image's EXR by their names."""
        self._index(frame)
        path = self.layout.exr(self._camera(camera), output, frame)
        return files.channels_of(path, files.read_exr(path), *names)

    def next_T_w_c(self, frame: int, camera: str | None = None) -> np.ndarray | None:
        """Pose [4, 4] of a camera at the next frame of the sequence, to which F is the flow; None if not on record.

        The vehicle's motion has that of the last frame, too. Without it, the next frame must be in the dataset.
        """
        return rows.next_pose(self, frame, camera)

    def segments(self) -> list[dict]:
        """What the numbers of S stand for: rows of ``id``, ``key``, ``kind``, ``material``, ``material_id``."""
        content = files.read_json(self.layout.segments)
        rows = content.get("segments") if isinstance(content, dict) else None
        if not isinstance(rows, list):
            raise InputError("has no list of segments", file=self.layout.segments, remedy=_ANEW)
        return rows

    def depth(self, frame: int, camera: str | None = None) -> np.ndarray:
        """Metres [H, W] of D, of the kind that dataset.json names; inf at or beyond the end of the range."""
        return self.image(DEPTH, frame, camera)

    def planar_depth(self, frame: int, camera: str | None = None, pixels: np.ndarray | None = None) -> np.ndarray:
        """Metres [H, W] along the camera's z axis, whichever kind D has, float64; inf where it has none.

        ``pixels`` of D, if they are at hand, save reading them.
        """
        pixels = self.pixels(DEPTH, frame, camera) if pixels is None else pixels
        depth = OUTPUTS[DEPTH].decode(pixels, self.scale(DEPTH, frame)).astype(float)
        return depth if self.meta["depth"]["kind"] == "z" else along_axis(depth, self.camera_model(camera))

    def scale(self, output: str, frame: int, camera: str | None = None) -> FrameGain | tuple[float, float] | None:
        """What an image's pixels are decoded with: gain of A, B and P, range [m] of D, None for others."""
        if output == DEPTH:
            return tuple(self.meta["depth"]["range_m"])
        return self.gain(output, frame, camera) if OUTPUTS[output].is_color else None

    def gain(self, output: str, frame: int, camera: str | None = None) -> FrameGain:
        """Exposure gain of A, B or P; with white balance those of red, green and blue."""
        camera = self._camera(camera)
        gains = self._once(("gains", output, camera), lambda: self.gains(output, camera))
        if frame not in gains:
            raise InputError(f"has no gain of frame {frame}", file=self.layout.exposures(camera, output), remedy=_ANEW)
        return gains[frame]

    def gains(self, output: str, camera: str | None = None) -> dict[int, FrameGain]:
        """Exposure gain of every frame of A, B or P; with white balance those of red, green and blue."""
        return read_gains(self.layout.exposures(self._camera(camera), output))

    # ------------------------------------------------------------------------------------------- poses and sensors

    def time_ns(self, camera: str | None = None) -> np.ndarray:
        """Time of every frame, int64 [N]."""
        return files.read_numbers(self.layout.camera_file(self._camera(camera), "_timestamps.csv"), 1)[0]

    def poses(self, name: str | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Times int64 [N] and T_w_x float64 [N, 4, 4] of a camera, a sensor, ``vehicle`` or one of `moving`.

        Raises:
            InputError: If there is no such thing, or its poses cannot be read.
        """
        path = self.layout.poses(name or self.cameras[0], "transformation_matrix")
        if name and not path.is_file():
            known = [*self.cameras, "vehicle", *self.meta["sensors"], *self.moving]
            require_known(name, known, "nothing of this name has poses", near=True, key="name")
        table = files.read_numbers(path, 13)
        T = np.tile(np.eye(4), (len(table[0]), 1, 1))
        T[:, :3] = np.column_stack(table[1:]).reshape(-1, 3, 4)
        return table[0], T

    @property
    def moving(self) -> list[str]:
        """Keys of what moves, such as ``objects.3``, whose poses at the frames `poses` gives.

        ``meta["moving"]`` has their numbers in S and their boxes, too, and the lights of other vehicles.
        """
        return [entry["key"] for entry in self.meta.get("moving") or ()]

    def views(self, camera: str | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Times int64 [N] and T_w_c [N, 4, 4] of a camera at the frames; both are kept, so do not change them.

        Raises:
            InputError: If they are not those of the frames.
        """
        return self._once(("views", self._camera(camera)), lambda: self._views(self._camera(camera)))

    def _views(self, camera: str) -> tuple[np.ndarray, np.ndarray]:
        time_ns, T_w_c = self.poses(camera)
        if len(time_ns) != len(self) or not np.array_equal(time_ns, self.time_ns(camera)):
            raise InputError(
                "the poses are not those of the frames and of their time stamps",
                file=self.layout.poses(camera, "transformation_matrix"),
                remedy=_CHECK,
            )
        return time_ns, T_w_c

    def T_w_c(self, frame: int, camera: str | None = None) -> np.ndarray:
        """Pose [4, 4] of a camera (OpenCV axes) at a frame, by its number."""
        return self.views(camera)[1][self._index(frame)].copy()

    def T_w_c_rows(self, frame: int, camera: str | None = None) -> np.ndarray:
        """Pose [H, 4, 4] of a camera in the middle of the exposure of each row of a frame, by its number.

        Without a rolling shutter, and of a camera that stands in the world, all are `T_w_c`.
        """
        T = rows.sight(self, frame, camera)
        return T if T.ndim == 3 else np.tile(T, (self.camera(camera)["height"], 1, 1))

    def T_w_v(self, frame: int) -> np.ndarray:
        """Pose [4, 4] of the vehicle at a frame, by its number; where it was not written, from a camera on it.

        Raises:
            InputError: If neither the vehicle nor a camera on it is in the dataset.
        """
        return self._once("T_w_v", self._vehicle_at_frames)[self._index(frame)].copy()

    def _vehicle_at_frames(self) -> np.ndarray:
        if "vehicle" in self.recorded:
            return self.vehicle_at(self.views()[0])
        mounted = [camera for camera in self.cameras if "T_v_c" in self.camera(camera)]
        if not mounted:
            raise InputError(
                "there is no vehicle in the dataset",
                file=self.layout.states,
                remedy="`varos-warp simulate` into the same folder adds it.",
            )
        return self.views(mounted[0])[1] @ np.linalg.inv(self.camera(mounted[0])["T_v_c"])

    def vehicle_at(self, time_ns: np.ndarray) -> np.ndarray:
        """Poses [M, 4, 4] of the vehicle at any times int64 [M]: those on record, and between them by `trajectory`.

        Raises:
            InputError: If a time is before the first pose or after the last.
        """
        known, T_w_v = self._once(("poses", "vehicle"), lambda: self.poses("vehicle"))
        rows = np.searchsorted(known, time_ns).clip(max=len(known) - 1)
        T, off = T_w_v[rows], np.flatnonzero(known[rows] != time_ns)
        if off.size:
            T[off] = self.motion_at(np.asarray(time_ns)[off]).poses()
        return T

    def motion_at(self, time_ns: np.ndarray) -> Trajectory:
        """The vehicle's motion at times int64 [M].

        Raises:
            InputError: If a time is before the first state or after the last.
        """
        try:
            return self.trajectory().at(time_ns)
        except ValueError as error:
            raise InputError(
                f"has no pose at the time of some frame or sample: {error}", file=self.layout.states, remedy=_CHECK
            ) from None

    def trajectory(self) -> Trajectory:
        """The vehicle's motion, which gives its state at any time between the first and the last on record."""
        return self._once("trajectory", lambda: Trajectory(**self.states()))

    @property
    def has_scene_noise(self) -> bool:
        """True if A has the noise that its scene asks for, and not that of `varos-warp noise`."""
        return bool((self.meta["scene"].get("render") or {}).get("noise"))

    @property
    def is_dithered(self) -> bool:
        """True if A, B and P were dithered before they were rounded to 8 bits."""
        return bool((self.meta["scene"].get("render") or {}).get("dither"))

    def torch(self, outputs: Sequence[str] = "ACD", camera: str | None = None, **options: Any) -> "TorchDataset":
        """This dataset for PyTorch: `varos_warp.dataset.reader.torch.TorchDataset`.

        Raises:
            InputError: If PyTorch is not installed.
        """
        from varos_warp.dataset.reader.torch import TorchDataset

        return TorchDataset(self, outputs, camera, **options)
