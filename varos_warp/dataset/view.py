"""A dataset as a recording for the viewer Rerun: images, depth cloud, frustum, course and sensors on one time line.

Times are those of the dataset, in nanoseconds, on the time line ``time``; frames also stand on the time line ``frame``.
Rerun keeps positions in single precision, so a world far from the origin is moved nearer; ``origin`` says by how much.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.dataset import files
from varos_warp.dataset.progress import Progress
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.points import planar_depth
from varos_warp.errors import InputError
from varos_warp.render.image.outputs import DEPTH_LEVELS, OUTPUTS

FAR_M = 1000.0
"""Positions beyond this have steps of more than 0.06 mm in single precision."""
AXES = {"x": [230, 80, 70], "y": [90, 180, 90], "z": [80, 130, 230]}
"""Colours of the axes' curves."""


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
        InputError: If Rerun is not installed, the frames are none, or something in the dataset cannot be read.
    """
    rr = _rerun()
    data = Dataset(root)
    numbers = _select(data, frames)
    stream = rr.RecordingStream("varos_warp")
    if save is None:
        stream.spawn(default_blueprint=_blueprint(data))
        _record(rr, stream, data, numbers, quiet)
        stream.flush()
        return None
    with files.atomic(Path(save)) as temp:
        stream.save(temp, default_blueprint=_blueprint(data))
        _record(rr, stream, data, numbers, quiet)
        stream.disconnect()
    return Path(save)


def _rerun():
    try:
        import rerun
    except ImportError as error:
        raise InputError("the viewer Rerun is not installed", key="view",
                         remedy='Install it with `pip install "varos_warp[view]"`.') from error
    return rerun


def _select(data: Dataset, frames: slice) -> list[int]:
    """Numbers of the dataset's frames in a slice of the sequence."""
    wanted = range(*frames.indices(data.meta["frames"]["of"]))
    numbers = [number for number in data.frames if number in wanted]
    if not numbers:
        raise InputError("there are no such frames", file=data.root, key="--frames",
                         remedy=f"The dataset has {len(data)} frames"
                                + (f", {data.frames[0]} to {data.frames[-1]}." if data.frames else "."))
    return numbers


def _record(rr, stream, data: Dataset, numbers: list[int], quiet: bool) -> None:
    origin = local_origin(data)
    stream.send_recording_name(data.meta["name"])
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    words = "Add this to positions [m]: " + " ".join(f"{x:g}" for x in origin)
    stream.log("origin", rr.TextDocument(words), static=True)
    _record_vehicle(rr, stream, data, origin)
    _record_sensors(rr, stream, data)
    for camera in data.cameras:
        _record_camera(rr, stream, data, camera, numbers, origin)
    work = [(camera, number) for number in numbers for camera in data.cameras]
    with Progress("recording", len(work), quiet=quiet) as progress:
        for camera, number in work:
            _record_images(rr, stream, data, camera, number)
            progress.advance()


def local_origin(data: Dataset) -> np.ndarray:
    """Whole metres [3] near the first camera's first position, or zero where that is near enough."""
    position = data.views()[1][:, :3, 3]
    return np.round(position[0]) if np.abs(position).max() > FAR_M else np.zeros(3)


# ------------------------------------------------------------------------------------------------ what is in the world


def _times(rr, time_ns: np.ndarray) -> list:
    return [rr.TimeColumn("time", duration=time_ns.astype("timedelta64[ns]"))]


def _poses(rr, T: np.ndarray, origin: np.ndarray):
    """Poses [N, 4, 4] as columns, moved by the origin."""
    return rr.Transform3D.columns(translation=T[:, :3, 3] - origin,
                                  quaternion=Rotation.from_matrix(T[:, :3, :3]).as_quat(canonical=True))  # x y z w


def _record_vehicle(rr, stream, data: Dataset, origin: np.ndarray) -> None:
    """The course as a line, and axes that move along it; without a vehicle, the course of the first camera."""
    if "vehicle" in data.recorded:
        time_ns, T = data.poses("vehicle")
        stream.send_columns("world/vehicle", _times(rr, time_ns), _poses(rr, T, origin))
        stream.log("world/vehicle/axes", rr.Arrows3D(vectors=0.3 * np.eye(3), colors=list(AXES.values())), static=True)
    else:
        T = data.views()[1]
    stream.log("world/trajectory", rr.LineStrips3D([T[:, :3, 3] - origin], colors=[240, 180, 60]), static=True)


def _record_camera(rr, stream, data: Dataset, camera: str, numbers: list[int], origin: np.ndarray) -> None:
    """Where a camera is at its frames, its frustum, and the exposure of its images."""
    entity, about = f"world/cam{camera}", data.camera(camera)
    time_ns, T_w_c = data.views(camera)
    rows = np.searchsorted(data.frames, numbers)
    indexes = [*_times(rr, time_ns[rows]), rr.TimeColumn("frame", sequence=numbers)]
    stream.send_columns(entity, indexes, _poses(rr, T_w_c[rows], origin))
    stream.log(entity, rr.Pinhole(image_from_camera=data.intrinsics(camera), width=about["width"],
                                  height=about["height"], camera_xyz=rr.ViewCoordinates.RDF,
                                  image_plane_distance=0.5), static=True)
    for output in data.outputs:
        if OUTPUTS[output].is_color and all(map(data.gains(output, camera).__contains__, numbers)):
            gains = [data.gain(output, number, camera) for number in numbers]
            stream.send_columns(f"exposure/cam{camera}/{output}", indexes, rr.Scalars.columns(scalars=gains))


def _record_sensors(rr, stream, data: Dataset) -> None:
    """Curves of the IMU and of the depth gauge, every reading."""
    if "imu0" in data.recorded:
        imu = data.imu()
        for quantity in ("acceleration", "angular_velocity"):
            for i, (axis, color) in enumerate(AXES.items()):
                _record_curve(rr, stream, f"imu0/{quantity}/{axis}", imu["time_ns"], imu[quantity][:, i], axis, color)
    if "depth0" in data.recorded:
        gauge = data.depth_gauge()
        _record_curve(rr, stream, "depth0/depth", gauge["time_ns"], gauge["depth"], "depth [m]", [90, 160, 220])


def _record_curve(rr, stream, entity: str, time_ns: np.ndarray, values: np.ndarray, name: str, color) -> None:
    stream.log(entity, rr.SeriesLines(names=[name], colors=[color]), static=True)
    stream.send_columns(entity, _times(rr, time_ns), rr.Scalars.columns(scalars=values))


# ----------------------------------------------------------------------------------------------------------- images


def _record_images(rr, stream, data: Dataset, camera: str, number: int) -> None:
    """The images of a frame: A, B and C as the files are, D in its own steps, S with the objects' keys."""
    stream.set_time("time", duration=np.timedelta64(data.frame(number, camera).time_ns, "ns"))
    stream.set_time("frame", sequence=number)
    for output in data.outputs:
        entity = f"world/cam{camera}/{output}"
        if output == "D":
            stream.log(entity, _depth_image(rr, data, camera, number))
        elif output == "S":
            stream.log(entity, rr.SegmentationImage(data.pixels("S", number, camera)))
        else:
            data.pixels(output, number, camera)  # a damaged file is named here, not shown by the viewer as nothing
            contents = data.layout.png(camera, output, number).read_bytes()
            stream.log(entity, rr.EncodedImage(contents=contents, media_type="image/png"))
    if "S" in data.outputs and number == data.frames[0]:
        labels = [(0, "nothing"), *((row["id"], row["key"]) for row in data.segments())]
        stream.log("world", rr.AnnotationContext(labels), static=True)


def _depth_image(rr, data: Dataset, camera: str, number: int):
    """D along the camera's axis; 0, which Rerun takes for none, where there is none."""
    start, end = data.meta["depth"]["range_m"]
    if data.meta["depth"]["kind"] == "z" and start == 0:
        pixels = data.pixels("D", number, camera)
        return rr.DepthImage(np.where(pixels == DEPTH_LEVELS, 0, pixels).astype(np.uint16), meter=DEPTH_LEVELS / end,
                             depth_range=[0, DEPTH_LEVELS - 1])
    depth = planar_depth(data, number, camera)
    return rr.DepthImage(np.where(np.isfinite(depth), depth, 0).astype(np.float32), meter=1.0, depth_range=[0, end])


def _blueprint(data: Dataset):
    """The world at the left, the first camera's images at the right, sensors below."""
    import rerun.blueprint as rrb

    camera = f"world/cam{data.cameras[0]}"
    images = [rrb.Spatial2DView(origin=f"{camera}/{output}", name=f"{output}: {OUTPUTS[output].content}")
              for output in data.outputs]
    others = [f"- $origin/cam{camera}/{output}" for camera in data.cameras for output in data.outputs
              if output not in "AD"]  # A is on the frustum's far side, D is a cloud
    world = rrb.Spatial3DView(origin="world", name="World", contents=["+ $origin/**", *others])
    curves = [rrb.TimeSeriesView(origin=entity, name=name) for entity, name, sensor in (
        ("imu0/acceleration", "specific force [m/s²]", "imu0"),
        ("imu0/angular_velocity", "angular velocity [rad/s]", "imu0"),
        ("depth0", "depth gauge [m]", "depth0"), ("exposure", "exposure gain", None))
        if sensor is None or sensor in data.recorded]
    top = rrb.Horizontal(world, rrb.Grid(*images, grid_columns=2), column_shares=[1, 1]) if images else world
    return rrb.Blueprint(rrb.Vertical(top, rrb.Horizontal(*curves), row_shares=[3, 1]),
                         rrb.TimePanel(state="collapsed", timeline="time"), collapse_panels=True)
