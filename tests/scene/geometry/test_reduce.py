"""Fewer triangles within a tolerance: measured anew with other points than the code looks at."""

import numpy as np
import pytest
import trimesh

from varos_warp.scene.geometry.procedural import generate_terrain, grid_mesh
from varos_warp.scene.geometry.reduce import Lines, deviation, nearest, reduce_mesh
from varos_warp.scene.geometry.terrain import Surface

RIPPLED = generate_terrain(40.0, 161, 2.0, seed=3)
BALL = trimesh.creation.icosphere(subdivisions=5)
EYE = np.array([0.0, 0.0, 1.5])


def everywhere(value):
    return lambda points: np.full(len(points), value)


def by_distance(points):
    """0.2 % of the distance from a point above the middle."""
    return 0.002 * np.linalg.norm(points - EYE, axis=1)


def rim(vertices, faces):
    """Ends [n, 6] of the edges of one face, sorted."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, uses = np.unique(edges, axis=0, return_counts=True)
    ends = np.sort(vertices[edges[uses == 1]].view([("", float)] * 3), axis=1)
    return np.sort(ends.view(float).reshape(-1, 6).view([("", float)] * 6), axis=0).view(float).reshape(-1, 6)


def worst_share(given, made, tolerance, count=200_000):
    """The largest distance found, either way, as a share of what is allowed there: random points, evenly by area."""
    shares = []
    for source, target in ((given, made), (made, given)):
        points = np.asarray(trimesh.sample.sample_surface(trimesh.Trimesh(*source, process=False), count, seed=7)[0])
        shares.append(np.max(Surface(*target).nearest(points)[0] / tolerance(points)))
    return max(shares)


@pytest.fixture(scope="module")
def reduced():
    """The rippled terrain by distance."""
    return reduce_mesh(*RIPPLED, by_distance)


def test_the_surface_stays_within_the_tolerance_of_every_place(reduced):
    """At random points, not those that were measured; and most of the tolerance is made use of."""
    assert len(reduced[1]) < 0.3 * len(RIPPLED[1])
    assert 0.8 < worst_share(RIPPLED, reduced, by_distance) <= 1.0


def test_no_crack_opens_between_bands_and_the_outline_stays_as_it_is(reduced):
    np.testing.assert_array_equal(rim(*reduced), rim(*RIPPLED))


def test_detail_follows_the_tolerance(reduced):
    """Against the tolerance of the nearest place everywhere: as many triangles near the point, far fewer elsewhere."""
    def count(vertices, faces, low, high):
        distance = np.linalg.norm(vertices[faces].mean(axis=1) - EYE, axis=1)
        return np.count_nonzero((distance >= low) & (distance < high))

    uniform = reduce_mesh(*RIPPLED, everywhere(0.002 * 4.0))
    assert count(*reduced, 3.5, 4.5) == pytest.approx(count(*uniform, 3.5, 4.5), rel=0.35)
    assert count(*reduced, 12.0, 18.0) < 0.6 * count(*uniform, 12.0, 18.0)


def test_the_same_mesh_gives_the_same_mesh(reduced):
    again = reduce_mesh(*RIPPLED, by_distance)
    np.testing.assert_array_equal(again[0], reduced[0])
    np.testing.assert_array_equal(again[1], reduced[1])


def test_a_closed_mesh_stays_closed_and_faces_keep_their_outside():
    vertices, faces = np.asarray(BALL.vertices), np.asarray(BALL.faces, np.int32)
    made = trimesh.Trimesh(*reduce_mesh(vertices, faces, everywhere(0.003)), process=False)
    assert made.is_watertight
    assert made.is_winding_consistent
    assert made.euler_number == 2
    # a surface within 0.003 of a ball of radius 1
    assert made.volume == pytest.approx(BALL.volume, rel=3 * 0.0031)
    assert np.min(np.einsum("ij,ij->i", made.face_normals, made.triangles_center)) > 0.5


def test_triangles_of_a_ball_are_in_inverse_proportion_to_the_tolerance():
    """A chord of length c lies c^2/8 off a circle of radius 1, so the area of a triangle goes with the tolerance.

    The order over a factor of 8, which half a triangle's size more or less at either end changes by 0.2.
    """
    vertices, faces = np.asarray(BALL.vertices), np.asarray(BALL.faces, np.int32)
    counts = [len(reduce_mesh(vertices, faces, everywhere(e))[1]) for e in (0.002, 0.016)]
    assert np.log(counts[0] / counts[1]) / np.log(8.0) == pytest.approx(1.0, abs=0.25)


def test_a_plane_needs_its_outline_only():
    axis = np.linspace(0.0, 5.0, 51)
    vertices, faces = grid_mesh(axis, axis, np.zeros((51, 51)))
    v, f = reduce_mesh(vertices, faces, everywhere(0.001))
    assert len(f) < 2 * 4 * 50  # a triangle for each edge of the outline, and as many again
    assert trimesh.Trimesh(v, f, process=False).area == pytest.approx(25.0, rel=1e-9)
    np.testing.assert_array_equal(rim(v, f), rim(vertices, faces))


def test_without_tolerance_nothing_changes():
    v, f = reduce_mesh(*RIPPLED, everywhere(0.0))
    assert v is RIPPLED[0]
    assert f is RIPPLED[1]


def test_a_sheet_thinner_than_the_tolerance_is_not_turned_inside_out():
    """Both sides of a plate of 1 mm lie within 5 mm of each other; still every face looks to its own side."""
    plate = trimesh.creation.box([1.0, 1.0, 0.001]).subdivide().subdivide().subdivide().subdivide()
    made = trimesh.Trimesh(*reduce_mesh(np.asarray(plate.vertices), np.asarray(plate.faces, np.int32),
                                        everywhere(0.005)), process=False)
    assert made.is_watertight
    assert len(made.faces) < len(plate.faces)
    assert made.volume > 0.0


def test_deviation_finds_the_lift_of_a_plane_and_faces_that_look_the_other_way():
    axis = np.linspace(0.0, 2.0, 9)
    vertices, faces = grid_mesh(axis, axis, np.zeros((9, 9)))
    found = deviation(Surface(vertices, faces), Surface(vertices + [0, 0, 0.25], faces[:, ::-1]), everywhere(0.1))
    np.testing.assert_allclose(found.distance, 0.25, rtol=1e-6)
    assert found.turned.all()
    assert not deviation(Surface(vertices, faces), Surface(vertices, faces), everywhere(0.1)).turned.any()


def test_distances_above_the_limit_are_exact_in_float64():
    """Points 0.3 mm off a plane, whose coordinates of 10 km are rounded to 1 mm in float32."""
    vertices = np.array([[-1e4, -1e4, 1e4], [1e4, -1e4, 1e4], [1e4, 1e4, 1e4], [-1e4, 1e4, 1e4], [0, 0, -1e4]], float)
    surface = Surface(vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    points = np.random.default_rng(1).uniform(-5e3, 5e3, (500, 3)) * [1, 1, 0] + [0.0, 0.0, 1e4 + 3e-4]
    rough, exact = (nearest(surface, points, np.full(500, limit))[0] for limit in (1.0, 0.0))
    np.testing.assert_allclose(exact, 3e-4, rtol=1e-6)
    assert np.abs(rough - 3e-4).max() > 1e-5


def test_points_along_edges_are_no_farther_apart_than_asked():
    vertices, faces = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0], [3, 4, 1]]), np.array([[0, 1, 2], [1, 3, 2]])
    lines = Lines.along(vertices, faces, 0.5)
    assert len(np.unique(lines.number)) == 5
    for number in range(5):
        points = lines.points()[lines.number == number]
        ends = lines.start[lines.number == number][:1], lines.end[lines.number == number][:1]
        steps = np.linalg.norm(np.diff(np.concatenate([ends[0], points, ends[1]]), axis=0), axis=1)
        assert steps.max() <= 0.5 + 1e-12
    on = trimesh.triangles.closest_point(vertices[faces[lines.face]], lines.points())
    np.testing.assert_allclose(on, lines.points(), atol=1e-12)


def test_crossings_are_where_the_edges_of_a_grid_lie_above_an_edge():
    """An edge from x = 0.25 to 3.75, y = 3.6 to 0.5: three lines of x, three of y, and diagonals from -3 to 3."""
    axis = np.arange(5.0)
    grid = Surface(*grid_mesh(axis, axis, np.zeros((5, 5))))
    vertices, faces = np.array([[0.25, 3.6, 1], [3.75, 0.5, 1], [4.0, 4.0, 1]]), np.array([[0, 1, 2]], np.int32)
    lines = Lines.along(vertices, faces, 0.05)
    crossed, below = lines.crossings(np.array([[0.0, 0.0, 1.0]]), grid, grid.nearest(lines.points())[1])
    np.testing.assert_allclose(below, crossed.points() * [1, 1, 0], atol=1e-12)
    x, y, _ = crossed.points()[crossed.number == 0].T
    on_grid = np.abs(np.array([x, y, x - y]) - np.round([x, y, x - y])) < 1e-9
    np.testing.assert_array_equal(on_grid.sum(axis=1), [3, 3, 7])
    np.testing.assert_array_equal(on_grid.sum(axis=0), 1)
