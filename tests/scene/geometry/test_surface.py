"""Nearest points of a mesh: the face is found in single precision, the distance to it is that of double precision."""

import numpy as np
import pytest
import trimesh

from varos_warp.scene.geometry.procedural import generate_terrain
from varos_warp.scene.geometry.surface import Surface

BALL = trimesh.creation.icosphere(subdivisions=3)
FAR = np.array([569_000.0, 7_035_000.0, -50.0])


def smallest_distance(vertices, faces, points):
    """Over all triangles, in float64."""
    return np.array(
        [
            np.linalg.norm(
                trimesh.triangles.closest_point(vertices[faces], np.tile(p, (len(faces), 1))) - p, axis=1
            ).min()
            for p in points
        ]
    )


@pytest.mark.parametrize("size", [30.0, 500.0])
def test_the_distance_is_the_smallest_over_all_triangles(size):
    """One large triangle lies among many small ones; of two faces as far as single precision tells, either is found."""
    vertices, faces = generate_terrain(30, 41, 2.0)
    vertices = np.vstack([vertices, [[-size, -size, -20], [size, -size, -20], [0, size, -20]]])
    faces = np.vstack([faces, [[len(vertices) - 3, len(vertices) - 2, len(vertices) - 1]]])
    points = np.random.default_rng(0).uniform(-40, 40, (60, 3)) * [1, 1, 0.4]
    found, face = Surface(vertices, faces).nearest(points)
    off = found - smallest_distance(vertices, faces, points)
    assert off.min() > -1e-12
    assert off.max() < 4 * 2.0**-24 * size
    on_it = trimesh.triangles.closest_point(vertices[faces[face]], points)
    np.testing.assert_array_equal(found, np.linalg.norm(on_it - points, axis=1))


def test_distances_survive_utm_coordinates():
    points = np.random.default_rng(1).standard_normal((200, 3)) * 2.0
    near, _ = Surface(BALL.vertices, BALL.faces).nearest(points)
    far, _ = Surface(BALL.vertices + FAR, BALL.faces).nearest(points + FAR)
    np.testing.assert_allclose(near, far, atol=1e-7)  # squares of 1e-9 m


def test_beyond_its_reach_there_is_nothing():
    points = np.array([[1.5, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 0.9]])
    distance, face = Surface(BALL.vertices, BALL.faces).nearest(points, 1.0)
    assert np.isfinite(distance).tolist() == [True, False, True]
    assert (face >= 0).tolist() == [True, False, True]


class _EdgeOn(Surface):
    """A surface of which a BVH in float32 says that rays meet its first face, as it may of one edge on."""

    def first_hits(self, points, directions):
        return np.zeros(len(points), np.int32), np.ones(len(points), np.float32)


@pytest.mark.parametrize("offset", [0.0, 1e-9], ids=["in its plane", "beside it"])
def test_a_face_edge_on_is_as_far_as_its_nearest_corner(offset):
    """There the plane is met nowhere, or anywhere: 0 / 0 and x / 0 made relief of sheet piles not finite."""
    surface = _EdgeOn(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([[0, 1, 2]]))
    t = surface.distances(np.array([[0.25, offset, 3.0]]), np.array([[0.0, 0.0, -2.0]]))
    np.testing.assert_allclose(t, [1.0], atol=1e-12)


def test_a_face_edge_on_around_the_ray_is_there():
    """It reaches behind where the ray begins, and no distance is negative."""
    surface = _EdgeOn(np.array([[-5.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, 0.0, 3.0]]), np.array([[0, 1, 2]]))
    t = surface.distances(np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(t, [0.0])


def test_of_faces_the_other_way_the_plane_counts():
    surface = Surface(np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 4.0]]), np.array([[0, 1, 2]]))
    t = surface.distances(np.array([[1.0, 1.0, 5.0]]), np.array([[0.0, 0.0, -1.0]]))
    np.testing.assert_allclose(t, [4.0], rtol=1e-12)
