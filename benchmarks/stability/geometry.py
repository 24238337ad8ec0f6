"""Sweeps of world coordinates, meshes and lenses: what depth D keeps of a wall whose depth is known."""

import numpy as np

from benchmarks.stability import geometry_guidance
from benchmarks.stability.entry import Measured, Sweeps
from varos_warp.errors import InputError
from varos_warp.products.images.depth import decode_depth, encode_depth
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene import device
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import intrinsics, transform
from varos_warp.scene.geometry import terrain
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.geometry.procedural import generate_terrain

TILT, FLOOR = 0.3, 1e-9
"""Slope of the wall; errors below are drawn at the floor."""


def seen_from(*positions, camera=None):
    """A scene that visits some places."""
    stops = [{"time_s": float(i), "position": tuple(map(float, p))} for i, p in enumerate(positions)]
    return scene_from_dict(
        {"trajectory": {"poses": stops}, "vehicle": {"cameras": [{"resolution": (64, 36)} | (camera or {})]}}
    )


def on_the_wall(x, z) -> np.ndarray:
    """Points of the wall y = 3 + TILT x, 3 m in front of the origin."""
    return np.column_stack([x, 3.0 + TILT * np.asarray(x), z])


def wall(half=10.0, parts=1):
    """Vertices and faces of the wall, ``parts`` by ``parts`` squares."""
    side = np.linspace(-half, half, parts + 1)
    x, z = (grid.ravel() for grid in np.meshgrid(side, side))
    n = np.arange((parts + 1) ** 2, dtype=np.int32).reshape(parts + 1, parts + 1)
    a, b, c, d = n[:-1, :-1].ravel(), n[:-1, 1:].ravel(), n[1:, 1:].ravel(), n[1:, :-1].ravel()
    return on_the_wall(x, z), np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])


def truth(camera, at=(0.0, 0.0)) -> np.ndarray:
    """Planar depth of the wall in every column for a camera at (x, y)."""
    K, (width, _) = intrinsics(camera), camera.resolution
    return (3.0 + TILT * at[0] - at[1]) / (1.0 - TILT * (np.arange(width) + 0.5 - K[0, 2]) / K[0, 0])


def depth_error(scene, meshes, at, truth_at=(0.0, 0.0), scale=1.0) -> float:
    """Largest error of D, in units of ``scale``; nan where the wall is missed."""
    parts = [Part(f"objects.{i}", *mesh, Diffuse()) for i, mesh in enumerate(meshes)]
    depth = FrameRenderer(scene, "cpu", parts).render(transform(position=at), outputs="D").D.depth
    error = float(np.abs(depth / scale - truth(scene.vehicle.cameras[0], truth_at)).max())
    return max(error, FLOOR) if np.isfinite(error) else float("nan")


def worst(error) -> float:
    """Return the worst error of places beside a scene that rounding does not favour; nan if one misses the wall."""
    return float(np.max([error(np.array([x, y, 0.0])) for x in (0.1237, -0.3319, 0.4471) for y in (0.0541, -0.2713)]))


# --------------------------------------------------------------------------------------------------------- coordinates


def world_offset() -> Measured:
    """The scene moved away from the origin of the world."""
    offsets = [0.0, 1.0, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 9.9e8]

    def error(offset, local):
        at = np.array([offset + 0.371, 0.213 - 0.73 * offset, 0.3])
        vertices, faces = wall()
        kept = device.local_origin
        if not local:
            device.local_origin = lambda scene, parts: np.zeros(3)
        try:
            return worst(lambda aside: depth_error(seen_from(at), [(vertices + at, faces)], at + aside, aside))
        finally:
            device.local_origin = kept

    return offsets, {
        "D [m]": [error(o, True) for o in offsets],
        "rays in world coordinates [m]": [error(o, False) for o in offsets],
    }


def course_span() -> Measured:
    """One course from end to end, which only one local origin serves."""
    halves = [10.0, 100.0, 1e3, 3e3, 3.2e3, 1e4, 3e4, 1e5, 1e6, 1e7, 1e8]

    def error(half):
        at = np.array([half + 0.371, 0.73 * half + 0.213, 0.331])
        meshes = [(wall()[0] + at, wall()[1]), (wall()[0] - at, wall()[1])]
        return worst(lambda aside: depth_error(seen_from(-at, at), meshes, at + aside, aside))

    return halves, {"D [m]": [error(half) for half in halves]}


# -------------------------------------------------------------------------------------------------------------- meshes


def mesh_scale() -> Measured:
    """The wall and its distance, smaller and larger."""
    scales = [1e-30, 1e-20, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e8, 3e8, 1e9, 1e12]
    vertices, faces = wall()
    return scales, {
        "D, relative": [
            depth_error(seen_from((0, 0, 0)), [(vertices * s, faces)], np.zeros(3), scale=s) for s in scales
        ]
    }


def triangle_size() -> Measured:
    """A near wall of ever larger triangles."""
    sizes = [1.0, 10.0, 100.0, 1e3, 3e3, 1e4, 1e5, 1e6, 1e7, 1e8]

    def error(half):
        camera = {} if half > 5.0 else {"focal_mm": 34.0}
        return depth_error(seen_from((0, 0, 0), camera=camera), [wall(half)], np.zeros(3))

    return sizes, {"D [m]": [error(size) for size in sizes]}


def broken_share() -> Measured:
    """A sheet with ever more of its faces missing, turned over, repeated or loose."""
    shares = [0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97]
    vertices, faces = generate_terrain(20.0, 65, 2.0, seed=3)

    def made(share, fault):
        some = np.random.default_rng(2).random(len(faces)) < share
        v, f = vertices, faces
        if fault == "missing":
            f = faces[~some]
        elif fault == "turned over":
            f = np.where(some[:, None], faces[:, ::-1], faces)
        elif fault == "repeated":
            f = np.concatenate([faces, faces[some], faces[some][:, [0, 0, 1]]])
        else:
            f = faces.copy()
            loose = len(v) + np.arange(3 * some.sum()).reshape(-1, 3)
            v, f[some] = np.concatenate([v, v[faces[some]].reshape(-1, 3)]), loose
        try:
            result = terrain.preprocess(v, f, shrinkwrap_resolution=90, close="none")
        except InputError:
            return float("nan")
        return max(terrain.one_sided_distance((vertices, faces), result, 20_000)["p95"], FLOOR)

    faults = ("missing", "turned over", "repeated", "loose")
    return shares, {fault: [made(share, fault) for share in shares] for fault in faults}


# ----------------------------------------------------------------------------------------------------- lenses and depth


def depth_range() -> Measured:
    """Depth written in 16 bits over 0..25 m and read back."""
    values = [0.0, 1e-4, 1.9e-4, 1e-3, 0.1, 1.0, 5.0, 10.0, 20.0, 24.9997, 24.9999, 25.0, 26.0, 1e3, 1e9]

    def error(depth):
        back = float(decode_depth(encode_depth(np.array([[depth]]), (0.0, 25.0)), (0.0, 25.0))[0, 0])
        return max(abs(back - depth), FLOOR) if np.isfinite(back) else float("nan")

    return values, {"D [m]": [error(v) for v in values]}


SWEEPS: Sweeps = (
    world_offset,
    course_span,
    mesh_scale,
    triangle_size,
    broken_share,
    depth_range,
    *geometry_guidance.SWEEPS,
)
