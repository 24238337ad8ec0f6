"""Dissimilar scenes for image A: near and far, open and closed, clear and turbid.

Each scene is a function of the resolution, built in memory; `build` finds it by name.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmarks.light.shapes import (
    BLUE,
    DARK,
    GREY,
    PAPER,
    RED,
    box,
    ground,
    paper_lamps,
    pole,
    room,
    rough_sheet,
    sheet,
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


SCENES: dict[str, tuple[str, Callable]] = {}
"""Title and function of each."""


def _named(title: str):
    """Enter a function under its own name."""

    def enter(function):
        SCENES[function.__name__] = (title, function)
        return function

    return enter


def build(name: str, resolution=RESOLUTION) -> Built:
    """A scene by name, or an `InputError` where there is none."""
    require_known(name, SCENES, "there is no such scene", key="--scenes")
    return SCENES[name][1](resolution)


def _assemble(resolution, medium, lights, parts, eye=(0, 0, 0), target=None, **blocks) -> Built:
    """A vehicle at ``eye`` that looks at ``target``, forward where that is absent; ``parts`` None: as blocks say."""
    view = {
        "id": "M0",
        "resolution": tuple(resolution),
        "focal_mm": FOCAL_MM,
        "sensor_mm": (TALL_MM * resolution[0] / resolution[1], TALL_MM),
    } | blocks.pop("view", {})
    pose = {"position": tuple(eye)} | ({} if target is None else {"look_at": tuple(target)})
    scene = Scene(water=medium, vehicle={"lights": lights, "cameras": [view]}, trajectory={"poses": [pose]}, **blocks)
    T_w_v = transform(None if target is None else look_at_matrix(eye, target), eye)
    return Built(scene, build_parts(scene) if parts is None else parts, T_w_v)


def _boxes() -> list[Part]:
    """What lies on the ground three metres ahead."""
    return [
        box("box.0", (0.6, 0.5, 0.5), (-0.7, 2.6, 0.25), RED, 20.0),
        box("box.1", (0.4, 0.4, 0.9), (0.6, 3.2, 0.45)),
        box("box.2", (0.3, 0.8, 0.3), (0.2, 2.1, 0.15), BLUE, -35.0),
        box("box.3", (1.2, 0.3, 0.6), (0.1, 4.4, 0.3)),
    ]


def _pipes() -> list[dict]:
    """A pipe on two supports, and a boulder."""
    return [
        {
            "kind": "pipe",
            "radius": 0.15,
            "length": 3.0,
            "position": (0, 5, 0.25),
            "rotation_euler_deg": (0, 90, 0),
            "material": "painted",
        },
        *(
            {
                "kind": "pipe_support",
                "radius": 0.15,
                "height": 0.6,
                "position": (x, 5, 0.25),
                "rotation_euler_deg": (0, 0, 90),
                "material": "steel",
            }
            for x in (-1, 1)
        ),
        {"kind": "boulder", "diameter": 0.8, "seed": 5, "position": (0.9, 4.1, 0.0), "material": "sand"},
    ]


PLAIN = {
    "sand": {"kind": "diffuse", "reflectance": (0.45, 0.40, 0.32)},
    "painted": {"kind": "diffuse", "reflectance": (0.62, 0.42, 0.07)},
    "steel": {"kind": "diffuse", "reflectance": (0.45, 0.45, 0.47)},
}
TERRAIN = {"kind": "procedural", "size_m": 40, "resolution": 129, "relief_m": 2.0, "seed": 1, "material": "sand"}


# ------------------------------------------------------------------------------------------------- the paper's water


@_named("paper's water, a far rough floor, a pole beside a light")
def paper_far(resolution=RESOLUTION) -> Built:
    parts = [ground(20.0, -2.5, 0.25), pole("pole", (0.3, 0.25, -2.5), (0.3, 0.25, 1.0))]
    return _assemble(resolution, PAPER, paper_lamps(), parts, target=(0, 8, -1.5))


@_named("paper's water, a closed room")
def paper_room(resolution=RESOLUTION) -> Built:
    parts = [*room((-2, -1.5, -1.2), (2, 4, 1.3)), box("box.0", (0.5, 0.5, 1.0), (-0.8, 2.8, -0.7), RED, 30.0)]
    return _assemble(resolution, PAPER, paper_lamps(), parts, target=(0.2, 3, -0.2))


def _before_pipes(resolution, **blocks) -> Built:
    """Terrain and pipes in the paper's water, two to three metres ahead."""
    pose = (-0.5, 2.4, 1.0), (0, 5, 0.2)
    return _assemble(resolution, PAPER, paper_lamps(), None, *pose, terrain=TERRAIN, objects=_pipes(), **blocks)


@_named("paper's water, terrain and pipes at two to three metres")
def paper_pipes(resolution=RESOLUTION) -> Built:
    return _before_pipes(resolution, materials=PLAIN)


# --------------------------------------------------------------------------------------------------------- coastal


@_named("rough floor and boxes, four tilted soft lights, sigma_t 0.7, g 0.87")
def coastal(resolution=RESOLUTION) -> Built:
    return _assemble(resolution, water(0.7, 0.87), soft_lamps(), [ground(), *_boxes()], (0, 0, 1.1), (0, 3, 0.2))


@_named("the same with a pole beside a light, sigma_t 0.4, g 0.86")
def coastal_pole(resolution=RESOLUTION) -> Built:
    parts = [ground(), *_boxes(), pole("pole", (0.5, 0.35, -0.2), (0.5, 0.35, 2.0))]
    return _assemble(resolution, water(0.4, 0.86), soft_lamps(), parts, (0, 0, 1.1), (0, 3, 0.2))


@_named("a canyon 1.1 m wide, sigma_t 0.5, g 0.85")
def canyon(resolution=RESOLUTION) -> Built:
    along, up = (0, 16, 0), (0, 0, 4)
    parts = [
        rough_sheet("left", (-0.55, -2, -1), along, up, 0.04, 60, 2),
        ground(12.0, -0.9, 0.05, 3),
        rough_sheet("right", (0.55, -2, -1), up, along, 0.04, 60, 4),
        box("box.0", (0.3, 0.3, 0.6), (0.2, 3, -0.6), RED),
    ]
    return _assemble(resolution, water(0.5, 0.85), paper_lamps(), parts, target=(0, 4, -0.4))


@_named("four lights of four colours, coastal water")
def coloured(resolution=RESOLUTION) -> Built:
    colours = [(150.0, 15.0, 15.0), (15.0, 150.0, 15.0), (15.0, 15.0, 150.0), (120.0, 120.0, 15.0)]
    return _assemble(
        resolution, water(0.6, 0.85), soft_lamps(colours), [ground(seed=6), *_boxes()], (0, 0, 1.1), (0, 3, 0.2)
    )


@_named("nothing but coastal water")
def open_coastal(resolution=RESOLUTION) -> Built:
    return _assemble(resolution, water(0.7, 0.87), soft_lamps(), [])


# --------------------------------------------------------------------------------------------------------- confined


@_named("a closed room, sigma_t 1.8")
def closed_room(resolution=RESOLUTION) -> Built:
    parts = [
        *room((-1.6, -1, -1), (1.6, 3, 1.2)),
        box("box.0", (0.5, 0.5, 0.9), (-0.6, 1.9, -0.55), RED, 25.0),
        box("box.1", (0.4, 0.4, 0.4), (0.6, 1.4, -0.8), GREY, -15.0),
    ]
    return _assemble(resolution, water(1.8, 0.85, 0.8), soft_lamps(), parts, target=(0, 2, -0.2))


def _sheets(resolution, sigma_t: float) -> Built:
    """A light 0.3 m from a wall, one behind a blind, one outside behind a hole."""
    lamps = [
        spot((0.7, 0.5, 0.1), (0.2, 1, 0), 90.0),
        spot((-0.4, 1.3, 0.0), (-0.3, 1, 0.1), 100.0),
        spot((0.3, 2.25, 0.2), (0, -1, 0), 80.0),
    ]
    parts = [
        *room((-1, -0.5, -0.8), (1, 2, 0.8), hole=(0.15, 0.45, 0.05, 0.35)),
        sheet("blind", (-0.75, 1.05, -0.5), (0.6, 0, 0), (0, 0, 0.9), DARK),
    ]
    return _assemble(resolution, water(sigma_t, 0.85, 0.9), lamps, parts)


@_named("a closed box of sheets: lights by a wall, behind a blind and a hole; sigma_t 4")
def sheets_turbid(resolution=RESOLUTION) -> Built:
    return _sheets(resolution, 4.0)


@_named("the same, sigma_t 1")
def sheets(resolution=RESOLUTION) -> Built:
    return _sheets(resolution, 1.0)


# ------------------------------------------------------------------------------------------------ cameras and lights


@_named("paper's water, a light that faces the camera")
def facing_lamp(resolution=RESOLUTION) -> Built:
    lamps = [*paper_lamps(), spot((0.35, 2.5, 0.2), (-0.1, -1, -0.1), 80.0)]
    parts = [ground(12.0, -1.0), box("box.0", (0.6, 0.6, 0.8), (-0.6, 3, -0.6), RED)]
    return _assemble(resolution, PAPER, lamps, parts)


@_named("a camera that stands in the world, a vehicle with lights passes it, sigma_t 0.3")
def standing_camera(resolution=RESOLUTION) -> Built:
    view = {"mount": "world", "position": (0.2, -2.6, 1.0), "look_at": (0.0, 0.5, 0.5)}
    hull = box("hull", (0.7, 0.35, 0.35), (-1.0, 0.3, 0.8), BLUE)
    lamps = [spot((x, 0.05, 0.0), (0, 1, -0.15)) for x in (-0.15, 0.15)]
    return _assemble(
        resolution, water(0.3, 0.85), lamps, [ground(), hull, *_boxes()], (-0.55, 0.3, 0.8), (2.0, 0.6, 0.5), view=view
    )


@_named("paper's water, thin lens; metal, rust and textures")
def metal_lens(resolution=RESOLUTION) -> Built:
    materials = PLAIN | {
        "sand": {"kind": "slope_blend"},
        "steel": {"kind": "metal", "roughness": 0.25},
        "painted": {"kind": "rust", "amount": 0.5, "roughness": 0.35},
    }
    return _before_pipes(resolution, materials=materials, view={"f_stop": 1.7, "focus_m": 2.6})


# --------------------------------------------------------------------------------------------- water as it was measured


@_named("Jerlov IB over a floor")
def jerlov_1b(resolution=RESOLUTION) -> Built:
    return _assemble(
        resolution, {"jerlov": {"type": "IB"}}, paper_lamps(), [ground(15.0), *_boxes()], (0, -0.5, 1.3), (0, 3.5, 0.2)
    )


@_named("Jerlov 1C, objects at two metres")
def jerlov_1c(resolution=RESOLUTION) -> Built:
    return _assemble(
        resolution, {"jerlov": {"type": "1C"}}, paper_lamps(), [ground(), *_boxes()], (0, 0.6, 0.9), (0, 2.6, 0.2)
    )


def _harbour(resolution, kind: str, away: float) -> Built:
    parts = [
        ground(6.0, -0.5, 0.04),
        box("box.0", (0.5, 0.3, 0.6), (-0.3, away + 0.15, -0.2), RED, 15.0),
        box("box.1", (0.4, 0.3, 0.4), (0.45, away + 0.4, -0.3), GREY, -20.0),
    ]
    return _assemble(resolution, {"jerlov": {"type": kind}}, paper_lamps(), parts, target=(0, away, -0.2))


@_named("Jerlov 3C, the subject 1.5 attenuation lengths away")
def jerlov_3c(resolution=RESOLUTION) -> Built:
    return _harbour(resolution, "3C", 1.8)


@_named("Jerlov 5C, the subject 1.5 attenuation lengths away")
def jerlov_5c(resolution=RESOLUTION) -> Built:
    return _harbour(resolution, "5C", 1.0)
