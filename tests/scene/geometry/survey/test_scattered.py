"""Points without a grid are triangulated; those of a grid are known as one."""

import numpy as np
import pytest

from varos_warp.errors import InputError
from varos_warp.scene.geometry.survey import scattered
from varos_warp.scene.geometry.survey.content import Raster

FAR = np.array([400_000.0, 6_100_000.0, 0.0])


def lattice(columns=7, rows=5, dx=0.5, dy=0.25):
    """Points of a grid at UTM coordinates [N, 3], row after row from the south, heights without symmetry."""
    x, y = np.meshgrid(dx * np.arange(columns), dy * np.arange(rows))
    return np.column_stack([x.ravel(), y.ravel(), np.arange(x.size) ** 1.3]) + FAR


def random_points(count=400, seed=3):
    xyz = np.random.default_rng(seed).random((count, 3)) * [10.0, 10.0, 0.1]
    return xyz + FAR


def area_of(vertices, faces):
    corners = vertices[faces][..., :2]
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return 0.5 * (one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])


def test_points_of_a_grid_are_known_as_one_in_any_order():
    points = lattice()
    found = scattered.grid_of(np.random.default_rng(1).permutation(points))
    assert isinstance(found, Raster)
    np.testing.assert_allclose(found.values[::-1].ravel(), points[:, 2])
    np.testing.assert_allclose(found.T, [[0.5, 0.0, FAR[0]], [0.0, -0.25, FAR[1] + 1.0]], rtol=1e-12)


def test_a_grid_may_lack_points():
    points = np.delete(lattice(), [3, 16, 17], axis=0)
    found = scattered.grid_of(points)
    assert found is not None
    assert np.isnan(found.values).sum() == 3


@pytest.mark.parametrize(
    "spoil",
    [
        lambda p: random_points(),
        lambda p: p[::3],
        lambda p: np.vstack([p, p[:1] + [0, 0, 1.0]]),
        lambda p: p[:7],
        lambda p: p + np.random.default_rng(1).normal(0.0, 0.01, p.shape),
        lambda p: np.vstack([p, p[:1] + [0.1, 0, 0]]),
    ],
    ids=["random", "every third", "two on a node", "a line", "jittered", "one between"],
)
def test_other_points_are_not(spoil):
    assert scattered.grid_of(spoil(lattice())) is None


def test_scattered_points_are_joined_with_faces_up_and_nothing_twice():
    points = random_points()
    vertices, faces, holes, _ = scattered.triangulate(points, 1e9, "terrain")
    area = area_of(vertices, faces)
    assert (area > 0.0).all()
    from scipy.spatial import ConvexHull

    assert area.sum() == pytest.approx(ConvexHull(points[:, :2] - FAR[:2]).volume, rel=1e-9)
    assert holes == (0, 0.0)
    assert len(vertices) == len(points)


def test_a_gap_wider_than_the_longest_edge_stays_a_hole_and_is_told():
    rng = np.random.default_rng(4)
    xy = rng.random((4000, 2)) * 20.0
    gap = np.linalg.norm(xy - 10.0, axis=1) < 4.0
    points = np.column_stack([xy, np.zeros(len(xy))])[~gap] + FAR
    vertices, faces, holes, _ = scattered.triangulate(points, None, "terrain")
    assert holes.count == 1
    assert holes.area_m2 == pytest.approx(np.pi * 4.0**2, rel=0.15)  # its rim is as ragged as the points
    middle = vertices[faces].mean(axis=1)[:, :2] - FAR[:2] - 10.0
    assert np.linalg.norm(middle, axis=1).min() > 3.0
    whole = scattered.triangulate(points, 100.0, "terrain")
    assert whole[2].count == 0
    assert area_of(*whole[:2]).sum() == pytest.approx(area_of(vertices, faces).sum() + holes.area_m2, rel=0.02)


def test_no_edge_is_longer_than_asked():
    vertices, faces, _, _ = scattered.triangulate(random_points(), 0.8, "terrain")
    sides = vertices[faces][..., :2] - np.roll(vertices[faces][..., :2], 1, axis=1)
    assert np.linalg.norm(sides, axis=2).max() <= 0.8


def test_points_above_each_other_become_one_at_their_mean_height():
    points = np.array([[0, 0, 1.0], [1, 0, 2.0], [0, 1, 3.0], [0, 0, 5.0]]) + FAR
    merged = scattered.merge_stacked(points) - FAR
    assert merged.tolist() == [[0, 0, 3.0], [1, 0, 2.0], [0, 1, 3.0]]


def test_block_means_are_those_of_the_points_in_each_square():
    points = random_points()
    means = scattered.block_means(points, 2.5)
    square = np.floor(points[:, :2] / 2.5)
    assert len(means) == len(np.unique(square, axis=0))
    for mean in means[:5]:
        inside = (square == np.floor(mean[:2] / 2.5)).all(axis=1)
        np.testing.assert_allclose(mean, points[inside].mean(axis=0), rtol=1e-12)


def test_points_that_make_no_surface_are_refused():
    for points in (random_points(2), np.outer(np.arange(5.0), [1, 1, 0]) + FAR):
        with pytest.raises(InputError, match=f"{len(points)} points make no surface"):
            scattered.triangulate(points, None, "terrain")
    with pytest.raises(InputError, match="edges as short as 1e-06 m") as caught:
        scattered.triangulate(random_points(), 1e-6, "terrain")
    assert caught.value.key == "terrain.longest_edge_m"


def test_more_points_than_the_limit_are_refused_with_a_resolution_to_thin_to(monkeypatch):
    monkeypatch.setenv("VAROS_WARP_MAX_SCATTERED_POINTS", "100")
    with pytest.raises(InputError, match=r"resolution_m: 1\.4;") as caught:  # 2 x 10 m x 10 m / 100
        scattered.triangulate(random_points(), None, "terrain")
    assert caught.value.key == "terrain.resolution_m"


def test_a_large_triangulation_is_kept_for_later_runs(monkeypatch):
    monkeypatch.setattr(scattered, "KEPT_POINTS", 10)
    points = random_points()
    first = scattered.triangulate(points, None, "terrain")
    monkeypatch.setattr(scattered, "Delaunay", None)
    again = scattered.triangulate(points, None, "terrain")
    assert (first[1] == again[1]).all()
    assert first[2] == again[2]
