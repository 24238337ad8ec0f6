"""Light in open water: single scattering against adaptive quadrature, and how tables are looked up."""

import numpy as np
import pytest
import warp as wp
from fields import look_up
from physics.rig import single_scattering as exact

from varos_warp.kernels.field.open_water import (
    LightField,
    NodeGrid,
    grid_place,
    node_angle,
    node_distance,
)
from varos_warp.kernels.field.single_scattering import single_scattering
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.lights.record import Light


@wp.kernel(enable_backward=False)
def scatter_once(scene: SceneData, ends: wp.array(dtype=float), L: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    L[i] = single_scattering(scene.medium, scene.lights[0], wp.vec3(0.0), wp.vec3(0.0, 0.0, 1.0), ends[i])


@wp.kernel(enable_backward=False)
def find_nodes(grid: NodeGrid, places: wp.array2d(dtype=wp.vec2)):
    i, j = wp.tid()
    places[i, j] = grid_place(grid, node_distance(grid, i), node_angle(grid, j))


def lamp(position=(0, 0, 0), axis=(0, 0, 1), cone_deg=65.0, blend=0.0, intensity=1.0) -> Light:
    light = Light()
    light.position, light.axis = wp.vec3(*position), wp.vec3(*(np.array(axis) / np.linalg.norm(axis)))
    light.cos_half = -1.0 if cone_deg >= 360 else float(np.cos(np.radians(cone_deg) / 2))
    light.blend, light.intensity = blend, wp.vec3(intensity)
    return light


@pytest.mark.parametrize("T", [0.5, 2.0, 10.0, 25.0])
@pytest.mark.parametrize(
    ("position", "axis", "cone_deg", "blend"),
    [
        ((0.15, 0, -0.1), (0, 0, 1), 65, 0.0),
        ((0.15, 0, -0.1), (0, 0, 1), 65, 0.15),
        ((0.15, 0, -0.1), (0, 0, 1), 65, 1.0),
        ((0.5, 0.2, 0.1), (-0.3, 0, 1), 20, 0.0),
        ((0.5, 0.2, 0.1), (-0.3, 0, 1), 20, 0.5),
        ((1.0, 0, 0.4), (-0.5, 0.1, 1), 120, 0.3),
        ((1.0, 0, 1.0), None, 360, 0.0),
        ((0.01, 0, 1.0), (-1, 0, 0.3), 65, 0.0),
    ],
)
def test_single_scattering_is_right_to_a_thousandth(position, axis, cone_deg, blend, T):
    """Of the paper's red, green and blue; soft edges too (the quadrature of the notes has the same bound)."""
    sigma_s, sigma_t, g = np.array([0.00175, 0.01825, 0.043125]), np.array([0.125, 0.057989, 0.043125]), 0.8
    scene = SceneData()
    scene.medium.sigma_s, scene.medium.sigma_t, scene.medium.phase.g = wp.vec3(*sigma_s), wp.vec3(*sigma_t), g
    lights = wp.array([lamp(position, axis or (0, 0, 1), cone_deg, blend)], dtype=Light, device="cpu")
    scene.lights = lights
    L = wp.zeros(1, dtype=wp.vec3, device="cpu")
    wp.launch(scatter_once, 1, inputs=[scene, wp.array([T], dtype=float, device="cpu"), L], device="cpu")
    cone = {} if axis is None else {"axis": axis, "cone_deg": cone_deg, "blend": blend}
    truth = [exact(position, s, t, g, T, **cone, breaks=100) for s, t in zip(sigma_s, sigma_t, strict=True)]
    # where a ray has just entered the soft edge next to nothing arrives
    assert L.numpy()[0] == pytest.approx(truth, rel=1e-3, abs=1e-3 * sigma_s.max() * 1e-4)


def node_grid(half_angle=0.5, inside=5, outside=7) -> NodeGrid:
    grid = NodeGrid()
    grid.distances, grid.nearest, grid.log_step = 9, 0.1, 0.5
    grid.half_angle, grid.inside, grid.outside = half_angle, inside, outside
    grid.decay = wp.vec3(0.1, 0.2, 0.3)
    return grid


@pytest.mark.parametrize(("half_angle", "inside", "outside"), [(0.5, 5, 7), (1.5, 10, 2), (np.pi, 1, 0)])
def test_every_node_is_found_where_it_lies(half_angle, inside, outside):
    shape = (9, inside + outside + 1)
    places = wp.zeros(shape, dtype=wp.vec2, device="cpu")
    wp.launch(find_nodes, shape, inputs=[node_grid(half_angle, inside, outside), places], device="cpu")
    row, col = np.meshgrid(*map(np.arange, shape), indexing="ij")
    # a place at the last nodes stays a little inside; angles are steepest at the edge, where a root amplifies rounding
    assert np.abs(places.numpy()[..., 0] - row).max() < 1.1e-3
    assert np.abs(places.numpy()[..., 1] - col).max() < 5e-3


@pytest.fixture
def table():
    """Any numbers, but the same on both sides of the plane of the axis, as the layout has it."""
    rng = np.random.default_rng(5)
    made = LightField()
    made.grid = node_grid()
    for name, shape in (("irradiance", (13, 7, 5, 9)), ("source", (13, 8, 5, 9))):
        setattr(made, name, wp.array(rng.uniform(0.5, 1.5, (*shape, 3)), dtype=wp.vec3, device="cpu"))
    return made


def looked_up(table, light, p, d):
    p, d = (wp.array(np.asarray(x, np.float32), dtype=wp.vec3, device="cpu") for x in (p, d))
    E, S = (wp.zeros(len(p), dtype=wp.vec3, device="cpu") for _ in range(2))
    tables, lights = wp.array([table], dtype=LightField, device="cpu"), wp.array([light], dtype=Light, device="cpu")
    wp.launch(look_up, len(p), inputs=[tables, lights, p, d, E, S], device="cpu")
    return np.stack([E.numpy(), S.numpy()])


def places_and_directions(n=200):
    rng = np.random.default_rng(1)
    d = rng.normal(size=(n, 3))
    return rng.normal(size=(n, 3)), d / np.linalg.norm(d, axis=1)[:, None]


def test_what_is_looked_up_moves_and_turns_with_the_lamp(table):
    from scipy.spatial.transform import Rotation

    p, d = places_and_directions()
    R, shift = Rotation.from_euler("xyz", [0.3, 1.1, -2.0]), np.array([0.4, -0.2, 0.3])
    at_rest = looked_up(table, lamp(), p, d)
    moved = looked_up(table, lamp(shift, R.apply([0, 0, 1])), R.apply(p) + shift, R.apply(d))
    # float32, where the table is at most steep: 2 between nodes that are as near as 0.02 rad
    assert np.median(np.abs(moved / at_rest - 1)) < 1e-5
    assert np.abs(moved / at_rest - 1).max() < 5e-3


def test_what_is_looked_up_is_the_same_on_both_sides_of_the_lamps_axis(table):
    p, d = places_and_directions()
    p[:, 1] = 0.0
    assert looked_up(table, lamp(), p, d) == pytest.approx(looked_up(table, lamp(), p, d * [1, -1, 1]), rel=1e-3)


def test_brighter_lamps_scatter_more_light(table):
    p, d = places_and_directions()
    one, seven = (looked_up(table, lamp(intensity=power), p, d) for power in (1.0, 7.0))
    assert seven == pytest.approx(7.0 * one, rel=1e-6)
