"""The vehicle's lights: where they are at a pose, and what kernels know of them."""

import numpy as np
import warp as wp

from varos_warp.kernels.world.light import Light as LightData
from varos_warp.scene.description.vehicle import Light


def light_position(light: Light, T_w_v: np.ndarray) -> np.ndarray:
    """Where a light of the vehicle at ``T_w_v`` is in the world [3] [m]."""
    return T_w_v[:3, :3] @ light.position + T_w_v[:3, 3]


def light_record(light: Light, T_w_v: np.ndarray, origin) -> LightData:
    """A light of the vehicle at a pose, relative to ``origin``."""
    record = LightData()
    record.position = wp.vec3(*(light_position(light, T_w_v) - origin))
    record.intensity = wp.vec3(*light.intensity)
    record.cos_half = -1.0
    record.axis = wp.vec3(0.0, 0.0, 1.0)
    if light.kind == "spot":
        axis = T_w_v[:3, :3] @ np.asarray(light.direction)
        record.axis = wp.vec3(*(axis / np.linalg.norm(axis)))
        record.cos_half = float(np.cos(np.radians(light.cone_deg) / 2)) if light.cone_deg < 360.0 else -1.0
        record.blend = light.blend
    return record
