"""Dissimilar scenes for image A: near and far, open and closed, clear and turbid; `build` makes one by its name."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from benchmarks.light import shapes
from varos_warp.errors import require_known
from varos_warp.scene.description import Scene
from varos_warp.scene.frames import look_at_matrix, transform
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.parts import Part

RESOLUTION = (96, 56)
TALL_MM, FOCAL_MM = 3.5, 4.0
"""Height of a sensor 6 mm wide with square pixels at the default resolution, and the focal length."""
SCENES = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
"""What each scene is made of, as the file explains."""


class Built(NamedTuple):
    """A scene, its geometry, and the pose of its vehicle."""

    scene: Scene
    parts: list[Part]
    T_w_v: np.ndarray


def build(name: str, resolution=RESOLUTION) -> Built:
    """A scene by name, or an `InputError` where there is none."""
    require_known(name, SCENES, "there is no such scene", key="--scenes")
    said = SCENES[name]
    eye, target = said.get("eye", (0, 0, 0)), said.get("target")
    camera = {
        "id": "M0",
        "resolution": tuple(resolution),
        "focal_mm": FOCAL_MM,
        "sensor_mm": (TALL_MM * resolution[0] / resolution[1], TALL_MM),
        **said.get("view", {}),
    }
    scene = Scene(
        water=_made(said["water"]) if "water" in said else shapes.PAPER,
        vehicle={"lights": _all_of(said.get("lights", ["paper_lamps"])), "cameras": [camera]},
        trajectory={"poses": [{"position": eye} | ({} if target is None else {"look_at": target})]},
        **said.get("blocks", {}),
    )
    T_w_v = transform(None if target is None else look_at_matrix(eye, target), eye)
    return Built(scene, _all_of(said["parts"]) if "parts" in said else build_parts(scene), T_w_v)


def _all_of(words: list) -> list:
    """What words make, of which some make several."""
    made = [_made(word) for word in words]
    return [each for some in made for each in (some if isinstance(some, list) else [some])]


def _made(word: str | dict[str, Any]):
    """What a function of `shapes` makes; keys of a scene file as they are."""
    name, arguments = (word, ()) if isinstance(word, str) else next(iter(word.items()))
    if not hasattr(shapes, name):
        return word
    colours = [getattr(shapes, a) if isinstance(a, str) and a.isupper() else a for a in arguments]
    return getattr(shapes, name)(*colours)
