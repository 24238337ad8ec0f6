"""Dissimilar scenes with things that masks of textures cut into strips, each as mesh files with masks and without.

Alpha jumps between columns of texels and is blended along a line from the middle of one to that of the next, so that
strips of triangles can end just where the blend is the cutoff: both files are the same surface (`TWINS`). Of
``painted`` the surface is whole, and colours are what differs: a texture times factors times colours of vertices, or a
plain reflectance for every part.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from benchmarks.light.scenes import Built
from benchmarks.light.shapes import BLUE, PAPER, RED, box, ground, room, soft_lamps, spot, water
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import look_at_matrix, transform
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.parts import Part

TWINS = ("textured", "plain")
"""With mesh files' textures, and the same as triangles with a reflectance."""
SOLID = np.repeat([1, 0, 1, 0, 1, 0, 1], [1, 2, 1, 1, 3, 2, 2]).astype(bool)
"""Of the columns of texels."""
FACTOR = (0.6, 0.4, 0.2)
"""Reflectance of what is cut: of a white texture."""
NOW_S = 0.5
"""Time of the frame."""
PAINTS = np.array([[[255, 255, 255], [255, 255, 0]], [[255, 0, 255], [0, 255, 255]]], np.uint8)
"""Rows from the top. Textures keep reflectances to 10 or 11 bits: of these, exactly."""
TINTS = np.array([[255, 255, 255], [255, 128, 64], [90, 160, 255]], np.uint8)
"""Colours of vertices, linear."""


# ------------------------------------------------------------------------------------------------------- mesh files


def _cut(path: Path, sheets: np.ndarray, times: int, cutoff: float) -> None:
    """Parallelograms [N, 3, 3] (corner, u, v) of a few askew triangles each, with stripes along v cut out.

    The texture repeats ``times`` along u. The sixth is whole, by a material without any.
    """
    u, v = (grid.ravel() for grid in np.meshgrid([0.0, 0.37, 0.71, 1.0], [0.0, 0.4, 1.0], indexing="ij"))
    inner = (u > 0.0) & (u < 1.0) & (v > 0.0) & (v < 1.0)
    st = np.column_stack([u, v + inner * (0.3 - 0.5 * u)])
    cells = np.array([[i, i + 3, i + 4, i + 1] for i in range(8) if i % 3 < 2])
    faces = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    texels = np.full((4, len(SOLID), 4), 255, np.uint8)
    texels[..., 3] *= SOLID
    material = PBRMaterial(
        baseColorTexture=Image.fromarray(texels), baseColorFactor=[*FACTOR, 1.0], alphaMode="MASK", alphaCutoff=cutoff
    )
    whole = PBRMaterial(baseColorFactor=[*FACTOR, 1.0])
    pieces = [
        trimesh.Trimesh(
            corner + st @ axes,
            faces,
            process=False,
            visual=TextureVisuals(st * [times, 1], material=material if k < 5 else whole),
        )
        for k, (corner, *axes) in enumerate(sheets)
    ]
    trimesh.Scene(pieces).export(path)


def _strips(path: Path, sheets: np.ndarray, times: int, cutoff: float) -> None:
    """What the mask leaves, as two triangles a strip; the middle of the blend is where the texels meet."""
    solid = np.tile(SOLID, times)
    jumps = np.flatnonzero(np.diff(np.concatenate([[0], solid, [0]]))).reshape(-1, 2)
    ends = np.clip((jumps + (0.5 - cutoff) * np.array([-1, 1])) / len(solid), 0.0, 1.0)
    corners = np.array(
        [
            corner + s * u + t * v
            for k, (corner, u, v) in enumerate(sheets)
            for a, b in (ends if k < 5 else [(0, 1)])
            for s, t in ((a, 0), (b, 0), (b, 1), (a, 1))
        ]
    )
    faces = 4 * np.arange(len(corners) // 4)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    trimesh.Trimesh(corners, faces.reshape(-1, 3), process=False).export(path)


BOARD = np.array([[[-0.8, 0, -0.6], [1.6, 0, 0], [0, 0, 1.2]]])
X, Y, Z = 0.5 * np.eye(3)
BOX = np.array(
    [
        (o - 0.5 * (X + Y + Z), u, v)
        for o, u, v in ((0 * X, X, Z), (Y, X, Z), (0 * X, Y, Z), (X, Z, Y), (0 * X, X, Y), (Z, Y, X))
    ]
)
"""Closed but for its stripes, 0.5 m wide, its top whole."""


def _files(folder: Path, twin: str) -> None:
    write = _cut if twin == "textured" else _strips
    write(folder / "board.glb", BOARD, 2, 0.5)
    write(folder / "box.glb", BOX, 1, 0.25)


def _painted(folder: Path, twin: str) -> list[Part]:
    """A rough floor in twelve colours, each face with one texel's and one of its corners'."""
    floor, rng = ground(cells=40, relief=0.12), np.random.default_rng(3)
    paint, tint = rng.integers(4, size=len(floor.faces)), rng.integers(3, size=len(floor.faces))
    if twin == "plain":
        colours = FACTOR * (PAINTS.reshape(-1, 1, 3) / 255.0) * (TINTS / 255.0)
        return [
            replace(
                floor,
                name=f"floor.{i}",
                faces=floor.faces[3 * paint + tint == i],
                material=Diffuse(reflectance=tuple(colours.reshape(12, 3)[i])),
            )
            for i in range(12)
        ]
    corners = floor.vertices[floor.faces].reshape(-1, 3)
    texels = Image.fromarray(PAINTS.repeat(64, 0).repeat(64, 1))
    middles = np.array([[0.25, 0.75], [0.75, 0.75], [0.25, 0.25], [0.75, 0.25]])
    uv = middles[paint][:, None] + 0.01 * np.array([[0, 0], [1, 0], [0, 1]])
    visual = TextureVisuals(
        uv.reshape(-1, 2), material=PBRMaterial(baseColorTexture=texels, baseColorFactor=[*FACTOR, 1.0])
    )
    visual.vertex_attributes["color"] = np.insert(TINTS[tint].repeat(3, 0), 3, 255, axis=1)
    mesh = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), visual=visual, process=False)
    mesh.export(folder / "floor.glb")
    return []


# ------------------------------------------------------------------------------------------------------------ scenes

TERRAIN = {"kind": "procedural", "size_m": 30, "resolution": 65, "relief_m": 1.0, "seed": 1, "position": [0, 0, -1.2]}
PRINCIPLED = {
    "principled": {
        "density": 0.125,
        "color": [0.014, 0.146, 0.345],
        "absorption_color": [0, 0.394, 1.0],
        "anisotropy": 0.8,
    }
}


def board(position, turn=(4, 0, 0), **more) -> dict:
    """Across the view, 1.6 m wide; always tilted, for where a normal is level rounding turns what is drawn about it."""
    return {"file": "board.glb", "position": position, "rotation_euler_deg": turn, **more}


def cage(position, turn=(20, 10, 30), **more) -> dict:
    """The box."""
    return board(position, turn, file="box.glb", **more)


def passing(start, end, thing=board, turns=(0, 20), **more) -> dict:
    """One that moves, in a second."""
    stops = [
        {"time_s": t, "position": place, "rotation_euler_deg": (5, 0, turn)}
        for t, place, turn in zip((0, 1), (start, end), turns, strict=True)
    ]
    return thing(start, path=stops, **more)


def _copies(count, area) -> list[dict]:
    thing = {"file": "box.glb", "rotation_euler_deg": (20, 10, 30)}
    return [{"object": thing, "count": count, "area": area, "scale_range": (0.6, 1.6), "sink_m": -0.1}]


SCENES: dict[str, tuple[str, Callable[[], dict]]] = {
    "open": (
        "paper's open water, a spot, boards and boxes still, copied and moving",
        lambda: {
            "water": PRINCIPLED,
            "terrain": TERRAIN,
            "scatter": _copies(12, (-2, 1.5, 2, 5)),
            "lights": [spot((0.2, -0.1, 0.1))],
            "objects": [
                board((-0.5, 2.3, 0.3), (8, 5, 25)),
                cage((0.5, 1.8, -0.35)),
                passing((0.6, 3.0, 0.2), (1.0, 3.2, 0.4)),
            ],
        },
    ),
    "coastal": (
        "Jerlov 3C, four tilted soft lamps over a rough floor",
        lambda: {
            "water": {"jerlov": {"type": "3C"}},
            "lights": soft_lamps(),
            "eye": (0, 0, 1.1),
            "target": (0, 2.6, 0.2),
            "objects": [
                board((-0.3, 2.1, 0.35), (20, 0, -30)),
                cage((0.5, 1.5, 0.4)),
                board((0.5, 2.9, 0.4), (5, 80, 10)),
            ],
            "parts": [ground(relief=0.12), box("box.0", (0.6, 0.5, 0.5), (-0.7, 3.0, 0.25), RED, 20.0)],
        },
    ),
    "turbid_room": (
        "a closed room, sigma_t 1.8, lamps within",
        lambda: {
            "water": water(1.8, 0.85, 0.8),
            "lights": [*soft_lamps(), spot((0.6, 1.9, 0.4), (-0.5, -0.2, -0.3), 110.0)],
            "target": (0, 2, -0.2),
            "objects": [board((0.1, 1.5, 0.0), (5, 0, 20)), cage((-0.5, 1.0, -0.3))],
            "parts": room((-1.2, -0.8, -0.9), (1.2, 2.4, 0.9)),
        },
    ),
    "world_camera": (
        "a camera that stands in the world watches a vehicle behind a board, sigma_t 0.3",
        lambda: {
            "water": water(0.3, 0.85),
            "lights": [spot((x, 0.05, 0.0), (0, 1, -0.15)) for x in (-0.15, 0.15)],
            "eye": (-0.55, 0.3, 0.8),
            "target": (2.0, 0.6, 0.5),
            "view": {"mount": "world", "position": (0.2, -2.6, 1.0), "look_at": (0.0, 0.5, 0.5)},
            "objects": [
                board((-0.4, -0.6, 0.8), (3, 10, -15)),
                board((0.9, 0.6, 0.7), (4, 0, 75)),
                cage((0.4, 1.3, 0.4)),
            ],
            "parts": [ground(), box("hull", (0.7, 0.35, 0.35), (-1.0, 0.3, 0.8), BLUE)],
        },
    ),
    "lamp_in_view": (
        "paper's water, a lamp that faces the camera behind a board",
        lambda: {
            "water": PAPER,
            "lights": [spot((0.15, -0.1, 0.0)), spot((0.35, 3.0, 0.2), (-0.1, -1, -0.1), 80.0)],
            "objects": [board((0.2, 2.0, 0.1), (3, 25, 10)), cage((-0.5, 1.6, -0.2))],
            "parts": [ground(12.0, -1.0), box("box.0", (0.6, 0.6, 0.8), (-0.8, 3, -0.6), RED)],
        },
    ),
    "shutter": (
        "boards and a box that move and turn while a shutter is open, sigma_t 0.4",
        lambda: {
            "water": water(0.4, 0.86),
            "lights": soft_lamps(),
            "eye": (0, 0, 1.1),
            "target": (0, 3, 0.2),
            "view": {"shutter": {"exposure_s": 0.15}},
            "parts": [ground()],
            "objects": [
                passing((-0.6, 2.0, 0.4), (0.4, 2.2, 0.6)),
                board((0.2, 3.0, 0.4), (4, 0, 5)),
                passing((0.8, 1.6, 0.3), (0.2, 1.7, 0.7), cage, (0, 90)),
            ],
        },
    ),
    "shafts": (
        "a lamp behind a board, its shafts across the view, coastal water",
        lambda: {
            "water": water(0.35, 0.87),
            "lights": [spot((-1.8, 2.2, 0.3), (1, 0, 0), 80.0, 0.15, (300.0,) * 3)],
            "objects": [board((-1.0, 2.2, 0.3), (5, -85, -75)), cage((0.7, 2.2, 0.2))],
            "parts": [ground(12.0, -0.8)],
        },
    ),
    "painted": (
        "a texture times factors times colours of vertices; as coastal",
        lambda: {
            "water": {"jerlov": {"type": "3C"}},
            "lights": soft_lamps(),
            "eye": (0, 0, 1.1),
            "target": (0, 2.6, 0.2),
            "objects": [],
            "painted": True,
        },
    ),
}


def build(name: str, twin: str, folder: Path, resolution: tuple[int, int]) -> Built:
    """A scene by name, whose mesh files are written into a folder."""
    given = SCENES[name][1]()
    folder = folder / twin
    folder.mkdir(parents=True, exist_ok=True)
    _files(folder, twin)
    more = _painted(folder, twin) if given.pop("painted", False) else given.pop("parts", [])
    if (folder / "floor.glb").exists():
        given["objects"].append({"file": "floor.glb"})
    for block in [*given["objects"], *(group["object"] for group in given.get("scatter", []))]:
        block |= {"up": "z"} | ({} if twin == "textured" else {"material": "cut"})
    view = {
        "resolution": resolution,
        "focal_mm": 4.0,
        "sensor_mm": (3.5 * resolution[0] / resolution[1], 3.5),
    } | given.pop("view", {})
    pose = {"position": given.pop("eye", (0, 0, 0)), "look_at": given.pop("target", (0, 3, 0))}
    scene = scene_from_dict(
        {
            "vehicle": {"lights": given.pop("lights"), "cameras": [view]},
            "trajectory": {"poses": [pose]},
            "materials": {"cut": {"kind": "diffuse", "reflectance": FACTOR}},
            **given,
        },
        folder,
    )
    T_w_v = transform(look_at_matrix(pose["position"], pose["look_at"]), pose["position"])
    return Built(scene, [*build_parts(scene), *more], T_w_v)
