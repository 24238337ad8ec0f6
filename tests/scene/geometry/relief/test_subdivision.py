"""Refinement is conforming, keeps what is closed closed, makes the edges asked for, and follows smooth surfaces."""

import numpy as np
import pytest
import trimesh

from varos_warp.scene.geometry.procedural import generate_terrain
from varos_warp.scene.geometry.relief.subdivision import refine
from varos_warp.scene.geometry.surface import Surface
from varos_warp.scene.geometry.topology import edge_uses


def ball(level):
    mesh = trimesh.creation.icosphere(subdivisions=level)
    return np.array(mesh.vertices), np.array(mesh.faces, np.int32)


def graded(points, normals=None):
    return 0.02 + 0.2 * np.abs(points[:, 0])


def longest_over_wanted(vertices, faces, length):
    following = np.roll(faces, -1, axis=1)
    size = np.linalg.norm(vertices[faces] - vertices[following], axis=2)
    return (size / np.minimum(length[faces], length[following])).max()


@pytest.mark.parametrize("mesh", [ball(2), generate_terrain(3.0, 9, 0.5)], ids=["ball", "terrain"])
def test_no_edge_is_longer_than_wanted_at_either_end(mesh):
    vertices, faces, length = refine(*mesh, graded)
    np.testing.assert_array_equal(length, graded(vertices))
    assert longest_over_wanted(vertices, faces, length) <= 1.0


def test_a_closed_mesh_stays_closed_without_t_junctions():
    vertices, faces, _ = refine(*ball(2), graded)
    once, often = edge_uses(faces)
    assert len(once) == len(often) == 0
    assert len(np.unique(vertices, axis=0)) == len(vertices)


def test_a_sheet_keeps_its_outline():
    """Only edges on the outline have one face: on a plane, all their ends lie on its border."""
    mesh = generate_terrain(2.0, 5, 0.0)
    vertices, faces, _ = refine(*mesh, graded)
    keys, often = edge_uses(faces)
    ends = vertices[np.concatenate([keys >> 32, keys & 0xFFFFFFFF])]
    assert (np.abs(ends[:, :2]).max(axis=1) == 1.0).all()
    assert len(often) == 0
    area = 0.5 * np.linalg.norm(
        np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]), axis=1
    )
    assert area.sum() == pytest.approx(4.0, rel=1e-12)


def test_slivers_become_round():
    vertices = np.array([[0.0, 0, 0], [10, 0, 0], [10, 0.1, 0], [0, 0.1, 0]])
    v, f, _ = refine(vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32), lambda p, n: np.full(len(p), 0.05))
    size = np.linalg.norm(v[f] - v[np.roll(f, -1, axis=1)], axis=2)
    assert np.median(size.max(axis=1) / size.min(axis=1)) < 3.0
    assert len(f) < 2.0 * 1.0 / (0.17 * 0.05**2)


def test_new_vertices_follow_a_sphere_with_the_fourth_power_of_the_edge():
    """A cubic through two points with the sphere's normals is off by the fourth order of the edge."""
    off = []
    for level in (1, 2):
        vertices, faces = ball(level)
        v, _, _ = refine(vertices, faces, lambda p, n: np.full(len(p), 0.04), vertices.copy())
        off.append(np.abs(np.linalg.norm(v, axis=1) - 1.0).max())
    assert off[0] / off[1] == pytest.approx(16.0, rel=0.3)


def test_without_normals_facets_stay_flat():
    vertices, faces = ball(1)
    v, f, _ = refine(vertices, faces, lambda p, n: np.full(len(p), 0.1))
    distance, _ = Surface(vertices, faces).nearest(v)
    assert distance.max() < 1e-12
    assert len(f) > len(faces)


def test_a_mesh_that_is_fine_already_is_not_touched():
    vertices, faces = ball(2)
    v, f, _ = refine(vertices, faces, lambda p, n: np.full(len(p), 10.0))
    np.testing.assert_array_equal(v, vertices)
    np.testing.assert_array_equal(f, faces)
