"""Image S: the object that the pixels' centres see, by its number, and the table of the numbers."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from varos_warp.products.images.protocol import FirstHits, FrameFiles, ImageProduct
from varos_warp.scene.description import Scene
from varos_warp.scene.description.image_types import SEGMENTS
from varos_warp.scene.description.looks import LOOKS

SEGMENT_LEVELS = 65535
"""Most objects that S can number."""


@dataclass(frozen=True)
class SegmentImage:
    """What the pixel centres' rays hit first, int32 [H, W]; 0 where nothing is hit. See `FrameRenderer.segments`."""

    instance: np.ndarray
    """Number of the terrain or object, from 1."""
    material_ids: np.ndarray
    """Number of the material of each instance in the scene file, from 1, and of nothing (0), int32 [N + 1]; 0: none."""

    @property
    def material(self) -> np.ndarray:
        """Number of the material that each ray hits, as ``instance``."""
        return self.material_ids[self.instance]


class Segments(ImageProduct):
    """Image S."""

    letter, content = SEGMENTS, "Number of the object in each pixel"
    method = "first hits of pixel centres"
    planes, channels, dtype, bytes_a_pixel = ("instance",), 1, np.uint16, 0.05
    beside = LOOKS
    averages = False  # numbers of objects have no mean

    def of_hits(self, hits: FirstHits) -> SegmentImage:
        """Numbers of objects, and the materials that they have."""
        return SegmentImage(hits.planes["instance"], hits.material_ids)

    def pixels(self, image: SegmentImage, render: Any) -> np.ndarray:
        """uint16 [H, W] of the numbers of objects."""
        return np.asarray(image.instance).astype(np.uint16)

    def is_empty(self, image: SegmentImage, render: Any) -> bool:
        """Return whether nothing is hit."""
        return not image.instance.any()

    def decode(self, pixels: np.ndarray, scale: Any = None) -> np.ndarray:
        """Numbers of objects int32 [H, W]; 0 where nothing was hit."""
        return pixels.astype(np.int32)

    def check(self, files: FrameFiles) -> Iterator[tuple[str, str]]:
        """It numbers only what segments.json lists."""
        listed = {0, *(row["id"] for row in files.data.segments())}
        if unknown := set(np.flatnonzero(np.bincount(files.pixels(SEGMENTS).ravel())).tolist()) - listed:
            yield files.file(SEGMENTS).name, f"segments.json does not list {sorted(unknown)[:5]}"

    def colors(self, pixels: np.ndarray, meta: Mapping[str, Any], near_far: tuple[float, float] | None) -> np.ndarray:
        """A colour for each number, unlike its neighbours' (hues a golden section apart); black where it is 0."""
        from matplotlib.colors import hsv_to_rgb

        number = pixels.astype(float)
        value = np.where(pixels > 0, 0.95, 0.0)
        hsv = np.stack([number * 0.618034 % 1.0, 0.4 + 0.5 * (number * 0.37 % 1.0), value], -1)
        return (hsv_to_rgb(hsv) * 255).astype(np.uint8)


def segment_table(scene: Scene, part_names: list[str]) -> list[dict]:
    """A row for each terrain, object and copy, in the order of their keys in the scene file.

    Rows of ``id`` (from 1; 0 is nothing), ``key`` (``terrain``, ``objects.3``, ``scatter.0.17``, of a body
    ``vehicles.ID``), ``kind`` (``terrain``, ``mesh``, ``pipe``, ``barnacle`` ...), ``material`` and ``material_id``
    (its place among the scene file's materials, from 1; 0: none).
    """
    materials = list(scene.materials)
    rows = []
    for number, key in enumerate(part_names, start=1):
        block = block_of(scene, key)
        kind = "terrain" if key == "terrain" else getattr(block, "kind", "")
        name = getattr(block, "material", None)
        material_id = materials.index(name) + 1 if name in materials else 0
        rows.append({"id": number, "key": key, "kind": kind, "material": name, "material_id": material_id})
    return rows


def block_of(scene: Scene, key: str) -> Any:
    """The block that a key names; None for parts from elsewhere than the scene file."""
    group, *numbers = key.split(".")
    if group == "terrain":
        return scene.terrain
    if group == "vehicles":
        return next((vehicle.body for vehicle in scene.vehicles or () if vehicle.key == key), None)
    groups: dict[str, Any] = {
        "objects": scene.objects,
        "scatter": [block.object for block in scene.scatter],
        "growth": scene.growth,
    }
    blocks = groups.get(group, [])
    known = bool(numbers) and numbers[0].isdigit() and int(numbers[0]) < len(blocks)
    return blocks[int(numbers[0])] if known else None


SEGMENT_IMAGE = Segments()
