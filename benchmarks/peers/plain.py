"""One view of a scene in plain arrays, local to the camera, for the exporters to other renderers.

Only this module knows what the peers cannot render and how a bound on paths translates; the exporters merely translate
names.
"""

import numpy as np

from benchmarks.peers.lobes import lobes_of
from benchmarks.peers.view import PlainLight, PlainMesh, PlainScene
from varos_warp.errors import InputError
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.frames import camera_pose, intrinsics
from varos_warp.scene.geometry.normals import corner_normals
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.water import optical_properties


def plain_scene(
    scene: Scene,
    parts: list[Part | Instances],
    camera: Camera,
    T_w_v: np.ndarray,
    *,
    max_scatterings: int | None = None,
    max_bounces: int | None = None,
    max_events: int | None = None,
) -> PlainScene:
    """A scene as a camera sees it from the vehicle's pose ``T_w_v`` [4, 4]; copies are expanded.

    Bounds are as in `benchmarks.peers.render`. An InputError tells what the peers cannot render, such as a material, or
    count.
    """
    if camera.port is not None or camera.distortion is not None:
        raise InputError(
            "the peers' cameras have neither port nor distortion",
            key="cameras.port, distortion",
            remedy="Compare a camera without them.",
        )
    T_w_c = camera_pose(camera, np.asarray(T_w_v, float))
    origin = np.round(T_w_c[:3, 3])
    T_w_c[:3, 3] -= origin
    water = optical_properties(scene)
    events, scatters, reflects = _bound(max_scatterings, max_bounces, max_events)
    single = [part for group in parts for part in (group.parts() if isinstance(group, Instances) else [group])]
    K = intrinsics(camera)
    return PlainScene(
        origin=origin,
        meshes=[_mesh(part, origin, reflects) for part in single],
        lights=[_light(light, T_w_v, origin) for light in scene.vehicle.lights],
        sigma_s=water.sigma_s if scatters else np.zeros(3),
        sigma_a=water.sigma_a if scatters else water.sigma_t,
        lobes=lobes_of(water.phase),
        T_w_c=T_w_c,
        resolution=camera.resolution,
        focal=(K[0, 0], K[1, 1]),
        aperture=0.5e-3 * camera.focal_mm / camera.f_stop if camera.f_stop > 0.0 else 0.0,
        focus=camera.focus_m,
        max_events=events,
    )


def _bound(scatterings, bounces, events):
    """One bound on all events of a path, and whether water scatters and surfaces reflect.

    The peers bound the events together; bounds on one kind are exact where the other kind is unbounded, or is none at
    all: water that only absorbs, or surfaces that are black.
    """
    kinds = (scatterings != 0, bounces != 0)
    bounds = [n for n in (scatterings, bounces) if n is not None and n != 0]
    if events is not None:
        bounds.append(events)
    countable = not bounds or (scatterings is None and bounces is None) or sum(kinds) == 1
    if not countable or not any(kinds) or events == 0:
        raise InputError(
            "another renderer counts scatterings and reflections together",
            key="max_scatterings, max_bounces, max_events",
            value=(scatterings, bounces, events),
            remedy="Leave both unbounded, set one of them to 0 and bound the other, or bound max_events.",
        )
    return min(bounds, default=None), *kinds


def _mesh(part, origin, reflects):
    """A part with a plain material; others have no counterpart that is known to be equal."""
    if part.skin is not None or not isinstance(part.material, Diffuse):
        kind = "the colours of the mesh file" if part.skin is not None else part.material.kind
        raise InputError(
            f"another renderer cannot be given {kind}",
            key=f"{part.name}.material",
            remedy="Only materials of kind diffuse compare; name one.",
        )
    if part.material.diffuse_roughness > 0.0:
        raise InputError(
            "another renderer is given Lambertian surfaces only",
            key=f"{part.name}.material.diffuse_roughness",
            value=part.material.diffuse_roughness,
            remedy="Leave it out.",
        )
    normals = corner_normals(part.vertices, part.faces, part.smooth_angle) if part.smooth_shading else None
    reflectance = part.material.reflectance if reflects else (0.0, 0.0, 0.0)
    return PlainMesh(part.name, part.vertices - origin, part.faces, tuple(reflectance), normals)


def _light(light, T_w_v, origin):
    """A light of the vehicle, in the local world."""
    if light.kind not in ("point", "spot") or getattr(light, "port", None) is not None:
        raise InputError(
            "the peers know points and spots without a port only",
            key="vehicle.lights",
            value=light.kind,
            remedy="Compare a scene with such lights.",
        )
    position = T_w_v[:3, :3] @ light.position + T_w_v[:3, 3] - origin
    axis, half, blend = np.array([0.0, 0.0, 1.0]), np.pi, 0.0
    if light.kind == "spot" and light.cone_deg < 360.0:
        axis = T_w_v[:3, :3] @ np.asarray(light.direction, float)
        axis, half, blend = axis / np.linalg.norm(axis), np.radians(light.cone_deg) / 2, light.blend
    return PlainLight(position, axis, float(half), blend, np.array(light.intensity))
