"""Where reducing a mesh might fail: cameras on the surface, coordinates far from zero, meshes that are no surfaces."""

import numpy as np
import pytest
import trimesh

from varos_warp.scene.description import LevelOfDetail, Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.frames import transform
from varos_warp.scene.geometry.lod import reduce_parts
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.geometry.procedural import generate_terrain
from varos_warp.scene.geometry.reduce import reduce_mesh
from varos_warp.scene.geometry.terrain import Surface

TERRAIN = generate_terrain(20.0, 81, 1.0, seed=6)
BALL = trimesh.creation.icosphere(subdivisions=4)


def everywhere(value):
    return lambda points: np.full(len(points), value)


def open_edges(faces):
    """Edges of an odd number of faces, the boundary modulo two; faces that repeat another do not count."""
    faces = np.unique(np.sort(faces, axis=1), axis=0)
    edges = faces[:, [0, 1, 1, 2, 0, 2]].reshape(-1, 2)
    _, uses = np.unique(edges, axis=0, return_counts=True)
    return np.count_nonzero(uses % 2)


def both_ways(given, made):
    return max(Surface(*made).nearest(given[0])[0].max(), Surface(*given).nearest(made[0])[0].max())


def test_a_camera_on_the_surface_keeps_what_it_touches_exactly():
    touched = TERRAIN[0][40 * 81 + 40]
    scene = Scene(vehicle={"cameras": [{}], "lights": []}, trajectory={"poses": [{"position": [0, 0, 0]}]})
    (part,), (kept,) = reduce_parts(scene, [Part("terrain", *TERRAIN, Diffuse())], [transform(position=touched)],
                                    LevelOfDetail(tolerance_px=20.0, depth_steps=None))
    assert kept.nearest_m < 1e-9
    assert kept.kept < 0.7 * kept.triangles
    assert np.any(np.all(part.vertices == touched, axis=1))
    assert np.isfinite(part.vertices).all()


def test_a_world_at_utm_coordinates_is_reduced_alike():
    """float64 has 1 nm there, which may decide collapses of equal cost; the tolerance is kept all the same."""
    shift = np.array([569_000.0, 7_035_000.0, -50.0])
    here, there = reduce_mesh(*TERRAIN, everywhere(0.01)), reduce_mesh(TERRAIN[0] + shift, TERRAIN[1], everywhere(0.01))
    assert len(there[1]) == pytest.approx(len(here[1]), rel=0.02)
    assert both_ways((TERRAIN[0] + shift, TERRAIN[1]), there) <= 0.01


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_the_unit_of_length_does_not_matter(scale):
    v, f = reduce_mesh(scale * np.asarray(BALL.vertices), np.asarray(BALL.faces, np.int32), everywhere(0.005 * scale))
    made = trimesh.Trimesh(v, f, process=False)
    assert made.is_watertight
    assert 100 < len(f) < 0.6 * len(BALL.faces)
    assert np.abs(np.linalg.norm(v, axis=1) / scale - 1.0).max() < 0.006


@pytest.mark.parametrize("tolerance", [0.5, 10.0])
def test_a_tolerance_larger_than_the_object_leaves_a_closed_object(tolerance):
    v, f = reduce_mesh(np.asarray(BALL.vertices), np.asarray(BALL.faces, np.int32), everywhere(tolerance))
    made = trimesh.Trimesh(v, f, process=False)
    assert made.is_watertight
    assert 4 <= len(f) < len(BALL.faces) / 4
    assert made.volume > 0.0


def wall_on_a_floor():
    """A T: a wall stands on the middle line of a floor, where three faces share each edge."""
    axis = np.linspace(0.0, 4.0, 21)
    x, y = (g.ravel() for g in np.meshgrid(axis, axis))
    number = np.arange(441).reshape(21, 21)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], -1).reshape(-1, 4)
    floor = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    above = 441 + np.arange(21 * 5).reshape(5, 21)
    rows = np.concatenate([number[10][None], above])
    quads = np.stack([rows[:-1, :-1], rows[:-1, 1:], rows[1:, 1:], rows[1:, :-1]], -1).reshape(-1, 4)
    wall = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    height = np.repeat(0.2 * np.arange(1, 6), 21)
    vertices = np.concatenate([np.column_stack([x, y, 0.02 * np.sin(3 * x)]),
                               np.column_stack([np.tile(axis, 5), np.full(105, 2.0), height])])
    return vertices, np.concatenate([floor, wall]).astype(np.int32)


def two_balls_at_a_point():
    other = np.asarray(BALL.vertices) + 2.0 * np.asarray(BALL.vertices)[0]
    vertices = np.concatenate([BALL.vertices, other])
    touch = len(BALL.vertices) + np.argmin(np.linalg.norm(other - BALL.vertices[0], axis=1))
    faces = np.concatenate([BALL.faces, BALL.faces + len(BALL.vertices)])
    return vertices, np.where(faces == touch, 0, faces).astype(np.int32)


BROKEN = {
    "a wall on a floor": wall_on_a_floor(),
    "two balls that share a vertex": two_balls_at_a_point(),
    "every face twice": (TERRAIN[0], np.concatenate([TERRAIN[1], TERRAIN[1]])),
    "every face from both sides": (TERRAIN[0], np.concatenate([TERRAIN[1], TERRAIN[1][:, ::-1]])),
    "half of the faces turned over": (TERRAIN[0], np.where(np.arange(len(TERRAIN[1]))[:, None] % 2, TERRAIN[1],
                                                           TERRAIN[1][:, ::-1])),
    "separate triangles": (TERRAIN[0][TERRAIN[1]].reshape(-1, 3), np.arange(3 * len(TERRAIN[1]), dtype=np.int32)
                           .reshape(-1, 3)),
    "faces without area": (TERRAIN[0], np.concatenate([TERRAIN[1], TERRAIN[1][:200, [0, 1, 1]]]).astype(np.int32)),
}


@pytest.mark.parametrize("name", BROKEN)
def test_meshes_that_are_no_surfaces_keep_the_tolerance_and_get_no_new_openings(name):
    vertices, faces = BROKEN[name]
    made = reduce_mesh(vertices, faces, everywhere(0.01))
    assert 0 < len(made[1]) <= len(faces)
    assert np.isfinite(made[0]).all()
    assert both_ways((vertices, faces), made) <= 0.01
    if name != "faces without area":
        assert open_edges(made[1]) <= open_edges(faces)


def test_two_triangles_stay_two_triangles():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    v, f = reduce_mesh(vertices, faces, everywhere(10.0))
    np.testing.assert_array_equal(v, vertices)
    np.testing.assert_array_equal(f, faces)
