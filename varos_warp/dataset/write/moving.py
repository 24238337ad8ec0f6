"""Objects that move, in a dataset: their boxes in dataset.json, their poses at every frame."""

import numpy as np

from varos_warp.dataset.layout import Layout
from varos_warp.dataset.write.texts import write_poses
from varos_warp.scene.description import Scene
from varos_warp.scene.geometry.build import object_part
from varos_warp.scene.geometry.parts import Moving
from varos_warp.sim.poses import poses_along


def describe_moving(scene: Scene, parts: list | None) -> list[dict]:
    """What dataset.json says of each object that moves.

    Args:
        scene: The scene.
        parts: Everything solid in it, where it is at hand.

    Returns:
        Entries of ``key`` in the scene file, ``id`` in S, and ``box_m``, the lowest and highest corner [m] of its
        bounding box in its own axes, as large as it is in the world.
    """
    found = {part.name: part for part in parts or ()}
    entries = []
    for i, block in scene.moving.items():
        key = f"objects.{i}"
        part = found.get(key) or object_part(scene, block, key)
        assert isinstance(part, Moving)
        own = (part.vertices - part.origin) @ part.R_w_o
        entries.append({"key": key, "id": scene.number_of_object(i),
                        "box_m": [own.min(axis=0).tolist(), own.max(axis=0).tolist()]})
    return entries


def write_moving(layout: Layout, scene: Scene, time_ns: np.ndarray) -> None:
    """Poses of every object that moves at the times of the frames, int64 [N]."""
    for i, block in scene.moving.items():
        write_poses(layout, f"objects.{i}", time_ns, poses_along(block.stops, time_ns))
