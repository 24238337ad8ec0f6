"""What prototypes are made of: surfaces of revolution, tubes and ribbons, with a colour at every vertex."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from varos_warp.scene.geometry.topology import area_normals

Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class Solid:
    """A mesh of unit size that stands on z = 0, with colours."""

    vertices: np.ndarray
    """float64 [V, 3]; what lies below z = 0 is inside of the host."""
    faces: np.ndarray
    """int32 [F, 3], counter-clockwise seen from outside."""
    colours: np.ndarray
    """float64 [V, 3]: linear reflectances."""
    normals: np.ndarray | None = None
    """float64 [F, 3, 3]: normals of the corners, smoothed over all edges; None: they are not known."""

    def tinted(self, tint: Rgb | np.ndarray) -> Self:
        """The solid in other colours, each channel multiplied."""
        return replace(self, colours=np.clip(self.colours * np.asarray(tint), 0.0, 0.9))

    def scaled(self, scale: float) -> Self:
        """The solid, so many times as large."""
        return replace(self, vertices=scale * self.vertices)

    @property
    def corners(self) -> np.ndarray:
        """Colours of the corners of faces, float32 [F, 3, 3]."""
        return self.colours[self.faces].astype(np.float32)


def solid(vertices: np.ndarray, faces: np.ndarray, colour) -> Solid:
    """A mesh of one colour [3], or of one for each vertex [V, 3]."""
    return Solid(vertices, faces.astype(np.int32), np.broadcast_to(np.asarray(colour, float), vertices.shape))


def together(solids: list[Solid]) -> Solid:
    """Several meshes as one."""
    starts = np.cumsum([0] + [len(each.vertices) for each in solids[:-1]])
    faces = np.concatenate([each.faces + start for each, start in zip(solids, starts, strict=True)])
    return solid(
        np.concatenate([each.vertices for each in solids]), faces, np.concatenate([each.colours for each in solids])
    )


@dataclass(frozen=True)
class Strip:
    """A ribbon or a tube about a line, narrow for its length."""

    path: np.ndarray
    """float64 [K, 3]: its line."""
    radius: np.ndarray
    """float64 [K]: half its width there."""
    colours: np.ndarray
    """float64 [K, 3]: linear reflectances."""
    across: np.ndarray | None = None
    """float64 [K, 3]: the way that a ribbon is wide there, unit vectors; None: a tube."""
    sides: int = 2
    """Sides of the cross section, of a tube."""

    def solid(self) -> Solid:
        """Mesh of the strip."""
        if self.across is None:
            vertices, faces = tube(self.path, self.radius, self.sides)
        else:
            vertices, faces = ribbon(self.path, self.radius[:, None] * self.across)
        return solid(vertices, faces, np.repeat(self.colours, len(vertices) // len(self.path), axis=0))

    @property
    def surface(self) -> float:
        """Area of all that is seen of it from some side [m^2]: of ribbons both faces."""
        made = self.solid()
        area = 0.5 * np.linalg.norm(area_normals(made.vertices, made.faces), axis=1).sum()
        return (1.0 if self.across is None else 2.0) * float(area)


@dataclass(frozen=True, kw_only=True)
class Sheet(Strip):
    """A ribbon of several columns, ruffled and blotched; its line, width and colours are what coarser ones have."""

    points: np.ndarray
    """float64 [K, C, 3]: points of its rows."""
    tones: np.ndarray
    """float64 [K, C, 3]: linear reflectances of these points."""

    def solid(self) -> Solid:
        """Mesh of the sheet."""
        rows, columns = self.points.shape[:2]
        return solid(self.points.reshape(-1, 3), grid_faces(rows, columns, closed=False), self.tones.reshape(-1, 3))


@dataclass(frozen=True)
class Form:
    """What a prototype is made of, for coarser ones to be made of it as well."""

    body: Solid | None
    strips: tuple[Strip, ...] = ()
    coarser: tuple[Solid, ...] = ()
    """Coarser meshes, one for each level, of what has arms that it would lose with its edges; none: they are made."""

    def whole(self) -> Solid:
        """Body and strips as one mesh."""
        return together([*([] if self.body is None else [self.body]), *(strip.solid() for strip in self.strips)])


def grid_faces(rows: int, columns: int, closed: bool = True) -> np.ndarray:
    """Faces [F, 3] of a grid of vertices, row after row; ``closed``: the last column joins the first."""
    i = np.arange(rows - 1)[:, None] * columns
    j = np.arange(columns if closed else columns - 1)[None]
    right = (j + 1) % columns
    quads = np.stack([i + j, i + right, i + columns + right, i + columns + j], -1).reshape(-1, 4)
    return np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def around(count: int) -> np.ndarray:
    """Angles once around [rad]."""
    return np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)


def revolved(radius: np.ndarray, height: np.ndarray, girth: np.ndarray) -> np.ndarray:
    """Vertices [R C, 3] of a profile [R] that goes around an axis.

    ``girth`` [C] or [R, C] is a factor of the radius at each angle.
    """
    t = around(np.shape(girth)[-1])
    wide = radius[:, None] * np.broadcast_to(girth, (len(radius), len(t)))
    return np.stack([wide * np.cos(t), wide * np.sin(t), np.broadcast_to(height[:, None], wide.shape)], -1).reshape(
        -1, 3
    )


def tube(path: np.ndarray, radius: np.ndarray, sides: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a tube of radii [K] about a line [K, 3], open at its ends."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    one = np.cross(along, [0.31, 0.52, 0.79])
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    other, t = np.cross(along, one), around(sides)
    ring = np.cos(t)[None, :, None] * one[:, None] + np.sin(t)[None, :, None] * other[:, None]
    return (path[:, None] + radius[:, None, None] * ring).reshape(-1, 3), grid_faces(len(path), sides)


def ribbon(path: np.ndarray, side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a strip about a line [K, 3], from it by ``side`` [K, 3] to either side; seen from both."""
    vertices = np.stack([path - side, path + side], axis=1).reshape(-1, 3)
    step = 2 * np.arange(len(path) - 1)[:, None]
    return vertices, np.vstack([step + [0, 1, 3], step + [0, 3, 2]])


def waves(points: np.ndarray, wavelength: float, rng: np.random.Generator) -> np.ndarray:
    """Smooth noise [N] of variance 1 at points [N, 3]: cosines of about one wavelength in all directions."""
    count = 12
    k = rng.standard_normal((3, count))
    k *= 2.0 * np.pi / wavelength * rng.uniform(0.6, 1.4, count) / np.linalg.norm(k, axis=0)
    return np.cos(points @ k + rng.uniform(0.0, 2.0 * np.pi, count)).sum(axis=1) * np.sqrt(2.0 / count)
