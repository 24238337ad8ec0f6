"""Objects that move and other vehicles: their poses against their paths, and which pixels are theirs.

What is held against other frames is only what stands still: pixels of these objects are left out, by S. Of a dataset
without S nothing is then.
"""

import numpy as np

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.rows import is_rolling, offsets_ns
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.render.image.flow import MovingPart
from varos_warp.scene.load import scene_from_dict
from varos_warp.sim.clock import frame_time_ns
from varos_warp.sim.companions import PosesAt, motions

EPS = np.finfo(float).eps


def known_motions(data: Dataset) -> dict[str, PosesAt]:
    """Where the scene has all that moves, by key.

    Raises:
        InputError: Another vehicle follows a surface whose file is not at hand.
    """
    return motions(scene_from_dict(data.meta["scene"])) if data.moving else {}


def check_moving(data: Dataset, result: Validation) -> None:
    """dataset.json names the objects that the scene lets move; their poses are those of their paths at the frames."""
    scene = scene_from_dict(data.meta["scene"])
    numbers = [[key, scene.number_of(key)] for key in scene.moving]
    if (named := [[entry["key"], entry["id"]] for entry in data.meta.get("moving") or ()]) != numbers:
        result.add(f"dataset.json: moving names {named}, but the scene lets {numbers} move")
        return
    known = known_motions(data)
    for key in data.moving:
        (time_ns, T), path = data.poses(key), data.layout.poses(key, "transformation_matrix")
        if not np.array_equal(time_ns, data.time_ns()):
            result.add(f"{result.name(path)}: its times are not those of the frames")
            continue
        apart = T - known[key](time_ns)
        off, limit = np.abs(apart).max((1, 2)), 1e-9 + 8 * EPS * np.abs(T).max(initial=0.0)
        told = result.add_rows(path, "is not where its path has it", ~(off <= limit), apart[:, :3].reshape(-1, 12),
                               range(1, 13))
        result.measure(f"{key}: poses against its path", off.max(initial=0.0), limit, "m", told)


def of_moving(data: Dataset, frame: int, camera: str) -> np.ndarray:
    """Pixels of objects that move, bool [H, W], by S, which the dataset must have."""
    return np.isin(data.pixels("S", frame, camera), [entry["id"] for entry in data.meta["moving"]])


def of_still(data: Dataset, depth: np.ndarray, frame: int, camera: str) -> np.ndarray:
    """Depth [H, W] of what stands still; infinite elsewhere, as where nothing is."""
    if not data.moving:
        return depth
    if "S" not in data.outputs:
        return np.full_like(depth, np.inf)
    seen = of_moving(data, frame, camera)
    return np.where(seen, np.inf, depth) if seen.shape == depth.shape else depth


def moving_parts(data: Dataset, frame: int, camera: str, row: np.ndarray, col: np.ndarray) -> list[MovingPart]:
    """Objects that move, for the flow from a frame of what pixels [N] see; S must be in the dataset."""
    if not data.moving:
        return []
    ids = {entry["key"]: entry["id"] for entry in data.meta["moving"]}
    numbers, about = data.pixels("S", frame, camera)[row, col], data.camera(camera)
    offset = offsets_ns(about) if is_rolling(about) else np.zeros(1, np.int64)
    times = [frame_time_ns(frame + i, data.meta["frames"]["rate_hz"]) + offset for i in range(2)]
    return [MovingPart(numbers == ids[key], *map(poses, times))
            for key, poses in known_motions(data).items() if key in ids]
