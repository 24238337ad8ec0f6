"""YOLO's text labels (https://docs.ultralytics.com/datasets/detect): a line "class x y width height" for each object.

The numbers are shares of the image's width and height, x and y of the box's middle. ``labels`` has boxes about what is
seen, ``labels_amodal`` about all of each object; labels.csv tells which object it is, and the visible share.
"""

from functools import partial

import yaml

from varos_warp.dataset.export.shared.job import Job
from varos_warp.dataset.export.shared.labels import Label, Labels
from varos_warp.dataset.export.shared.masks import box_of
from varos_warp.errors import InputError
from varos_warp.scene.description.image_types import SEGMENTS, WATER

IMAGES = NEEDS = WATER + SEGMENTS
NOTE = """# Images are of one sequence and look alike: validate on another, and name its folder as val.
# labels has boxes about what is seen; for boxes about all of each object, rename labels_amodal to labels.
"""


def write(job: Job) -> None:
    """Write data.yaml, images, labels and labels.csv."""
    labels = Labels(job)
    if not labels.categories:
        raise InputError(
            "there is nothing to label but the terrain",
            file=job.data.root,
            key="to",
            value="yolo",
            remedy="Give the scene objects, or export as coco.",
        )
    rows = ["image,object,key,class,visible_pixels,amodal_pixels,visible_share"]
    for camera in job.cameras:
        names = [f"cam{camera}/{name}" for name in job.names(camera)]
        job.link_images(camera, [f"images/{name}" for name in names])
        for each in job.each(f"labels {camera}", partial(_write_image, job, labels, camera), names):
            rows += each
    job.text("labels.csv", rows)
    content = {"train": "images", "val": "images", "names": dict(enumerate(labels.categories))}
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    job.text("data.yaml", [NOTE + text.rstrip("\n")])


def _write_image(job: Job, labels: Labels, camera: str, frame: int, name: str) -> list[str]:
    """Write the labels of an image, and return their rows of labels.csv."""
    about, numbers = job.data.camera(camera), {name: number for number, name in enumerate(labels.categories)}
    size, found = (about["height"], about["width"]), labels.of(frame, camera)
    text = f"{name.removesuffix('.png')}.txt"
    seen = [label for label in found if len(label.visible)]
    job.text(f"labels/{text}", [line(numbers, label, label.visible, size) for label in seen])
    if labels.silhouettes:
        job.text(f"labels_amodal/{text}", [line(numbers, label, label.whole, size) for label in found])
    return [_row(name, label) for label in found]


def line(numbers: dict[str, int], label: Label, pixels, size: tuple[int, int]) -> str:
    """The line of a label with the box about some of its pixels; ``size`` is (H, W)."""
    x, y, width, height = box_of(pixels, size[1])
    shares = ((x + 0.5 * width) / size[1], (y + 0.5 * height) / size[0], width / size[1], height / size[0])
    return f"{numbers[label.thing.category]} {' '.join(map(repr, shares))}"


def _row(name: str, label: Label) -> str:
    """A row of labels.csv; fields of what is not known are empty."""
    whole = "" if label.whole is None else len(label.whole)
    share = "" if label.share is None else repr(label.share)
    category = label.thing.category.replace('"', '""')
    return f'images/{name},{label.thing.number},{label.thing.key},"{category}",{len(label.visible)},{whole},{share}'
