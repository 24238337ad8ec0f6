"""White balance for a vehicle's lamps: gains that make grey things at the distance of focus grey."""

from typing import Any

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.description import Scene
from varos_warp.scene.frames import R_V_C, pose_matrix, transform
from varos_warp.scene.lights.distribution import distribution
from varos_warp.scene.lights.records import light_axes
from varos_warp.scene.water.properties import OpticalProperties, optical_properties

MOST_BALANCE = 4.0
"""Most that white balance makes a channel's gain over the green one's, or below it: beyond, noise and veils glow."""
AZIMUTHS = 72
"""Half planes around a lamp's axis over which a profile is averaged."""


def effective_attenuation(water: OpticalProperties) -> np.ndarray:
    """What dims a wide beam [1/m], float64 [3]: sigma_a + (1 - g) sigma_s, for what is scattered forwards goes on."""
    return water.sigma_a + (1.0 - water.g) * water.sigma_s


def lamp_gains(scene: Scene, camera: Any) -> np.ndarray:
    """Gains [3], in the green one's, by which a grey surface is grey that faces a camera at its focus.

    A channel's light is the sum over the vehicle's lamps of I cos(theta) / r^2 exp(-k (r + d)), with the intensity I
    towards the surface, its angle theta, the lamp's distance r from it, the camera's distance d = ``focus_m`` and the
    water's k (`effective_attenuation`). Sheets, which light a line, do not count. Gains are kept within
    `MOST_BALANCE`.

    Raises:
        InputError: If no lamp lights the middle of the image there.
    """
    light = np.zeros(3)
    T_v_c, k = pose_matrix(camera) @ transform(R_V_C), effective_attenuation(optical_properties(scene))
    place = T_v_c[:3, 3] + camera.focus_m * T_v_c[:3, 2]
    for lamp in (lamp for lamp in scene.vehicle.lights if lamp.kind != "sheet"):
        way = place - np.array(lamp.position)
        r, ahead = float(np.linalg.norm(way)), float(way @ T_v_c[:3, 2])
        if ahead > 0.0:
            intensity = _towards(lamp, scene, way / r) * np.asarray(lamp.intensity, float)
            light += intensity * ahead / r**3 * np.exp(-k * (r + camera.focus_m))
    if not (light > 0.0).all():
        raise InputError(
            f"none of the vehicle's lamps lights the middle of the image of camera {camera.id} in all channels at its "
            f"focus_m, {camera.focus_m:g} m",
            key=f"{scene.key_of_camera(camera)}.exposure.white_balance",
            value="lamps",
            remedy="Give grey_world, another focus_m, or lamps that shine there.",
        )
    return np.clip(light[1] / light, 1.0 / MOST_BALANCE, MOST_BALANCE)


def _towards(lamp: Any, scene: Scene, direction: np.ndarray) -> float:
    """Intensity of a lamp in a direction [3], relative to the one of its key, in the mean around its axis."""
    shape, axis = distribution(lamp, scene), light_axes(lamp)[:, 2]
    angle = np.arccos(np.clip(axis @ direction, -1.0, 1.0))
    turns = np.linspace(0.0, 2.0 * np.pi, AZIMUTHS, endpoint=False)
    return shape.gain * float(np.mean(shape.at(np.full(AZIMUTHS, angle), turns)))
