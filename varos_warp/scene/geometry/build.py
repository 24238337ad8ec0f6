"""Everything solid in a scene: what stands in one place, copies on the ground, and what grows on them."""

from varos_warp.scene.description import Scene
from varos_warp.scene.description.surfaces import Layered
from varos_warp.scene.description.world import Boulder, Scatter
from varos_warp.scene.geometry.growth.grow import grow
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.geometry.placed import moving_part, object_part, terrain_part
from varos_warp.scene.geometry.relief.apply import with_relief
from varos_warp.scene.geometry.scatter import Ground, scatter

COARSE = 0.025
"""Chord error of a boulder that relief refines, over its diameter."""


def build_parts(scene: Scene) -> list[Part | Instances]:
    """Everything solid in the scene (float64): terrain, objects in file order, bodies of companions, copies.

    Blocks of scatter come before those of growth. Copies are strewn without regard to bodies: they stand alike
    whichever vehicle sees them.
    """
    single = build_single_parts(scene)
    parts = [
        *single,
        *(moving_part(scene, key) for key in scene.moving if key in scene.companions),
        *build_instances(scene, single),
    ]
    parts = with_relief(scene, parts)
    return grow(scene, parts)


def build_single_parts(scene: Scene) -> list[Part]:
    """What stands in one place only: the terrain, then the objects in file order."""
    parts = [] if scene.terrain is None else [terrain_part(scene)]
    return parts + [object_part(scene, block, f"objects.{i}") for i, block in enumerate(scene.objects)]


def build_instances(scene: Scene, parts: list[Part]) -> list[Instances]:
    """One mesh with many poses for every block of ``scatter``; ``parts`` are those that stand in one place."""
    if not scene.scatter:
        return []
    ground = Ground(parts[0], parts[1:])  # nothing is scattered without a terrain, and it comes first
    return [
        group
        for i, block in enumerate(scene.scatter)
        for group in scatter(block, f"scatter.{i}", _shapes(scene, block, i), ground, scene.seed)
    ]


def _has_relief(scene: Scene, block: Boulder) -> bool:
    """Return whether relief makes a boulder as fine as it must be, so that its own mesh may be coarse."""
    return block.chord_error_m is None and isinstance(scene.materials.get(block.material or ""), Layered)


def _shapes(scene: Scene, block: Scatter, number: int) -> list[Part]:
    """The objects that a block of ``scatter`` copies: of several shapes, boulders of seeds that follow each other."""
    blocks = [block.object]
    if isinstance(block.object, Boulder):
        seeds = [(block.object.seed + k) % 2**31 for k in range(block.shapes or 1)]
        fine = {"chord_error_m": COARSE * block.object.diameter} if _has_relief(scene, block.object) else {}
        blocks = [block.object.model_copy(update={"seed": seed, **fine}) for seed in seeds]
    return [object_part(scene, each, f"scatter.{number}.object") for each in blocks]
