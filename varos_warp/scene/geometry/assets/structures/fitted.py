"""A bolted pair of flanges, a hand wheel, and a cast block with lifting eyes."""

import numpy as np

from varos_warp.scene.description.fittings import ConcreteBlock, FlangeJoint, HandWheel
from varos_warp.scene.description.world import Flange
from varos_warp.scene.geometry.assets.lofts import Detail, circle_points, lathe, rounded
from varos_warp.scene.geometry.assets.pipes import BORE, GASKET, flange, flange_measures
from varos_warp.scene.geometry.assets.slabs import box
from varos_warp.scene.geometry.assets.structures.hardware import ACROSS, bent_bar, hexagon, ring, rod, studs
from varos_warp.scene.geometry.assets.structures.pieces import Piece, chosen, placed

STEEL, RUBBER, BARE, RED = (0.12, 0.1, 0.085), (0.03, 0.03, 0.03), (0.13, 0.11, 0.09), (0.2, 0.03, 0.02)
CONCRETE = (0.13, 0.12, 0.1)
DOWN = np.diag([1.0, -1.0, -1.0])
NECK = 0.9
"""Length of a flange's welding neck, in thicknesses of the flange."""
EYE, EYE_HEIGHT, EYE_BEND = 0.008, 0.14, 0.045
"""Radius of the bar of lifting eyes, how high they stand, and the radius of their bend [m]."""


def flange_joint(block: FlangeJoint, key: str, detail: Detail) -> list[Piece]:
    """Flanges, gasket and bolts of a joint, each a closed solid."""
    r = block.radius
    _, circle, hole, count, thick = flange_measures(r)
    gap = GASKET * thick
    neck_low, neck_high, weld = 0.6 * thick, (1.0 + NECK) * thick, 1.06 * r
    inner = BORE * r
    shoulder = min(1.0 * r + 0.9 * thick, circle - 1.15 * ACROSS * hole)
    neck = [(inner, neck_low), (shoulder, neck_low), (shoulder, 1.1 * thick), (weld, neck_high), (inner, neck_high)]
    halves = [
        flange(Flange(kind="flange", radius=r), key, detail),
        lathe(rounded(neck, 0.04 * thick, detail, closed=True), detail, circle_points(shoulder, detail), closed=True),
    ]
    flanges = [placed(mesh, axes, (0.0, 0.0, 0.5 * gap * axes[2, 2])) for mesh in halves for axes in (np.eye(3), DOWN)]
    rim = circle - 1.2 * hole
    seal = [(inner, -0.55 * gap), (rim, -0.55 * gap), (rim, 0.55 * gap), (inner, 0.55 * gap)]
    gasket = lathe(rounded(seal, 0.2 * gap, detail, closed=True), detail, circle_points(rim, detail), closed=True)
    return chosen(
        {
            "flanges": [(STEEL, mesh) for mesh in flanges],
            "gasket": [(RUBBER, gasket)],
            "bolts": [(BARE, mesh) for mesh in studs(circle, hole, count, thick + 0.5 * gap, detail)],
        },
        block.only,
    )


def hand_wheel(block: HandWheel, key: str, detail: Detail) -> list[Piece]:
    """Rim, spokes, hub, nut and stem, each a closed solid."""
    rim = 0.055 * block.radius
    middle, dish, hub = block.radius - rim, 0.18 * block.radius, 0.15 * block.radius
    boss = [
        (0.0, -dish - hub),
        (0.8 * hub, -dish - hub),
        (hub, -dish),
        (0.75 * hub, 0.5 * hub - dish),
        (0.0, 0.5 * hub - dish),
    ]
    meshes = [
        ring(middle, rim, detail),
        lathe(rounded(boss, 0.15 * hub, detail), detail, circle_points(hub, detail)),
        hexagon(0.9 * hub, 0.49 * hub - dish, 0.95 * hub - dish, detail),
    ]
    # spokes are bent: level from the hub, then up to the rim
    line = np.array([(0.4 * hub, -dish - 0.25 * hub), (0.45 * middle, -dish - 0.1 * hub), (middle, 0.0)])
    spoke = bent_bar(line, 0.3 * middle, 0.7 * rim, detail)
    for angle in 2.0 * np.pi / block.spokes * np.arange(block.spokes):
        c, s = np.cos(angle), np.sin(angle)
        meshes.append(placed(spoke, [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
    pieces = [Piece("wheel", RED, *mesh) for mesh in meshes]
    if block.stem_m > 0.0:
        stem = rod(0.45 * hub, -dish - 0.9 * hub - block.stem_m, -dish, detail)
        pieces.append(Piece("stem", STEEL, *stem))
    return pieces


def concrete_block(block: ConcreteBlock, key: str, detail: Detail) -> list[Piece]:
    """The block and its lifting eyes, each a closed solid."""
    x, y, z = block.size_m
    edge = min(block.chamfer_m, 0.2 * min(block.size_m))
    body = box((-0.5 * x, -0.5 * y, 0.0), (0.5 * x, 0.5 * y, z), edge, detail)
    bend, foot = EYE_BEND, z - 0.08
    line = np.array([(-bend, foot), (-bend, z + EYE_HEIGHT), (bend, z + EYE_HEIGHT), (bend, foot)])
    eye = bent_bar(line, 0.95 * bend, EYE, detail)
    places = x * ((0.5 + np.arange(block.eyes)) / max(block.eyes, 1) - 0.5)
    return chosen(
        {"block": [(CONCRETE, body)], "eyes": [(STEEL, placed(eye, None, (at, 0.0, 0.0))) for at in places]}, block.only
    )
