"""What may be left out because it hardly reaches the image: triangles that no camera looks near, and weak lamps.

These are candidates: what leaving them out does to an image is then measured (plan.py).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from varos_warp.render.truncation import half_angle_deg, in_cone
from varos_warp.scene.description import LevelOfDetail, Scene
from varos_warp.scene.frames import lamp_position
from varos_warp.scene.geometry import Instances, Part
from varos_warp.scene.lod import Need, PlacedNeed
from varos_warp.scene.water import optical_properties
from varos_warp.scene.water.phase.phase_function import PhaseFunction

NEAREST_M = 25.0
"""Nearer triangles are always kept: they may cast shadows on what is seen."""
SMALL = 10_000
"""Meshes of fewer triangles are left as they are."""


def without_hidden(scene: Scene, parts: Sequence[Part | Instances],
                   poses: Sequence[np.ndarray]) -> tuple[list[Part | Instances], int]:
    """Parts without the triangles that are far from all cameras and lamps and in no camera's view at any frame.

    C, D and S do not change at all; A and B lose what these would have reflected. Views are told apart by cells of 1/48
    of a mesh. Each part keeps a triangle at least, so that numbers in S stay.

    Args:
        scene: The scene.
        parts: Its geometry.
        poses: T_w_v [4, 4] of every frame.

    Returns:
        The parts, and how many triangles are gone.
    """
    need = Need(scene, poses, LevelOfDetail())
    made = [_without_hidden(need, part) for part in parts]
    return made, sum(len(part.faces) for part in parts) - sum(len(part.faces) for part in made)


def _without_hidden(need: Need, part):
    if isinstance(part, Instances) or len(part.faces) < SMALL:
        return part
    corners = part.vertices[part.faces]
    centre = corners.mean(axis=1)
    radius = np.linalg.norm(corners - centre[:, None], axis=-1).max()
    placed = PlacedNeed(need, part.vertices)
    seen = placed.seen(centre) | np.any([placed.seen(corners[:, k]) for k in range(3)], axis=0)
    keep = seen.copy()
    keep[~seen] = need.within(centre[~seen], NEAREST_M + radius)
    keep[0] |= not keep.any()
    skin = part.skin and replace(part.skin, corners=part.skin.corners[keep])
    return replace(part, faces=part.faces[keep], skin=skin)


def with_lamps(scene: Scene, lamps: Sequence[int]) -> Scene:
    """The scene with some of its lamps only."""
    lights = [scene.vehicle.lights[i] for i in lamps]
    return scene.model_copy(update={"vehicle": scene.vehicle.model_copy(update={"lights": lights})})


def rebuilt(renderer, scene: Scene | None = None, parts: Sequence[Part | Instances] | None = None):
    """A renderer on the same device, of another scene or of other parts."""
    from varos_warp.render.frame import FrameRenderer

    scene, parts = scene or renderer.scene, renderer.parts if parts is None else parts
    return FrameRenderer(scene, renderer.device, parts, renderer.launcher.threads)


# -------------------------------------------------------------------------------------------------------------- lamps


def lamp_light(scene: Scene, view, rays: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Radiance that each lamp sends into a view [lamp, H, W, 3], rather too much than too little.

    White surfaces that nothing shades, and water that lets all scattered light go on (attenuation by absorption alone);
    outside of a cone, as much light as if all of the lamp's were scattered evenly. Not in it: light from surface to
    surface.

    Args:
        scene: The scene.
        view: `pilot.View`.
        rays: Origin [3] and directions [H, W, 3].
    """
    water = optical_properties(scene)
    origin, d = rays
    hit = np.isfinite(view.range)
    peak = _peak(water.phase)
    t_end = np.where(hit, view.range, FARTHEST_M)
    lights = []
    for light in scene.vehicle.lights:
        position = lamp_position(light, view.T_w_v)
        total = np.where(hit[..., None], _arriving(light, view, origin + t_end[..., None] * d, position, t_end,
                                                   water) / np.pi, 0.0)
        for k in range(NODES):
            t = t_end * ((k + 0.5) / NODES) ** 2
            step = t_end * (((k + 1) / NODES) ** 2 - (k / NODES) ** 2)
            arriving = _arriving(light, view, origin + t[..., None] * d, position, t, water)
            total = total + step[..., None] * water.sigma_s * peak * arriving / (4.0 * np.pi)
        lights.append(total)
    return np.array(lights)


NODES, FARTHEST_M = 24, 200.0


def _peak(phase: PhaseFunction) -> float:
    """Largest value of a phase function over its mean.

    Those of sea water have none: the mean over the first degree stands for it, for what is scattered by less goes on as
    if it were not.
    """
    if phase.is_henyey_greenstein:
        g = abs(phase.mean_cosine)
        return (1.0 + g) / (1.0 - g) ** 2
    s = np.sin(np.radians(0.5)) ** 2
    return float(phase.cdf(s) / s)


def _arriving(light, view, p: np.ndarray, position: np.ndarray, t: np.ndarray, water) -> np.ndarray:
    """Light of a lamp at points [H, W, 3] that a camera sees at a distance ``t``."""
    to = p - position
    distance = np.maximum(np.linalg.norm(to, axis=-1), 1e-3)
    inside = np.ones(distance.shape)
    if light.kind == "spot" and light.cone_deg < 360.0:
        elsewhere = 0.5 * (1.0 - np.cos(np.radians(half_angle_deg(light))))
        inside = np.where(in_cone(light, view.T_w_v, to, distance), 1.0, elsewhere)
    attenuation = np.exp(-water.sigma_a * (t + distance)[..., None])
    return (inside / distance**2)[..., None] * attenuation * np.asarray(light.intensity)
