"""Scenes for image A by name: dissimilar ones made of shapes, and scene files by which plans are judged."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from benchmarks.light import shapes
from varos_warp.errors import require_known
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.file.load import load_scene
from varos_warp.scene.frames import look_at_matrix, transform
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.parts import Part
from varos_warp.sim.trajectory import simulate

HERE = Path(__file__).parent
RESOLUTION = (96, 56)
TALL_MM, FOCAL_MM = 3.5, 4.0
"""Height of a sensor 6 mm wide with square pixels at the default resolution, and the focal length."""
SCENES = yaml.safe_load((HERE / "scenes.yaml").read_text(encoding="utf-8"))
"""Near and far, open and closed, clear and turbid: what each scene is made of, as the file explains."""
PLANNED = yaml.safe_load((HERE / "planned.yaml").read_text(encoding="utf-8"))
"""Scene files, and what is changed in them, as the file explains."""
PLANNED_SIZE = ("vehicle.cameras.0.resolution=[320,180]", "render.spp=null")


class Built(NamedTuple):
    """A scene, its geometry, and the pose of its vehicle."""

    scene: Scene
    parts: list[Part]
    T_w_v: np.ndarray

    @property
    def camera(self) -> Camera:
        """The camera that is compared: the first."""
        return self.scene.vehicle.cameras[0]


def from_file(path: Path, changes=(), frame: int = 0) -> Built:
    """A scene of a file, with changes as ``key.path=value``, at a frame."""
    scene = load_scene(path, changes)
    return Built(scene, build_parts(scene), simulate(scene).frames.T_w_v(frame))


def build_planned(name: str) -> Built:
    """A scene by which plans are judged, or an `InputError` where there is none."""
    require_known(name, PLANNED, "there is no such scene", key="--scenes")
    said = PLANNED[name]
    path = HERE.parents[1] / said.get("file", "benchmarks/scenes/floor_clear.yaml")
    return from_file(path, (*PLANNED_SIZE, *said.get("changes", ())), said.get("frame", 0))


def build(name: str, resolution=RESOLUTION) -> Built:
    """A dissimilar scene by name, or an `InputError` where there is none."""
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
