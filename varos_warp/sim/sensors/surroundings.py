"""What is around a vehicle, for its sensors: gravity, the surface, and what their beams meet."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from varos_warp.scene.description import Scene
from varos_warp.sim.poses import courses_of_moving, velocity_with

if TYPE_CHECKING:
    from varos_warp.scene.geometry.query import Solids


@dataclass
class Around:
    """What is around a vehicle: `varos_warp.products.sensors.protocol.Surroundings`."""

    gravity: float = 9.81
    """[m/s^2]"""
    surface_depth_m: float = 0.0
    """Depth of world z = 0 below the surface [m]."""
    parts: Sequence[Any] = ()
    """Everything solid, from ``build_parts``."""
    others: Mapping[str, Callable] | None = None
    """Poses of other vehicles, whose bodies are among the parts."""

    @classmethod
    def of(cls, scene: Scene, parts: Sequence[Any] | None, others: Mapping[str, Callable] | None) -> "Around":
        """What is around the vehicle of a scene."""
        return cls(scene.gravity, scene.surface_depth_m, parts or (), others)

    @cached_property
    def solids(self) -> "Solids":
        """Everything solid, with the BVHs that have been made of it."""
        from varos_warp.scene.geometry.query import Solids  # Warp is loaded only where there are beams

        return Solids(list(self.parts))

    def met_by_beams(
        self, time_ns: np.ndarray, T_w_s: np.ndarray, beams: np.ndarray, range_m: Sequence[float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distance [M, k] along beams to what is there, and its velocity along them, as `Surroundings` says."""
        start, when = np.repeat(T_w_s[:, :3, 3], len(beams), axis=0), np.repeat(time_ns, len(beams))
        directions = (beams @ T_w_s[:, :3, :3].swapaxes(1, 2)).reshape(-1, 3)
        least, most = range_m
        courses = courses_of_moving(self.solids.parts, self.others)
        distance, met = self.solids.first_met(start, directions, most, {key: at(when) for key, at in courses.items()})
        away = np.zeros(len(distance))
        for k, course in enumerate(courses.values()):
            rays = np.flatnonzero(met == k)
            points = start[rays] + distance[rays, None] * directions[rays]
            velocity = velocity_with(course, points, when[rays])
            away[rays] = (velocity * directions[rays]).sum(axis=1)
        distance = np.where((distance >= least) & np.isfinite(distance), distance, np.nan)
        return distance.reshape(-1, len(beams)), away.reshape(-1, len(beams))
