import time

import numpy as np
import pytest
import trimesh

from varos_warp.scene.geometry import normals
from varos_warp.scene.geometry.normals import corner_normals, face_normals
from varos_warp.scene.geometry.procedural import generate_terrain

RIGHT_ANGLE = np.pi / 2


def box():
    mesh = trimesh.creation.box()
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def test_a_cube_keeps_its_edges_below_a_right_angle_and_loses_them_at_it():
    vertices, faces = box()
    sharp = corner_normals(vertices, faces, np.radians(89.9))
    np.testing.assert_allclose(sharp, np.repeat(face_normals(vertices, faces)[:, None], 3, axis=1), atol=1e-12)
    # Each cube corner has angles of 90 degrees to three faces, however they are cut into triangles.
    smooth = corner_normals(vertices, faces, RIGHT_ANGLE)
    np.testing.assert_allclose(smooth, np.sign(vertices[faces]) / np.sqrt(3.0), atol=1e-12)


def test_a_fold_is_smoothed_up_to_its_angle_only():
    fold = np.radians(25.0)
    vertices = np.array([[0, 0, 0], [0, 1, 0], [-1, 0, 0], [np.cos(fold), 0, np.sin(fold)]])
    faces = np.array([[0, 1, 2], [1, 0, 3]])
    flat = corner_normals(vertices, faces, np.radians(24.0))
    assert np.degrees(np.arccos(flat[0, 0] @ flat[1, 1])) == pytest.approx(25.0)
    smooth = corner_normals(vertices, faces, fold)
    np.testing.assert_allclose(smooth[0, 0], smooth[1, 1], atol=1e-12)
    np.testing.assert_allclose(smooth[0, 2], flat[0, 2], atol=1e-12)


def test_a_sphere_is_smoothed_to_its_radial_directions():
    ball = trimesh.creation.icosphere(subdivisions=4)
    n = corner_normals(np.asarray(ball.vertices), np.asarray(ball.faces), np.radians(30.0))
    cosine = np.einsum("fci,fci->fc", n, ball.vertices[ball.faces])
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 0.2  # edges of 4 degrees, squared and a little


def test_normals_do_not_depend_on_how_a_plane_corner_is_cut_into_triangles():
    """Angle weights: a face of two triangles weighs as much as the same face in one."""
    apex = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, -1, 0], [0.5, 0.5, 0]], float)
    whole = corner_normals(apex, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]]), np.pi)[0, 0]
    cut = corner_normals(apex, np.array([[0, 1, 4], [0, 4, 2], [0, 2, 3], [0, 3, 1]]), np.pi)[0, 0]
    np.testing.assert_allclose(whole, cut, atol=1e-12)


def test_edges_of_three_faces_and_of_disagreeing_faces_are_sharp():
    vertices = np.array([[0, 0, 0], [0, 1, 0], [-1, 0, 0.1], [1, 0, 0.1], [0, 0, 1]], float)
    three = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    disagree = np.array([[0, 1, 2], [0, 1, 3]])
    for faces in (three, disagree):
        flat = np.repeat(face_normals(vertices, faces)[:, None], 3, axis=1)
        np.testing.assert_allclose(corner_normals(vertices, faces, np.pi), flat, atol=1e-12)


def test_degenerate_faces_get_finite_unit_normals_and_do_not_disturb_others():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]], float)
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 1, 2]])
    n = corner_normals(vertices, faces, np.pi)
    np.testing.assert_allclose(np.linalg.norm(n, axis=2), 1.0)
    np.testing.assert_allclose(n[0], [[0, 0, 1]] * 3)
    assert corner_normals(vertices, np.zeros((0, 3), int), 1.0).shape == (0, 3, 3)


def test_normals_survive_utm_coordinates():
    vertices, faces = generate_terrain(20, 33, 2.0)
    far = vertices + np.array([569_000.0, 7_035_000.0, 0.0])
    difference = corner_normals(vertices, faces, 0.5) - corner_normals(far, faces, 0.5)
    assert np.abs(difference).max() < 1e-8  # 1e-9 m of rounding on edges of 0.6 m


def test_six_hundred_thousand_faces_take_seconds():
    vertices, faces = generate_terrain(60, 553)
    start = time.perf_counter()
    n = corner_normals(vertices, faces, np.radians(30.0))
    assert n.shape == (len(faces), 3, 3)
    assert len(faces) > 600_000
    assert time.perf_counter() - start < 30.0  # 1.4 s on an idle core; ten times and more for a busy one


def test_normals_of_large_meshes_are_kept_and_only_those_of_the_same_mesh_are_taken(monkeypatch, tmp_path):
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path))
    monkeypatch.setattr(normals, "KEPT_FACES", 1000)
    ball, small = trimesh.creation.icosphere(3), trimesh.creation.icosphere(2)
    larger = ball.copy().apply_scale(2)
    for mesh, angle, kept in ((small, 0.5, 0), (ball, 0.5, 1), (ball, 0.5, 1), (ball, 0.1, 2), (larger, 0.1, 3)):
        found = normals.kept_corner_normals(mesh.vertices, mesh.faces, angle)
        np.testing.assert_array_equal(found, corner_normals(mesh.vertices, mesh.faces, angle))
        assert len([*tmp_path.glob("normals-*.npz")]) == kept
