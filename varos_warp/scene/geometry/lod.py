"""How much detail a scene's meshes need: where cameras and lamps go decides how far a surface may move.

A surface that moves by e at a distance d from the camera moves by at most e / (d a) pixels in its image, where a is the
least angle that a pixel spans. A shadow's edge moves likewise, with the distance from the lamp to what casts it. So
``tolerance_px d a`` is allowed, d being the nearest approach of any camera or lamp. docs/models.md says more.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from varos_warp.scene.description import LevelOfDetail, Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.description.world import Boulder, MeshObject
from varos_warp.scene.frames import camera_pose, intrinsics
from varos_warp.scene.geometry.assets import default_chord_error
from varos_warp.scene.geometry.build import object_part
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.geometry.reduce import deviation, reduce_mesh
from varos_warp.scene.geometry.terrain import Surface

CLOSE_M = 1.0
"""Up to this distance surfaces may move by ``depth_steps`` steps of D, beyond it in proportion to the distance."""
UNSEEN = 4.0
"""What no camera ever has in view casts shadows and light only; it may move this many times as far."""
CELLS = 48
"""Cells along the longest side of a part, of each of which it is found out whether a camera ever has it in view."""
NEVER_SEEN = f"never in view: {UNSEEN:g} times the tolerance"
SMALL = 1000
"""Meshes of fewer triangles are kept as they are: nothing would be gained."""
FINEST_CHORD_M = 2e-5
"""Parametric objects are not made finer than this, however near a camera comes."""


def pixel_angle(camera: Camera) -> float:
    """Least angle [rad] that a pixel spans.

    A shift by e at right angles to a ray that is theta off the axis moves the image by up to e f / (r cos^2 theta), at
    a distance r along the ray; so a pixel in the corner spans cos^2 theta / f.
    """
    K, (width, height) = intrinsics(camera), camera.resolution
    tangent2 = (0.5 * width / K[0, 0]) ** 2 + (0.5 * height / K[1, 1]) ** 2
    return 1.0 / (max(K[0, 0], K[1, 1]) * (1.0 + tangent2))


def depth_step(scene: Scene) -> float:
    """Step of D's 16 bits [m]: 0.381 mm for a range of 25 m."""
    near, far = scene.render.depth_range_m
    return (far - near) / 65535.0


class Need:
    """How far surfaces may move [m], by place; call it with points [N, 3].

    Args:
        scene: Its cameras and lamps.
        poses: T_w_v [4, 4] of every frame.
        detail: The criteria.
    """

    def __init__(self, scene: Scene, poses: Sequence[np.ndarray], detail: LevelOfDetail):
        poses = np.asarray(poses, float)
        self.views = [(camera, np.unique([camera_pose(camera, T) for T in poses], axis=0))
                      for camera in scene.vehicle.cameras]
        lamps = [poses[:, :3, :3] @ light.position + poses[:, :3, 3] for light in scene.vehicle.lights]
        self.eyes = cKDTree(np.concatenate([*(T[:, :3, 3] for _, T in self.views), *lamps]))
        self.per_metre = detail.tolerance_px * min(map(pixel_angle, scene.vehicle.cameras))
        judged = detail.depth_steps is not None and "D" in scene.render.outputs
        self.depth = detail.depth_steps * depth_step(scene) if judged else np.inf

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Nearest approach [N] [m] of any camera or lamp to points [N, 3]."""
        return self.eyes.query(points, workers=-1)[0]

    def nearest(self, points: np.ndarray) -> float:
        """The least of these distances; of a few points first, which bounds the search for the others."""
        bound = self.distance(points[::64]).min()
        others = self.eyes.query(points, distance_upper_bound=bound, workers=-1)[0]
        return float(min(bound, others.min()))

    def at(self, distance: np.ndarray) -> np.ndarray:
        """What is allowed at a distance, of what is seen [m]."""
        return np.minimum(self.per_metre * distance, self.depth * np.maximum(1.0, distance / CLOSE_M))

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """What is allowed [N] [m] at points [N, 3] that are seen."""
        return self.at(self.distance(points))

    def in_view(self, centres: np.ndarray, radius: float) -> np.ndarray:
        """Whether balls around points [N, 3] reach into the field of view of any camera at any frame, bool [N]."""
        seen = np.zeros(len(centres), bool)
        for camera, T_w_c in self.views:
            K = intrinsics(camera)
            tangent = 0.5 * np.array(camera.resolution) / (K[0, 0], K[1, 1])
            for T in T_w_c:
                left = np.flatnonzero(~seen)
                if not len(left):
                    return seen
                p = (centres[left] - T[:3, 3]) @ T[:3, :3]
                aside = (np.abs(p[:, :2]) - p[:, 2:] * tangent) / np.hypot(1.0, tangent)
                seen[left] = (p[:, 2] > -radius) & (aside < radius).all(axis=1)
        return seen


class PlacedNeed:
    """A `Need` in one part, where what is never in view may move further.

    Args:
        need: The need.
        vertices: The part's, float64 [V, 3] [m].
    """

    def __init__(self, need: Need, vertices: np.ndarray):
        self.need, self.low = need, vertices.min(axis=0)
        self.size = max(float(np.ptp(vertices, axis=0).max()) / CELLS, 1e-6)
        self.cells, self.cell_seen = np.zeros(0, np.int64), np.zeros(0, bool)

    def seen(self, points: np.ndarray) -> np.ndarray:
        """Whether the cells around points [N, 3] are ever in view, bool [N]."""
        x, y, z = np.floor((points - self.low) / self.size).astype(np.int64).T + (1 << 20)  # a little below 0, too
        number = x << 42 | y << 21 | z
        new = np.setdiff1d(number, self.cells)
        cell = np.stack([new >> 42, new >> 21 & 0x1FFFFF, new & 0x1FFFFF], axis=1) - (1 << 20)
        seen = np.append(self.cell_seen, self.need.in_view(self.low + (cell + 0.5) * self.size, self.size))
        self.cells, order = np.unique(np.append(self.cells, new), return_index=True)
        self.cell_seen = seen[order]
        return self.cell_seen[np.searchsorted(self.cells, number)]

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """What is allowed [N] [m] at points [N, 3]."""
        return self.need(points) * np.where(self.seen(points), 1.0, UNSEEN)


# ------------------------------------------------------------------------------------------------------------- results


@dataclass(frozen=True)
class Region:
    """Part of a mesh by its distance from where cameras and lamps go."""

    nearest_m: tuple[float, float]
    """From, to."""
    in_view: bool
    triangles: int
    kept: int
    allowed_mm: float
    """Where it is least."""
    error_mm: float
    """Largest distance between the two surfaces, either way."""


@dataclass(frozen=True)
class Kept:
    """What was kept of one mesh, and why."""

    name: str
    triangles: int
    kept: int
    reason: str
    nearest_m: float
    """Nearest approach of a camera or lamp to a vertex."""
    error_mm: float = 0.0
    """Largest distance between the two surfaces, either way."""
    of_allowed: float = 0.0
    """The largest share of what is allowed that an error takes up: at most 1."""
    regions: list[Region] = field(default_factory=list)


def reduce_parts(scene: Scene, parts: Sequence[Part | Instances], poses: Sequence[np.ndarray],
                 detail: LevelOfDetail) -> tuple[list[Part | Instances], list[Kept]]:
    """The parts of a scene with the triangles that its images need, and what was kept of each.

    Args:
        scene: The scene.
        parts: Its geometry.
        poses: T_w_v [4, 4] of every frame of the sequence.
        detail: What is allowed.
    """
    need = Need(scene, poses, detail)
    results = [_reduce_part(scene, need, part) for part in parts]
    return [part for part, _ in results], [kept for _, kept in results]


def keep_parts(scene: Scene, parts: Sequence[Part | Instances], poses: Sequence[np.ndarray]) -> list[Kept]:
    """What `reduce_parts` says where the level of detail is off: everything is kept."""
    need = Need(scene, poses, LevelOfDetail())
    return [_unchanged(need, part, "exact: render.level_of_detail is off") for part in parts]


def _reduce_part(scene, need, part):
    """A part made fit for its need, and what was kept of it."""
    if part.skin is not None:
        return part, _unchanged(need, part, "exact: it has a texture map or colours of its own")
    if isinstance(part, Instances):
        return _reduce_instances(need, part)
    block = _block(scene, part.name)
    if block is not None and not isinstance(block, MeshObject | Boulder):  # a boulder's mesh is its true surface
        return _tessellate(scene, need, part, block)
    if len(part.faces) < SMALL:
        return part, _unchanged(need, part, f"exact: fewer than {SMALL} triangles")
    allowed = PlacedNeed(need, part.vertices)
    vertices, faces = reduce_mesh(part.vertices, part.faces, allowed)
    return replace(part, vertices=vertices, faces=faces), _account(need, allowed, part, vertices, faces)


def _account(need, allowed, part, vertices, faces):
    """Measure what was made of a part."""
    given, made = Surface(part.vertices, part.faces), Surface(vertices, faces)
    found = deviation(given, made, allowed)
    regions = _regions(need, allowed, part.vertices[part.faces].mean(axis=1), vertices[faces].mean(axis=1), found)
    ruled = "the depth" if need.per_metre * CLOSE_M > need.depth else "the pixel"
    return Kept(part.name, len(part.faces), len(faces), f"as far as {ruled} tolerance lets",
                need.nearest(part.vertices), 1e3 * float(found.distance.max()),
                float((found.distance / np.maximum(found.limit, 1e-300)).max()), regions)


def _regions(need, allowed, before, after, found):
    """Triangles and errors by powers of two of the distance [m], what is in view apart from what is not."""
    def label(points):
        octave = np.floor(np.log2(np.maximum(need.distance(points), 1e-3))).astype(int)
        return octave, allowed.seen(points)

    (octave, seen), (octave_after, seen_after) = label(before), label(after)
    octave_found, seen_found = label(found.points)
    rows = []
    for view in (True, False):
        for k in np.unique(octave[seen == view]):
            low = 2.0 ** float(k)
            error = found.distance[(octave_found == k) & (seen_found == view)].max(initial=0.0)
            rows.append(Region((low, 2.0 * low), view, int(np.count_nonzero((octave == k) & (seen == view))),
                               int(np.count_nonzero((octave_after == k) & (seen_after == view))),
                               1e3 * float(need.at(np.array(low))) * (1.0 if view else UNSEEN),
                               1e3 * float(error)))
    return rows


def _tessellate(scene, need, part, block):
    """A parametric object, made anew with the chord error that its nearest approach allows."""
    if block.chord_error_m is not None:
        return part, _unchanged(need, part, f"chord_error_m {block.chord_error_m:g}: given")
    allowed, seen = allowed_all_over(need, part.vertices)
    chord = max(allowed, FINEST_CHORD_M)
    made = object_part(scene, block.model_copy(update={"chord_error_m": chord}), part.name)
    why = f"chord error {1e3 * chord:.3g} mm instead of {1e3 * default_chord_error(block, part.name):.3g}"
    why += "" if seen else f", {NEVER_SEEN}"
    return made, Kept(part.name, len(part.faces), len(made.faces), why, need.nearest(part.vertices),
                      1e3 * chord, 1.0)


def _reduce_instances(need, group):
    """An instanced mesh, reduced to what the copy needs that comes nearest in proportion to its scale."""
    if len(group.faces) < SMALL:
        return group, _unchanged(need, group, f"exact: fewer than {SMALL} triangles")
    scales = np.cbrt(np.linalg.det(group.T_w_o[:, :3, :3]))
    least = min(allowed_all_over(need, box.vertices)[0] / scale
                for box, scale in zip(group.boxes(), scales, strict=True))

    def allowed(points):
        return np.full(len(points), least)

    vertices, faces = reduce_mesh(group.vertices, group.faces, allowed)
    found = deviation(Surface(group.vertices, group.faces), Surface(vertices, faces), allowed)
    kept = Kept(group.name, len(group.faces), len(faces), "as the nearest copy needs",
                _nearest_approach(need, group), 1e3 * float(found.distance.max()) * float(scales.max()),
                float(found.distance.max() / least) if least > 0.0 else 0.0)
    return replace(group, vertices=vertices, faces=faces), kept


def allowed_all_over(need: Need, vertices: np.ndarray) -> tuple[float, bool]:
    """What is allowed everywhere in the ball around vertices [m], by its nearest point, and if it is ever in view."""
    centre = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = np.linalg.norm(vertices - centre, axis=1).max()
    distance = max(float(need.distance(centre[None])[0] - radius), 0.0)
    seen = bool(need.in_view(centre[None], radius)[0])
    return float(need.at(np.array(distance))) * (1.0 if seen else UNSEEN), seen


def _nearest_approach(need, part):
    return min(need.nearest(box.vertices) for box in part.boxes())


def _unchanged(need, part, why):
    return Kept(part.name, len(part.faces), len(part.faces), why, _nearest_approach(need, part))


def _block(scene, name):
    """The block of an object; None for the terrain, and for parts that no scene file names."""
    kind, _, number = name.partition(".")
    is_one = kind == "objects" and number.isdigit() and int(number) < len(scene.objects)
    return scene.objects[int(number)] if is_one else None
