"""From photogrammetry to a sea floor (paper 3.1.1): join, merge, repair, crop, shrinkwrap, decimate; with a report.

The shrinkwrap here is a height field: the model seen from above, sampled on a square grid. What lies under an overhang
is lost, and the report's distances say how much that and the decimation cost.
"""

import os
from pathlib import Path

import fast_simplification
import numpy as np
import trimesh
from scipy.interpolate import NearestNDInterpolator
from scipy.ndimage import binary_dilation, binary_fill_holes
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from varos_warp.errors import InputError
from varos_warp.scene.procedural import grid_mesh
from varos_warp.scene.query import surface_distance

DISTANCE_SAMPLES = 4000
ROUNDING = 1e-7
"""In grid steps and barycentric coordinates: what float64 loses at UTM coordinates on a grid of centimetres."""


def join(meshes) -> tuple[np.ndarray, np.ndarray]:
    """One mesh (vertices float64 [V, 3], faces int32 [F, 3]) of many, nothing merged."""
    meshes = list(meshes)
    if not meshes:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    offsets = np.cumsum([0] + [len(v) for v, _ in meshes[:-1]])
    vertices = np.concatenate([np.asarray(v, float) for v, _ in meshes])
    faces = np.concatenate([np.asarray(f, np.int64) + o for (_, f), o in zip(meshes, offsets, strict=True)])
    return vertices, faces.astype(np.int32)


def preprocess(vertices, faces, *, region=None, merge_tolerance_m=0.001, shrinkwrap_resolution=None,
               target_vertices=None, key="preprocess") -> tuple[np.ndarray, np.ndarray]:
    """A terrain made fit for use; the arguments are the scene file's block ``terrain.preprocess``.

    Args:
        vertices: float64 [V, 3] [m].
        faces: int32 [F, 3].
        region: Keep the faces that reach into xmin, ymin, xmax, ymax [m]; with a shrinkwrap, exactly the rectangle.
        merge_tolerance_m: Vertices nearer than this become one (chains of such vertices, too) [m].
        shrinkwrap_resolution: Vertices along the longer side of the new grid; none: keep the mesh.
        target_vertices: Decimate to about this many vertices; none: do not.
        key: Where the options stand, for messages.

    Raises:
        InputError: Nothing is left, or the tolerance is larger than the mesh's edges.
    """
    if region is not None:
        vertices, faces = crop(vertices, faces, region, key)
    vertices, faces = merge_near(vertices, faces, merge_tolerance_m, key)
    vertices, faces = clean(vertices, faces)
    if len(faces) == 0:
        raise InputError("no triangles are left", key=key,
                         remedy="All were degenerate: look at the mesh, and lower merge_tolerance_m.")
    if shrinkwrap_resolution is not None:
        vertices, faces = shrinkwrap(vertices, faces, shrinkwrap_resolution, region)
        if len(faces) == 0:
            raise InputError("nothing is seen from above", key=f"{key}.shrinkwrap_resolution",
                             remedy="Only surfaces that can be seen from above can be shrinkwrapped; check up_axis.")
    if target_vertices is not None and target_vertices < len(vertices):
        vertices, faces = decimate(vertices, faces, target_vertices)
    return vertices, faces


def preprocess_meshes(files, vertices: int | None = None, *, merge_tolerance_m: float = 0.001,
                      shrinkwrap_resolution: int | None = None, region=None, up_axis: str | None = None):
    """Join mesh files and make one terrain of them; what ``varos-warp preprocess`` does.

    Args:
        files: Mesh files.
        vertices: Target number of vertices; none: do not decimate.
        merge_tolerance_m: See ``preprocess``; so too the other options.

    Returns:
        The mesh (vertices float64 [V, 3], faces int32 [F, 3]) and a report: ``before`` and ``after`` as in
        ``mesh_facts``, and ``distance_to_result_m``, ``distance_to_original_m`` with ``rms``, ``p95`` and ``max``.
    """
    from varos_warp.scene.meshes import load_mesh

    original = join(load_mesh(file, "MESH", up_axis) for file in files)
    if len(original[1]) == 0:
        raise InputError("no mesh files are given", key="MESH", remedy="Name at least one.")
    result = preprocess(*original, region=region, merge_tolerance_m=merge_tolerance_m, target_vertices=vertices,
                        shrinkwrap_resolution=shrinkwrap_resolution, key="preprocess")
    compared = original if region is None else crop(*original, region, "preprocess")
    report = {"files": [str(file) for file in files], "before": mesh_facts(*original), "after": mesh_facts(*result),
              "distance_to_result_m": one_sided_distance(compared, result),
              "distance_to_original_m": one_sided_distance(result, compared)}
    return result, report


def mesh_facts(vertices: np.ndarray, faces: np.ndarray) -> dict:
    """Counts, bounds [m], area [m^2], whether it is watertight and how many edges have one face only."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    uses = np.bincount(mesh.edges_unique_inverse)
    return {"vertices": len(vertices), "triangles": len(faces), "bounds_m": mesh.bounds.tolist(),
            "area_m2": float(mesh.area), "watertight": bool(mesh.is_watertight),
            "boundary_edges": int(np.count_nonzero(uses == 1))}


def one_sided_distance(source, target, samples: int = DISTANCE_SAMPLES) -> dict:
    """Distances [m] from points spread evenly by area over one mesh to the other: ``rms``, ``p95``, ``max``."""
    points, _ = trimesh.sample.sample_surface(trimesh.Trimesh(*source, process=False), samples, seed=1)
    d = surface_distance(*target, np.asarray(points))
    return {"samples": samples, "rms": float(np.sqrt(np.mean(d**2))), "p95": float(np.quantile(d, 0.95)),
            "max": float(d.max())}


def write_ply(path: str | Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Write a binary PLY in double precision, aside first and then renamed (trimesh writes single precision)."""
    path = Path(path)
    header = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
              "property double x\nproperty double y\nproperty double z\n"
              f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n")
    rows = np.empty(len(faces), [("count", "u1"), ("index", "<i4", 3)])
    rows["count"], rows["index"] = 3, faces
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        aside.write_bytes(header.encode() + np.asarray(vertices, "<f8").tobytes() + rows.tobytes())
        aside.replace(path)
    except OSError as error:
        aside.unlink(missing_ok=True)
        raise InputError(f"cannot be written: {error.strerror}", file=path,
                         remedy="Choose a folder that exists, is writable and has space.") from error


# --------------------------------------------------------------------------------------------------------------- steps


def crop(vertices, faces, region, key="preprocess"):
    """The faces whose bounding rectangle reaches into ``region``."""
    xmin, ymin, xmax, ymax = region
    low, high = vertices[faces, :2].min(axis=1), vertices[faces, :2].max(axis=1)
    kept = faces[(high >= (xmin, ymin)).all(axis=1) & (low <= (xmax, ymax)).all(axis=1)]
    if len(kept) == 0:
        bounds = np.concatenate([vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)]).round(3).tolist()
        raise InputError("lies beside the terrain", key=f"{key}.region", value=list(region),
                         remedy=f"The terrain covers {bounds}.")
    return _compact(vertices, kept)


def merge_near(vertices, faces, tolerance: float, key="preprocess"):
    """Vertices nearer than ``tolerance`` [m] become one, at their mean."""
    edges = np.linalg.norm(np.diff(vertices[faces[:, [0, 1, 2, 0]]], axis=1), axis=2)
    median = float(np.median(edges)) if len(faces) else 0.0
    if tolerance > 0.5 * median and tolerance > 0.0 and median > 0.0:
        raise InputError(f"is more than half the mesh's median edge of {median:.3g} m", value=tolerance,
                         key=f"{key}.merge_tolerance_m", remedy="Lower it, else the surface collapses.")
    pairs = cKDTree(vertices).query_pairs(tolerance, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs), np.int8), pairs.T), shape=(len(vertices),) * 2)
    count, label = connected_components(graph, directed=False)
    merged = np.column_stack([np.bincount(label, vertices[:, axis], count) for axis in range(3)])
    return merged / np.bincount(label, minlength=count)[:, None], label[faces].astype(np.int32)


def clean(vertices, faces):
    """Without degenerate and repeated faces, and without vertices that no face uses."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0.0]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return _compact(vertices, faces[np.sort(first)])


def _compact(vertices, faces):
    used, renumbered = np.unique(faces, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3).astype(np.int32)


def decimate(vertices, faces, target_vertices: int):
    """About ``target_vertices`` vertices, by quadric edge collapse (Garland and Heckbert 1997)."""
    centre = vertices.mean(axis=0)  # the library computes in float32
    target = max(4, round(len(faces) * target_vertices / len(vertices)))
    points, triangles = fast_simplification.simplify((vertices - centre).astype(np.float32), faces,
                                                     target_count=target, lossless=False)
    return clean(points.astype(float) + centre, np.asarray(triangles, np.int32))


def shrinkwrap(vertices, faces, resolution: int, region=None):
    """A regular grid draped over the model as seen from above, ``resolution`` vertices along the longer side.

    Holes inside the outline are closed smoothly; beyond the outline there is nothing.
    """
    low, high = vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)
    if region is not None:
        low, high = np.maximum(low, region[:2]), np.minimum(high, region[2:])
    if not (high > low).all():  # a wall
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    step = (high - low).max() / (resolution - 1)
    x, y = (np.linspace(low[i], high[i], max(2, round((high[i] - low[i]) / step) + 1)) for i in range(2))
    z = rasterise(vertices, faces, x, y)
    covered = np.isfinite(z)
    if not covered.any():
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    keep = binary_fill_holes(covered)
    return grid_mesh(x, y, _fill(z, keep & ~covered), keep)


def rasterise(vertices, faces, x, y, chunk: int = 2_000_000):
    """Height [len(y), len(x)] of the highest surface over every node of a regular grid; NaN where there is none.

    Every triangle is tried on the nodes of its bounding rectangle, a bounded number of pairs at a time.
    """
    z = np.full((len(y), len(x)), -np.inf)
    triangles = vertices[faces]
    origin, step = np.array([x[0], y[0]]), np.array([np.ptp(x) / (len(x) - 1), np.ptp(y) / (len(y) - 1)])
    flat = (triangles[..., :2] - origin) / step
    first = np.clip(np.ceil(flat.min(axis=1) - ROUNDING), 0, None).astype(np.int64)
    last = np.minimum(np.floor(flat.max(axis=1) + ROUNDING), (len(x) - 1, len(y) - 1)).astype(np.int64)
    span = np.maximum(last - first + 1, 0)
    count = span.prod(axis=1)
    bounds = np.searchsorted(np.cumsum(count), np.arange(0, count.sum() + chunk, chunk))
    for start, stop in zip(bounds[:-1], np.append(bounds[1:-1], len(faces)), strict=True):
        _raster_chunk(z, flat, triangles[..., 2], first, span, count, np.arange(start, stop))
    return np.where(np.isfinite(z), z, np.nan)


def _raster_chunk(z, flat, heights, first, span, count, members):
    """Raise ``z`` to the triangles ``members``, in units of grid steps."""
    which = np.repeat(members, count[members])
    offset = np.arange(len(which)) - np.repeat(np.cumsum(count[members]) - count[members], count[members])
    column = first[which, 0] + offset % span[which, 0]
    row = first[which, 1] + offset // span[which, 0]
    a, b, c = (flat[which, i] for i in range(3))
    p = np.column_stack([column, row]) - a
    ab, ac = b - a, c - a
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    safe = np.where(area == 0.0, 1.0, area)
    v = (p[:, 0] * ac[:, 1] - p[:, 1] * ac[:, 0]) / safe
    w = (ab[:, 0] * p[:, 1] - ab[:, 1] * p[:, 0]) / safe
    hit = (area != 0.0) & (v >= -ROUNDING) & (w >= -ROUNDING) & (v + w <= 1.0 + ROUNDING)
    h = heights[which]
    np.maximum.at(z, (row[hit], column[hit]), (h[:, 0] + v * (h[:, 1] - h[:, 0]) + w * (h[:, 2] - h[:, 0]))[hit])


def _fill(z, holes):
    """Heights with ``holes`` closed: the harmonic surface through their rims, by repeated averaging."""
    if not holes.any():
        return z
    rim = binary_dilation(holes, np.ones((3, 3))) & ~holes & np.isfinite(z)
    z = z.copy()
    z[holes] = NearestNDInterpolator(np.argwhere(rim), z[rim])(np.argwhere(holes))
    row, column = np.nonzero(holes)
    up, down = np.maximum(row - 1, 0), np.minimum(row + 1, z.shape[0] - 1)
    left, right = np.maximum(column - 1, 0), np.minimum(column + 1, z.shape[1] - 1)
    for _ in range(4 * max(z.shape)):
        z[row, column] = 0.25 * (z[up, column] + z[down, column] + z[row, left] + z[row, right])
    return z
