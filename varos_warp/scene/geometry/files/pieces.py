"""What a mesh file holds, whatever its format: pieces of surface, each with one material of the file."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from varos_warp.errors import InputError
from varos_warp.limits import check_limit
from varos_warp.scene.geometry.files.polygons import triangulate

WRAPS = ("repeat", "clamp", "mirror")
"""What a texture shows outside of 0..1: itself again, its edge, or itself mirrored."""


@dataclass(frozen=True)
class Mask:
    """A picture that gives the alpha of a surface, in place of its texture's own."""

    path: Path
    channel: str = ""
    """Channel of the picture: r, g, b, m (alpha) or l (brightness); empty: its alpha, or where that is opaque
    throughout, its brightness."""
    inverted: bool = False
    """True if the picture is transparency, 1 - alpha."""


@dataclass(frozen=True)
class Texture:
    """A picture that a mesh file names or holds."""

    source: Path | bytes | None
    """File of the picture, or its bytes; None: it is white, and there for its mask."""
    name: str
    """What the mesh file calls it, for messages."""
    wrap: tuple[str, str] = ("repeat", "repeat")
    """One of `WRAPS` along u and along v."""
    mask: Mask | None = None


@dataclass(frozen=True)
class FileMaterial:
    """What a mesh file says of a surface's colour; all else of its materials is not modelled."""

    base: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Linear reflectance; it multiplies the texture and the colours of vertices."""
    alpha: float = 1.0
    """Opacity, which multiplies the alpha of the texture and of the vertices."""
    texture: Texture | None = None
    cutoff: float | None = None
    """Alpha below which the surface has holes; None: it has none, whatever its alpha."""


@dataclass(frozen=True)
class Piece:
    """Triangles with one material, in the axes and units of the file."""

    vertices: np.ndarray
    """float64 [V, 3]."""
    faces: np.ndarray
    """int [F, 3], counter-clockwise seen from outside."""
    material: FileMaterial | None = None
    """Material of the piece; None: the file says nothing."""
    uv: np.ndarray | None = None
    """float [F, 3, 2]: texture coordinates of the corners, v up."""
    colours: np.ndarray | None = None
    """float32 [F, 3, 3 or 4]: linear reflectances of the corners, perhaps with alpha."""

    def moved(self, matrix: np.ndarray) -> "Piece":
        """The piece moved by an affine [4, 4]; a mirroring one turns the faces, so that outside stays outside."""
        vertices = self.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        if np.linalg.det(matrix[:3, :3]) >= 0.0:
            return Piece(vertices, self.faces, self.material, self.uv, self.colours)
        uv, colours = (None if corners is None else corners[:, ::-1] for corners in (self.uv, self.colours))
        return Piece(vertices, self.faces[:, ::-1], self.material, uv, colours)


@dataclass
class MeshFile:
    """What a reader found in a file."""

    path: Path
    pieces: list[Piece] = field(default_factory=list)
    up_axis: str | None = None
    """Which axis the file says is up: x, y or z; None: it does not say."""
    unit_m: float = 1.0
    """Length of its unit [m]."""
    notes: list[str] = field(default_factory=list)
    """Whole sentences about what was not read as it may be meant."""
    triangles: int = 0
    """Number of triangles in the pieces so far."""
    colours_multiply: bool = False
    """Colours of vertices multiply textures and colours of materials, as in glTF; else only the one of them counts."""
    why_empty: str = ""
    """The reason why it may have no triangles, for the message that says so."""
    copies: int = 0
    """Number of places where meshes stand, so far."""

    def note(self, words: str) -> None:
        """Add a note, once."""
        if words not in self.notes:
            self.notes.append(words)

    def add(self, piece: Piece) -> None:
        """Add a piece.

        Raises:
            InputError: The file has more triangles than the limit, or a face names a vertex that is not there.
        """
        self.triangles += len(piece.faces)
        check_limit("TRIANGLES", self.triangles, file=self.path)
        self.check(piece.faces, len(piece.vertices), "vertex")
        self.pieces.append(piece)

    def check(self, numbers: np.ndarray, count: int, what: str) -> None:
        """Refuse faces whose numbers, from 0, name ``what`` is not among so many."""
        if numbers.size and (numbers.min() < 0 or numbers.max() >= count):
            worst = numbers.min() if numbers.min() < 0 else numbers.max()
            raise damaged(f"a face names {what} {worst} of {count}")

    def triangulated(self, vertices: np.ndarray, corners: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, ...]:
        """Triangles of many polygons; those that cross themselves are noted.

        Args:
            vertices: float64 [V, 3].
            corners: int [C], the vertices of all polygons, one after another.
            starts: int [P + 1], where each begins, and the number of corners.

        Returns:
            Numbers int64 [T, 3] of the triangles' corners in ``corners``, and the polygon of each int64 [T].
        """
        self.check(corners, len(vertices), "vertex")
        triangles, polygon, crossed = triangulate(vertices[corners], starts)
        self.note_crossed(crossed)
        return triangles, polygon

    def note_crossed(self, count: int) -> None:
        """Note how many polygons cross themselves, if any do."""
        if count:
            self.note(f"{count} of its polygons cross themselves: what is built of them may differ")

    def count_copy(self) -> None:
        """Count one more place where a mesh stands.

        Raises:
            InputError: They are more than the limit.
        """
        self.copies += 1
        check_limit("COPIES", self.copies, file=self.path)


def damaged(problem: str, key: str | None = None, value: Any = None) -> InputError:
    """The error of a file that is not what its format says; who calls the reader names the file (mesh_files.py)."""
    return InputError(problem, key=key, value=value, remedy="The file is damaged; export it again.")


def in_words(names: Iterable[str], most: int = 5) -> str:
    """Names in a sentence: the first few, and how many more there are."""
    names = list(dict.fromkeys(names))
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
