import numpy as np
import pytest
import trimesh

from varos_warp.scene.geometry.procedural import generate_terrain
from varos_warp.scene.geometry.query import clearance, heights_at, is_inside
from varos_warp.scene.geometry.surface import Surface

BALL = trimesh.creation.icosphere(subdivisions=3)


def test_a_line_through_a_closed_surface_crosses_it_an_even_number_of_times_even_at_vertices_and_edges():
    edges = 0.5 * (BALL.vertices[BALL.edges_unique[:, 0]] + BALL.vertices[BALL.edges_unique[:, 1]])
    xy = np.vstack([BALL.vertices[:, :2], edges[:, :2]])
    assert all(len(z) % 2 == 0 for z in heights_at(BALL.vertices, BALL.faces, xy))


def test_inside_is_where_the_nearest_surface_is_inside_the_radius():
    points = np.random.default_rng(2).uniform(-1.2, 1.2, (400, 3))
    radius = np.linalg.norm(points, axis=1)
    clear = (radius < 0.98) | (radius > 1.0)  # the facets lie between
    np.testing.assert_array_equal(is_inside(BALL.vertices, BALL.faces, points)[clear], radius[clear] < 0.98)


def test_under_an_open_terrain_is_inside_and_under_an_overhang_is_not():
    floor = np.array([[-5, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]], float)
    shelf = np.array([[-1, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]], float)
    low = shelf - [0, 0, 0.5]
    vertices = np.vstack([floor, shelf, low])
    square = np.array([[0, 1, 2], [0, 2, 3]])
    faces = np.vstack([square, square + 4, square[:, ::-1] + 8])
    points = [[0.1, 0.2, -1], [0.1, 0.2, 1], [0.1, 0.2, 1.8], [0.1, 0.2, 3], [3, 3, -1], [9, 9, -1]]
    assert is_inside(vertices, faces, points).tolist() == [True, False, True, False, True, False]


@pytest.mark.parametrize("reach", [0.1, 0.5, 3.0])
def test_clearance_is_the_distance_within_reach_and_infinite_beyond(reach):
    vertices, faces = generate_terrain(20, 41, 2.0, seed=4)
    big = np.array([[-30.0, -30, -3], [30, -30, -3], [0, 40, -3]])
    vertices, faces = np.vstack([vertices, big]), np.vstack([faces, [[len(vertices) + i for i in range(3)]]])
    points = np.random.default_rng(0).uniform([-14, -14, -5], [14, 14, 5], (500, 3))
    exact, _ = Surface(vertices, faces).nearest(points)
    # of two faces that are as far to single precision, the part of the mesh may find the other
    np.testing.assert_allclose(
        clearance(vertices, faces, points, reach), np.where(exact < reach, exact, np.inf), atol=4 * 2.0**-24 * 30.0
    )
    assert np.isinf(clearance(vertices, faces, points + [0, 0, 50], reach)).all()


def test_heights_lie_on_the_plane_and_there_are_none_beside_it():
    vertices = np.array([[0, 0, 0], [2, 0, 2], [0, 2, 4]], float)
    z = heights_at(vertices, np.array([[0, 1, 2]]), np.array([[0.5, 0.5], [3.0, 3.0]]))
    assert [heights.tolist() for heights in z] == [[0.5 + 1.0], []]
