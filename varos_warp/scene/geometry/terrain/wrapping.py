"""Shrinkwrap (paper 3.1.1): a new surface projected onto a model at a low resolution, refined and projected again.

The first surface is where the winding number of the model changes, on a coarse grid: it closes holes and gaps, keeps
overhangs and tunnels wider than about two of its cells, and needs no sound mesh, only faces that look the right way.
A closed model has winding number 1 inside and 0 outside, so 1/2 parts them; a sheet has 1/2 - s below it and -s above,
|s| < 1/2, so 0 does. Then each round cuts every triangle into four, spreads the vertices and moves them onto the model
by queries of its BVH. Where there is no model, over a hole, the surface stays a smooth membrane.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp
from scipy.ndimage import binary_dilation
from skimage.measure import marching_cubes

from varos_warp.device.devices import upload
from varos_warp.device.launch import launch
from varos_warp.errors import InputError
from varos_warp.kernels.mesh import project
from varos_warp.scene.geometry.joining import median_edge, merge_equal
from varos_warp.scene.geometry.surface import Surface
from varos_warp.scene.geometry.terrain.draping import drape
from varos_warp.scene.geometry.terrain.repair import clean
from varos_warp.scene.geometry.topology import area_normals, chunks, compact, groups, incidence, pieces, subdivide

BASE = 512
"""Most vertices along the longer side of the first surface."""

BASE_NODES = 40_000_000
"""Most nodes of the grid of the first surface: 160 MB."""

BLOCK = 8
"""Nodes along a side of the largest blocks; a power of 2."""

EIGHT = np.indices((2, 2, 2)).reshape(3, -1).T
"""Offsets of the eight halves of a block, int [8, 3]."""

MOST_VERTICES = 16_600_000
"""Most vertices of a surface whose resolution is left to us (paper 3.1.1)."""

PER_CELL = 1.5
"""Vertices on the area of a square of one step: 1 where it lies in a plane of the grid, sqrt(3) where most oblique."""

MOST_ROWS = 8192

FLAT = 0.2
"""Least |sum of the face areas as vectors| over the sum of the areas of a sheet; of a closed surface it is 0."""

MARGIN = 3
"""Empty cells of the grid around the model."""

FIRST_ROUNDS, ROUNDS, LAST_ROUNDS = 10, 3, 2
"""Projections of the first surface, of those between, and of the last."""


@dataclass
class Wrap:
    """A surface on its way: in the float32 coordinates of the model's BVH."""

    points: np.ndarray
    """float32 [V, 3] [m], about the model's origin."""
    faces: np.ndarray
    """int32 [F, 3]."""
    lock: np.ndarray
    """int8 [V, 3]: -1 or 1 in x and y for vertices on that side of the region, which they do not leave."""
    held: np.ndarray
    """bool [V]: lies on the model."""


def is_sheet(vertices, faces) -> bool:
    """Return whether a model is open by nature: its faces' areas, as vectors, do not cancel."""
    normals = area_normals(vertices, faces)
    return bool(np.linalg.norm(normals.sum(axis=0)) > FLAT * np.linalg.norm(normals, axis=1).sum())


def is_height_field(vertices, faces) -> bool:
    """Return whether every face looks up: seen from above, nothing is hidden."""
    return all((area_normals(vertices, faces[part])[:, 2] > 0.0).all() for part in chunks(len(faces)))


def shrinkwrap(
    vertices,
    faces,
    resolution: int | str,
    region=None,
    *,
    sheet: bool | None = None,
    device: str = "cpu",
    progress=lambda share: None,
):
    """A new surface on a model, about as fine as ``resolution`` vertices along the longer side.

    A height field is draped with a regular grid. Anything else is wrapped: a sheet over its bounding rectangle, so
    that its only boundary is its outline; a closed model from outside, watertight.

    Args:
        vertices: float64 [V, 3] [m].
        faces: int32 [F, 3], facing up and outwards.
        resolution: Vertices along the longer side; ``auto``: as ``natural_resolution`` finds.
        region: Keep exactly xmin, ymin, xmax, ymax [m] of a sheet.
        sheet: Whether the model is open by nature; none: as ``is_sheet`` finds.
        device: Where the projections run.
        progress: Called with the share that is done.

    Raises:
        InputError: Nothing of a sheet is seen from above.
    """
    sheet = is_sheet(vertices, faces) if sheet is None else sheet
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if sheet and region is not None:  # its top and bottom stay the model's
        low[:2], high[:2] = np.maximum(low[:2], region[:2]), np.minimum(high[:2], region[2:])
    if sheet and not (high > low)[:2].all():
        raise InputError(
            "nothing is seen from above",
            key="shrinkwrap_resolution",
            remedy="Only surfaces that can be seen from above can be shrinkwrapped; check up_axis.",
        )
    side = float((high - low)[: 2 if sheet else 3].max())
    if resolution == "auto":
        resolution = natural_resolution(vertices, faces, side)
    if sheet and is_height_field(vertices, faces):
        return _sound(*drape(vertices, faces, resolution, region))
    model = Surface(vertices, faces, device, winding=True)
    rounds, step = plan(high - low, side, resolution)
    wrap = first_surface(model, low, high, step, sheet)
    project_rounds(model, wrap, step, FIRST_ROUNDS)
    for level in range(1, rounds + 1):
        progress(4.0 ** (level - rounds - 1))
        wrap, step = refine(wrap), 0.5 * step
        project_rounds(model, wrap, step, LAST_ROUNDS if level == rounds else ROUNDS)
    if sheet:
        wrap = trim(model, wrap, step)
    result = wrap.points + model.origin
    for axis, end in ((axis, end) for axis in (0, 1) for end in (-1, 1)):
        if sheet:  # exactly, not to float32
            result[wrap.lock[:, axis] == end, axis] = (low, high)[end > 0][axis]
    return _sound(result, wrap.faces)


def _sound(vertices, faces):
    """The surface without the few faces that lost their area where the rim was drawn to a corner of the outline."""
    if not all((area_normals(vertices, faces[part]) != 0.0).any(axis=1).all() for part in chunks(len(faces))):
        vertices, faces = clean(*merge_equal(vertices, faces))
    if len(faces) == 0:
        raise InputError(
            "nothing of the model is left within its outline",
            key="shrinkwrap_resolution",
            remedy="Raise it: the model, or what is whole of it, is narrower than a cell.",
        )
    return vertices, faces


def natural_resolution(vertices, faces, side: float) -> int:
    """Vertices along the longer side [m] for a surface twice as fine as the model, within ``MOST_VERTICES``."""
    area = 0.5 * np.linalg.norm(area_normals(vertices, faces), axis=1).sum()
    step = max(0.5 * median_edge(vertices, faces), np.sqrt(PER_CELL * area / MOST_VERTICES))
    return int(np.clip(np.ceil(side / step), 2, MOST_ROWS)) + 1


def plan(size, side: float, resolution: int) -> tuple[int, float]:
    """How often to refine, and the grid step [m] of the first surface, which every refinement halves.

    ``size`` [3] [m] is that of the box to wrap, ``side`` its longer one.
    """
    rounds, cells = 0, resolution - 1
    while cells > BASE or np.prod(size / (side / cells) + 2 * MARGIN + 2) > BASE_NODES:
        rounds, cells = rounds + 1, cells / 2
    return rounds, side / max(cells, 2)


# ------------------------------------------------------------------------------------------------- the first surface


def first_surface(model: Surface, low, high, step: float, sheet: bool) -> Wrap:
    """The surface between inside and outside, by marching cubes on a grid of ``step`` [m]."""
    axes = []
    for axis in range(3):
        a, b, cells = low[axis], high[axis], max(1, int(np.ceil((high[axis] - low[axis]) / step - 1e-6)))
        if not sheet or axis == 2:
            # half a step off, so that a flat face does not lie in a plane of nodes, its side left to rounding
            a, cells = low[axis] - (MARGIN + 0.5) * step, cells + 2 * MARGIN + 1
            b = a + cells * step
        axes.append(np.linspace(a, b, cells + 1) - model.origin[axis])
    value = _grid_values(model, axes, step, 0.0 if sheet else 0.5)
    if value.min() > 0.0 or value.max() < 0.0:
        raise InputError(
            "the model has no inside",
            key="shrinkwrap_resolution",
            remedy="Raise it, or mend the orientation of the faces in a mesh editor.",
        )
    nodes, faces, _, _ = marching_cubes(value, 0.0)
    last = np.array(value.shape) - 1
    lock = np.where(nodes == last, 1, np.where(nodes == 0.0, -1, 0)).astype(np.int8)
    lock *= np.array([sheet, sheet, False], np.int8)
    spacing = np.array([(a[-1] - a[0]) / (len(a) - 1) for a in axes])
    points = (nodes * spacing + [a[0] for a in axes]).astype(np.float32)
    wrap = Wrap(points, faces, lock, np.zeros(len(points), bool))
    return _part_of(wrap, faces[_reachable(wrap, step)])


def _grid_values(model, axes, step, threshold):
    """Signed distance [m] on a grid, within two steps of the surface; beyond, two steps with the right sign.

    Blocks of nodes are halved again and again where a surface is near their middle, or where the sign changes nearby:
    over a hole it does so far from any surface.
    """
    shape, size = np.array([len(axis) for axis in axes]), BLOCK
    middles = np.indices(-(-shape // size)).reshape(3, -1).T
    value = model.signed_distance(_block_middles(axes, middles, size), threshold, np.zeros(len(middles), np.int8))
    value = value.reshape(-(-shape // size))
    while size > 1:
        hole = _jumps(value, size * step)
        near = np.argwhere(hole | (np.abs(value) < np.sqrt(3.0) * (0.5 * (size - 1) + 1.0) * step))
        size //= 2
        finer = np.where(value < 0.0, np.float32(-2.0 * step), np.float32(2.0 * step))
        for axis, count in enumerate(-(-shape // size)):
            finer = np.take(np.repeat(finer, 2, axis=axis), np.arange(count), axis=axis)
        for part in chunks(len(near)):
            parent, child = np.repeat(near[part], 8, axis=0), (2 * near[part, None] + EIGHT).reshape(-1, 3)
            inside = (child < finer.shape).all(axis=1)
            parent, child = tuple(parent[inside].T), child[inside]
            # no surface comes between, so that the sign is the parent's
            known = ~hole[parent] & (np.abs(value[parent]) > np.sqrt(3.0) * 0.5 * size * step)
            sign = np.where(known, np.sign(value[parent]), 0.0).astype(np.int8)
            finer[tuple(child.T)] = model.signed_distance(_block_middles(axes, child, size), threshold, sign)
        value = finer
    # vertices stay off the nodes, where marching cubes would make slivers
    sized = np.clip(np.abs(value), 0.1 * step, 2.0 * step)
    return np.where(value < 0.0, -sized, sized)


def _jumps(value, distance):
    """Blocks around which a signed distance changes by more than the distance of two middles, bool.

    Its sign changes in the open there.
    """
    jumps = np.zeros(value.shape, bool)
    for axis in range(3):
        far = np.abs(np.diff(np.moveaxis(value, axis, 0), axis=0)) > 1.001 * distance
        moved = np.moveaxis(jumps, axis, 0)
        moved[:-1] |= far
        moved[1:] |= far
    return binary_dilation(jumps, np.ones((3, 3, 3)))


def _block_middles(axes, block, size):
    """Middles float32 [N, 3] of blocks [N, 3] of ``size`` nodes along each side."""
    return np.column_stack(
        [axis[0] + (axis[1] - axis[0]) * (block[:, i] * size + 0.5 * (size - 1)) for i, axis in enumerate(axes)]
    ).astype(np.float32)


def _part_of(wrap, faces):
    """Some faces of a surface."""
    used = np.unique(faces)
    points, faces = compact(wrap.points, faces)
    return Wrap(points, faces, wrap.lock[used], wrap.held[used])


def _reachable(wrap, step):
    """Faces [F] but of closed pieces that enclose water (caves that nothing can enter) and of pieces of a few cells."""
    points, faces = wrap.points, wrap.faces
    label = pieces(faces, len(points))
    a, b, c = (points[faces[:, i]].astype(float) for i in range(3))
    count = label.max() + 1
    volume = np.bincount(label, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0, minlength=count)
    area = np.bincount(label, 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1), minlength=count)
    closed = np.bincount(label, (wrap.lock[faces] != 0).any(axis=(1, 2)), minlength=count) == 0
    keep = np.where(closed, volume > (2.0 * step) ** 3, area > (4.0 * step) ** 2)
    if not keep.any():
        keep = area >= area.max()
    return keep[label]


# ------------------------------------------------------------------------------------------------- refine and project


def refine(wrap: Wrap) -> Wrap:
    """Every triangle cut into four."""
    edges, faces = subdivide(wrap.faces, len(wrap.points))
    a, b = edges.T
    lock_a, lock_b = wrap.lock[a], wrap.lock[b]
    # an edge across a corner of the region joins two sides and lies on neither
    return Wrap(
        np.concatenate([wrap.points, 0.5 * (wrap.points[a] + wrap.points[b])]),
        faces,
        np.concatenate([wrap.lock, np.where(lock_a == lock_b, lock_a, np.int8(0))]),
        np.concatenate([wrap.held, wrap.held[a] & wrap.held[b]]),
    )


def project_rounds(model: Surface, wrap: Wrap, step: float, rounds: int) -> None:
    """Spread the vertices and move them onto the model, ``rounds`` times; in place."""
    device, count = model.device, len(wrap.points)
    first, incident = (upload(array, wp.int32, device) for array in incidence(wrap.faces, count))
    faces, lock = upload(wrap.faces, wp.vec3i, device), upload(wrap.lock, wp.vec3b, device)
    points = upload(wrap.points, wp.vec3, device)
    moved, held = wp.empty_like(points), wp.empty(count, dtype=wp.int8, device=device)
    for _ in range(rounds):
        fans = {"faces": faces, "first": first, "incident": incident}
        move = {"mesh": model.mesh.id, "points": points, "lock": lock, "step": step, "moved": moved, "held": held}
        launch(project.move_vertices, count, move | fans, device)
        after = wp.empty_like(points)
        launch(project.undo_folds, count, {"before": points, "moved": moved, "after": after} | fans, device)
        points = after
    wrap.points, wrap.held = points.numpy(), held.numpy().astype(bool)


# ------------------------------------------------------------------------------------------------------- the outline


def trim(model: Surface, wrap: Wrap, step: float) -> Wrap:
    """A sheet without what lies beyond the model's outline, and its rim drawn to that outline.

    Vertices that are not on the model and from which the side of the region is reached over such vertices are beyond;
    those that are enclosed by the model are over its holes, and stay.
    """
    count = len(wrap.points)
    edges = np.concatenate([wrap.faces[:, :2], wrap.faces[:, 1:], wrap.faces[:, ::2]])
    free = ~wrap.held
    if not free.any():
        return wrap
    near = np.zeros(count, bool)  # beside a vertex that is held: these make the rim
    near[edges[wrap.held[edges[:, 0]], 1]] = True
    near[edges[wrap.held[edges[:, 1]], 0]] = True
    core = free & ~near
    label = groups(edges[core[edges].all(axis=1)], count)
    rim = (wrap.lock != 0).any(axis=1)
    outside = np.zeros(label.max() + 1, bool)
    outside[label[core & rim]] = True
    beyond = core & outside[label]
    touched = beyond[wrap.faces].any(axis=1)
    rim[wrap.faces[touched].ravel()] = True
    points, lock = wrap.points.copy(), wrap.lock.copy()
    loose = np.flatnonzero(rim & free)
    lock[loose] = 0  # they follow the outline, not the side of the region
    place, face = model.project(points[loose], 3.0 * step)  # just beyond the outline, the nearest point is on it
    points[loose[face >= 0]] = place[face >= 0]
    return _part_of(Wrap(points, wrap.faces, lock, wrap.held), wrap.faces[~touched])
