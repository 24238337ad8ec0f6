"""Objects: the poses of those that move against their paths, and whether those that stand still are where they must be.

What is held against other frames is only what stands still: pixels of what moves, other vehicles too, are left out, by
S. Of a dataset without S nothing is then.

What an object's number marks in S lies, by D and the poses, in the box of that object. The box is known of parametric
objects that stand still only: meshes are files from outside of the dataset, and where copies of `scatter` stand only
all meshes together tell.
"""

import itertools
from functools import lru_cache, partial

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.points import points_at, project, seen_pixels
from varos_warp.dataset.reader.rows import exposure_s, is_rolling, offsets_ns
from varos_warp.dataset.validate.metadata import same
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.dataset.write.texts import describe_lights, sources
from varos_warp.render.image.flow import MovingPart
from varos_warp.scene.description.image_types import DEPTH, SEGMENTS
from varos_warp.scene.description.world import MeshObject
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import transform
from varos_warp.scene.geometry.placed import object_part
from varos_warp.scene.optics.camera import CameraModel
from varos_warp.scene.optics.shutter import in_ns
from varos_warp.sim.clock import TICK_NS, frame_time_ns
from varos_warp.sim.companions import PosesAt, motions
from varos_warp.sim.poses import Knots, at_ticks

EPS = np.finfo(float).eps
MOST_POINTS = 20_000
"""Points of a frame that are looked at."""
FEWEST_POINTS = 30
"""Fewest points of an object that say something."""
INSTANTS = np.linspace(-0.5, 0.5, 5)
"""Instants at which it is looked, as shares of the time that a shutter is open, from its middle."""


@lru_cache(1)  # every view and pair of frames asks
def known_motions(data: Dataset) -> dict[str, PosesAt]:
    """Poses over time of all that moves in the scene, by key.

    Those of another vehicle on a recorded course whose file is not at hand are from the poses in the dataset.
    """
    if not data.moving:
        return {}
    scene = scene_from_dict(data.meta["scene"])
    unlike = {name for name, digest in sources(scene).items() if digest != data.meta["sources"].get(name)}
    lost = [key for key, vehicle in scene.companions.items() if vehicle.trajectory.file in unlike]
    as_kept = {key: partial(_between_frames, *data.poses(key)) for key in lost if key in data.moving}
    return motions(scene, lost) | as_kept


def _between_frames(frames_ns: np.ndarray, T: np.ndarray, time_ns: np.ndarray) -> np.ndarray:
    """Poses [N, 4, 4] at times int64 [N] [ns] of what has poses [M, 4, 4] at frames [M] [ns]: splines between them."""
    knots = Knots(frames_ns / TICK_NS, T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]))
    columns = at_ticks(knots, np.asarray(time_ns) / TICK_NS)
    return transform(Rotation.from_quat(columns["quaternion"], scalar_first=True).as_matrix(), columns["position"])


def solid(data: Dataset) -> list[dict]:
    """What dataset.json says of what moves and can be seen: all but vehicles without a body."""
    return [entry for entry in data.meta.get("moving") or () if entry.get("id") is not None]


def check_moving(data: Dataset, result: Validation) -> None:
    """dataset.json has what the scene lets move, with its lights; the poses are those of the paths at the frames."""
    scene, entries = scene_from_dict(data.meta["scene"]), data.meta.get("moving") or []
    numbers = [[key, scene.number_of(key) if key in scene.moving else None] for key in scene.tracked]
    if (named := [[entry["key"], entry.get("id")] for entry in entries]) != numbers:
        result.add(f"dataset.json: moving names {named}, but the scene lets {numbers} move")
        return
    made = [
        {"lights": describe_lights(scene.companions[key])} if key in scene.companions else {} for key in scene.tracked
    ]
    result.add_all(
        [
            f"dataset.json: moving.{key} is {here!r}, but its scene makes it {there!r}"
            for key, here, there in files.differences(entries, made, same, every=False)
        ],
        "entries",
    )
    known = known_motions(data)
    for key in data.moving:
        (time_ns, T), path = data.poses(key), data.layout.poses(key, "transformation_matrix")
        if not np.array_equal(time_ns, data.time_ns()):
            result.add(f"{result.name(path)}: its times are not those of the frames")
            continue
        apart = T - known[key](time_ns)
        off, limit = np.abs(apart).max((1, 2)), 1e-9 + 8 * EPS * np.abs(T).max(initial=0.0)
        told = result.add_rows(
            path, "is not where its path has it", ~(off <= limit), apart[:, :3].reshape(-1, 12), range(1, 13)
        )
        result.measure(f"{key}: poses against its path", off.max(initial=0.0), limit, "m", told)


def of_moving(data: Dataset, frame: int, camera: str) -> np.ndarray:
    """Pixels of objects that move, bool [H, W], by S, which the dataset must have."""
    return np.isin(data.pixels(SEGMENTS, frame, camera), [entry["id"] for entry in solid(data)])


def of_still(data: Dataset, depth: np.ndarray, frame: int, camera: str) -> np.ndarray:
    """Depth [H, W] of what stands still; infinite elsewhere, as where nothing is."""
    if not solid(data):
        return depth
    if SEGMENTS not in data.outputs:
        return np.full_like(depth, np.inf)
    seen = of_moving(data, frame, camera)
    return np.where(seen, np.inf, depth) if seen.shape == depth.shape else depth


def swept(data: Dataset, frame: int, camera: str, shape: tuple[int, ...]) -> np.ndarray:
    """Pixels that what moves may have been before while the shutter was open, bool [H, W]; without exposure none.

    B is blurred there, unlike S, which is of an instant. Each is taken for the rectangle about its box at all instants;
    where some corner of that is behind the camera, for the whole image.
    """
    about, model = data.camera(camera), data.camera_model(camera)
    covered = np.zeros(shape, bool)
    if not solid(data) or not exposure_s(about):
        return covered
    open_s = exposure_s(about) + about["exposure"]["readout_s"]
    time_ns = frame_time_ns(frame, data.meta["frames"]["rate_hz"]) + in_ns(open_s * INSTANTS)
    T_w_c = _camera_at(data, camera, time_ns)
    if T_w_c is None:
        return ~covered
    known, boxes = known_motions(data), {entry["key"]: entry["box_m"] for entry in solid(data)}
    for key, box in boxes.items():
        corners = np.array(list(itertools.product(*np.transpose(box))))
        points = [corners @ T[:3, :3].T + T[:3, 3] for T in known[key](time_ns)]
        u, v, z = np.concatenate([project(p, model, T) for p, T in zip(points, T_w_c, strict=True)]).T
        ahead = np.isfinite(u + v) & (z > 0.0)
        if ahead.all():
            rows, cols = (slice(max(0, int(x.min()) - 1), max(0, int(x.max()) + 2)) for x in (v, u))
            covered[rows, cols] = True
        elif ahead.any():
            covered[:] = True
    return covered


def _camera_at(data: Dataset, camera: str, time_ns: np.ndarray) -> np.ndarray | None:
    """Poses of a camera [N, 4, 4] at some times; None where they are not on record."""
    about = data.camera(camera)
    if about["mount"] == "world":
        return np.repeat(np.array(about["T_w_c"], float)[None], len(time_ns), axis=0)
    if "vehicle" not in data.recorded or time_ns[-1] > data.trajectory().time_ns[-1]:
        return None
    return data.trajectory().from_before(time_ns).poses() @ np.array(about["T_v_c"], float)


def moving_parts(data: Dataset, frame: int, camera: str, row: np.ndarray, col: np.ndarray) -> list[MovingPart]:
    """Objects that move, for the flow from a frame of what pixels [N] see; S must be in the dataset."""
    if not (entries := solid(data)):
        return []
    ids = {entry["key"]: entry["id"] for entry in entries}
    numbers, about = data.pixels(SEGMENTS, frame, camera)[row, col], data.camera(camera)
    offset = offsets_ns(about) if is_rolling(about) else np.zeros(1, np.int64)
    times = [frame_time_ns(frame + i, data.meta["frames"]["rate_hz"]) + offset for i in range(2)]
    return [
        MovingPart(numbers == ids[key], *map(poses, times)) for key, poses in known_motions(data).items() if key in ids
    ]


# ----------------------------------------------------------------------------------------------------------- places


def boxes(data: Dataset) -> dict[int, np.ndarray]:
    """Lowest and highest corner [2, 3] [m] of the parametric objects, by their numbers in S; none without S and D."""
    scene, found = scene_from_dict(data.meta["scene"]), {}
    for i, block in enumerate(scene.objects if {DEPTH, SEGMENTS} <= set(data.outputs) else ()):
        if not isinstance(block, MeshObject) and not block.path:
            corners = object_part(scene, block.model_copy(update={"chord_error_m": None}), f"objects.{i}").vertices
            low, high = corners.min(0), corners.max(0)
            # steps of D, and that the default mesh is coarser than the one rendered
            slack = 2.0 * data.meta["depth"]["scale_m"] + 0.01 * (high - low).max()
            found[scene.number_of(f"objects.{i}")] = np.stack([low - slack, high + slack])
    return found


def sums_in(depth: np.ndarray, model: CameraModel, T_w_c: np.ndarray, numbers: np.ndarray, boxes: dict) -> np.ndarray:
    """Sums over one frame, a row for each of ``boxes``: points with its number, those within, sums of x, y, z [n, 5].

    ``depth`` [H, W] [m] is planar, inf where there is none; ``numbers`` [H, W] are S, ``boxes`` corners [2, 3] by
    number.
    """
    row, col, z = seen_pixels(depth, MOST_POINTS)
    points, here = points_at(model, T_w_c, row, col, z), numbers[row, col]
    found = []
    for number, (low, high) in boxes.items():
        own = points[here == number]
        found.append([len(own), ((own >= low) & (own <= high)).all(-1).sum(), *own.sum(0)])
    return np.array(found)


def check_places(data: Dataset, result: Validation, camera: str, boxes: dict, sums: np.ndarray) -> None:
    """More than half of the points with an object's number lie in its box; if not, where they lie is told."""
    keys = {
        number: f"number {number} (objects.{number - 1 - (data.meta['scene'].get('terrain') is not None)})"
        for number in boxes
    }
    for (number, _), (count, within, *total) in zip(boxes.items(), sums, strict=True):
        if count >= FEWEST_POINTS and within < count / 2:
            middle = np.array(total) / count
            others = [keys[n] for n, (low, high) in boxes.items() if ((middle >= low) & (middle <= high)).all()]
            where = f"; they lie where {others[0]} is" if others else ""
            result.add(
                f"{camera}: S: {100 - 100 * within / count:.0f} % of the points of {keys[number]} do not lie "
                f"where the scene has it{where}"
            )
