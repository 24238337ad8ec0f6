"""What cannot reach the image and need not be rendered: far triangles that no camera looks near, lamps too weak.

Bounds, not estimates: what is left out is known to matter less than is stated.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from varos_warp.scene.description import LevelOfDetail, Scene
from varos_warp.scene.frames import camera_pose
from varos_warp.scene.geometry import Instances, Part
from varos_warp.scene.lod import Need
from varos_warp.scene.water import optical_properties

SIN_BESIDE = 0.5
"""Triangles count as looked at within so much of their distance beside the field of view: 30 degrees."""
NEAREST_M = 25.0
"""Nearer ones are always kept: they may cast shadows on what is seen."""
SMALL = 10_000
"""Meshes of fewer triangles are left as they are."""
WORTH = 0.1
"""Nothing is cut where it would be less than this share of all triangles."""


def cut_parts(scene: Scene, parts: Sequence[Part | Instances], poses: Sequence[np.ndarray],
              allowed: float) -> tuple[list[Part | Instances], float, int]:
    """Parts without the triangles that the images of a sequence can do without.

    These are never within 30 degrees of any camera's field of view, so C, D and S do not change at all. For A and B,
    they would have lit what is seen by no more than their form factor, sum of A |cos| / (pi d^2): they are not brighter
    than what is seen, being farther from the lamps (A) or lit alike (B). What is seen at a distance d' lies at least
    d / 2 from them, so the form factor seen from the cameras, four times, bounds it. Without B among the outputs, water
    absorbs lamp light on its way there and back, too. The farthest are cut first.

    Args:
        scene: The scene.
        parts: Its geometry.
        poses: T_w_v [4, 4] of every frame.
        allowed: Largest share of the light that may be missing.

    Returns:
        The parts (each keeps a triangle at least, so that their numbers in S stay), the share of the light that may be
        missing, and how many triangles were cut.
    """
    need = Need(scene, poses, LevelOfDetail())
    eyes = np.unique([camera_pose(camera, T)[:3, 3] for camera in scene.vehicle.cameras for T in poses], axis=0)
    hidden = [_hidden(need, eyes, part) for part in parts]
    distance = np.concatenate([d for d, _, _ in hidden])
    share = np.concatenate([f for _, f, _ in hidden])
    if "B" not in scene.render.outputs:
        share = share * np.exp(-1.5 * optical_properties(scene).sigma_a.min() * distance)
    order = np.argsort(-distance, kind="stable")
    total = np.cumsum(share[order])
    count = int(np.searchsorted(total, allowed, side="right"))
    if not count:
        return list(parts), 0.0, 0
    limit = distance[order[count - 1]]
    cut = [faces[d >= limit] for d, _, faces in hidden]
    made = [_without(part, faces) for part, faces in zip(parts, cut, strict=True)]
    given, kept = (sum(len(part.faces) for part in which) for which in (parts, made))
    if given - kept < WORTH * given:
        return list(parts), 0.0, 0
    return made, float(total[count - 1]), given - kept


def _hidden(need: Need, eyes: np.ndarray, part) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance [N], bound on the form factor [N] and numbers [N] of a part's triangles that could be left out."""
    none = np.zeros(0), np.zeros(0), np.zeros(0, int)
    if isinstance(part, Instances) or len(part.faces) < SMALL:
        return none
    corners = part.vertices[part.faces]
    centre = corners.mean(axis=1)
    radius = np.linalg.norm(corners - centre[:, None], axis=-1).max()
    distance = need.distance(centre)
    faces = np.flatnonzero(distance - radius > NEAREST_M)
    # a ball as wide as this reaches into the view wherever the triangle is beside it by less than it is far away
    faces = faces[~_looked_at(need, centre[faces], distance[faces], radius)]
    if not len(faces):
        return none
    normal = 0.5 * np.cross(corners[faces, 1] - corners[faces, 0], corners[faces, 2] - corners[faces, 0])
    factor = np.zeros(len(faces))
    for eye in eyes:
        to = centre[faces] - eye
        factor = np.maximum(factor, np.abs(np.einsum("ij,ij->i", normal, to)) / np.linalg.norm(to, axis=1) ** 3)
    return distance[faces], 4.0 / np.pi * factor, faces


def _looked_at(need: Need, centre: np.ndarray, distance: np.ndarray, radius: float) -> np.ndarray:
    """Whether points come within 30 degrees of a field of view, octave by octave of their distance, bool [N]."""
    octave = np.floor(np.log2(distance)).astype(int)
    seen = np.zeros(len(centre), bool)
    for k in np.unique(octave):
        chosen = octave == k
        seen[chosen] = need.in_view(centre[chosen], radius + SIN_BESIDE * 2.0 ** (k + 1))
    return seen


def _without(part, faces: np.ndarray):
    """A part without some of its triangles, but with one at least."""
    if not len(faces):
        return part
    keep = np.ones(len(part.faces), bool)
    keep[faces] = False
    keep[0] |= not keep.any()
    skin = part.skin and replace(part.skin, corners=part.skin.corners[keep])
    return replace(part, faces=part.faces[keep], skin=skin)


# -------------------------------------------------------------------------------------------------------------- lamps


def lamp_bounds(scene: Scene, view, rays: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Upper bound on the radiance that each lamp sends into a view [lamp, H, W, 3].

    White surfaces that nothing shades, and water that lets all scattered light go on (attenuation by absorption alone);
    outside of a cone, as much light as if all of the lamp's were scattered evenly.

    Args:
        scene: The scene.
        view: `pilot.View`.
        rays: Origin [3] and directions [H, W, 3].
    """
    water = optical_properties(scene)
    origin, d = rays
    hit = np.isfinite(view.range)
    peak = (1.0 + abs(water.g)) / (1.0 - abs(water.g)) ** 2  # of Henyey and Greenstein's phase function, over its mean
    t_end = np.where(hit, view.range, FARTHEST_M)
    bounds = []
    for light in scene.vehicle.lights:
        position = view.T_w_v[:3, :3] @ light.position + view.T_w_v[:3, 3]
        total = np.where(hit[..., None], _arriving(light, view, origin + t_end[..., None] * d, position, t_end,
                                                   water) / np.pi, 0.0)
        for k in range(NODES):
            t = t_end * ((k + 0.5) / NODES) ** 2
            step = t_end * (((k + 1) / NODES) ** 2 - (k / NODES) ** 2)
            arriving = _arriving(light, view, origin + t[..., None] * d, position, t, water)
            total = total + step[..., None] * water.sigma_s * peak * arriving / (4.0 * np.pi)
        bounds.append(total)
    return np.array(bounds)


NODES, FARTHEST_M = 24, 200.0


def with_lamps(renderer, lamps: Sequence[int]):
    """A renderer of the same scene with some of its lamps only."""
    from varos_warp.render.frame import FrameRenderer

    vehicle = renderer.scene.vehicle
    vehicle = vehicle.model_copy(update={"lights": [vehicle.lights[i] for i in lamps]})
    scene = renderer.scene.model_copy(update={"vehicle": vehicle})
    return FrameRenderer(scene, renderer.device, renderer.parts, renderer.launcher.threads)


def _arriving(light, view, p: np.ndarray, position: np.ndarray, t: np.ndarray, water) -> np.ndarray:
    """Bound on the light of a lamp at points [H, W, 3] that a camera sees at a distance ``t``."""
    to = p - position
    distance = np.maximum(np.linalg.norm(to, axis=-1), 1e-3)
    inside = np.ones(distance.shape)
    if light.kind == "spot" and light.cone_deg < 360.0:
        axis = view.T_w_v[:3, :3] @ np.asarray(light.direction) / np.linalg.norm(light.direction)
        half = np.cos(np.radians(0.5 * light.cone_deg))
        inside = np.where(to @ axis > distance * half, 1.0, 0.5 * (1.0 - half))
    attenuation = np.exp(-water.sigma_a * (t + distance)[..., None])
    return (inside / distance**2)[..., None] * attenuation * np.asarray(light.intensity)
