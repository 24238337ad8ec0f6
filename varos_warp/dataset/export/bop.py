"""BOP: poses, masks, depth and models of objects (bop_toolkit, docs/bop_datasets_format.md).

Lengths are in mm; the centre of the top left pixel is (0, 0). Each camera is a scene. As scripts/calc_gt_info.py there
counts, an object's silhouette reaches beyond the image, up to its size on each side, and widths and heights of boxes
are from the first pixel to the last: one less than how many there are.
"""

import json

import numpy as np
from scipy.spatial import ConvexHull, QhullError, distance

from varos_warp.dataset import files
from varos_warp.dataset.export.shared.job import Job, lens_of
from varos_warp.dataset.export.shared.labels import Label, Labels, within
from varos_warp.dataset.export.shared.masks import box_of, image_of
from varos_warp.dataset.export.shared.models import models_of, ply
from varos_warp.errors import InputError
from varos_warp.scene.description.image_types import DEPTH, SEGMENTS, WATER
from varos_warp.scene.frames import inverse

IMAGES, NEEDS = WATER + SEGMENTS + DEPTH, SEGMENTS
MM = 1000.0
SPLIT = "train"


def write(job: Job) -> None:
    """Write a folder of each camera's images and annotations, and the models of what they show."""
    for camera in job.cameras:
        lens_of(job, camera, "BOP")
    labels = Labels(job, must_be_whole=True)
    if not labels.things:
        raise InputError(
            "there is nothing with a pose but the terrain",
            file=job.data.root,
            key="to",
            value="bop",
            remedy="Give the scene objects, or export as coco.",
        )
    models = models_of(labels)
    numbers = {key: model.number for model in models for key in model.keys}
    shown: set[int] = set()
    for scene, camera in enumerate(job.cameras):
        shown |= _write_scene(job, labels, camera, f"{SPLIT}/{scene:06d}", numbers)
    info = {}
    for model in models:
        if model.number in shown:
            vertices = MM * model.vertices
            files.write_bytes(job.out / f"models/obj_{model.number:06d}.ply", ply(vertices, model.faces))
            info[model.number] = {**measures(vertices), "class": model.category, "key": model.keys[0]}
    _write_json(job, "models/models_info.json", info)
    first = job.cameras[0]
    about, (fx, fy, cx, cy) = job.data.camera(first), job.fx_fy_cx_cy(first)
    _write_json(
        job,
        "camera.json",
        {
            "cx": cx,
            "cy": cy,
            "depth_scale": _depth_scale(job),
            "fx": fx,
            "fy": fy,
            "height": about["height"],
            "width": about["width"],
        },
    )
    job.text("dataset_info.md", _about(job, info))


def _depth_scale(job: Job) -> float:
    """Millimetres in a step of the depth images: those of D."""
    return MM / _steps_per_metre(job)


def _steps_per_metre(job: Job) -> float:
    return 65535.0 / job.data.meta["depth"]["range_m"][1] if job.has_depth else MM


def _write_scene(job: Job, labels: Labels, camera: str, folder: str, numbers: dict[str, int]) -> set[int]:
    """Write all of a camera, and return the numbers of the models that it shows."""
    frames = job.data.frames
    names = [f"{frame:06d}.png" for frame in frames]
    job.link_images(camera, [f"{folder}/rgb/{name}" for name in names])
    if job.has_depth:
        job.depths(camera, [f"{folder}/depth/{name}" for name in names], _steps_per_metre(job))
    found = job.each(f"labels {camera}", lambda frame: _frame(job, labels, camera, frame, folder, numbers))
    K = job.data.intrinsics(camera, "opencv").ravel().tolist()
    cameras = {}
    for frame in frames:
        T_c_w = inverse(job.data.T_w_c(frame, camera))
        cameras[frame] = {"cam_K": K, "depth_scale": _depth_scale(job), **_rigid(T_c_w, "w2c")}
    _write_json(job, f"{folder}/scene_camera.json", cameras)
    for name, part in (("scene_gt", 0), ("scene_gt_info", 1)):
        entries = {frame: each[part] for frame, each in zip(frames, found, strict=True)}
        _write_json(job, f"{folder}/{name}.json", entries)
    return {entry["obj_id"] for each, _ in found for entry in each}


def _rigid(T: np.ndarray, name: str) -> dict:
    """A pose as BOP has it."""
    return {f"cam_R_{name}": T[:3, :3].ravel().tolist(), f"cam_t_{name}": (MM * T[:3, 3]).tolist()}


def _frame(
    job: Job, labels: Labels, camera: str, frame: int, folder: str, numbers: dict[str, int]
) -> tuple[list[dict], list[dict]]:
    """Write the masks of a frame; return its entries of scene_gt and of scene_gt_info."""
    size = job.data.camera(camera)["height"], job.data.camera(camera)["width"]
    depth = job.data.planar_depth(frame, camera).ravel() if job.has_depth else None
    entries, infos = [], []
    for i, label in enumerate(labels.of(frame, camera, margin=size)):
        own = label.whole[within(label.whole, size, size)]
        row, col = np.divmod(own, 3 * size[1])
        inside = (row - size[0]) * size[1] + col - size[1]
        for kind, pixels in (("mask", inside), ("mask_visib", label.visible)):
            files.write_png(job.out / folder / kind / f"{frame:06d}_{i:06d}.png", image_of(pixels, size))
        entries.append({**_rigid(label.T_c_o, "m2c"), "obj_id": numbers[label.thing.key]})
        valid = 0 if depth is None else int(np.isfinite(depth[inside]).sum())
        infos.append(_info(label, size, valid))
    return entries, infos


def _info(label: Label, size: tuple[int, int], valid: int) -> dict:
    """An entry of scene_gt_info; boxes of what is not seen are -1."""
    whole, seen = [-1] * 4, [-1] * 4
    if len(label.visible):
        x, y, width, height = box_of(label.whole, 3 * size[1])
        whole = [x - size[1], y - size[0], width - 1, height - 1]
        x, y, width, height = box_of(label.visible, size[1])
        seen = [x, y, width - 1, height - 1]
    return {
        "bbox_obj": whole,
        "bbox_visib": seen,
        "px_count_all": len(label.whole),
        "px_count_valid": valid,
        "px_count_visib": len(label.visible),
        "visib_fract": label.share,
    }


def measures(vertices: np.ndarray) -> dict:
    """What models_info.json says of a model: its box and its diameter, the largest distance of two vertices [mm]."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    try:
        outer = vertices[ConvexHull(vertices).vertices]
    except QhullError:  # flat
        outer = np.unique(vertices, axis=0)
    diameter = max(float(distance.cdist(outer[i : i + 512], outer).max()) for i in range(0, len(outer), 512))
    return {
        "diameter": diameter,
        **{f"min_{axis}": float(low[k]) for k, axis in enumerate("xyz")},
        **{f"size_{axis}": float(high[k] - low[k]) for k, axis in enumerate("xyz")},
    }


def _write_json(job: Job, name: str, content: dict) -> None:
    """JSON with a line for each entry, as bop_toolkit writes it."""
    lines = (f"  {json.dumps(str(key))}: {json.dumps(value, allow_nan=False)}" for key, value in content.items())
    files.write_bytes(job.out / name, ("{\n" + ",\n".join(lines) + "\n}\n").encode())


def _about(job: Job, info: dict) -> list[str]:
    """dataset_info.md."""
    scenes = [f"* `{SPLIT}/{i:06d}`: camera {camera}" for i, camera in enumerate(job.cameras)]
    kinds = [f"* {number}: {entry['class']} (`{entry['key']}`)" for number, entry in info.items()]
    return [
        f"# {job.data.meta['scene']['name']}",
        "",
        "Made by varos_warp in the format of BOP.",
        "",
        "## Scenes",
        "",
        *scenes,
        "",
        "## Models",
        "",
        *kinds,
    ]
