"""Objects that move, and other vehicles: their boxes and lights in dataset.json, their poses at every frame."""

import numpy as np

from varos_warp.dataset.layout import Layout
from varos_warp.dataset.write.tables import write_poses
from varos_warp.dataset.write.texts import describe_lights
from varos_warp.scene.description import Scene
from varos_warp.scene.geometry.placed import moving_part
from varos_warp.sim.companions import motions


def describe_moving(scene: Scene, parts: list | None) -> list[dict]:
    """What dataset.json says of each of `Scene.tracked`; ``parts`` are everything solid, where it is at hand.

    Entries of ``key`` in the scene file; of what is solid ``id`` in S, and ``box_m``, the lowest and highest corner [m]
    of its bounding box in its own axes, as large as it is in the world; of another vehicle its ``lights``.
    """
    found, entries = {part.name: part for part in parts or ()}, []
    for key in scene.tracked:
        entry: dict = {"key": key}
        if key in scene.moving:
            part = found.get(key) or moving_part(scene, key)
            own = (part.vertices - part.origin) @ part.R_w_o
            entry |= {"id": scene.number_of(key), "box_m": [own.min(axis=0).tolist(), own.max(axis=0).tolist()]}
        if key in scene.companions:
            entry["lights"] = describe_lights(scene.companions[key])
        entries.append(entry)
    return entries


def write_moving(layout: Layout, scene: Scene, time_ns: np.ndarray) -> None:
    """Poses of all that moves at the times of the frames, int64 [N]."""
    for key, poses in motions(scene).items():
        write_poses(layout, key, time_ns, poses(time_ns))
