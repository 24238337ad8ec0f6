"""A scene of things that hide each other, and which pixels show each: by float64 rays against every triangle."""

import numpy as np

from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.parts import Grown, Instances, Moving
from varos_warp.scene.optics.camera import pixel_centres
from varos_warp.scene.optics.shutter import in_ns, offsets_of_rows_s
from varos_warp.sim.clock import frame_time_ns
from varos_warp.sim.companions import motions

PATH = [
    {"time_s": 0, "position": [-1.4, 3.4, 0.5], "rotation_euler_deg": [20, 70, 0]},
    {"time_s": 0.4, "position": [0.2, 3.6, 0.6], "rotation_euler_deg": [0, 90, 40]},
]
ROUGH = {"chord_error_m": 0.05}
SCENE = {
    "name": "hidden",
    "terrain": {"kind": "procedural", "size_m": 20, "resolution": 17, "position": [0, 5, -1.6]},
    "objects": [
        {"kind": "boulder", "position": [0.25, 4, 0], "diameter": 1.2, "class": "rock", **ROUGH},  # half hidden
        {"kind": "pipe", "radius": 0.25, "length": 1.6, "position": [0, 2.6, 0], **ROUGH},  # before it
        {"kind": "boulder", "position": [0, -4, 0], "class": "rock", **ROUGH},  # behind the cameras
        {"kind": "pipe", "radius": 0.2, "length": 1.0, "path": PATH, **ROUGH},
        {
            "kind": "boulder",
            "position": [-2.5, 4, 0.2],
            "diameter": 1.0,
            "rotation_euler_deg": [30, 40, 50],
            "scale": [1.0, 1.4, 0.7],
            **ROUGH,
        },  # leaves the image
        {"kind": "boulder", "position": [0, 3.6, -0.1], "diameter": 0.2, **ROUGH},
    ],  # hidden by the pipe
    "scatter": [
        {
            "object": {"kind": "boulder", "diameter": 0.3, **ROUGH},
            "count": 12,
            "area": [-2, 2, 2, 6],
            "scale_range": [0.5, 2],
        }
    ],
    "growth": [{"on": ["objects.0", "terrain"], "kind": "tube_worm", "per_m2": 8, "size_m": [0.1, 0.15]}],
    "vehicle": {
        "cameras": [
            {"id": "M0", "resolution": [64, 36]},
            {
                "id": "M1",
                "resolution": [48, 27],
                "rotation_euler_deg": [-10, 0, 0],
                "distortion": {"model": "kannala_brandt", "k": [-0.02, 0.003, 0, 0]},
                "port": {"kind": "dome", "radius_m": 0.05, "centre": [0.002, 0, 0.003]},
            },
            {"id": "R0", "resolution": [48, 27], "exposure": {"time_s": 0.004, "readout_s": 0.06}},
        ]
    },
    "trajectory": {
        "poses": [
            {"time_s": 0, "position": [0, 0, 0]},
            {"time_s": 1, "position": [0.6, 0.2, 0], "rotation_euler_deg": [0, 0, 20]},
        ],
        "duration_s": 0.3,
    },
    "render": {"frame_rate_hz": 10, "outputs": ["B", "D", "S"], "spp_b": 1, "denoise_b": "none"},
}
NEAR = 1e-4
"""Pixels by which rays are moved aside: some hundred times the rounding of float32 in the image of this scene. What all
of them hit, the middle one hits by any arithmetic."""


def distances(vertices, faces, origin, direction):
    """Distances [N] at which rays [N, 3] first hit a mesh; inf where they do not (Moeller and Trumbore)."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    found = np.full(len(origin), np.inf)
    middle = (vertices.min(0) + vertices.max(0)) / 2
    radius = 1.01 * np.linalg.norm(vertices - middle, axis=1).max()
    near = np.flatnonzero(np.linalg.norm(np.cross(middle - origin, direction), axis=1) < radius)
    for i in range(0, len(near), 64):
        some = near[i : i + 64]
        o, d = origin[some, None], direction[some, None]
        p = np.cross(d, (c - a)[None])
        det = (p * (b - a)).sum(-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = ((o - a) * p).sum(-1) / det
            q = np.cross(o - a, (b - a)[None])
            v, t = (q * d).sum(-1) / det, (q * (c - a)).sum(-1) / det
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        found[some] = np.where(hit, t, np.inf).min(1)
    return found


def meshes(scene, at_ns, parts):
    """World vertices and faces of all parts at a time, by number in S; what grows has that of its host."""
    found: dict[int, list] = {}
    known, numbers = motions(scene), {name: i for i, name in enumerate(scene.numbered, 1)}
    for part in parts:
        if isinstance(part, Moving):
            T = known[part.name](np.array([at_ns]))[0]
            own = (part.vertices - part.origin) @ part.R_w_o
            found.setdefault(numbers[part.name], []).append((own @ T[:3, :3].T + T[:3, 3], part.faces))
        elif isinstance(part, Instances):
            for i, copy in enumerate(part.parts()):
                host = part.hosts[part.host[i]] if isinstance(part, Grown) else copy.name
                number = numbers.setdefault(host, len(numbers) + 1)
                found.setdefault(number, []).append((copy.vertices, copy.faces))
        else:
            found.setdefault(numbers[part.name], []).append((part.vertices, part.faces))
    return found


def rays_of(data, frame, camera, aside):
    """Rays of all pixels, moved ``aside`` [2] [px], in the world: origins and directions [H, W, 3]."""
    about, model = data.camera(camera), data.camera_model(camera)
    rays = model.rays(pixel_centres(about["width"], about["height"]) + aside)
    T = data.T_w_c_rows(frame, camera)[:, None]
    return (
        np.einsum("hwij,hwj->hwi", np.broadcast_to(T[..., :3, :3], (*rays.origin.shape, 3)), rays.origin)
        + T[..., :3, 3],
        np.einsum("hwij,hwj->hwi", np.broadcast_to(T[..., :3, :3], (*rays.origin.shape, 3)), rays.direction),
    )


def truth(data, frame, camera):
    """By number: pixels that surely show it, that may, that would surely if nothing hid it, that may; bool [H, W]."""
    scene, about = scene_from_dict(data.meta["scene"]), data.camera(camera)
    rows = offsets_of_rows_s(about["height"], (about.get("exposure") or {"readout_s": 0.0})["readout_s"])
    time_ns = frame_time_ns(frame, data.meta["frames"]["rate_hz"]) + in_ns(rows)
    rolls = len(np.unique(time_ns)) > 1
    parts = build_parts(scene)
    every = [meshes(scene, t, parts) for t in (time_ns if rolls else time_ns[:1])]
    seen, whole = {}, {}
    for aside in NEAR * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]):
        o, d = (rays.reshape(len(every), -1, 3) for rays in rays_of(data, frame, camera, aside))
        t = {
            number: np.stack(
                [np.min([distances(*mesh, o[k], d[k]) for mesh in there[number]], 0) for k, there in enumerate(every)]
            ).reshape(about["height"], -1)
            for number in every[0]
        }
        nearest = np.min(list(t.values()), 0)
        for number, own in t.items():
            seen.setdefault(number, []).append(np.isfinite(own) & (own <= nearest))
            whole.setdefault(number, []).append(np.isfinite(own))
    return {
        number: (np.all(seen[number], 0), np.any(seen[number], 0), np.all(whole[number], 0), np.any(whole[number], 0))
        for number in seen
    }
