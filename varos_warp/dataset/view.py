"""A dataset as a recording for the viewer Rerun: images, depth cloud, frustum, course and sensors on one time line.

Times are those of the dataset, in nanoseconds, on the time line ``time``; frames also stand on the time line ``frame``.
Rerun keeps positions in single precision, so a world far from the origin is moved nearer; ``origin`` says by how much.
"""

import contextlib
import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.dataset import files
from varos_warp.dataset.progress import Progress
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.errors import InputError, counted, optional
from varos_warp.products.images.depth import DEPTH_LEVELS
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.products.sensors.protocol import Curve, SensorProduct
from varos_warp.products.sensors.registry import SENSORS
from varos_warp.scene.description.image_types import DEPTH, SEGMENTS, WATER

VIEWER_PORT = 9876
"""Rerun's own."""
FAR_M = 1000.0
"""Positions beyond this have steps of more than 0.06 mm in single precision."""
AXES = {"x": [230, 80, 70], "y": [90, 180, 90], "z": [80, 130, 230]}
"""Colours of the axes' curves."""
SINGLE = [90, 160, 220]
"""Colour of a curve that stands alone."""


def view(root, save: str | Path | None = None, frames: slice = slice(None), quiet: bool = False) -> Path | None:
    """Show a dataset in Rerun's viewer, or write the recording to a file.

    Args:
        root: Folder of the dataset.
        save: The file, ``.rrd``; None: open the viewer.
        frames: Which frames of the sequence.
        quiet: No progress on stderr.

    Returns:
        The file; None where the viewer was opened.

    Raises:
        InputError: If Rerun is not installed or cannot be opened, the frames are none, or something in the dataset
            cannot be read.
    """
    rerun = optional("rerun", "the viewer Rerun", "view", key="view")
    data = Dataset(root)
    numbers = _select(data, frames)
    stream = rerun.RecordingStream("varos_warp")
    recorder = _Recorder(rerun, stream, data)
    if save is None:
        open_viewer(stream, _blueprint(data), "view", "Write a recording with --save FILE.rrd.")
        recorder.record(numbers, quiet)
        stream.flush()
        return None
    with files.atomic(Path(save)) as temp:
        stream.save(temp, default_blueprint=_blueprint(data))
        recorder.record(numbers, quiet)
        stream.disconnect()
    return Path(save)


def open_viewer(stream, blueprint, verb: str, remedy: str) -> None:
    """Open the viewer for a stream, or use the open one; refused without a display, or if the program is not found."""
    displays = {"DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"}
    if sys.platform.startswith("linux") and not displays & set(os.environ) and not _is_open():
        raise InputError("there is no display for the viewer Rerun", key=verb, remedy=remedy)
    try:
        stream.spawn(default_blueprint=blueprint)
    except RuntimeError as error:
        raise InputError(
            "the viewer Rerun cannot be opened: " + str(error).strip().splitlines()[0].rstrip("."),
            key=verb,
            remedy=f"Activate the environment that it is installed in. {remedy}",
        ) from error


def _is_open() -> bool:
    """Return whether a viewer listens, on this machine or through a tunnel."""
    with contextlib.suppress(OSError):
        socket.create_connection(("127.0.0.1", VIEWER_PORT), timeout=0.5).close()
        return True
    return False


def _select(data: Dataset, frames: slice) -> list[int]:
    """Numbers of the dataset's frames in a slice of the sequence."""
    wanted = range(*frames.indices(data.meta["frames"]["of"]))
    numbers = [number for number in data.frames if number in wanted]
    if not numbers:
        raise InputError(
            "there are no such frames",
            file=data.root,
            key="--frames",
            remedy=f"The dataset has {counted(len(data), 'frame')}"
            + (f", {data.frames[0]} to {data.frames[-1]}." if data.frames else "."),
        )
    return numbers


def local_origin(data: Dataset) -> np.ndarray:
    """What a dataset's positions are moved by [3]: see `moved_by`."""
    return moved_by(data.views()[1][:, :3, 3])


def moved_by(position: np.ndarray) -> np.ndarray:
    """Whole metres [3] near the first of the positions [N, 3], or zero where all are near enough."""
    return np.round(position[0]) if np.abs(position).max() > FAR_M else np.zeros(3)


def frustum(rr, K: np.ndarray, width: int, height: int):
    """A camera with OpenCV's axes and K [3, 3] for the viewer."""
    axes = rr.ViewCoordinates.RDF
    return rr.Pinhole(image_from_camera=K, width=width, height=height, camera_xyz=axes, image_plane_distance=0.5)


class _Recorder:
    """Writes a dataset to a stream of Rerun, the module ``rr``."""

    def __init__(self, rr, stream, data: Dataset):
        self.rr, self.stream, self.data, self.origin = rr, stream, data, local_origin(data)

    def record(self, numbers: list[int], quiet: bool) -> None:
        """Everything, with the images of some frames."""
        self.stream.send_recording_name(self.data.meta["name"])
        self.fix("world", self.rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        words = " ".join(f"{x:g}" for x in self.origin)
        self.fix("origin", self.rr.TextDocument(f"Add this to positions [m]: {words}"))
        self.vehicle()
        self.moving()
        self.sensors()
        for camera in self.data.cameras:
            self.camera(camera, numbers)
        if SEGMENTS in self.data.outputs:
            labels = [(0, "nothing"), *((row["id"], row["key"]) for row in self.data.segments())]
            self.fix("world", self.rr.AnnotationContext(labels))
        work = [(number, camera) for number in numbers for camera in self.data.cameras]
        with Progress("recording", len(work), quiet=quiet) as progress:
            for view in work:
                self.images(*view)
                progress.advance()

    def fix(self, entity: str, *what) -> None:
        """Record what does not change."""
        self.stream.log(entity, *what, static=True)

    def times(self, time_ns: np.ndarray) -> list:
        """The time line of some columns."""
        return [self.rr.TimeColumn("time", duration=time_ns.astype("timedelta64[ns]"))]

    def poses(self, T: np.ndarray):
        """Poses [N, 4, 4] as columns, moved by the origin."""
        return self.rr.Transform3D.columns(
            translation=T[:, :3, 3] - self.origin, quaternion=Rotation.from_matrix(T[:, :3, :3]).as_quat(canonical=True)
        )

    def axes(self, entity: str, name: str) -> np.ndarray:
        """Axes that move along the course of something in the dataset; returns its poses [N, 4, 4]."""
        time_ns, T = self.data.poses(name)
        self.stream.send_columns(entity, self.times(time_ns), self.poses(T))
        self.fix(f"{entity}/axes", self.rr.Arrows3D(vectors=0.3 * np.eye(3), colors=list(AXES.values())))
        return T

    def vehicle(self) -> None:
        """The course as a line, and axes that move along it; without a vehicle, the course of the first camera."""
        if "vehicle" in self.data.recorded:
            T = self.axes("world/vehicle", "vehicle")
        else:
            T = self.data.views()[1]
        self.fix("world/trajectory", self.rr.LineStrips3D([T[:, :3, 3] - self.origin], colors=[240, 180, 60]))

    def moving(self) -> None:
        """What moves: axes along its course, and its box."""
        for entry in self.data.meta.get("moving") or ():
            entity = f"world/moving/{entry['key']}"
            self.axes(entity, entry["key"])
            if "box_m" in entry:
                low, high = np.array(entry["box_m"])
                self.fix(
                    f"{entity}/box",
                    self.rr.Boxes3D(centers=[(low + high) / 2], half_sizes=[(high - low) / 2], labels=[entry["key"]]),
                )

    def camera(self, camera: str, numbers: list[int]) -> None:
        """Poses of a camera at its frames, its frustum, and the exposure of its images."""
        rr, data, entity, about = self.rr, self.data, f"world/cam{camera}", self.data.camera(camera)
        time_ns, T_w_c = data.views(camera)
        rows = np.searchsorted(data.frames, numbers)
        indexes = [*self.times(time_ns[rows]), rr.TimeColumn("frame", sequence=numbers)]
        self.stream.send_columns(entity, indexes, self.poses(T_w_c[rows]))
        self.fix(entity, frustum(rr, data.intrinsics(camera), about["width"], about["height"]))
        for output in (output for output in data.outputs if OUTPUTS[output].is_color):
            gains = data.gains(output, camera)
            if all(number in gains for number in numbers):
                found = np.array([gains[number] for number in numbers])
                names = [""] if found.ndim == 1 else ["/red", "/green", "/blue"]
                for name, values in zip(names, np.atleast_2d(found.T), strict=True):
                    entity = f"exposure/cam{camera}/{output}{name}"
                    self.stream.send_columns(entity, indexes, rr.Scalars.columns(scalars=values))

    def sensors(self) -> None:
        """The curves that each sensor has here: three of a vector."""
        for sensor, drawn in _viewed(self.data):
            readings, entity = self.data.readings(sensor.id), f"{sensor.id}/{drawn.quantity}"
            times, values = readings["time_ns"], readings[drawn.quantity]
            if values.ndim == 1:
                self.curve(entity, times, values, f"{drawn.quantity} [{drawn.unit}]", SINGLE)
                continue
            for i, (axis, color) in enumerate(AXES.items()):
                self.curve(f"{entity}/{axis}", times, values[:, i], axis, color)

    def curve(self, entity: str, time_ns: np.ndarray, values: np.ndarray, name: str, color) -> None:
        """A curve over time."""
        self.fix(entity, self.rr.SeriesLines(names=[name], colors=[color]))
        self.stream.send_columns(entity, self.times(time_ns), self.rr.Scalars.columns(scalars=values))

    def images(self, number: int, camera: str) -> None:
        """The images of a frame: 8 bits as they are, D in its steps, S with the objects' keys, others in colours."""
        rr, data = self.rr, self.data
        self.stream.set_time("time", duration=np.timedelta64(data.frame(number, camera).time_ns, "ns"))
        self.stream.set_time("frame", sequence=number)
        for output in data.outputs:
            pixels = data.pixels(output, number, camera)  # a damaged file is named here, not shown as nothing
            if output == DEPTH:
                image = self.depth(pixels, number, camera)
            elif output == SEGMENTS:
                image = rr.SegmentationImage(pixels)
            elif OUTPUTS[output].dtype is not np.uint8:
                image = rr.Image(OUTPUTS[output].colors(pixels, data.meta, None))
            else:
                contents = data.layout.image(camera, output, number).read_bytes()
                image = rr.EncodedImage(contents=contents, media_type="image/png")
            self.stream.log(f"world/cam{camera}/{output}", image)

    def depth(self, pixels: np.ndarray, number: int, camera: str):
        """D along the camera's axis; 0, which Rerun takes for none, where there is none."""
        start, end = self.data.meta["depth"]["range_m"]
        if self.data.meta["depth"]["kind"] == "z" and start == 0:
            return self.rr.DepthImage(
                np.where(pixels == DEPTH_LEVELS, 0, pixels).astype(np.uint16),
                meter=DEPTH_LEVELS / end,
                depth_range=[0, DEPTH_LEVELS - 1],
            )
        depth = self.data.planar_depth(number, camera)
        return self.rr.DepthImage(
            np.where(np.isfinite(depth), depth, 0).astype(np.float32), meter=1.0, depth_range=[0, end]
        )


def _viewed(data: Dataset) -> Iterator[tuple[SensorProduct, Curve]]:
    """Curves of the sensors that are shown, and the sensors."""
    for sensor in (sensor for sensor in SENSORS if sensor.id in data.recorded):
        yield from ((sensor, drawn) for drawn in sensor.curves if drawn.viewed)


def _blueprint(data: Dataset):
    """The world at the left, the first camera's images at the right, sensors below."""
    import rerun.blueprint as rrb

    camera = f"world/cam{data.cameras[0]}"
    images = [
        rrb.Spatial2DView(origin=f"{camera}/{output}", name=f"{output}: {OUTPUTS[output].content}")
        for output in data.outputs
    ]
    others = [
        f"- $origin/cam{camera}/{output}"
        for camera in data.cameras
        for output in data.outputs
        if output not in (WATER, DEPTH)
    ]  # A is on the frustum's far side, D is a cloud
    world = rrb.Spatial3DView(origin="world", name="World", contents=["+ $origin/**", *others])
    origins = [
        *((f"{sensor.id}/{drawn.quantity}", drawn.viewed) for sensor, drawn in _viewed(data)),
        ("exposure", "exposure gain"),
    ]
    curves = [rrb.TimeSeriesView(origin=entity, name=name) for entity, name in origins]
    top = rrb.Horizontal(world, rrb.Grid(*images, grid_columns=2), column_shares=[1, 1]) if images else world
    return rrb.Blueprint(
        rrb.Vertical(top, rrb.Horizontal(*curves), row_shares=[3, 1]),
        rrb.TimePanel(state="collapsed", timeline="time"),
        collapse_panels=True,
    )
