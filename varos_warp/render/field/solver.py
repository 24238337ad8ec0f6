"""Light around one kind of light source in water without end, of all orders of scattering, without random numbers.

Light scattered once is a quadrature. What is scattered n + 1 times follows from what is scattered n times: at every
node a matrix turns the light that arrives into what leaves (render/field/directions.py), and integrals along straight
lines take that to the nodes again (kernels/field/tabulate.py). The sum over the orders solves a linear equation,
X = B + K X.
"""

import functools

import numpy as np
import warp as wp
from scipy.interpolate import make_interp_spline
from scipy.sparse.linalg import LinearOperator, gmres

from varos_warp.device.devices import upload
from varos_warp.device.launcher import Launcher
from varos_warp.kernels.field.open_water import LightField, NodeGrid
from varos_warp.kernels.field.tabulate import tabulate_next_order, tabulate_single_scattering
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.lights.record import Light as LightData
from varos_warp.render.field.directions import Directions, irradiance_matrix
from varos_warp.render.field.scattering import scattering_matrix, shape_of_twice
from varos_warp.scene.lights.distribution import Distribution
from varos_warp.scene.lights.records import light_record
from varos_warp.scene.water import OpticalProperties, medium_record
from varos_warp.scene.water.phase.phase_function import PhaseFunction

NEAREST_M, FARTHEST_M, FARTHEST_DEPTH = 0.02, 200.0, 30.0
"""Distances from the light that have nodes, the last as optical depth too; what is nearer is in proportion."""
FINE = (64, 20, 48)
"""Nodes of the distance from a light, steps of the angle in its cone, and outside of it, for linear interpolation."""
MIDDLE = (32, 10, 14)
"""Nodes and steps, as in `FINE`, for light scattered twice, which is smoother."""
COARSE = (32, 8, 10)
"""Nodes and steps, as in `FINE`, for light scattered more often. With 20 distances, what lies over five free paths away
was a tenth off."""
ONCE = Directions.quadrature(80, 32, power=2)
"""Directions of light scattered once, which is sharp around the light; see docs/results.md for the errors."""
TWICE = Directions.quadrature(28, 16, power=2)
"""Directions of light scattered twice."""
AGAIN = Directions.quadrature(20, 8, power=2)
"""Directions of light scattered more often."""
LEAVING = Directions.ends(56, 19, power=2)
"""Directions in which light leaves a scattering."""
NORMALS = Directions.ends(41, 13, power=1)
"""Normals of the planes whose irradiance is kept; one is at 90 degrees, where light from the source begins to graze
them."""
TOLERANCE, ENOUGH, GROWTH = 3e-6, 1e-4, 0.7
"""Relative residual of the sum over all orders: the one asked for, and the one accepted where rounding allows no less.
Errors count exp(-GROWTH x optical depth) times as much as at the source: light near by hardly knows of what lies far
away, and far light follows from it."""
MOST_UNEVEN = 0.01
"""Share of even light, the same from everywhere, that scattering as a matrix may make or lose in any direction. For all
smooth phase functions it is a tenth of that; steps of a measured one between two directions of the matrix make it more,
and where it is 3 % light in open water is 2 % off (measured)."""
RESTART, RESTARTS = 40, 5
"""Steps between restarts, and at most so many of them; with fewer steps thick water would not converge."""


class NotSolved(Exception):
    """The light in this water is not found with these nodes; the message says why."""


def nodes() -> list[tuple[int, ...]]:
    """How fine the grids are: of distances and angles, then of directions."""
    return [FINE, MIDDLE, COARSE, *((len(grid.s), len(grid.phi)) for grid in (ONCE, TWICE, AGAIN, LEAVING, NORMALS))]


def farthest_m(water: OpticalProperties) -> float:
    """The last distance from a light that has nodes [m]; all channels share it."""
    return min(FARTHEST_M, FARTHEST_DEPTH / max(float(water.sigma_t.min()), 1e-3))


class LightFieldSolver:
    """Scattered light around a source of intensity 1.

    Args:
        light: How the source's intensity is distributed.
        water: What scatters.
        launcher: Of the device that does the integrals.
    """

    def __init__(self, light: Distribution, water: OpticalProperties, launcher: Launcher):
        self.light, self.water, self.launcher, self.device = light, water, launcher, launcher.device
        self.phase = water.phase
        self.fine, self.middle, self.coarse = map(self.grid, (FINE, MIDDLE, COARSE))
        self._scene = self._light_alone()

    def grid(self, nodes: tuple[int, int, int]) -> NodeGrid:
        """Nodes around the light; a field that is the same all around needs no angles."""
        grid = NodeGrid()
        everywhere = self.light.everywhere
        grid.distances, grid.inside, grid.outside = (nodes[0], 1, 0) if everywhere else nodes
        step = np.log(farthest_m(self.water) / NEAREST_M) / (nodes[0] - 1)
        grid.nearest, grid.log_step = NEAREST_M, float(step)
        grid.half_angle = self.light.half_angle
        # forward-scattered light goes on as if it were not scattered; after many scatterings light diffuses
        onward = self.water.sigma_t - self.phase.mean_cosine * self.water.sigma_s
        grid.decay = wp.vec3(*np.minimum(onward, np.sqrt(3.0 * self.water.sigma_a * onward)))
        return grid

    def solve(self) -> dict[str, np.ndarray]:
        """The arrays of a LightField, ``irradiance`` and ``source``, float32 with the channels last.

        Raises:
            NotSolved: If they cannot be found.
        """
        self._once_to, self._twice_to, self._again_to = _matrices(self.phase, ONCE, TWICE, AGAIN)
        once = self._scattered_once()
        first = self._source(once, self._once_to)
        twice = self._scattered_again(first, self.middle, TWICE)
        from_middle = Refinement(self.middle, self.fine, twice, self.water.sigma_t)
        second = from_middle(self._source(twice, self._twice_to))
        more, from_coarse = self._all_further_orders(second)
        irradiance = _applied(self._once_to["irradiance"], once)
        irradiance += from_middle(_applied(self._twice_to["irradiance"], twice))
        irradiance += from_coarse(_applied(self._again_to["irradiance"], more))
        source = first + second + from_coarse(self._source(more, self._again_to))
        if not (np.isfinite(irradiance).all() and np.isfinite(source).all()):
            raise NotSolved("the light in open water is not a number somewhere")
        return {"irradiance": _as_grid(irradiance, NORMALS), "source": _as_grid(source, LEAVING)}

    def _all_further_orders(self, second: np.ndarray) -> tuple[np.ndarray, "Refinement"]:
        """Light [angles, AGAIN, distances, 3] scattered three times and more, after it left its second scattering."""
        thrice = self._scattered_again(second, self.coarse, AGAIN)
        refined = Refinement(self.coarse, self.fine, thrice, self.water.sigma_t)
        shape, scale = thrice.shape, refined.amplitude

        def without_next(x):
            """X - K X, of X in units of its amplitude."""
            x = x.reshape(shape).astype(np.float32) * scale
            further = self._scattered_again(refined(self._source(x, self._again_to)), self.coarse, AGAIN)
            return ((x - further) / scale).ravel()

        operator = LinearOperator((thrice.size, thrice.size), matvec=without_next, dtype=np.float32)
        x = self._converged(operator, (thrice / scale).ravel())
        return x.reshape(shape).astype(np.float32) * scale, refined

    def _converged(self, operator: LinearOperator, b: np.ndarray) -> np.ndarray:
        """Solution of operator x = b, as right as float32 lets it be.

        Raises:
            NotSolved: If it does not converge.
        """
        size = np.linalg.norm(b)
        x = np.zeros_like(b)
        for _ in range(RESTARTS):
            x, left = gmres(operator, b, x0=x, rtol=TOLERANCE, restart=RESTART, maxiter=1)
            if left == 0:  # the residual, which it has looked at, is within the tolerance
                return x
            residual = np.linalg.norm(b - operator.matvec(x))
            if residual <= ENOUGH * size:  # in turbid water rounding stops it before the tolerance
                return x
            if not np.isfinite(residual):
                break
        raise NotSolved("the sum over all orders of scattering does not converge in this water")

    # ------------------------------------------------------------------------------------------ from node to node

    def _scattered_once(self) -> np.ndarray:
        """Light [angles, ONCE, distances, 3] that arrives at the fine nodes after it was scattered once."""
        return self._tabulated(tabulate_single_scattering, self.fine, ONCE)

    def _scattered_again(self, source: np.ndarray, grid: NodeGrid, directions: Directions) -> np.ndarray:
        """Light [angles, directions, distances, 3] that arrives at nodes after it left scatterings at the fine ones.

        Args:
            source: What leaves there, [angles, LEAVING, distances, 3].
            grid: Nodes where it arrives.
            directions: From where.
        """
        field = LightField()
        field.grid, field.source = self.fine, upload(_as_grid(source, LEAVING), wp.vec3, self.device)
        return self._tabulated(tabulate_next_order, grid, directions, field=field)

    def _tabulated(self, kernel, grid: NodeGrid, directions: Directions, **more) -> np.ndarray:
        shape = (grid.inside + grid.outside + 1, len(directions.pairs), grid.distances)
        radiance = wp.zeros(shape, dtype=wp.vec3, device=self.device)
        pairs = wp.array(directions.pairs.astype(np.float32), dtype=wp.vec2, device=self.device)
        self.launcher.rows(
            kernel,
            shape[:2],
            {"scene": self._scene, "grid": grid, "directions": pairs, "radiance": radiance, **more},
            tile_rows=1,
        )
        return radiance.numpy()

    def _source(self, radiance: np.ndarray, matrices) -> np.ndarray:
        source = _applied(matrices["source"], radiance)
        source *= self.water.sigma_s.astype(np.float32)
        return source

    def _light_alone(self) -> SceneData:
        """The light at the origin, along z, in the water; its peak is 1."""
        self._profile = wp.array(self.light.profile, dtype=float, device=self.device)
        scene = SceneData()
        scene.medium = medium_record(self.water, self.device)
        record = light_record(self.light, np.ones(3) / self.light.gain, profile=self._profile)
        scene.lights = self._lights = wp.array([record], dtype=LightData, device=self.device)
        return scene


class Refinement:
    """Interpolation from values at the nodes of a coarse grid to those of a fine one, by splines.

    Args:
        coarse: The one grid.
        fine: The other.
        like: Radiance [angles, n, distances, 3] of the order of what is to be refined, at the coarse nodes.
        sigma_t: Extinction [1/m], float64 [3].
    """

    def __init__(self, coarse: NodeGrid, fine: NodeGrid, like: np.ndarray, sigma_t: np.ndarray):
        d = NEAREST_M * np.exp(coarse.log_step * np.arange(coarse.distances))
        depth = np.outer(d, sigma_t)
        amplitude = np.maximum(like.max(axis=(0, 1)), 1e-30) * np.exp(GROWTH * np.minimum(depth, FARTHEST_DEPTH))
        # farther away an order says nothing of the sum of them all: it goes on as ``scale_at`` does
        last = (depth <= FARTHEST_DEPTH).sum(axis=0) - 1
        amplitude = amplitude[np.minimum(np.arange(len(d))[:, None], last), np.arange(3)]
        along, across = (
            make_interp_spline(at, np.eye(len(at)), k=min(3, len(at) - 1))(others)
            for at, others in zip(_places(coarse), _places(fine), strict=True)
        )
        self.amplitude = amplitude.astype(np.float32)
        """How large values are about at each distance [distances, 3]; splines and errors are of what is left."""
        rescaled = np.exp(along @ np.log(amplitude))[:, None] * along[..., None] / amplitude
        self._along = np.einsum("fic,cd->icfd", rescaled, np.eye(3)).reshape(3 * len(d), -1).astype(np.float32)
        self._across = across.astype(np.float32)

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Values [angles, n, distances, 3] at the fine nodes."""
        angles, n = values.shape[:2]
        along = values.reshape(angles * n, -1) @ self._along
        return (self._across @ along.reshape(angles, -1)).reshape(len(self._across), n, -1, 3)


@functools.lru_cache(maxsize=1)
def _matrices(phase: PhaseFunction, once: Directions, *more: Directions) -> list[dict[str, np.ndarray]]:
    """What turns radiance from each grid of directions into irradiance and sources; it is the same for all lights.

    Raises:
        NotSolved: If the phase function is too sharp for a matrix.
    """
    scatter = scattering_matrix(phase, once, LEAVING)
    off = np.abs(scatter.sum(axis=1) - 1.0).max()
    if not off <= MOST_UNEVEN:
        raise NotSolved(
            "the phase function has steps or peaks too sharp for the field, whose scattering would make or "
            f"lose up to {off:.1%} of the light in a direction"
        )
    irradiance = irradiance_matrix(once, NORMALS)
    shape = shape_of_twice(phase, scatter, once, LEAVING)
    between = [grid.interpolation(once, shape) for grid in more]
    if not all(np.isfinite(matrix).all() for matrix in between):
        raise NotSolved("the phase function has steps or peaks too sharp for the field")
    return [
        {"irradiance": irradiance, "source": scatter},
        *({"irradiance": irradiance @ matrix, "source": scatter @ matrix} for matrix in between),
    ]


def _as_grid(values: np.ndarray, directions: Directions) -> np.ndarray:
    """Values [angles, n, distances, 3] in n directions as [angles, gamma, phi, distances, 3]."""
    return values.reshape(len(values), len(directions.s), len(directions.phi), *values.shape[2:])


def _applied(matrix: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A matrix [m, n] applied to values [angles, n, distances, 3]."""
    angles, n, *rest = values.shape
    return (matrix.astype(np.float32) @ values.reshape(angles, n, -1)).reshape(angles, -1, *rest)


def _places(grid: NodeGrid) -> tuple[np.ndarray, np.ndarray]:
    """Places of nodes that grids of any fineness share: distances from 0 to 1, angles to 1 at the edge and on to 2."""
    outside = 1.0 + np.arange(grid.outside + 1) / max(grid.outside, 1)
    return np.linspace(0.0, 1.0, grid.distances), np.concatenate([np.arange(grid.inside) / grid.inside, outside])
