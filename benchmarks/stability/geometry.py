"""Sweeps of world coordinates, meshes and lenses: what depth D keeps of a wall whose depth is known."""

import time

import numpy as np

from benchmarks.stability import geometry_guidance
from benchmarks.stability.entry import Sweep, Sweeps
from varos_warp.errors import InputError
from varos_warp.products.images.depth import decode_depth, encode_depth
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene import device
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import intrinsics, transform
from varos_warp.scene.geometry import terrain
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.geometry.procedural import generate_terrain

COORDINATES = "tests/stability/test_coordinates.py"
MESHES = "tests/stability/test_mesh_limits.py"
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
    """Of places beside a scene, for which rounding has no reason to be kind; nan if the wall is missed from one."""
    return float(np.max([error(np.array([x, y, 0.0])) for x in (0.1237, -0.3319, 0.4471) for y in (0.0541, -0.2713)]))


# --------------------------------------------------------------------------------------------------------- coordinates


def world_offset() -> Sweep:
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

    return Sweep(
        "world_offset",
        "World coordinates",
        "float64 world, float32 scene about a local origin",
        "offset [m]",
        offsets,
        {
            "D [m]": [error(o, True) for o in offsets],
            "rays in world coordinates [m]": [error(o, False) for o in offsets],
        },
        "Largest error of D of a wall 3 m away, the whole scene moved by the offset in x and -y; poses keep the "
        "spacing of float64.",
        "1e9 m, where float64 places are 0.1 micrometres apart",
        "without the local origin D is off by its step (0.38 mm) at 10 km and by 0.6 m at 1e7 m",
        "moves everything to a local origin in float64; refuses coordinates beyond 1e9 m",
        f"{COORDINATES}::test_coordinates_of_more_than_a_million_kilometres_are_refused",
        holds=(None, 1e9),
        bound=1e-5,
        scale="symlog",
    )


def course_span() -> Sweep:
    """One course from end to end, which only one local origin serves."""
    halves = [10.0, 100.0, 1e3, 3e3, 3.2e3, 1e4, 3e4, 1e5, 1e6, 1e7, 1e8]

    def error(half):
        at = np.array([half + 0.371, 0.73 * half + 0.213, 0.331])
        meshes = [(wall()[0] + at, wall()[1]), (wall()[0] - at, wall()[1])]
        return worst(lambda aside: depth_error(seen_from(-at, at), meshes, at + aside, aside))

    return Sweep(
        "course_span",
        "Width of a course",
        "float32 scene about the middle of the course",
        "distance from the middle [m]",
        halves,
        {"D [m]": [error(half) for half in halves]},
        "Largest error of D of a wall 3 m away, seen from the end of a course.",
        "3.2 km, where places round by half a step of D",
        "at 10 km D is off by its step, at 30 km by a millimetre, at 1e7 m by 0.6 m",
        "warns, and says to divide the course into several scenes",
        f"{COORDINATES}::test_a_course_so_wide_that_depth_loses_its_step_is_reported",
        holds=(None, 3.2e3),
        bound=25.0 / 65535,
    )


# -------------------------------------------------------------------------------------------------------------- meshes


def mesh_scale() -> Sweep:
    """The wall and its distance, smaller and larger."""
    scales = [1e-30, 1e-20, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e8, 3e8, 1e9, 1e12]
    vertices, faces = wall()
    return Sweep(
        "mesh_scale",
        "Scale of a mesh",
        "rays in float32",
        "scale",
        scales,
        {
            "D, relative": [
                depth_error(seen_from((0, 0, 0)), [(vertices * s, faces)], np.zeros(3), scale=s) for s in scales
            ]
        },
        "Largest error of D of a wall at 3 m times the scale, in units of the scale.",
        "1e-9 to 1e9 m of size",
        "products of smaller lengths underflow: D is off by 0.4 % at 1e-15; rays are 1e9 m long: nothing is hit beyond",
        "refuses parts smaller than 1e-9 m or larger than 1e9 m; warns of sizes that no sea floor or object has",
        f"{COORDINATES}::test_objects_of_sizes_that_rays_cannot_resolve_are_refused",
        holds=(1e-9, 1e8),
        bound=2e-5,
    )


def triangle_size() -> Sweep:
    """A near wall of ever larger triangles."""
    sizes = [1.0, 10.0, 100.0, 1e3, 3e3, 1e4, 1e5, 1e6, 1e7, 1e8]

    def error(half):
        camera = {} if half > 5.0 else {"focal_mm": 34.0}
        return depth_error(seen_from((0, 0, 0), camera=camera), [wall(half)], np.zeros(3))

    return Sweep(
        "triangle_size",
        "Size of a triangle",
        "rays in float32",
        "half side [m]",
        sizes,
        {"D [m]": [error(size) for size in sizes]},
        "Largest error of D of a wall 3 m away made of two triangles.",
        "about 1 km for half a step of D at 3 m",
        "the corners round in proportion to their distance: a floor of two triangles 100 km wide is off by millimetres",
        "warns of objects larger than 100 m and terrains larger than 50 km; a giant plane is better divided",
        f"{MESHES}::test_the_depth_of_a_large_triangle_loses_digits_with_its_size",
        holds=(None, 1e3),
        bound=0.5 * 25.0 / 65535,
    )


def needles() -> Sweep:
    """A fan of ever thinner triangles that fills the view."""
    aspects = [10.0, 100.0, 1e3, 1e4, 1e5, 3e5, 1e6]

    def fan(aspect):
        width = 20.0 / aspect
        x = np.arange(-4, 5) * width + 0.371 * width
        low = 2 * np.arange(8)
        faces = np.concatenate([np.stack([low, low + 2, low + 3], -1), np.stack([low, low + 3, low + 1], -1)])
        camera = {"focal_mm": min(3.0 * 4.416 / (0.25 * width), 1e6)}
        mesh = on_the_wall(np.repeat(x, 2), np.tile([-10.0, 10.0], 9)), faces.astype(np.int32)
        return seen_from((0, 0, 0), camera=camera), mesh

    def seen(aspect):
        scene, mesh = fan(aspect)
        depth = FrameRenderer(scene, "cpu", [Part("a", *mesh, Diffuse())]).render(np.eye(4), outputs="D").D.depth
        hit, off = np.isfinite(depth), np.abs(depth - truth(scene.vehicle.cameras[0]))
        return max(float(off[hit].max()), FLOOR), max(1.0 - float(hit.mean()), FLOOR)

    made = [seen(aspect) for aspect in aspects]
    return Sweep(
        "needles",
        "Needle triangles",
        "watertight intersection in float32",
        "length over width",
        aspects,
        {"D [m]": [a for a, _ in made], "share of rays that fall through": [b for _, b in made]},
        "A fan of triangles 20 m long, seen through a lens that sees a quarter of one from 3 m: error of D, and rays "
        "that miss.",
        "no end found: to 1e6, where the lens ends",
        "nothing was found to fail",
        "repairs drop triangles without area only",
        f"{MESHES}::test_needles_are_hit_where_they_are",
        bound=1e-5,
    )


def triangle_count() -> Sweep:
    """The wall in ever more triangles."""
    counts = [1, 7, 70, 700]
    rows = []
    for parts in counts:
        mesh, scene = wall(10.0, parts), seen_from((0, 0, 0))
        start = time.process_time()
        error = depth_error(scene, [mesh], np.zeros(3))
        rows.append((2.0 * parts**2, error, time.process_time() - start))
    return Sweep(
        "triangle_count",
        "Number of triangles",
        "scene in memory, BVH, smoothed normals",
        "triangles",
        [count for count, _, _ in rows],
        {"D [m]": [error for _, error, _ in rows], "CPU to load and see it [s]": [seconds for _, _, seconds in rows]},
        "Error of D of a wall 3 m away, and the time from arrays to the first image of depth.",
        "memory: 500 bytes a triangle at the peak, while normals are smoothed; no error found to 10 million",
        "nothing but patience: 10 million triangles (measured once) took 42 s of one core and 5 GB",
        "`varos-warp preprocess --vertices` decimates a terrain",
        f"{MESHES}::test_one_triangle_is_a_world",
        bound=1e-5,
    )


def broken_share() -> Sweep:
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
    return Sweep(
        "broken_share",
        "Broken terrains",
        "preprocess with a shrinkwrap",
        "share of the faces",
        shares,
        {fault: [made(share, fault) for share in shares] for fault in faults},
        "A sea floor 20 m wide, relief 2 m, grid of 31 cm, wrapped at 22 cm: 95 % of it lie nearer to the result than "
        "this [m]; 1.7 cm is the grid's own.",
        "a third of the faces missing; no end found for faces turned over, repeated or loose",
        "with half of the faces missing the relief between what is left is lost: 0.3 m, and more with more",
        "repairs and reports what it did; refuses what has no triangles left",
        "tests/stability/test_broken_meshes.py::test_a_broken_sheet_becomes_a_sound_one",
        scale="symlog",
    )


# ----------------------------------------------------------------------------------------------------- lenses and depth


def focal_length() -> Sweep:
    """From almost 180 degrees to a microradian."""
    values = [1e-30, 1e-12, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 3.4, 100.0, 1e4, 1e6, 1e9]
    flat = np.array([[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]])

    def error(focal, checked):
        try:
            camera = Camera(focal_mm=focal, resolution=(64, 36))
        except ValueError:
            if checked:
                return float("nan")
            camera = Camera.model_construct(**Camera(resolution=(64, 36)).model_dump() | {"focal_mm": focal})
        vertices = min(max(20.0, 30.0 / focal), 1e30) * flat + [0.0, 3.0, 0.0]
        part = Part("a", vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Diffuse())
        renderer = FrameRenderer(seen_from((0, 0, 0)), "cpu", [part])
        depth = renderer.render(np.eye(4), camera, outputs="D").D.depth
        error = float(np.abs(depth / 3.0 - 1.0).max())
        return max(error, FLOOR) if np.isfinite(error) else float("nan")

    return Sweep(
        "focal_length",
        "Focal length",
        "pinhole in float32",
        "focal_mm [mm]",
        values,
        {"ours": [error(f, True) for f in values], "if it were taken": [error(f, False) for f in values]},
        "Relative error of D of a plane at 3 m, sensor 4.4 mm; the plane is somewhat larger than the view.",
        "1e-3 to 1e6 mm: 179.97 degrees to 0.9 arc seconds",
        "at 1e-12 mm rays run along the plane and miss it",
        "refuses",
        f"{COORDINATES}::test_lenses_that_single_precision_cannot_hold_are_refused",
        holds=(1e-3, 1e6),
        bound=2e-5,
    )


def depth_range() -> Sweep:
    """Depth written in 16 bits over 0..25 m and read back."""
    values = [0.0, 1e-4, 1.9e-4, 1e-3, 0.1, 1.0, 5.0, 10.0, 20.0, 24.9997, 24.9999, 25.0, 26.0, 1e3, 1e9]

    def error(depth):
        back = float(decode_depth(encode_depth(np.array([[depth]]), (0.0, 25.0)), (0.0, 25.0))[0, 0])
        return max(abs(back - depth), FLOOR) if np.isfinite(back) else float("nan")

    return Sweep(
        "depth_range",
        "Range of D",
        "16 bit PNG",
        "depth [m]",
        values,
        {"D [m]": [error(v) for v in values]},
        "Error of a depth that was written and read back.",
        "half a step (0.19 mm) up to half a step below 25 m",
        "at and beyond the end of the range there is one value for all",
        "reads back as infinite, the same as nothing "
        "hit; render.depth_range_m widens it, render.depth_exr writes float32",
        f"{COORDINATES}::test_depth_keeps_half_a_step_up_to_the_end_of_its_range_and_is_infinite_beyond",
        holds=(None, 24.9998),
        bound=0.5 * 25.0 / 65535 * 1.001,
    )


SWEEPS: Sweeps = (
    world_offset,
    course_span,
    mesh_scale,
    triangle_size,
    needles,
    triangle_count,
    broken_share,
    focal_length,
    depth_range,
    *geometry_guidance.SWEEPS,
)
