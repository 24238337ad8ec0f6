"""Tables of light in open water: built once for the lamps and cameras of a vehicle in its water, and kept on disk.

kernels/open_water.py says what they hold, docs/transport.md how right they are.
"""

import numpy as np
import warp as wp
from scipy.interpolate import RegularGridInterpolator

from varos_warp.kernels.intersect import SceneData
from varos_warp.kernels.light import Light as LightData
from varos_warp.kernels.open_water import MOMENTS, LampTable, Tables
from varos_warp.kernels.tabulate import fill_first_order, fill_higher_orders, fill_veil
from varos_warp.render.launch import Launcher
from varos_warp.scene.description import Camera, Scene
from varos_warp.scene.device import camera_record, light_record, medium_record
from varos_warp.scene.water import optical_properties

NEAREST_M, FARTHEST_M = 0.02, 200.0
"""Distances that are tabulated; what is nearer is in proportion."""
FINE = (64, 20, 28)
"""Nodes of the distance from a lamp, steps of the angle in its cone, and outside of it."""
COARSE = (16, 8, 10)
"""The same for light scattered twice or more, which is smoother."""
DIRECTIONS = 64
"""Steps of the angle to the lamp in the quadrature over directions; half as many around it."""
VEIL = (32, 19, 33)
"""Nodes of the distance along the camera's rays, of rows and columns of the image."""
SAMPLES = 4096


class OpenWater:
    """The tables of one scene on one device."""

    def __init__(self, scene: Scene, launcher: Launcher):
        self.scene, self.launcher, self.device = scene, launcher, launcher.device
        self.samples = SAMPLES
        self._lamps: list[LampTable] | None = None
        self._cameras: dict = {}

    def tables(self, view: Camera) -> Tables:
        """Tables for a camera."""
        tables = Tables()
        if self._lamps is None:
            self._lamps = self._lamp_tables()
            self._lamp_array = wp.array(self._lamps, dtype=LampTable, device=self.device)
        tables.lamp = self._lamp_array
        tables.veil = self._veil(view)
        tables.veil_nearest, tables.veil_log_step = NEAREST_M, _log_step(VEIL[0])
        return tables

    def _lamp_tables(self):
        """One per lamp; lamps with the same cone share their moments."""
        kinds, tables = {}, []
        for light in self.scene.vehicle.lights:
            kind = (light.kind, light.cone_deg, light.blend) if light.kind == "spot" else light.kind
            if kind not in kinds:
                kinds[kind] = self._lamp_table(light)
            tables.append(kinds[kind])
        self._moments = [table.moments for table in tables]
        return tables

    def _lamp_table(self, light) -> LampTable:
        alone = light.model_copy(update={"position": (0.0, 0.0, 0.0), "intensity": (1.0, 1.0, 1.0)})
        if light.kind == "spot":
            alone = alone.model_copy(update={"direction": (0.0, 0.0, 1.0)})
        scene, record = self._scene([alone])
        table = self._table(record, FINE)
        moments = self._array(_shape(FINE))
        table.moments = moments
        self.launcher.run(fill_first_order, _shape(FINE)[:2], [scene, table, DIRECTIONS], [moments])
        coarse = self._table(record, COARSE)
        higher = self._array((1, *_shape(COARSE)))
        coarse.moments = self._array(_shape(COARSE))
        self.launcher.run(fill_higher_orders, higher.shape[:3], [scene, coarse, 0, self.samples, 7], [higher])
        table.moments = self._array(moments.numpy() + _refined(higher.numpy().mean(axis=0)))
        return table

    def _table(self, light: LightData, nodes) -> LampTable:
        medium = medium_record(optical_properties(self.scene))
        table = LampTable()
        table.nearest, table.log_step = NEAREST_M, _log_step(nodes[0])
        table.half_angle = float(np.arccos(light.cos_half)) if light.cos_half > -1.0 else float(np.pi)
        table.inside = nodes[1]
        table.decay = medium.sigma_t - medium.g * medium.sigma_s
        return table

    def _veil(self, view: Camera) -> wp.array:
        key = view.model_dump_json(exclude={"id", "f_stop", "focus_m"})
        if key not in self._cameras:
            scene, _ = self._scene(self.scene.vehicle.lights)
            camera = camera_record(view, np.eye(4), np.zeros(3), pinhole=True)
            parts, squares = self._array((1, *VEIL)), self._array((1, *VEIL[1:]))
            width, height = map(float, view.resolution)
            inputs = [scene, camera, width, height, NEAREST_M, _log_step(VEIL[0]), 0, self.samples, 11]
            self.launcher.run(fill_veil, (1, *VEIL[1:]), inputs, [parts, squares])
            self._cameras[key] = self._array(np.cumsum(parts.numpy().mean(axis=0, dtype=float), axis=0))
        return self._cameras[key]

    def _scene(self, lights):
        """Lamps in open water, at the pose of a vehicle at rest; and the first of them."""
        scene = SceneData()
        scene.medium = medium_record(optical_properties(self.scene))
        records = [light_record(light, np.eye(4), np.zeros(3)) for light in lights]
        scene.lights = self._kept = wp.array(records, dtype=LightData, device=self.device)
        return scene, records[0]

    def _array(self, values) -> wp.array:
        if isinstance(values, tuple):
            return wp.empty(values, dtype=wp.vec3, device=self.device)
        return wp.array(np.ascontiguousarray(values, np.float32), dtype=wp.vec3, device=self.device)


def _shape(nodes) -> tuple[int, int, int]:
    return nodes[0], nodes[1] + nodes[2] + 1, MOMENTS


def _log_step(distances: int) -> float:
    return float(np.log(FARTHEST_M / NEAREST_M) / (distances - 1))


def _angle_places(inside: int, outside: int) -> np.ndarray:
    """Places of the nodes of the angle: 0 to 1 inside the cone, 1 to 2 outside."""
    return np.concatenate([np.arange(inside) / inside, 1.0 + np.arange(outside + 1) / outside])


def _refined(moments: np.ndarray) -> np.ndarray:
    """Moments at the coarse nodes [COARSE..., MOMENTS, 3], between them cubic, at the fine ones."""
    axes = [(np.linspace(0.0, 1.0, n[0]), _angle_places(*n[1:])) for n in (COARSE, FINE)]
    between = RegularGridInterpolator(axes[0], moments.astype(float), method="cubic")
    return between(tuple(np.meshgrid(*axes[1], indexing="ij")))
