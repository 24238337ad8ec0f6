"""Sweeps of world coordinates, meshes and lenses: what depth D keeps of a wall whose depth is known."""

from functools import cache

import numpy as np

from benchmarks.stability import geometry_guidance
from benchmarks.stability.entry import Sweeps
from varos_warp.products.images.depth import decode_depth, encode_depth
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene import device
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import intrinsics, transform
from varos_warp.scene.geometry import terrain
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.geometry.procedural import generate_terrain

TILT = 0.3
"""Slope of the wall."""


def seen_from(*positions, camera=None):
    """A scene that visits some places."""
    stops = [{"time_s": float(i), "position": tuple(map(float, p))} for i, p in enumerate(positions)]
    return scene_from_dict(
        {"trajectory": {"poses": stops}, "vehicle": {"cameras": [{"resolution": (64, 36)} | (camera or {})]}}
    )


def wall(half=10.0):
    """Vertices and faces of the wall y = 3 + TILT x, 3 m in front of the origin."""
    x, z = half * np.array([-1.0, 1.0, 1.0, -1.0]), half * np.array([-1.0, -1.0, 1.0, 1.0])
    return np.column_stack([x, 3.0 + TILT * x, z]), np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def truth(camera, at=(0.0, 0.0)) -> np.ndarray:
    """Planar depth of the wall in every column for a camera at (x, y)."""
    K, (width, _) = intrinsics(camera), camera.resolution
    return (3.0 + TILT * at[0] - at[1]) / (1.0 - TILT * (np.arange(width) + 0.5 - K[0, 2]) / K[0, 0])


def depth_error(scene, meshes, at, truth_at=(0.0, 0.0), scale=1.0) -> float:
    """Largest error of D, in units of ``scale``; nan where the wall is missed."""
    parts = [Part(f"objects.{i}", *mesh, Diffuse()) for i, mesh in enumerate(meshes)]
    depth = FrameRenderer(scene, "cpu", parts).render(transform(position=at), outputs="D").D.depth
    error = float(np.abs(depth / scale - truth(scene.vehicle.cameras[0], truth_at)).max())
    return error if np.isfinite(error) else float("nan")


def worst(error) -> float:
    """Return the worst error of places beside a scene that rounding does not favour; nan if one misses the wall."""
    return float(np.max([error(np.array([x, y, 0.0])) for x in (0.1237, -0.3319, 0.4471) for y in (0.0541, -0.2713)]))


def offset_error(offset: float, local: bool = True) -> float:
    """The scene moved away from the origin of the world, with rays from a local origin or from the world's."""
    at = np.array([offset + 0.371, 0.213 - 0.73 * offset, 0.3])
    vertices, faces = wall()
    kept = device.local_origin
    if not local:
        device.local_origin = lambda scene, parts: np.zeros(3)
    try:
        return worst(lambda aside: depth_error(seen_from(at), [(vertices + at, faces)], at + aside, aside))
    finally:
        device.local_origin = kept


def span_error(half: float) -> float:
    """At the end of a course which only one local origin serves."""
    at = np.array([half + 0.371, 0.73 * half + 0.213, 0.331])
    vertices, faces = wall()
    meshes = [(vertices + at, faces), (vertices - at, faces)]
    return worst(lambda aside: depth_error(seen_from(-at, at), meshes, at + aside, aside))


def near_error(scale: float = 1.0, half: float = 10.0) -> float:
    """The wall and its distance, smaller and larger; or near, of ever larger triangles."""
    scene = seen_from((0, 0, 0), camera={} if half > 5.0 else {"focal_mm": 34.0})
    vertices, faces = wall(half)
    return depth_error(scene, [(vertices * scale, faces)], np.zeros(3), scale=scale)


SHEET = cache(lambda: generate_terrain(20.0, 65, 2.0, seed=3))


def broken(share: float, fault: str):
    """A sheet with a share of its faces missing, turned over, repeated or loose."""
    v, f = SHEET()
    some = np.random.default_rng(2).random(len(f)) < share
    if fault == "missing":
        return v, f[~some]
    if fault == "turned over":
        return v, np.where(some[:, None], f[:, ::-1], f)
    if fault == "repeated":
        return v, np.concatenate([f, f[some], f[some][:, [0, 0, 1]]])
    loose = f.copy()
    loose[some] = len(v) + np.arange(3 * some.sum()).reshape(-1, 3)
    return np.concatenate([v, v[f[some]].reshape(-1, 3)]), loose


def mended_error(share: float, fault: str) -> float:
    """Distance [m] to the sheet from what is made of the broken one, that 95 % keep within."""
    made = terrain.preprocess(*broken(share, fault), shrinkwrap_resolution=90, close="none")
    return terrain.one_sided_distance(SHEET(), made, 20_000)["p95"]


def coded_error(depth: float) -> float:
    """Depth written in 16 bits over 0..25 m and read back."""
    back = float(decode_depth(encode_depth(np.array([[depth]]), (0.0, 25.0)), (0.0, 25.0))[0, 0])
    return abs(back - depth) if np.isfinite(back) else float("nan")


SWEEPS: Sweeps = {
    "world_offset": {"D [m]": offset_error, "rays in world coordinates [m]": lambda x: offset_error(x, local=False)},
    "course_span": {"D [m]": span_error},
    "mesh_scale": {"D, relative": near_error},
    "triangle_size": {"D [m]": lambda half: near_error(half=half)},
    "broken_share": {
        fault: lambda share, fault=fault: mended_error(share, fault)
        for fault in ("missing", "turned over", "repeated", "loose")
    },
    "depth_range": {"D [m]": coded_error},
    **geometry_guidance.SWEEPS,
}
