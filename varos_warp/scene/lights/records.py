"""The lights of all vehicles as kernels know them: where they are at a pose, and how their intensity is distributed."""

from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from varos_warp.kernels.world.lights.record import Light as LightData
from varos_warp.scene.description import Scene
from varos_warp.scene.description.lights import Light
from varos_warp.scene.frames import R_V_C, look_at_matrix
from varos_warp.scene.lights.distribution import Distribution, distribution
from varos_warp.scene.optics.shutter import Instants, on_share

DISK_NODES = np.array(
    [
        (0.0, 0.0, 1.0 / 4.0),
        *(
            (np.sqrt(2.0 / 3.0) * np.cos(t), np.sqrt(2.0 / 3.0) * np.sin(t), 1.0 / 8.0)
            for t in np.arange(6) * np.pi / 3.0
        ),
    ]
)
"""Points (x, y) of the unit disk and weights, [7, 3]: exact for polynomials of degree five (Stroud 1971, S2 5-1)."""


def light_record(shape: Distribution, intensity: ArrayLike, profile: wp.array | None = None) -> LightData:
    """A light as kernels know it, at the origin, along z; ``profile`` has its distribution's values on the device."""
    record = LightData()
    record.intensity = wp.vec3(*(shape.gain * np.asarray(intensity, float)))
    record.axis = wp.vec3(0.0, 0.0, 1.0)
    record.cos_half = -1.0 if shape.half_angle >= np.pi else float(np.cos(shape.half_angle))
    record.blend = shape.blend
    record.planes = shape.planes
    if profile is not None:
        record.profile = profile
    return record


class Lights:
    """The lights of a scene on a device; owns the profiles that their records point to."""

    def __init__(self, scene: Scene, device: str):
        self.lights, self.device = scene.lights, device
        self.carriers = {
            len(scene.vehicle.lights) + i: key
            for i, key in enumerate(key for key, vehicle in scene.companions.items() for _ in vehicle.lights)
        }
        """Keys of the companions that carry lights, by the number of the light; all others are on the vehicle."""
        self.distributions = [distribution(light, scene) for light in self.lights]
        self._profiles = {
            shape: wp.array(shape.profile, dtype=float, device=device)
            for shape in self.distributions
            if shape.has_profile
        }
        records = [self._record(light, shape) for light, shape in zip(self.lights, self.distributions, strict=True)]
        self._records = wp.array(records, dtype=LightData, device=device).numpy()

    def at(self, T_w_v: np.ndarray, origin, others: dict[str, np.ndarray] | None = None) -> wp.array:
        """The records [n] for a pose of the vehicle, relative to ``origin``; ``others``: poses [1, 4, 4] by key."""
        return wp.array(self._placed(T_w_v[None], origin, others or {})[0], dtype=LightData, device=self.device)

    @property
    def of_points(self) -> np.ndarray:
        """Numbers [m] of the lights that the points of `points_at` are of."""
        return np.repeat(np.arange(len(self.lights)), [len(_nodes(light)) for light in self.lights])

    def points_at(self, T_w_v: np.ndarray, origin) -> wp.array:
        """The records [m] as of `at`, but each disk as points that together light all that is smooth as it does."""
        records = self._placed(T_w_v[None], origin, {})[0][self.of_points]
        nodes = [node for light in self.lights for node in _nodes(light)]
        x, y, weight = np.reshape(nodes, (-1, 3)).T[:, :, None]
        records["position"] += records["radius"][:, None] * (x * records["right"] + y * records["up"])
        records["intensity"] *= weight
        records["radius"] = 0.0
        return wp.array(records, dtype=LightData, device=self.device)

    def over(self, T_w_v: np.ndarray, origin, when: Instants, others: dict[str, np.ndarray]) -> wp.array:
        """The records [N, n] for poses [N, 4, 4] of the vehicle at instants.

        ``others``: poses [N, 4, 4] of the companions that carry lights, by key.
        """
        placed = self._placed(T_w_v, origin, others)
        for i, light in enumerate(self.lights):
            placed["intensity"][:, i] *= np.reshape(on_share(light.strobe, when), (-1, 1))
        return wp.array(placed, dtype=LightData, device=self.device)

    def _record(self, light: Light, shape: Distribution) -> LightData:
        """The record of a light but for its place."""
        record = light_record(shape, light.intensity, profile=self._profiles.get(shape))
        record.sheet, record.radius = int(light.kind == "sheet"), radius_of(light)
        return record

    def _placed(self, T_w_v: np.ndarray, origin, others: dict[str, np.ndarray]) -> np.ndarray:
        """The records [N, n] of the lights for poses [N, 4, 4] of the vehicle and of others, relative to ``origin``."""
        records = np.repeat(self._records[None], len(T_w_v), axis=0)
        for i, light in enumerate(self.lights):
            T = others[self.carriers[i]] if i in self.carriers else T_w_v
            record, R = records[:, i], T[:, :3, :3]
            record["position"] = light_position(light, T) - origin
            axis = np.array([0.0, 0.0, 1.0]) if light.kind == "point" else R @ np.asarray(light.direction)
            record["axis"] = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
            lengths = 1.0
            if light.kind == "sheet":
                lengths = 1.0 / np.tan(np.radians([light.fan_deg, light.thickness_deg, 90.0]) / 2.0)
            record["right"], record["up"], _ = np.moveaxis(R @ (lengths * light_axes(light)), -1, 0)
        return records


def _nodes(light):
    """Points of a light and their weights, as `DISK_NODES`: of what is no disk, itself."""
    return DISK_NODES if radius_of(light) else np.array([[0.0, 0.0, 1.0]])


def lights_vary(lights: Iterable[Light]) -> bool:
    """Return whether the lights differ from instant to instant, though vehicle and camera stand still."""
    return any(light.strobe for light in lights)


def disks(lights: Sequence[Light]) -> int:
    """Number of the lights, if some are disks, whose points differ from sample to sample; else 0."""
    return len(lights) if any(map(radius_of, lights)) else 0


def radius_of(light: Light) -> float:
    """Radius of a light that is a disk [m], else 0."""
    return getattr(light, "radius_m", None) or 0.0


def light_position(light: Light, T_w_v: np.ndarray) -> np.ndarray:
    """Position in the world [..., 3] [m] of a light of the vehicle at ``T_w_v`` [..., 4, 4]."""
    return T_w_v[..., :3, :3] @ light.position + T_w_v[..., :3, 3]


@lru_cache(maxsize=64)
def light_axes(light: Light) -> np.ndarray:
    """Axes of a light in the vehicle [3, 3]: z outwards, of a sheet y its normal and x along the fan.

    Else as of a camera, x to the right and y down: -y is the key ``up`` of a profile, made perpendicular. Not to be
    written to.
    """
    if light.kind == "point":
        return np.eye(3)
    y = light.normal if light.kind == "sheet" else np.negative(getattr(light, "up", None) or (0.0, 0.0, 0.0))
    if not np.any(y):
        return look_at_matrix((0.0, 0.0, 0.0), light.direction) @ R_V_C
    z = light.direction / np.linalg.norm(light.direction)
    y = y - (z @ y) * z
    y /= np.linalg.norm(y)
    return np.column_stack([np.cross(y, z), y, z])
