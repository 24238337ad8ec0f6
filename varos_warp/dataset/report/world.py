"""The world for the page: the ground and what stands on it in a few thousand triangles, the course, the cameras."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.points import planar_depth, points_at
from varos_warp.dataset.report.pictures import spread
from varos_warp.dataset.write import texts as writers
from varos_warp.errors import InputError
from varos_warp.scene.geometry.parts import Instances, Part

TRIANGLES = {"ground": 6000, "objects": 4500}
"""About as many of each does the page draw; it sorts them at every stroke."""
FEWEST = 12
"""Triangles of a part."""
MOST_COPIES = 400
"""Of a scattered object."""
MARGIN_M = 12.0
"""How far the world is drawn around the course."""
POINTS = 9000
"""Of the cloud that stands in where there are no meshes."""
COURSE_POINTS = 600


@dataclass
class SceneParts:
    """The dataset's scene made anew."""

    parts: list[Part | Instances] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    """What looks wrong in the scene."""
    missing: str | None = None
    """Why there are no parts."""


def scene_parts(data: Dataset) -> SceneParts:
    """The meshes that the dataset was rendered of; none where a file is not at hand, or is not the same any more."""
    from varos_warp.scene.checks import check_scene
    from varos_warp.scene.geometry.build import build_parts
    from varos_warp.scene.load import scene_from_dict

    try:
        scene = scene_from_dict(data.meta["scene"])
        changed = [name for name, digest in writers.sources(scene).items() if digest != data.meta["sources"].get(name)]
        if changed:
            return SceneParts(missing=f"{changed[0]} is not at hand, or not as it was")
        parts = build_parts(scene)
        return SceneParts(parts, check_scene(scene, parts))
    except InputError as error:
        return SceneParts(missing=error.message.rstrip("."))


def world(data: Dataset, frames: list[int], scene: SceneParts) -> dict[str, Any]:
    """What the page draws in three dimensions.

    Args:
        data: The dataset.
        frames: Those that the page shows.
        scene: Its meshes.

    Returns:
        ``course`` (points), ``cameras`` (by id: ``poses``, row-major 3 x 4 of every frame, and ``half``, the tangents
        of half the field of view), ``meshes`` (``vertices`` in mm and ``faces``, flat) or ``cloud`` (``points`` in mm
        and ``colors``, flat), all moved by ``origin`` [m].
    """
    course = data.poses("vehicle")[1][:, :3, 3] if "vehicle" in data.recorded else data.views()[1][:, :3, 3]
    origin = np.round(course.mean(axis=0))
    rows = np.searchsorted(data.frames, frames)
    cameras = {camera: {"poses": [_rounded(T[:3] - np.pad(origin[:, None], ((0, 0), (3, 0))))
                                  for T in data.views(camera)[1][rows]], "half": _half(data, camera)}
               for camera in data.cameras}
    picks = np.unique(np.linspace(0, len(course) - 1, min(len(course), COURSE_POINTS)).round().astype(int))
    result = {"origin": origin.tolist(), "course": _rounded(course[picks] - origin), "cameras": cameras}
    meshes = {kind: _mesh(scene.parts, kind, course, origin) for kind in TRIANGLES}
    meshes = {kind: mesh for kind, mesh in meshes.items() if mesh is not None}
    if meshes:
        return result | {"meshes": meshes}
    return result | ({"cloud": _cloud(data, frames, origin)} if "D" in data.outputs and frames else {})


def _rounded(values: np.ndarray) -> list:
    return np.round(values, 4).ravel().tolist()


def _half(data: Dataset, camera: str) -> list[float]:
    about, K = data.camera(camera), data.intrinsics(camera)
    return [about["width"] / 2 / K[0, 0], about["height"] / 2 / K[1, 1]]


# -------------------------------------------------------------------------------------------------------------- meshes


Piece = tuple[np.ndarray, np.ndarray]
"""Vertices float64 [V, 3] [m] and faces int [F, 3]."""


def _mesh(parts: list, kind: str, course: np.ndarray, origin: np.ndarray) -> dict[str, list[int]] | None:
    """The ground, or all the rest, near the course and decimated; None where there is none.

    Every part gets triangles in proportion to its size, so that what is small keeps a shape.
    """
    chosen = [part for part in parts if (part.name == "terrain") == (kind == "ground")]
    pieces = [_copies(part, course) if isinstance(part, Instances) else [_near(part.vertices, part.faces, course)]
              for part in chosen]
    sizes = np.array([sum(np.sqrt(_area(*piece)) for piece in group) for group in pieces])
    if not sizes.sum() > 0:
        return None
    shares = TRIANGLES[kind] * sizes / sizes.sum()
    made = [decimate(*piece, max(FEWEST, int(share / len(group))))
            for group, share in zip(pieces, shares, strict=True) for piece in group if len(piece[1])]
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in made)])
    vertices = np.concatenate([vertices for vertices, _ in made]) - origin
    faces = np.concatenate([faces + start for (_, faces), start in zip(made, starts, strict=False)])
    return {"vertices": np.rint(vertices * 1000).astype(int).ravel().tolist(), "faces": faces.ravel().tolist()}


def _area(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _copies(part: Instances, course: np.ndarray) -> list[Piece]:
    """The copies near the course, the largest of them if they are very many, each with few triangles already."""
    low, high = _box(course)
    at = part.T_w_o[:, :2, 3]
    near = part.T_w_o[((at >= low) & (at <= high)).all(axis=1)]
    near = near[np.argsort(-np.linalg.det(near[:, :3, :3]), kind="stable")[:MOST_COPIES]]
    vertices, faces = decimate(part.vertices, part.faces, 4 * FEWEST)
    return [(vertices @ T[:3, :3].T + T[:3, 3], faces) for T in near]


def _box(course: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends in x and y of what is drawn around the course."""
    return course.min(axis=0)[:2] - MARGIN_M, course.max(axis=0)[:2] + MARGIN_M


def _near(vertices: np.ndarray, faces: np.ndarray, course: np.ndarray) -> Piece:
    """Triangles around the course, and the vertices that they use."""
    low, high = _box(course)
    inside = ((vertices[:, :2] >= low) & (vertices[:, :2] <= high)).all(axis=1)
    faces = faces[inside[faces].all(axis=1)]
    used, index = np.unique(faces, return_inverse=True)
    return vertices[used], index.reshape(-1, 3)


def decimate(vertices: np.ndarray, faces: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """A mesh of about ``most`` triangles at most; the least noticeable go first."""
    if len(faces) <= most:
        return vertices, faces
    import fast_simplification

    return fast_simplification.simplify(vertices.astype(np.float32), faces.astype(np.int32), target_count=most)


# --------------------------------------------------------------------------------------------------------------- cloud


def _cloud(data: Dataset, frames: list[int], origin: np.ndarray) -> dict[str, list[int]]:
    """Points of D of some frames, carried into the world by the poses, with the colours of B (or A, or white)."""
    views = [(camera, frame) for camera in data.cameras for frame in spread(frames, 12)]
    color = next((output for output in "BA" if output in data.outputs), None)
    points, colors = [], []
    for camera, frame in views:
        found, where = back_project(data, frame, camera, POINTS // len(views))
        points.append(found - origin)
        colors.append(data.pixels(color, frame, camera)[where] if color else np.full((len(found), 3), 200, np.uint8))
    return {"points": np.rint(np.concatenate(points) * 1000).astype(int).ravel().tolist(),
            "colors": np.concatenate(colors).ravel().tolist()}


def back_project(data: Dataset, frame: int, camera: str, most: int) -> tuple[np.ndarray, tuple]:
    """World points [N, 3] of at most ``most`` evenly spread pixels that hit something, and their (rows, columns)."""
    z = planar_depth(data, frame, camera)
    step = max(1, int(np.ceil(np.sqrt(z.size / most))))
    row, col = (index[::step, ::step].ravel() for index in np.indices(z.shape))
    hit = np.isfinite(z[row, col])
    row, col = row[hit], col[hit]
    return points_at(z, data.intrinsics(camera), data.T_w_c(frame, camera), row, col), (row, col)
