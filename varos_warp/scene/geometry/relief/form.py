"""Surfaces with relief: parts of layered materials are refined, displaced and coloured, vertex by vertex.

The steps (docs/surfaces.md): refine until edges are about two pixels; coarse form; new normals; fine form; then colours
by what lies where, and the thickness of silt.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from varos_warp.device.launch import in_tiles
from varos_warp.scene.description.surfaces import Layered
from varos_warp.scene.geometry.joining import merge_equal
from varos_warp.scene.geometry.noise import fbm
from varos_warp.scene.geometry.normals import UP, corner_normals
from varos_warp.scene.geometry.parts import Shape
from varos_warp.scene.geometry.relief.contact import Foot, beside, settled
from varos_warp.scene.geometry.relief.recipes.blending import smoothstep
from varos_warp.scene.geometry.relief.recipes.coats import Coat
from varos_warp.scene.geometry.relief.recipes.diffusion import ends_of
from varos_warp.scene.geometry.relief.recipes.layers import DARKEST, PALEST
from varos_warp.scene.geometry.relief.recipes.masks import neighbours_of, shape_of
from varos_warp.scene.geometry.relief.recipes.registry import RECIPES
from varos_warp.scene.geometry.relief.recipes.sites import Sites
from varos_warp.scene.geometry.relief.subdivision import Lengths, refine
from varos_warp.scene.geometry.surface import Surface
from varos_warp.scene.geometry.topology import area_normals, incidence

STEEP = (0.79, 0.85)
"""Upward part of the normal below which ground is steep, and above which it is flat, as in `slope_blend`."""
RAGGED = 0.18
"""Factor on the noise that moves that bound."""
MEAN_EDGE = 2.0 / 3.0
"""Mean length of edges over the longest that is wanted."""
LARGEST_FORM_M = 1.0
"""Size that the forms of a sea floor go by [m]."""
WHITE = np.ones(3)
UNEVEN = 0.08
"""Deviation of the reflectance from vertex to vertex, as a share."""
SHARE_OF_THICKNESS = 1.0 / 3.0
"""Displacement inwards, at most, as a share of a part's thickness there: a third is left between both sides."""
SKIN = 1e-4
"""How far inside rays that measure thickness begin, as a share of the part's size: rounding stays behind them."""
MOST_OF_RADIUS = 0.4
"""Displacement into a hollow, at most, as a share of its radius of curvature: beyond, it would cross itself."""


Around = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""What a sea floor knows of what stands on it: at points [N, 3] of the world the distance from the nearest [N] [m], and
the height [N] that all add [m]."""


@dataclass(frozen=True, eq=False)
class Base:
    """A surface before its relief."""

    vertices: np.ndarray
    """float64 [V, 3], about the middle of the part [m]."""
    faces: np.ndarray
    normals: np.ndarray
    """Unit vectors [V, 3] where the surface is smooth, zeros elsewhere."""
    middle: np.ndarray
    """float64 [3]"""


def base_of(shape: Shape) -> Base:
    """The surface of a shape, its vertices at the same place welded."""
    middle = np.round(0.5 * (shape.vertices.min(axis=0) + shape.vertices.max(axis=0)), 3)
    vertices, faces = merge_equal(shape.vertices - middle, shape.faces)
    normals = np.zeros(vertices.shape)
    if shape.smooth_shading:
        corner = corner_normals(vertices, faces, shape.smooth_angle)
        normals = _summed(corner, faces, len(vertices))
        off = np.zeros(len(vertices), bool)
        off[faces[(np.einsum("fij,fij->fi", corner, normals[faces]) < 1.0 - 1e-6)]] = True
        normals[off] = 0.0
    return Base(vertices, faces, normals, middle)


def formed(
    base: Base,
    look: Layered,
    wanted: Lengths,
    around: Around | None,
    foot: Foot | None = None,
    tint: np.ndarray = WHITE,
) -> dict[str, np.ndarray]:
    """A surface with its relief, as arrays of plain types.

    Args:
        base: The surface before.
        look: Its material; its seed is the object's own.
        wanted: The longest edges, at points about the base's middle.
        around: Of a sea floor; absent: it is an object.
        foot: How an object stands in the ground; absent: it does not.
        tint: Of the sediment where objects and ground meet, [3], over that of silt.

    Returns:
        ``vertices`` float32 [V, 3] about the base's middle, ``faces`` int32 [F, 3], ``normals`` float32 [V, 3] and
        ``colours`` float32 [V, 3], linear reflectances. ``held``: share of the vertices whose displacement the
        thickness of the part bounds, and ``thinnest``, the least thickness there [m].
    """
    fine = _Fine(*refine(base.vertices, base.faces, wanted, base.normals))
    x, normals = fine.p, fine.normals(fine.p)
    up = normals[:, 2]  # of the ground: banks are of its sediment, however steep they are
    room = None
    if around is None:
        room = Room(base, x, fine.faces, normals)
        sites = _sites_of_object(base, fine, normals, foot)
    else:
        clear, height = around(x + base.middle)
        x = x + height[:, None] * UP
        normals = fine.normals(x)
        sites = _sites_of_ground(base, fine, normals, clear)
    coats = _blended(sites, look, up)
    x, normals = _displaced(coats, fine, x, normals, room)
    shape = shape_of(x, fine.joined, normals, sites.edge)
    colours, silts = zip(*(coat.colour(shape) for coat in coats), strict=True)
    colour, pattern = sum(colours), sites.patterns(look.seed)
    if foot is not None:
        colour = settled(colour, foot.covers(x, pattern), pattern, tint)
    elif np.isfinite(sites.clear).any():
        colour = settled(colour, beside(sites.clear, pattern), pattern, tint)
    colour = np.clip(colour * _uneven(len(x), look.seed)[:, None], DARKEST, PALEST)
    x = x + sum(silts)[:, None] * UP
    return {
        "vertices": x.astype(np.float32),
        "faces": fine.faces,
        "normals": fine.normals(x).astype(np.float32),
        "colours": colour.astype(np.float32),
        "held": np.array(room.held if room else 0.0),
        "thinnest": np.array(room.thinnest if room else np.inf),
    }


class _Fine:
    """A refined surface: its vertices before anything moves them, and what holds of its mesh wherever they are."""

    def __init__(self, p, faces, edge):
        self.p, self.faces, self.edge = p, faces, edge
        self.joined, self.fans = neighbours_of(len(p), faces), fans_of(len(p), faces)

    def normals(self, x):
        """Unit normals [V, 3] with the vertices at ``x`` [V, 3]."""
        return vertex_normals(x, self.faces, self.fans)


def _sites_of_object(base, fine, normals, foot):
    """The vertices of an object."""
    middle, spread = _spread(base)
    size, edge = float(np.ptp(base.vertices, axis=0).max()), MEAN_EDGE * fine.edge
    clear = np.full(len(fine.p), np.inf)
    sharp = shape_of(fine.p, fine.joined, normals, edge).convexity
    return Sites(fine.p, normals, edge, size, _heights(fine.p, foot), clear, middle, spread, sharp)


def _sites_of_ground(base, fine, normals, clear):
    """The vertices of a sea floor."""
    middle, spread = _spread(base)
    size = min(float(np.ptp(base.vertices, axis=0).max()), LARGEST_FORM_M)
    return Sites(fine.p, normals, MEAN_EDGE * fine.edge, size, np.zeros(len(fine.p)), clear, middle, spread)


def _displaced(coats, fine, x, normals, room):
    """Vertices and their normals, [V, 3] each, after the coarse and the fine form."""
    for step in ("coarse", "fine"):
        h = _bounded(sum(coat.displacement(step, normals) for coat in coats), x, normals, fine.joined)
        h = h if room is None else room.bounded(h)
        x = x + h[:, None] * normals
        normals = fine.normals(x)
    return x, normals


class Room:
    """How far a part may be displaced inwards: by a third of its thickness there, so that it does not cross itself.

    Rays inwards measure it; where no displacement comes near to a third of the least thickness, from few places.
    """

    def __init__(self, base: Base, x: np.ndarray, faces: np.ndarray, normals: np.ndarray):
        self._x, self._faces, self._normals = x, faces, normals
        self._moved = np.zeros(len(x))
        self._room: np.ndarray | None = None
        self._least = SHARE_OF_THICKNESS * self._rough(base)
        self.held, self.thinnest = 0.0, np.inf

    @staticmethod
    def _rough(base):
        """The least thickness below the middles of the base's faces [m]."""
        inwards = -area_normals(base.vertices, base.faces)
        size = np.linalg.norm(inwards, axis=1)
        whole = size > 0.0
        inwards = inwards[whole] / size[whole, None]
        middles = base.vertices[base.faces[whole]].mean(axis=1)
        return _thickness(Surface(base.vertices, base.faces), middles, inwards).min(initial=np.inf)

    def bounded(self, h: np.ndarray) -> np.ndarray:
        """Displacements [V] of a step [m], less far inwards where there is no room."""
        after = self._moved + h
        if after.min(initial=0.0) < -self._least:
            if self._room is None:
                surface = Surface(self._x, self._faces)
                self._room = SHARE_OF_THICKNESS * _thickness(surface, self._x, -self._normals)
            held = after < -self._room
            if held.any():
                self.held = max(self.held, float(held.mean()))
                self.thinnest = min(self.thinnest, float(self._room[held].min()) / SHARE_OF_THICKNESS)
            after = np.maximum(after, -self._room)
        h = after - self._moved
        self._moved = after
        return h


def _thickness(surface, points, inwards):
    """Distance [N] from points on a surface to its other side [m]; infinite where rays meet none."""
    skin = SKIN * float(np.ptp(surface.vertices, axis=0).max())
    # a face that a ray meets nearly edge on has its plane anywhere, behind the ray's origin too
    return skin + np.maximum(surface.distances(points + skin * inwards, inwards), 0.0)


def _heights(x, foot):
    """Heights [V] over the ground, or over the lowest place where a thing does not stand in any."""
    if foot is None:
        return x[:, 2] - x[:, 2].min()
    height = foot.height(x)
    return np.where(np.isfinite(height), height, x[:, 2] - x[:, 2].min())


def _spread(base):
    """Middle [3] and covariance [3, 3] of a surface, by area: they do not depend on how fine its mesh becomes."""
    area = np.linalg.norm(area_normals(base.vertices, base.faces), axis=1)
    corners = base.vertices[base.faces]
    weight = area / max(area.sum(), 1e-300)
    middle = np.einsum("f,fki->i", weight, corners) / 3.0
    # of a triangle: the mean over its corners and its middle, the latter with nine times the weight
    off, centre = corners - middle, corners.mean(axis=1) - middle
    within = np.einsum("f,fki,fkj->ij", weight, off, off) / 12.0
    return middle, within + 0.75 * np.einsum("f,fi,fj->ij", weight, centre, centre)


def _blended(sites, look, up):
    """The recipes of a material where they have a share: one everywhere, or two for flat and for steep ground."""
    if look.steep is None or look.steep == look.relief:
        return [Coat(RECIPES[look.relief], look, sites, np.ones(len(sites.p)))]
    flat = smoothstep(*STEEP, up + RAGGED * fbm(sites.p, 2.5, 5, look.seed, edge=sites.edge))
    return [Coat(RECIPES[name], look, sites, share) for name, share in ((look.relief, flat), (look.steep, 1.0 - flat))]


def _uneven(count, seed):
    """Factors [count] of the reflectance of vertices: what is between the finest noise of a mesh and its grain."""
    return 1.0 + UNEVEN * np.clip(np.random.default_rng([seed, 1]).standard_normal(count), -2.5, 2.5)


def _bounded(h, x, normals, neighbours):
    """Displacements [V] that do not make a hollow cross itself: outwards less than a share of its radius."""
    bend = np.zeros(len(x))

    def fill(rows):
        row, other = ends_of(neighbours, rows)
        way, turned = x[other] - x[rows.start + row], normals[other] - normals[rows.start + row]
        hollow = -np.einsum("ij,ij->i", turned, way) / np.maximum(np.einsum("ij,ij->i", way, way), 1e-18)
        first = np.flatnonzero(np.diff(row, prepend=-1))
        if len(first):
            bend[rows.start + row[first]] = np.maximum(np.maximum.reduceat(hollow, first), 0.0)

    in_tiles(fill, len(x))
    return np.minimum(h, MOST_OF_RADIUS / np.maximum(bend, 1e-9))


def fans_of(count: int, faces: np.ndarray) -> sparse.csr_array:
    """Which of the faces meet in each of ``count`` vertices, float64 [count, F]: 1 where they do."""
    starts, fans = incidence(faces, count)
    return sparse.csr_array((np.ones(len(fans)), fans, starts), shape=(count, len(faces)))


def vertex_normals(vertices: np.ndarray, faces: np.ndarray, fans: sparse.csr_array | None = None) -> np.ndarray:
    """Unit normals [V, 3], the means of the faces' weighted with their areas; +z where there is none.

    ``fans`` are those of the faces, where they are known.
    """
    fans = fans_of(len(vertices), faces) if fans is None else fans
    of_faces, normals = area_normals(vertices, faces), np.empty((len(vertices), 3))

    def fill(rows):
        normals[rows] = _directions(fans[rows] @ of_faces)

    in_tiles(fill, len(vertices))
    return normals


def _summed(corner, faces, count):
    total = np.column_stack([np.bincount(faces.ravel(), corner[..., axis].ravel(), count) for axis in range(3)])
    return _directions(total)


def _directions(total):
    size = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(size > 0.0, total / np.where(size > 0.0, size, 1.0), UP)
