"""Blocks of ``growth`` become copies on the parts of a scene."""

import itertools
from dataclasses import replace

import numpy as np

from varos_warp.cache import cached, code_hash
from varos_warp.device.launch import in_threads
from varos_warp.errors import warn
from varos_warp.scene.description import Scene
from varos_warp.scene.description.surfaces import Layered
from varos_warp.scene.geometry.growth.chance import uniform
from varos_warp.scene.geometry.growth.coat import Placed, coated
from varos_warp.scene.geometry.growth.hosts import REACH_M, Carrier
from varos_warp.scene.geometry.growth.kinds import SMOOTH, Kind, prototypes
from varos_warp.scene.geometry.growth.levels import LEVELS, level_of
from varos_warp.scene.geometry.growth.placing import COLUMNS, LEAST_PIXELS, Rooted, Wanted, joined, rooted
from varos_warp.scene.geometry.growth.spacing import apart
from varos_warp.scene.geometry.normals import UP
from varos_warp.scene.geometry.parts import Grown, Instances, Part, Skin
from varos_warp.scene.geometry.relief.density import Footprint, footprint

MANY_TRIANGLES = 4_000_000
"""A block with more is told of; on a GPU all copies of a scene join one mesh up to twice as many."""

SURFACE = Layered(kind="layered", grain=0.2)
"""How all that grows scatters light: rough and grained, in the colours that it has."""

ALONE = 1.2
"""Range of the tints of copies in one clump, in tints."""
LEVEL = 0.95
"""Vertical part of the normal from which copies with silt turn at random, for there silt has no side."""

CURRENT = np.array([0.8, 0.55, 0.1])
"""Mean direction in which the water moved while things grew."""
EDDIES = 1.8
"""Range of that direction from copy to copy [rad]."""


def grow(scene: Scene, parts: list[Part | Instances]) -> list[Part | Instances]:
    """The parts, coated where something grows, and copies for every block of ``growth``, by shape and tint.

    Args:
        scene: The scene.
        parts: All that things may grow on.

    Raises:
        InputError: A block asks for too many.
    """
    if not scene.growth:
        return parts
    near = footprint(scene, parts)
    named = {name for block in scene.growth for name in block.on}
    carriers = {part.name: [] for part in parts if part.name in named}
    for part in parts:
        if part.name in named:
            carriers[part.name].append(Carrier(part, near))
    blocks = [Wanted(block, f"growth.{i}", scene.seed, scene.surface_depth_m) for i, block in enumerate(scene.growth)]

    def place(wanted):
        return _placed(wanted, [carrier for name in wanted.block.on for carrier in carriers[name]], near)

    placed = in_threads(place, blocks)
    groups = [group for wanted, some in zip(blocks, placed, strict=True) for group in _groups(wanted, some)]
    return [*coated(parts, [(wanted.kind, some) for wanted, some in zip(blocks, placed, strict=True)]), *groups]


def _placed(wanted: Wanted, carriers: list[Carrier], near: Footprint) -> Placed:
    """The copies of a block; from the user's cache where they were placed before."""
    depends_on = {
        "block": wanted.block.model_dump(mode="json"),
        "seed": wanted.seed,
        "surface_depth_m": wanted.surface_depth_m,
        "hosts": [carrier.digest for carrier in carriers],
        "cameras": near.digest,
        "code": code_hash(__name__, ("varos_warp.scene.geometry", "varos_warp.kernels.mesh")),
    }
    kept = cached("growth", depends_on, lambda: _place(wanted, carriers, near))
    if (most := float(kept["most"])) < wanted.per_m2:
        about = float(f"{most:.2g}")  # which :g writes without an exponent
        warn(
            f"{wanted.key}.per_m2: no {wanted.per_m2:g} {wanted.block.kind} of {wanted.size_m[0]:g} to "
            f"{wanted.size_m[1]:g} m find room on a square metre, but about {about:g}, and no more are placed; "
            "lower it, or size_m"
        )
    return Placed(
        kept["names"].tolist(), kept["silt"], Rooted(*(kept[name] for name in COLUMNS), float(kept["too_small"]))
    )


def _place(wanted, carriers, near):
    """`_placed`, as arrays."""
    names, silt, found = [], [], []
    for number, host in enumerate(host for carrier in carriers for host in carrier.hosts()):
        names.append(host.name)
        silt.append(host.silt)
        found.append(rooted(wanted, host, number, near))
    copies = joined(found)
    # the larger stays, so that what is too small to be placed would not have driven out any that is
    priority = np.argsort(np.lexsort([copies.keys, copies.size])).astype(np.uint64)
    copies = copies.of(apart(copies.points, copies.size, wanted.kind.body, priority))
    most = wanted.per_m2 if wanted.filling is None else wanted.filling.most
    return {
        "names": np.array(names, str),
        "silt": np.array(silt, float),
        "too_small": np.array(copies.too_small),
        "most": np.array(most),
    } | {name: getattr(copies, name) for name in COLUMNS}


def _groups(wanted: Wanted, placed: Placed) -> list[Grown]:
    """The copies of one block, by their shapes and tints, and by how fine they are."""
    names, copies = placed.names, placed.copies
    if not len(copies.size):
        why = (
            "its per_m2 is 0"
            if wanted.per_m2 == 0.0
            else f"all of about {copies.too_small:.0f} would be smaller than {LEAST_PIXELS:g} pixels"
            if copies.too_small >= 1.0
            else f"no surface of its hosts within {REACH_M:g} m of the course is as it asks, or chance leaves none"
        )
        warn(f"{wanted.key}: no {wanted.block.kind} is placed: {why}")
        return []
    shapes, groups, first = prototypes(wanted.block.kind), [], 0
    silted = _silted(placed)
    which, poses = _which(copies, wanted.kind, silted), _poses(copies, wanted.kind, silted)
    level = level_of(copies.pixels)
    for k, fine in itertools.product(range(len(shapes)), range(len(LEVELS) + 1)):
        chosen, solid = np.flatnonzero((which == k) & (level == fine)), shapes[k][fine]
        if len(chosen):
            groups.append(
                Grown(
                    wanted.key,
                    solid.vertices,
                    solid.faces,
                    SURFACE,
                    poses[chosen],
                    first + np.arange(len(chosen)),
                    smooth_angle=SMOOTH,
                    normals=solid.normals,
                    smooth_shading=True,
                    skin=Skin(solid.corners),
                    hosts=tuple(names),
                    host=copies.host[chosen],
                )
            )
            first += len(chosen)
    facts = _facts(wanted, names, copies, sum(len(group) * len(group.faces) for group in groups))
    return [replace(groups[0], facts=facts), *groups[1:]]


def _facts(wanted: Wanted, names: list[str], copies: Rooted, triangles: int) -> dict:
    """What there is to say of a block: how many copies, how fine, on what, and how many are too small to be seen."""
    if triangles > MANY_TRIANGLES:
        warn(
            f"{wanted.key}: {len(copies.size)} copies of {wanted.block.kind} have {triangles / 1e6:.1f} million "
            f"triangles, which take memory and time; lower per_m2 ({wanted.per_m2:g}), or raise the least of size_m "
            f"({wanted.size_m[0]:g} m), and they have fewer"
        )
    by_name = dict.fromkeys(wanted.block.on, 0)
    for host, count in zip(names, np.bincount(copies.host, minlength=len(names)).tolist(), strict=True):
        by_name[next(name for name in by_name if f"{host}.".startswith(f"{name}."))] += count
    return {
        "name": wanted.key,
        "kind": wanted.block.kind,
        "copies": len(copies.size),
        "by_level": np.bincount(level_of(copies.pixels), minlength=len(LEVELS) + 1).tolist(),
        "triangles": triangles,
        "on": by_name,
        "too_small": round(copies.too_small),
    }


def _silted(placed: Placed) -> np.ndarray:
    """Which copies have silt on them [N]: on level ground a share as there is silt on the host, on undersides none."""
    copies = placed.copies
    up = copies.normals[:, 2] / np.linalg.norm(copies.normals, axis=1)
    return uniform(copies.keys, 9) < placed.silt[copies.host] * np.clip((up + 0.2) / 0.7, 0.0, 1.0)


def _which(copies: Rooted, kind: Kind, silted: np.ndarray) -> np.ndarray:
    """The prototype of each copy [N]: any shape, tints much alike within a clump."""
    tints, all_tints = len(kind.tints), len(kind.tints) + len(kind.dusty)
    tone = tints * uniform(copies.clump, 8) + ALONE * (uniform(copies.keys, 10) - 0.5)
    tone = np.clip(tone.astype(int), 0, tints - 1)
    if kind.dusty:
        tone = np.where(silted, tints + (len(kind.dusty) * uniform(copies.keys, 10)).astype(int), tone)
    return (uniform(copies.keys, 5) * kind.shapes).astype(int) * all_tints + tone


def _poses(copies: Rooted, kind: Kind, silted: np.ndarray) -> np.ndarray:
    """Poses [N, 4, 4]: roots at the origin, z along the normal but for what stands up and for chance.

    The y axes of those with silt look up along their host, as their silt lies.
    """
    u = [uniform(copies.keys, dimension) for dimension in (6, 7, 8)]
    radius = kind.jitter * np.sqrt(-2.0 * np.log1p(-u[0]))  # Box and Muller 1958
    z = copies.normals / np.linalg.norm(copies.normals, axis=1, keepdims=True) + [0.0, 0.0, kind.straight]
    x, y = _across(z)
    z = z + radius[:, None] * (np.cos(2.0 * np.pi * u[1])[:, None] * x + np.sin(2.0 * np.pi * u[1])[:, None] * y)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    x, y = _across(z)
    spin = np.where(silted & (np.abs(z[:, 2]) < LEVEL), _towards(UP, x, y) + (u[2] - 0.5), 2.0 * np.pi * u[2])
    if kind.flows:
        spin = _towards(CURRENT, x, y) + EDDIES * (u[2] - 0.5)
    spin = spin[:, None]
    x, y = np.cos(spin) * x + np.sin(spin) * y, np.cos(spin) * y - np.sin(spin) * x
    T = np.tile(np.eye(4), (len(z), 1, 1))
    T[:, :3, :3] = copies.size[:, None, None] * np.stack([x, y, z], axis=2)
    T[:, :3, 3] = copies.points
    return T


def _towards(direction, x, y):
    """Angles [N] by which unit vectors are turned so that y, of each two of them [N, 3], is towards a direction."""
    return np.arctan2(-x @ direction, y @ direction)


def _across(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors [N, 3] across directions [N, 3], which x, y and z make a right-handed system with."""
    axis = np.where(
        (np.abs(z[:, :1]) < 0.7 * np.linalg.norm(z, axis=1, keepdims=True)), [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]]
    )
    x = np.cross(axis, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(z, x)
    return x, y / np.linalg.norm(y, axis=1, keepdims=True)
