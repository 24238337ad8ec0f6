"""The vehicle's lights as kernels know them: where they are at a pose, and how their intensity is distributed."""

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from varos_warp.kernels.world.light import Light as LightData
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Light
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

    def at(self, T_w_v: np.ndarray, origin) -> wp.array:
        """Their records for a pose of the vehicle, relative to ``origin``."""
        records = [
            light_record(shape, light.intensity, light_position(light, T_w_v) - origin, _axis(light, T_w_v),
                         self._profiles.get(shape))
            for light, shape in zip(self.lights, self.distributions, strict=True)]
        return wp.array(records, dtype=LightData, device=self.device)


def light_position(light: Light, T_w_v: np.ndarray) -> np.ndarray:
    """Where a light of the vehicle at ``T_w_v`` is in the world [3] [m]."""
    return T_w_v[:3, :3] @ light.position + T_w_v[:3, 3]


def _axis(light: Light, T_w_v: np.ndarray) -> np.ndarray:
    return np.array([0.0, 0.0, 1.0]) if light.kind == "point" else T_w_v[:3, :3] @ np.asarray(light.direction)
