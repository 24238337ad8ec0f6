"""Parametric objects as even grids (max_edge_m), and what makes them: plane regions filled, long edges halved."""

import numpy as np
import pytest
import trimesh

from tests.scene.geometry.test_assets import ASSETS, assert_sound, block_of, off_pipe, off_torus
from varos_warp.errors import InputError
from varos_warp.scene.geometry.assets import make_asset
from varos_warp.scene.geometry.assets.grids import fill, fill_between, split_long
from varos_warp.scene.geometry.assets.lofts import Detail
from varos_warp.scene.geometry.assets.slabs import circle, rectangle, slab


def grid(data, max_edge_m) -> trimesh.Trimesh:
    return trimesh.Trimesh(*make_asset(block_of(data), max_edge_m=max_edge_m), process=False)


def aspects(triangles):
    """Longest edge over the height on it, 1 for an equilateral triangle."""
    longest = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    area = trimesh.triangles.area(triangles)
    return longest**2 / (2.0 * area) * np.sqrt(3.0) / 2.0


@pytest.mark.parametrize("share", [0.3, 0.03])
@pytest.mark.parametrize("data", ASSETS.values(), ids=ASSETS)
def test_no_edge_is_longer_than_asked_and_solids_stay_closed(data, share):
    size = np.ptp(make_asset(block_of(data))[0], axis=0).max()
    mesh = grid(data, share * size)
    assert_sound(mesh)
    assert mesh.edges_unique_length.max() <= share * size * (1.0 + 1e-12)


@pytest.mark.parametrize("max_edge_m", [0.01, 0.05, 1.0])
def test_walls_of_pipes_and_bends_have_no_slivers(max_edge_m):
    pipe = grid(ASSETS["pipe"], max_edge_m)
    wall = np.abs(pipe.triangles[..., 2]).max(axis=1) < 1.98
    assert np.percentile(aspects(pipe.triangles[wall]), 99) < 3.0
    ring = grid(ASSETS["ring"], max_edge_m)
    assert np.percentile(aspects(ring.triangles), 99) < 3.0


@pytest.mark.parametrize("name", ["flange", "support", "rod"])
def test_plane_faces_are_filled_with_even_triangles(name):
    data = ASSETS[name]
    mesh = grid(data, 0.01)
    axis = 1 if name == "support" else 2
    end = mesh.vertices[:, axis].max()
    face = np.abs(mesh.triangles[..., axis] - end).max(axis=1) < 1e-9
    area, slender = mesh.area_faces[face], aspects(mesh.triangles[face]) > 3.0
    assert len(area) > 200
    assert area[slender].sum() < 0.1 * area.sum()  # strips of a millimetre beside the rounded edges


def test_a_grid_has_about_as_many_triangles_as_its_area_holds():
    """Halves of squares whose diagonal is the longest edge e have an area of e^2 / 4."""
    mesh = grid({"kind": "pipe", "radius": 0.15, "length": 6.0}, 0.02)
    assert 1.0 < len(mesh.faces) / (mesh.area / (0.25 * 0.02**2)) < 1.15


@pytest.mark.parametrize("max_edge_m", [0.005, 0.02, 0.5])
def test_a_grid_lies_within_the_chord_error_of_the_true_surface(max_edge_m):
    chord_error = 2e-4
    pipe = grid(ASSETS["pipe"] | {"chord_error_m": chord_error, "length": 0.6}, max_edge_m)
    points = trimesh.sample.sample_surface(pipe, 20000, seed=1)[0]
    assert off_pipe(points[np.abs(points[:, 2]) < 0.27]).max() <= chord_error
    elbow = grid(ASSETS["elbow"] | {"chord_error_m": chord_error}, max_edge_m)
    assert off_torus(trimesh.sample.sample_surface(elbow, 20000, seed=1)[0]).max() <= chord_error * (1.0 + 1e-3)


@pytest.mark.parametrize("name", ["flange", "support", "bolt", "nut", "valve"])
def test_a_grid_encloses_what_the_object_encloses(name):
    """Both surfaces are within the chord error of the true one."""
    data = ASSETS[name] | {"chord_error_m": 2e-5}
    coarse, fine = trimesh.Trimesh(*make_asset(block_of(data)), process=False), grid(data, 0.01)
    assert fine.volume == pytest.approx(coarse.volume, abs=2.0 * coarse.area * 2e-5)
    assert fine.bounds == pytest.approx(coarse.bounds, abs=2e-5)


def test_the_longest_edge_is_a_length_in_the_world():
    data = {"kind": "pipe", "radius": 0.1, "length": 1.0, "chord_error_m": 1e-3}
    scaled = grid(data | {"scale": 10.0}, 0.2)
    large = grid(data | {"radius": 1.0, "length": 10.0}, 0.2)
    np.testing.assert_allclose(10.0 * scaled.vertices, large.vertices, atol=1e-12)


def test_the_key_and_the_argument_mean_the_same_and_the_argument_counts():
    data = {"kind": "pipe", "radius": 0.1, "length": 1.0}
    keyed = make_asset(block_of(data | {"max_edge_m": 0.03}))
    np.testing.assert_array_equal(keyed[0], make_asset(block_of(data), max_edge_m=0.03)[0])
    np.testing.assert_array_equal(keyed[0], make_asset(block_of(data | {"max_edge_m": 0.5}), max_edge_m=0.03)[0])


def test_an_absent_key_is_not_written_to_datasets():
    data = {"kind": "nut", "size": "M24"}
    assert "max_edge_m" not in block_of(data).model_dump()
    assert block_of(data | {"max_edge_m": 0.01}).model_dump()["max_edge_m"] == 0.01


@pytest.mark.parametrize(
    "data",
    [
        {"kind": "pipe", "radius": 1, "length": 50},
        {"kind": "elbow", "radius": 20, "bend_radius": 50},
        {"kind": "flange", "radius": 20},
        {"kind": "boulder", "diameter": 90},
        {"kind": "pipe_support", "radius": 20},
        {"kind": "valve", "radius": 20},
        {"kind": "hull_section"},
        {"kind": "quay_wall"},
    ],
)
def test_more_than_20_million_triangles_are_refused_before_they_are_made(data):
    with pytest.raises(InputError) as caught:
        make_asset(block_of(data | {"max_edge_m": 0.001}), "objects.3")
    assert caught.value.key == "objects.3.max_edge_m"
    assert caught.value.remedy


# --------------------------------------------------------------------------------------------------------------- planes


def test_a_region_with_a_hole_is_filled_whole():
    loops = [rectangle((0, 0), (2, 1)), circle(0.3, Detail(1e-3), (1.0, 0.5))[::-1]]
    loops, inner, triangles = fill_between(loops, 0.1)
    points = np.vstack([*loops, inner])
    a, b, c = (np.column_stack([points[triangles[:, i]], np.zeros(len(triangles))]) for i in range(3))
    area = 0.5 * np.cross(b - a, c - a)[:, 2]
    hole = 0.5 * len(loops[1]) * 0.3**2 * np.sin(2.0 * np.pi / len(loops[1]))
    assert (area > 0.0).all()
    assert area.sum() == pytest.approx(2.0 - hole)


def test_edges_of_a_thin_outline_that_no_triangle_has_are_halved():
    thin = np.array([(0, 0), (1, 0), (1, 1), (0.9, 1), (0.9, 0.1), (0.1, 0.1), (0.1, 1), (0, 1), (0.099, 0.5)], float)
    assert fill([thin])[2].any()
    loops, _, triangles = fill_between([thin], np.inf)
    assert len(loops[0]) > len(thin)
    assert len(triangles) == len(loops[0]) - 2


def test_outlines_that_cross_are_refused():
    bow = np.array([(0, 0), (1, 1), (1, 0), (0, 1)], float)
    with pytest.raises(InputError) as caught:
        slab([bow], 0.0, 0.1, 0.0, Detail(1e-3, key="objects.1"))
    assert caught.value.key == "objects.1"


def test_halving_leaves_no_long_edge_and_a_closed_surface_of_the_same_volume():
    box = trimesh.creation.box((5.0, 1.0, 0.02))
    mesh = trimesh.Trimesh(*split_long(np.asarray(box.vertices), np.asarray(box.faces), 0.3), process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.edges_unique_length.max() <= 0.3
    assert mesh.volume == pytest.approx(0.1)
