"""COCO: instances, amodal instances and panoptic segments (https://cocodataset.org/#format-data).

``annotations/instances.json`` has what is seen of each object, ``annotations/amodal.json`` all of it, also of what is
hidden, under the same numbers. ``annotations/panoptic.json`` and the PNG beside it give each pixel its segment.
"""

import colorsys
import json
from collections.abc import Iterable
from functools import partial

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.export.shared.job import Job
from varos_warp.dataset.export.shared.labels import Label, Labels
from varos_warp.dataset.export.shared.masks import box_of, run_lengths
from varos_warp.scene.description.image_types import SEGMENTS, WATER

IMAGES = NEEDS = WATER + SEGMENTS
GOLDEN = 0.618034
"""Hues so far apart are unlike each other."""


def write(job: Job) -> None:
    """Write the images under ``images/cam<id>``, and the annotations."""
    labels = Labels(job)
    images: list[dict] = []
    found: list[tuple[dict | None, dict | None]] = []
    segments: list[dict] = []
    for camera in job.cameras:
        about, first = job.data.camera(camera), len(images) + 1
        names = [f"cam{camera}/{name}" for name in job.names(camera)]
        job.link_images(camera, [f"images/{name}" for name in names])
        stamps = job.data.time_ns(camera).tolist()
        images += [
            {
                "id": first + i,
                "file_name": name,
                "width": about["width"],
                "height": about["height"],
                "camera": camera,
                "frame": frame,
                "timestamp_ns": stamp,
            }
            for i, (name, frame, stamp) in enumerate(zip(names, job.data.frames, stamps, strict=True))
        ]
        ids = range(first, first + len(names))
        for each in job.each(f"labels {camera}", partial(_annotations, labels, camera), ids):
            found += each
        segments += job.each(f"panoptic {camera}", partial(_panoptic, job, labels, camera), ids, names)
    _write_all(job, labels, images, found, segments)


def _annotations(labels: Labels, camera: str, frame: int, image: int) -> list[tuple[dict | None, dict | None]]:
    """Annotate each thing in an image: what is seen, if anything is, and all of it, if that is known."""
    about, numbers = labels.data.camera(camera), {name: i for i, name in enumerate(labels.categories, 1)}
    size = about["height"], about["width"]
    return [
        (
            instance(image, label, size, numbers) if len(label.visible) else None,
            amodal(image, label, size, numbers) if label.whole is not None else None,
        )
        for label in labels.of(frame, camera)
    ]


def _write_all(job: Job, labels: Labels, images: list[dict], found: list, segments: list[dict]) -> None:
    """Write the files of annotations."""
    things, surfaces = categories(labels)
    about = {"description": f"{job.data.meta['scene']['name']}, sequence {job.data.meta['sequence']}, by varos_warp"}
    bare = [{"id": entry["id"], "name": entry["name"], "supercategory": "object"} for entry in things]
    seen, whole = ([{"id": number, **pair[k]} for number, pair in enumerate(found, 1) if pair[k]] for k in (0, 1))
    files_of = {"instances": (bare, seen), "panoptic": ([*things, *surfaces], segments)}
    if labels.silhouettes:
        files_of["amodal"] = bare, whole
    for name, (kinds, annotations) in files_of.items():
        content = {"info": about, "licenses": [], "images": images, "categories": kinds, "annotations": annotations}
        text = json.dumps(content, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
        files.write_bytes(job.out / "annotations" / f"{name}.json", text.encode())


def categories(labels: Labels) -> tuple[list[dict], list[dict]]:
    """Categories of things, numbered from 1, and of the terrain and the water after them, as panoptic.json has them."""

    def entries(names: Iterable[str], first: int, is_thing: int) -> list[dict]:
        return [
            {
                "id": number,
                "name": name,
                "supercategory": "object" if is_thing else "surface",
                "isthing": is_thing,
                "color": _color(number),
            }
            for number, name in enumerate(names, first)
        ]

    things = entries(labels.categories, 1, 1)
    return things, entries(labels.surfaces.values(), len(things) + 1, 0)


def _color(number: int) -> list[int]:
    return [round(255 * part) for part in colorsys.hsv_to_rgb(number * GOLDEN % 1.0, 0.6, 0.9)]


def instance(image: int, label: Label, size: tuple[int, int], categories: dict[str, int]) -> dict:
    """An annotation of what is seen of an object, with our own keys of all of it, and of its pose."""
    whole = label.whole
    more = {} if whole is None else {"amodal_bbox": box_of(whole, size[1]), "amodal_area": len(whole)}
    return _annotation(image, label, label.visible, size, categories, more)


def amodal(image: int, label: Label, size: tuple[int, int], categories: dict[str, int]) -> dict:
    """An annotation of all of an object, with our own keys of what is seen of it."""
    seen = box_of(label.visible, size[1]) if len(label.visible) else None
    more = {"visible_bbox": seen, "visible_area": len(label.visible)}
    return _annotation(image, label, label.whole, size, categories, more)


def _annotation(
    image: int, label: Label, pixels, size: tuple[int, int], categories: dict[str, int], more: dict
) -> dict:
    """An annotation of some pixels of an object; what COCO has no keys for comes last."""
    share = {} if label.share is None else {"visible_share": label.share}
    pose = {} if label.T_c_o is None else {"T_c_o": label.T_c_o.tolist()}
    return {
        "image_id": image,
        "category_id": categories[label.thing.category],
        "bbox": box_of(pixels, size[1]),
        "area": len(pixels),
        "iscrowd": 0,
        "segmentation": run_lengths(pixels, size),
        **more,
        **share,
        "object": label.thing.number,
        "key": label.thing.key,
        **pose,
    }


def _panoptic(job: Job, labels: Labels, camera: str, frame: int, image: int, name: str) -> dict:
    """Write the PNG of an image, id = R + 256 G + 65536 B, and return its annotation."""
    numbers = labels.numbers(frame, camera)
    files.write_png(
        job.out / "annotations/panoptic" / name,
        np.stack([numbers >> shift & 255 for shift in (0, 8, 16)], -1).astype(np.uint8),
    )
    things, surfaces = categories(labels)
    ids = {entry["name"]: entry["id"] for entry in [*things, *surfaces]}
    of = {number: thing.category for number, thing in labels.things.items()} | labels.surfaces
    flat = numbers.ravel()
    order = np.argsort(flat, kind="stable")
    found, first = np.unique(flat[order], return_index=True)
    pixels = zip(found.tolist(), np.split(order, first[1:]), strict=True)
    info = [
        {
            "id": number,
            "category_id": ids[of[number]],
            "area": len(own),
            "bbox": box_of(own, numbers.shape[1]),
            "iscrowd": 0,
        }
        for number, own in pixels
        if number
    ]
    return {"image_id": image, "file_name": name, "segments_info": info}
