"""Everything solid in a scene: what stands there, its relief, and what grows on it."""

from varos_warp.scene.description import Scene
from varos_warp.scene.geometry.build import build_base_parts
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.geometry.relief.apply import with_relief


def build_parts(scene: Scene) -> list[Part | Instances]:
    """Everything solid in a scene (float64): terrain, objects in file order, bodies of companions, scatter."""
    return with_relief(scene, build_base_parts(scene))
