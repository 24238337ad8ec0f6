"""Pieces of a structure: closed solids with a name and a colour, turned and moved to their places."""

from typing import NamedTuple

import numpy as np

Mesh = tuple[np.ndarray, np.ndarray]
FACING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Rotation from the axes of a drawing (right, up, towards the viewer) to those of a structure that faces -y: x, z, -y.
"""
ALONG_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Rotation from the axes of a section (y, z, along the structure) to those of the structure."""


class Piece(NamedTuple):
    """A closed solid of a structure."""

    name: str
    """Name of the piece, as the block's ``only`` has it."""
    colour: tuple[float, float, float]
    """Linear reflectance where the scene names no material."""
    vertices: np.ndarray
    """Vertices float64 [V, 3] [m]."""
    faces: np.ndarray
    """Faces int32 [F, 3]."""


def placed(mesh: Mesh, axes=None, at=(0.0, 0.0, 0.0)) -> Mesh:
    """A mesh turned by a rotation [3, 3], then moved to ``at`` [m]."""
    vertices, faces = mesh
    return (vertices if axes is None else vertices @ np.asarray(axes).T) + np.asarray(at, float), faces


def chosen(pieces: dict[str, list[tuple[tuple[float, float, float], Mesh]]], only) -> list[Piece]:
    """The pieces of some names, in their order; all of them where ``only`` is None."""
    return [
        Piece(name, colour, *mesh)
        for name, meshes in pieces.items()
        if only is None or name in only
        for colour, mesh in meshes
    ]
