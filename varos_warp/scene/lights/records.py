"""The vehicle's lights as kernels know them: where they are at a pose, and how their intensity is distributed."""

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from varos_warp.kernels.world.light import Light as LightData
from varos_warp.kernels.world.light import Lights as LightsData
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Light
from varos_warp.scene.frames import R_V_C, look_at_matrix
from varos_warp.scene.lights.distribution import Distribution, distribution


def light_record(shape: Distribution, intensity: ArrayLike, position=(0.0, 0.0, 0.0), axis=(0.0, 0.0, 1.0),
                 profile: wp.array | None = None) -> LightData:
    """A light as kernels know it; ``profile`` holds the values of the distribution on the device."""
    record = LightData()
    record.position = wp.vec3(*position)
    record.intensity = wp.vec3(*(shape.gain * np.asarray(intensity, float)))
    record.axis = wp.vec3(*(np.asarray(axis, float) / np.linalg.norm(axis)))
    record.cos_half = -1.0 if shape.half_angle >= np.pi else float(np.cos(shape.half_angle))
    record.blend = shape.blend
    if profile is not None:
        record.profile = profile
    return record


class Lights:
    """The lights of a scene on a device; owns the profiles that their records point to."""

    def __init__(self, scene: Scene, device: str):
        self.lights, self.device = scene.vehicle.lights, device
        self.distributions = [distribution(light, scene) for light in self.lights]
        self._profiles = {shape: wp.array(shape.profile, dtype=float, device=device)
                          for shape in self.distributions if shape.profile}

    @property
    def disks(self) -> bool:
        """Whether some light is a disk."""
        return any(map(radius_of, self.lights))

    def at(self, T_w_v: np.ndarray, origin) -> LightsData:
        """Their records for a pose of the vehicle, relative to ``origin``."""
        lights = LightsData()
        lights.records = wp.array([self._record(light, shape, T_w_v, origin) for light, shape
                                   in zip(self.lights, self.distributions, strict=True)],
                                  dtype=LightData, device=self.device)
        return lights

    def _record(self, light: Light, shape: Distribution, T_w_v: np.ndarray, origin) -> LightData:
        record = light_record(shape, light.intensity, light_position(light, T_w_v) - origin, _axis(light, T_w_v),
                              self._profiles.get(shape))
        right, up, _ = (T_w_v[:3, :3] @ light_axes(light)).T
        record.radius = radius_of(light)
        if light.kind == "sheet":
            record.sheet = 1
            tangents = np.tan(np.radians([light.fan_deg, light.thickness_deg]) / 2.0)
            right, up = right / tangents[0], up / tangents[1]
        record.right, record.up = wp.vec3(*right), wp.vec3(*up)
        return record


def radius_of(light: Light) -> float:
    """Radius of a light that is a disk [m], else 0."""
    return getattr(light, "radius_m", None) or 0.0


def light_position(light: Light, T_w_v: np.ndarray) -> np.ndarray:
    """Where a light of the vehicle at ``T_w_v`` is in the world [3] [m]."""
    return T_w_v[:3, :3] @ light.position + T_w_v[:3, 3]


def light_axes(light: Light) -> np.ndarray:
    """Axes of a light in the vehicle [3, 3]: z outwards, of a sheet y its normal and x along the fan."""
    if light.kind == "point":
        return np.eye(3)
    if light.kind != "sheet":
        return look_at_matrix((0.0, 0.0, 0.0), light.direction) @ R_V_C
    z = light.direction / np.linalg.norm(light.direction)
    y = light.normal - (z @ light.normal) * z
    y /= np.linalg.norm(y)
    return np.column_stack([np.cross(y, z), y, z])


def _axis(light: Light, T_w_v: np.ndarray) -> np.ndarray:
    return np.array([0.0, 0.0, 1.0]) if light.kind == "point" else T_w_v[:3, :3] @ np.asarray(light.direction)
