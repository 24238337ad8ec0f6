"""Recipes at the vertices where they have a share of a surface: in tiles, by threads, where a recipe allows it."""

from dataclasses import replace

import numpy as np

from varos_warp.device.launch import in_threads, tiles_of
from varos_warp.scene.geometry.relief.recipes.masks import Shape
from varos_warp.scene.geometry.relief.recipes.sites import Look, Recipe, Sites

ALL = slice(None)
Rows = slice | np.ndarray


class Coat:
    """A recipe on the N vertices of a mesh. What it makes does not depend on the number of threads.

    Args:
        recipe: The recipe.
        look: How the surface is to look.
        sites: The vertices.
        share: How much of the surface is of this recipe, float64 [N]; where it is 0 nothing is made.
    """

    def __init__(self, recipe: Recipe, look: Look, sites: Sites, share: np.ndarray):
        self._recipe, self._look, self._share = recipe, look, share
        self._tiles: list[tuple[Rows, Sites]] = [(ALL, sites)]
        if recipe.by_vertex:
            found = (np.flatnonzero(share[rows] > 0.0) + rows.start for rows in tiles_of(len(share)))
            self._tiles = [(rows, sites.some(rows)) for rows in found if len(rows)]

    def displacement(self, step: str, normals: np.ndarray) -> np.ndarray:
        """The coat's share of what a step, ``coarse`` or ``fine``, moves vertices with normals [N, 3] by [m], [N]."""
        made = np.zeros(len(self._share))

        def fill(tile):
            rows, sites = tile
            sites = replace(sites, n=normals[rows])
            made[rows] = self._share[rows] * getattr(self._recipe, step)(sites, self._look)

        in_threads(fill, self._tiles)
        return made

    def colour(self, shape: Shape) -> tuple[np.ndarray, np.ndarray]:
        """The coat's share of reflectance [N, 3] and of silt's thickness [N] [m], on the mesh that has its form."""
        colour, silt = np.zeros((len(self._share), 3)), np.zeros(len(self._share))

        def fill(tile):
            rows, sites = tile
            sites, share = replace(sites, n=shape.n[rows]), self._share[rows]
            tone, thickness = self._recipe.colour(sites, shape if rows is ALL else shape.some(rows), self._look)
            colour[rows], silt[rows] = share[:, None] * tone, share * thickness

        in_threads(fill, self._tiles)
        return colour, silt
