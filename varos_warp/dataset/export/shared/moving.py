"""Poses of what moves beside every export: of objects, of other vehicles, and of their lights."""

import json
from collections.abc import Iterator

import numpy as np

from varos_warp.dataset.export.shared.job import Job, numbers, quaternion, seconds

FOLDER = "moving"


def write(job: Job) -> None:
    """Write a trajectory as TUM has them, ``moving/KEY.txt``, of each, and README.txt; nothing where nothing moves."""
    if not job.data.moving:
        return
    job.text(f"{FOLDER}/README.txt", _readme(job))
    lights = lights_of_others(job)
    for key in job.data.moving:
        time_ns, T_w_o = job.data.poses(key)
        placed = {
            name: T_w_o @ np.array(light["T_v_light"]) for (carrier, name), light in lights.items() if carrier == key
        }
        for name, T in {key: T_w_o, **placed}.items():
            rows = (f"{seconds(t)} {row}" for t, row in zip(time_ns, _rows(T), strict=True))
            job.text(f"{FOLDER}/{name}.txt", [f"# T_w_o of {name}", "# timestamp tx ty tz qx qy qz qw", *rows])


def lights_of_others(job: Job) -> dict[tuple[str, str], dict]:
    """What dataset.json says of each light of other vehicles, by their keys ``vehicles.ID`` and their own."""
    return {
        (entry["key"], f"{entry['key']}.lights.{i}"): light
        for entry in job.data.meta.get("moving") or ()
        for i, light in enumerate(entry.get("lights") or ())
    }


def _readme(job: Job) -> Iterator[str]:
    yield "Poses T_w_o of what moves at every frame: seconds, x y z, quaternion x y z w; from its own axes to the"
    yield "world of the dataset, z up, in metres. Where an export has another world, as KITTI has that of the first"
    yield "camera pose, these are in the dataset's all the same:"
    for camera in job.cameras:
        yield f"  first T_w_c of {camera} (OpenCV axes): {_rows(job.data.views(camera)[1][:1])[0]}"
    yield ""
    for entry in job.data.meta["moving"]:
        if entry.get("id") is not None:
            low, high = map(numbers, entry["box_m"])
            yield f"{entry['key']}: number {entry['id']} in S; its box in its own axes [m]: low {low}, high {high}"
        else:
            yield f"{entry['key']}: has lights only"
    if lights := lights_of_others(job):
        yield ""
        yield "Lights of other vehicles, by frame in files of their own: z of their axes is where they point. Keys as"
        yield "in a scene file, on their vehicle, and T_v_light; intensity in W/sr:"
        for (_, name), light in lights.items():
            yield f"{name}: {json.dumps(light)}"


def _rows(T: np.ndarray) -> list[str]:
    """Position and quaternion of each pose [N, 4, 4], scalar last."""
    return [numbers(row) for row in np.column_stack([T[:, :3, 3], quaternion(T, scalar_first=False)])]
