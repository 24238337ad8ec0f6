"""Dissimilar scenes for image A: near and far, open and closed, clear and turbid; `build` makes one by its name."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmarks.light import shapes
from benchmarks.light.shapes import (
    BLUE,
    GREY,
    PAPER,
    RED,
    box,
    ground,
    paper_lamps,
    pole,
    room,
    soft_lamps,
    spot,
    water,
)
from varos_warp.errors import require_known
from varos_warp.scene.description import Scene
from varos_warp.scene.frames import look_at_matrix, transform
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.parts import Part

RESOLUTION = (96, 56)
TALL_MM, FOCAL_MM = 3.5, 4.0
"""Height of a sensor 6 mm wide with square pixels at the default resolution, and the focal length."""


class Built(NamedTuple):
    """A scene, its geometry, and the pose of its vehicle."""

    scene: Scene
    parts: list[Part]
    T_w_v: np.ndarray


class Case(NamedTuple):
    """What a scene is made of."""

    title: str
    water: dict
    lights: list[dict]
    parts: Callable[[], list[Part]] | None
    """None: as the blocks say."""
    eye: tuple[float, float, float] = (0, 0, 0)
    """Where the vehicle is."""
    target: tuple[float, float, float] | None = None
    """What it looks at; None: forward."""
    view: dict = {}
    """Keys of the camera."""
    blocks: dict = {}
    """Further blocks of the scene."""


def build(name: str, resolution=RESOLUTION) -> Built:
    """A scene by name, or an `InputError` where there is none."""
    require_known(name, SCENES, "there is no such scene", key="--scenes")
    _, medium, lights, parts, eye, target, view, blocks = SCENES[name]
    sensor_mm = (TALL_MM * resolution[0] / resolution[1], TALL_MM)
    camera = {"id": "M0", "resolution": tuple(resolution), "focal_mm": FOCAL_MM, "sensor_mm": sensor_mm} | view
    pose = {"position": eye} | ({} if target is None else {"look_at": target})
    scene = Scene(water=medium, vehicle={"lights": lights, "cameras": [camera]}, trajectory={"poses": [pose]}, **blocks)
    T_w_v = transform(None if target is None else look_at_matrix(eye, target), eye)
    return Built(scene, build_parts(scene) if parts is None else parts(), T_w_v)


def _boxes() -> list[Part]:
    """What lies on the ground three metres ahead."""
    return [
        box("box.0", (0.6, 0.5, 0.5), (-0.7, 2.6, 0.25), RED, 20.0),
        box("box.1", (0.4, 0.4, 0.9), (0.6, 3.2, 0.45)),
        box("box.2", (0.3, 0.8, 0.3), (0.2, 2.1, 0.15), BLUE, -35.0),
        box("box.3", (1.2, 0.3, 0.6), (0.1, 4.4, 0.3)),
    ]


def _canyon() -> list[Part]:
    along, up = (0, 16, 0), (0, 0, 4)
    return [
        shapes.rough_sheet("left", (-0.55, -2, -1), along, up, 0.04, 60, 2),
        ground(12.0, -0.9, 0.05, 3),
        shapes.rough_sheet("right", (0.55, -2, -1), up, along, 0.04, 60, 4),
        box("box.0", (0.3, 0.3, 0.6), (0.2, 3, -0.6), RED),
    ]


def _closed_room() -> list[Part]:
    boxes = [
        box("box.0", (0.5, 0.5, 0.9), (-0.6, 1.9, -0.55), RED, 25.0),
        box("box.1", (0.4, 0.4, 0.4), (0.6, 1.4, -0.8), GREY, -15.0),
    ]
    return [*room((-1.6, -1, -1), (1.6, 3, 1.2)), *boxes]


def _sheets() -> list[Part]:
    blind = shapes.sheet("blind", (-0.75, 1.05, -0.5), (0.6, 0, 0), (0, 0, 0.9), shapes.DARK)
    return [*room((-1, -0.5, -0.8), (1, 2, 0.8), hole=(0.15, 0.45, 0.05, 0.35)), blind]


def _harbour(away: float) -> list[Part]:
    return [
        ground(6.0, -0.5, 0.04),
        box("box.0", (0.5, 0.3, 0.6), (-0.3, away + 0.15, -0.2), RED, 15.0),
        box("box.1", (0.4, 0.3, 0.4), (0.45, away + 0.4, -0.3), GREY, -20.0),
    ]


TERRAIN = {"kind": "procedural", "size_m": 40, "resolution": 129, "relief_m": 2.0, "seed": 1, "material": "sand"}


def _pipes(**materials) -> dict:
    """Blocks of terrain, a pipe on two supports, and a boulder."""
    support = {"kind": "pipe_support", "radius": 0.15, "height": 0.6, "rotation_euler_deg": (0, 0, 90)}
    pipe = {"kind": "pipe", "radius": 0.15, "length": 3.0, "position": (0, 5, 0.25), "rotation_euler_deg": (0, 90, 0)}
    diffuse = {"sand": (0.45, 0.40, 0.32), "painted": (0.62, 0.42, 0.07), "steel": (0.45, 0.45, 0.47)}
    plain = {name: {"kind": "diffuse", "reflectance": reflectance} for name, reflectance in diffuse.items()}
    return {
        "materials": plain | materials,
        "terrain": TERRAIN,
        "objects": [
            pipe | {"material": "painted"},
            *(support | {"position": (x, 5, 0.25), "material": "steel"} for x in (-1, 1)),
            {"kind": "boulder", "diameter": 0.8, "seed": 5, "position": (0.9, 4.1, 0.0), "material": "sand"},
        ],
    }


BEFORE_PIPES, OVER_BOXES = ((-0.5, 2.4, 1.0), (0, 5, 0.2)), ((0, 0, 1.1), (0, 3, 0.2))
"""Places of the vehicle, and what it looks at."""
COLOURS = [(150.0, 15.0, 15.0), (15.0, 150.0, 15.0), (15.0, 15.0, 150.0), (120.0, 120.0, 15.0)]
AT_SHEETS = [
    spot((0.7, 0.5, 0.1), (0.2, 1, 0), 90.0),
    spot((-0.4, 1.3, 0.0), (-0.3, 1, 0.1), 100.0),
    spot((0.3, 2.25, 0.2), (0, -1, 0), 80.0),
]
"""A light 0.3 m from a wall, one behind a blind, one outside behind a hole."""
SCENES = {
    "paper_far": Case(
        "paper's water, a far rough floor, a pole beside a light",
        PAPER,
        paper_lamps(),
        lambda: [ground(20.0, -2.5, 0.25), pole("pole", (0.3, 0.25, -2.5), (0.3, 0.25, 1.0))],
        target=(0, 8, -1.5),
    ),
    "paper_room": Case(
        "paper's water, a closed room",
        PAPER,
        paper_lamps(),
        lambda: [*room((-2, -1.5, -1.2), (2, 4, 1.3)), box("box.0", (0.5, 0.5, 1.0), (-0.8, 2.8, -0.7), RED, 30.0)],
        target=(0.2, 3, -0.2),
    ),
    "paper_pipes": Case(
        "paper's water, terrain and pipes at two to three metres",
        PAPER,
        paper_lamps(),
        None,
        *BEFORE_PIPES,
        blocks=_pipes(),
    ),
    "coastal": Case(
        "rough floor and boxes, four tilted soft lights, sigma_t 0.7, g 0.87",
        water(0.7, 0.87),
        soft_lamps(),
        lambda: [ground(), *_boxes()],
        *OVER_BOXES,
    ),
    "coastal_pole": Case(
        "the same with a pole beside a light, sigma_t 0.4, g 0.86",
        water(0.4, 0.86),
        soft_lamps(),
        lambda: [ground(), *_boxes(), pole("pole", (0.5, 0.35, -0.2), (0.5, 0.35, 2.0))],
        *OVER_BOXES,
    ),
    "canyon": Case(
        "a canyon 1.1 m wide, sigma_t 0.5, g 0.85", water(0.5, 0.85), paper_lamps(), _canyon, target=(0, 4, -0.4)
    ),
    "coloured": Case(
        "four lights of four colours, coastal water",
        water(0.6, 0.85),
        soft_lamps(COLOURS),
        lambda: [ground(seed=6), *_boxes()],
        *OVER_BOXES,
    ),
    "open_coastal": Case("nothing but coastal water", water(0.7, 0.87), soft_lamps(), list),
    "closed_room": Case(
        "a closed room, sigma_t 1.8", water(1.8, 0.85, 0.8), soft_lamps(), _closed_room, target=(0, 2, -0.2)
    ),
    "sheets_turbid": Case(
        "a closed box of sheets: lights by a wall, behind a blind and a hole; sigma_t 4",
        water(4.0, 0.85, 0.9),
        AT_SHEETS,
        _sheets,
    ),
    "sheets": Case("the same, sigma_t 1", water(1.0, 0.85, 0.9), AT_SHEETS, _sheets),
    "facing_lamp": Case(
        "paper's water, a light that faces the camera",
        PAPER,
        [*paper_lamps(), spot((0.35, 2.5, 0.2), (-0.1, -1, -0.1), 80.0)],
        lambda: [ground(12.0, -1.0), box("box.0", (0.6, 0.6, 0.8), (-0.6, 3, -0.6), RED)],
    ),
    "standing_camera": Case(
        "a camera that stands in the world, a vehicle with lights passes it, sigma_t 0.3",
        water(0.3, 0.85),
        [spot((x, 0.05, 0.0), (0, 1, -0.15)) for x in (-0.15, 0.15)],
        lambda: [ground(), box("hull", (0.7, 0.35, 0.35), (-1.0, 0.3, 0.8), BLUE), *_boxes()],
        (-0.55, 0.3, 0.8),
        (2.0, 0.6, 0.5),
        view={"mount": "world", "position": (0.2, -2.6, 1.0), "look_at": (0.0, 0.5, 0.5)},
    ),
    "metal_lens": Case(
        "paper's water, thin lens; metal, rust and textures",
        PAPER,
        paper_lamps(),
        None,
        *BEFORE_PIPES,
        view={"f_stop": 1.7, "focus_m": 2.6},
        blocks=_pipes(
            sand={"kind": "slope_blend"},
            steel={"kind": "metal", "roughness": 0.25},
            painted={"kind": "rust", "amount": 0.5, "roughness": 0.35},
        ),
    ),
    "jerlov_1b": Case(
        "Jerlov IB over a floor",
        {"jerlov": {"type": "IB"}},
        paper_lamps(),
        lambda: [ground(15.0), *_boxes()],
        (0, -0.5, 1.3),
        (0, 3.5, 0.2),
    ),
    "jerlov_1c": Case(
        "Jerlov 1C, objects at two metres",
        {"jerlov": {"type": "1C"}},
        paper_lamps(),
        lambda: [ground(), *_boxes()],
        (0, 0.6, 0.9),
        (0, 2.6, 0.2),
    ),
    **{
        f"jerlov_{kind.lower()}": Case(
            f"Jerlov {kind}, the subject 1.5 attenuation lengths away",
            {"jerlov": {"type": kind}},
            paper_lamps(),
            lambda away=away: _harbour(away),
            target=(0, away, -0.2),
        )
        for kind, away in (("3C", 1.8), ("5C", 1.0))
    },
}
"""By name."""
