"""Grids become meshes by rules that are stated: nodes, cells, diagonals, holes; tiles are joined, blocks are means."""

import numpy as np
import pytest

from varos_warp.errors import InputError
from varos_warp.scene.geometry.survey import grid
from varos_warp.scene.geometry.survey.content import Raster

NORTH_UP = np.array([[2.0, 0.0, 100.0], [0.0, -3.0, 200.0]])


def mesh(z, T=NORTH_UP):
    return grid.mesh_of(Raster(np.array(z, float), T), "terrain")


def corners(z, T=NORTH_UP):
    vertices, faces, _ = mesh(z, T)
    return vertices[faces]


def test_the_first_row_is_the_northernmost_and_the_first_column_the_westernmost():
    vertices, _, _ = mesh([[1, 2, 3], [4, 5, 6]])
    assert vertices.tolist() == [
        [100, 200, 1],
        [102, 200, 2],
        [104, 200, 3],
        [100, 197, 4],
        [102, 197, 5],
        [104, 197, 6],
    ]


def test_a_cell_is_divided_along_the_shorter_diagonal_in_space():
    """From north-west to south-east where their heights differ less, and where both are equal; else the other one."""

    def diagonal(z):
        (a, b) = ({tuple(p[:2]) for p in triangle} for triangle in corners(z))
        return sorted(a & b)

    north_west, north_east, south_west, south_east = (100.0, 200.0), (102.0, 200.0), (100.0, 197.0), (102.0, 197.0)
    assert diagonal([[0, 5], [5, 0]]) == sorted([north_west, south_east])
    assert diagonal([[5, 0], [0, 5]]) == sorted([north_west, south_east])
    assert diagonal([[0, 1], [1, 5]]) == sorted([north_east, south_west])
    assert diagonal([[0, 0], [0, 0]]) == sorted([north_west, south_east])


@pytest.mark.parametrize(
    "T",
    [
        NORTH_UP,
        NORTH_UP * [[1, 1, 1], [1, -1, 1]],
        NORTH_UP * [[-1, 1, 1], [1, 1, 1]],
        np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0]]),
    ],
)
def test_faces_run_counter_clockwise_seen_from_above(T):
    a, b, c = np.moveaxis(corners(np.random.default_rng(1).random((4, 5)), T), 1, 0)
    assert (np.cross(b - a, c - a)[:, 2] > 0.0).all()


def test_a_cell_is_there_where_all_four_of_its_nodes_have_heights():
    z = np.zeros((5, 5))
    z[2, 2] = np.nan
    _, faces, holes = mesh(z)
    assert len(faces) == 2 * (16 - 4)
    assert holes == grid.Holes(1, 4 * 2.0 * 3.0)


def test_holes_are_what_the_surface_surrounds_and_not_what_lies_at_its_rim():
    z = np.zeros((12, 12))
    z[0, :5] = z[5, 5] = z[8, 8] = z[8, 9] = np.nan
    _, faces, holes = mesh(z)
    assert holes == grid.Holes(2, (4 + 6) * 6.0)
    assert len(faces) == 2 * (121 - 5 - 10)


def test_nodes_without_a_cell_are_left_out():
    z = np.full((4, 4), np.nan)
    z[:2, :2] = z[3, 3] = 1.0
    vertices, faces, _ = mesh(z)
    assert (len(vertices), len(faces)) == (4, 2)


def test_a_region_keeps_the_nodes_in_it():
    raster = Raster(np.arange(20.0).reshape(4, 5), NORTH_UP)
    cut = grid.window(raster, (102.0, 193.0, 106.9, 199.0))
    assert cut.values.tolist() == [[6.0, 7.0, 8.0], [11.0, 12.0, 13.0]]
    assert grid.places(cut.T, 0, 0).tolist() == [102.0, 197.0]
    assert grid.window(raster, (0.0, 0.0, 50.0, 50.0)).values.size == 0


def test_a_region_of_a_turned_grid_keeps_the_nodes_in_it_and_no_others():
    T = np.array([[0.8, 0.6, 10.0], [0.6, -0.8, 20.0]])
    raster = Raster(np.arange(400.0).reshape(20, 20), T)
    cut = grid.window(raster, (12.1, 10.1, 24.9, 21.9))
    row, column = np.mgrid[:20, :20]
    x, y = np.moveaxis(grid.places(T, row, column), -1, 0)
    inside = (x > 12.1) & (x < 24.9) & (y > 10.1) & (y < 21.9)
    assert sorted(cut.values[~np.isnan(cut.values)]) == sorted(raster.values[inside])


def test_thinning_takes_the_mean_of_whole_blocks_at_their_middle():
    z = np.arange(30.0).reshape(5, 6)
    thin, block = grid.thinned(Raster(z, NORTH_UP), 6.0)
    assert block == (3, 2)
    assert thin.values.tolist() == [[z[:2, :3].mean(), z[:2, 3:].mean()], [z[2:4, :3].mean(), z[2:4, 3:].mean()]]
    assert grid.places(thin.T, 0, 0).tolist() == [102.0, 198.5]
    assert grid.spacing(thin.T) == (6.0, 6.0)


def test_a_block_with_heights_at_less_than_half_of_its_nodes_has_none():
    z = np.ones((2, 4))
    z[:, 0] = z[:, 2] = z[1, 3] = np.nan
    thin, _ = grid.thinned(Raster(z, np.array([[1.0, 0, 0], [0, -1.0, 0]])), 2.0)
    assert thin.values[0, 0] == 1.0
    assert np.isnan(thin.values[0, 1])


def test_tiles_are_one_grid_without_a_gap_between_them():
    z = np.random.default_rng(2).random((6, 9))
    whole = Raster(z, NORTH_UP)
    parts = [
        Raster(z[:, :4].copy(), NORTH_UP),
        Raster(z[2:, 4:].copy(), np.column_stack([NORTH_UP[:, :2], grid.places(NORTH_UP, 2, 4)])),
        Raster(z[:3, 3:].copy(), np.column_stack([NORTH_UP[:, :2], grid.places(NORTH_UP, 0, 3)])),
    ]
    joined = grid.mosaic(parts, ["a", "b", "c"], "terrain")
    assert (joined.values == whole.values).all()
    assert (joined.T == NORTH_UP).all()


def test_where_tiles_overlap_the_first_with_a_height_counts():
    one, two = np.array([[1.0, np.nan]]), np.array([[5.0, 6.0]])
    assert grid.mosaic([Raster(one, NORTH_UP), Raster(two, NORTH_UP)], ["a", "b"], "t").values.tolist() == [[1.0, 6.0]]


@pytest.mark.parametrize("change", [[0.0, 0.0, 0.5], [1e-2, 0.0, 0.0], [0.0, 0.05, 0.0]])
def test_tiles_of_other_grids_are_refused(change):
    other = NORTH_UP + np.array([change, [0.0, 0.0, 0.0]])
    with pytest.raises(InputError, match="gdalwarp -tap") as caught:
        grid.mosaic([Raster(np.zeros((3, 3)), T) for T in (NORTH_UP, other)], ["a.tif", "b.tif"], "terrain")
    assert caught.value.file == "b.tif"


def test_tiles_that_lie_far_apart_do_not_fill_the_memory():
    far = NORTH_UP + np.array([[0.0, 0.0, 2e6], [0.0, 0.0, 3e6]])
    with pytest.raises(InputError, match="VAROS_WARP_MAX_HEIGHTS"):
        grid.mosaic([Raster(np.zeros((3, 3)), T) for T in (NORTH_UP, far)], ["a.tif", "b.tif"], "terrain")


def test_more_triangles_than_the_limit_are_refused(monkeypatch):
    monkeypatch.setenv("VAROS_WARP_MAX_TRIANGLES", "7")
    with pytest.raises(InputError, match="8 triangles"):
        mesh(np.zeros((3, 3)))
