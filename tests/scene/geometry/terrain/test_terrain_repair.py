"""Repairs of meshes, each with its counts; topology by sorting; decimation in tiles; comparison."""

import numpy as np
import pytest
import trimesh

from varos_warp.errors import InputError
from varos_warp.scene.geometry import joining, terrain, topology
from varos_warp.scene.geometry.procedural import generate_terrain, grid_mesh
from varos_warp.scene.geometry.terrain import decimation, repair


def grid(n=21, size=10.0):
    axis = np.linspace(0.0, size, n)
    return grid_mesh(axis, axis, np.zeros((n, n)))


def without(vertices, faces, centre, radius):
    """A mesh with a hole: without the faces that lie in a box around a point."""
    inside = (np.abs(vertices - centre) < radius).all(axis=1)
    return terrain.clean(vertices, faces[~inside[faces].any(axis=1)])


def up(vertices, faces):
    return topology.area_normals(vertices, faces)[:, 2] > 0.0


# ---------------------------------------------------------------------------------------------------------- vertices


def test_vertices_that_are_not_finite_go_with_their_faces_and_are_counted():
    vertices, faces = grid(5)
    vertices[6], vertices[18, 2] = np.nan, np.inf
    (v, f), counts = repair.drop_not_finite(vertices, faces)
    at_them = np.isin(faces, [6, 18]).any(axis=1).sum()
    assert counts == {"not_finite_vertices": 2, "faces_at_them": at_them}
    assert len(f) == len(faces) - at_them
    assert np.isfinite(v).all()


def test_equal_rows_are_found_as_numpy_finds_them():
    rows = np.random.default_rng(0).integers(-3, 3, (5000, 3))
    first = topology.first_equal(rows)
    _, index, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    np.testing.assert_array_equal(first, index[inverse])


def test_merging_keeps_what_is_alone_to_the_last_digit_and_joins_chains():
    vertices = np.array(
        [
            [5e5, 7e6, 0.1],
            [5e5 + 1, 7e6, 0.2],
            [5e5, 7e6 + 1, 0.3],
            [5e5 + 1.0008, 7e6, 0.2],
            [5e5 + 1.0016, 7e6, 0.2],
            [5e5 + 2, 7e6 + 1, 0.0],
        ]
    )
    v, f = terrain.merge_near(vertices, np.array([[0, 1, 2], [4, 3, 5], [1, 5, 2]]), 0.001)
    assert len(v) == 4
    np.testing.assert_array_equal(v[f[0, [0, 2]]], vertices[[0, 2]])
    np.testing.assert_allclose(v[f[0, 1]], vertices[[1, 3, 4]].mean(axis=0), atol=1e-8)


# ------------------------------------------------------------------------------------------------------------- holes


def test_small_holes_are_filled_and_the_outline_and_wide_ones_are_not():
    vertices, faces = without(*without(*grid(), [3.0, 3.0, 0.0], 0.8), [7.0, 7.0, 0.0], 1.8)
    (v, f), counts = repair.fill_holes(vertices, faces, 3.1)
    assert (counts["holes_filled"], counts["holes_left"]) == (1, 2)  # left: the wide one and the outline
    assert counts["faces_added"] == len(f) - len(faces)
    assert up(v, f).all()
    narrow = topology.area_normals(*without(*grid(), [7.0, 7.0, 0.0], 1.8))
    assert topology.area_normals(v, f).sum() == pytest.approx(narrow.sum())  # the area, and no overlap
    whole = repair.fill_holes(vertices, faces, 100.0)[0]
    assert terrain.mesh_facts(*whole)["boundary_edges"] == 80
    assert repair.fill_holes(vertices, faces, 0.0)[1]["holes_filled"] == 0


def test_a_ball_with_a_hole_becomes_watertight():
    ball = trimesh.creation.icosphere(3)
    vertices, faces = without(np.asarray(ball.vertices), np.asarray(ball.faces, np.int32), [0, 0, 1], 0.4)
    assert terrain.mesh_facts(*repair.fill_holes(vertices, faces, 1.6)[0])["watertight"]


def test_preprocess_fills_holes_of_ten_edges_by_itself():
    vertices, faces = without(*grid(), [5.0, 5.0, 0.0], 0.8)
    assert terrain.mesh_facts(*terrain.preprocess(vertices, faces))["boundary_edges"] == 80
    left = terrain.preprocess(vertices, faces, fill_holes_m=0.0)
    assert terrain.mesh_facts(*left)["boundary_edges"] > 80


# ------------------------------------------------------------------------------------------------------- orientation


def test_a_sheet_that_looks_down_is_turned_up():
    vertices, faces = generate_terrain(20, 21, 2.0)
    (v, f), counts = repair.orient(vertices, faces[:, ::-1])
    assert up(v, f).all()
    assert counts == {"turned_faces": len(faces)}


def test_faces_turned_at_random_agree_again():
    vertices, faces = generate_terrain(20, 21, 2.0)
    turned = np.random.default_rng(0).random(len(faces)) < 0.4
    mixed = np.where(turned[:, None], faces[:, ::-1], faces)
    (v, f), counts = repair.orient(vertices, mixed)
    assert up(v, f).all()
    assert counts == {"turned_faces": int(turned.sum())}


def test_an_inverted_boulder_is_turned_and_a_hidden_underside_stays():
    ground = grid()
    boulder = trimesh.creation.icosphere(2).apply_translation([5.0, 5.0, 2.0])
    roof = grid(5, 2.0)
    roof = (roof[0] + [1.0, 1.0, 3.0], roof[1])
    ceiling = (roof[0] * [0.9, 0.9, 1.0] + [0.2, 0.2, -0.5], roof[1][:, ::-1])
    vertices, faces = terrain.join([ground, (boulder.vertices, boulder.faces[:, ::-1]), roof, ceiling])
    v, f = repair.orient(vertices, faces)[0]
    parts = np.split(f, np.cumsum([len(ground[1]), len(boulder.faces), len(roof[1])]))
    assert up(v, parts[0]).all()
    assert trimesh.Trimesh(v, parts[1], process=False).volume > 0.0
    assert up(v, parts[2]).all()
    assert not up(v, parts[3]).any()


def test_a_moebius_strip_is_left_as_it_is():
    n = 24
    t = np.arange(n) * 2.0 * np.pi / n
    side = 0.3 * np.column_stack([np.cos(t / 2) * np.cos(t), np.cos(t / 2) * np.sin(t), np.sin(t / 2)])
    middle = np.column_stack([np.cos(t), np.sin(t), 0.0 * t])
    a, b = np.arange(n), np.arange(n) + n
    c, d = np.append(a[1:], b[0]), np.append(b[1:], a[0])
    faces = np.concatenate([np.column_stack([a, c, b]), np.column_stack([c, d, b])]).astype(np.int32)
    assert len(repair.orient(np.concatenate([middle - side, middle + side]), faces)[0][1]) == 2 * n


@pytest.mark.parametrize(("size", "remedy"), [(60_000.0, "0.001"), (0.02, "1000"), (60.0, None), (3000.0, None)])
def test_sizes_of_another_unit_are_warned_of(size, remedy):
    warning = terrain.suspicious_size(grid(3, size)[0])
    assert warning is None if remedy is None else f"scale {remedy}" in warning


# ----------------------------------------------------------------------------------------------------------- topology


def test_subdivision_keeps_the_surface_and_makes_four_faces_of_each():
    ball = trimesh.creation.icosphere(2)
    edges, faces = topology.subdivide(np.asarray(ball.faces, np.int32), len(ball.vertices))
    vertices = np.concatenate([ball.vertices, ball.vertices[edges].mean(axis=1)])
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert len(faces) == 4 * len(ball.faces)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(ball.volume)


def test_facts_agree_with_those_of_trimesh():
    ball = trimesh.creation.icosphere(2)
    faces = np.concatenate([ball.faces[:-7], ball.faces[:1, ::-1]]).astype(np.int32)
    facts = terrain.mesh_facts(np.asarray(ball.vertices), faces)
    mesh = trimesh.Trimesh(ball.vertices, faces, process=False)
    uses = np.bincount(mesh.edges_unique_inverse)
    assert facts["boundary_edges"] == (uses == 1).sum()
    assert facts["edges_of_many_faces"] == (uses > 2).sum()
    assert facts["area_m2"] == pytest.approx(mesh.area)
    assert not facts["watertight"]
    assert terrain.mesh_facts(np.asarray(ball.vertices), np.asarray(ball.faces, np.int32))["watertight"]


def test_incidence_lists_the_faces_of_every_vertex():
    _, faces = grid(6)
    first, incident = topology.incidence(faces, 36)
    for vertex in range(36):
        assert set(incident[first[vertex] : first[vertex + 1]]) == set(np.flatnonzero((faces == vertex).any(axis=1)))


# --------------------------------------------------------------------------------------------------------- decimation


def test_decimation_in_tiles_leaves_no_seam(monkeypatch):
    vertices, faces = generate_terrain(30, 121, 2.0)
    whole = terrain.decimate(vertices, faces, 500)
    monkeypatch.setattr(decimation, "TILE", 4000)
    tiled = terrain.decimate(vertices, faces, 500)
    assert len(tiled[0]) == pytest.approx(500, rel=0.1)
    facts = terrain.mesh_facts(*tiled)
    assert (facts["pieces"], facts["edges_of_many_faces"]) == (1, 0)
    rms = [terrain.one_sided_distance((vertices, faces), m, 20_000)["rms"] for m in (whole, tiled)]
    assert rms[1] < 1.2 * rms[0]


def test_decimation_does_not_depend_on_the_unit_of_length():
    vertices, faces = generate_terrain(30, 61, 2.0)
    results = [terrain.decimate(vertices * s, faces, 300) for s in (1.0, 1024.0, 2.0**-10)]
    for (v, f), s in zip(results, (1.0, 1024.0, 2.0**-10), strict=True):
        np.testing.assert_array_equal(f, results[0][1])
        np.testing.assert_allclose(v / s, results[0][0], atol=1e-9)


def test_edges_of_many_faces_are_cut_out_and_filled():
    ball = trimesh.creation.icosphere(3)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces, np.int32)
    fin = np.vstack([vertices, 1.3 * vertices[faces[0, 0]]])
    finned = np.concatenate([faces, [[faces[0, 0], faces[0, 1], len(vertices)]]]).astype(np.int32)
    assert terrain.mesh_facts(fin, finned)["edges_of_many_faces"] == 1
    mended = decimation._mend(fin, finned)
    assert terrain.mesh_facts(*mended)["watertight"]
    assert trimesh.Trimesh(*mended, process=False).volume == pytest.approx(ball.volume, rel=0.01)


# --------------------------------------------------------------------------------------------------------- comparison


def test_distances_and_normals_of_a_tilted_plane_are_those_of_its_angle():
    vertices, faces = grid(21)
    angle = np.radians(3.0)
    tilted = vertices * [np.cos(angle), 1.0, 1.0] + np.outer(vertices[:, 0], [0.0, 0.0, np.sin(angle)])
    d = terrain.one_sided_distance((tilted, faces), (vertices, faces), 20_000)
    assert d["max"] == pytest.approx(10.0 * np.sin(angle), rel=1e-3)
    assert d["rms"] == pytest.approx(10.0 * np.sin(angle) / np.sqrt(3.0), rel=1e-3)  # stratified by area
    assert [d["normal_deg"][x] for x in ("mean", "p95", "max")] == pytest.approx([3.0] * 3)


def test_the_symmetric_distance_is_the_larger_one_way():
    vertices, faces = grid(21)
    half = terrain.clean(vertices, faces[vertices[faces][:, :, 0].max(axis=1) <= 5.0])
    found = terrain.compare((vertices, faces), half, 20_000)
    assert found["distance_to_original_m"]["max"] < 1e-6
    assert found["symmetric_m"]["hausdorff"] == found["distance_to_result_m"]["max"] == pytest.approx(5.0, rel=1e-2)
    assert found["symmetric_m"]["rms"] == pytest.approx(5.0 / np.sqrt(3.0) / np.sqrt(2.0) / np.sqrt(2.0), rel=1e-2)


def test_samples_are_spread_by_area():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [10, 0, 0], [13, 0, 0], [10, 1, 0]], float)
    points, face = terrain.comparison.sample_surface(vertices, np.array([[0, 1, 2], [3, 4, 5]]), 4000)
    assert (face == 0).sum() == pytest.approx(1000, abs=1)  # one in each of equal shares of the area
    low = points[face == 0]
    np.testing.assert_allclose(low.mean(axis=0), [1 / 3, 1 / 3, 0], atol=4.0 / np.sqrt(18 * 1000))


# ------------------------------------------------------------------------------------------------------ the pipeline


def test_the_report_counts_everything_that_was_removed(tmp_path):
    vertices, faces = generate_terrain(20, 41, 2.0)
    vertices = np.vstack([vertices, vertices[0] + [0.0, 0.0, 0.0004], [np.nan] * 3, [0, 0, 0]])
    count = len(vertices)
    faces = np.concatenate([faces, faces[:2], [[5, 5, 6], [count - 3, 1, 42], [count - 2, 1, 2]]]).astype(np.int32)
    path = tmp_path / "a.ply"
    terrain.write_ply(path, vertices, faces)
    seen = []
    _, report = terrain.preprocess_meshes([path], 500, samples=1000, progress=lambda *told: seen.append(told))
    counts = report["counts"]
    assert counts["not_finite_vertices"] == 1
    assert counts["faces_at_them"] == 1
    assert counts["merged_vertices"] == 1
    assert counts["degenerate_faces"] >= 1
    assert counts["repeated_faces"] >= 2
    assert report["peak_memory_gb"] > 0.0
    assert set(report["seconds"]) <= set(terrain.STEPS)
    assert [name for name, share in seen if share == 1.0] == list(report["seconds"])
    assert all(0.0 <= share <= 1.0 for _, share in seen)


def test_a_scale_makes_metres_of_millimetres(tmp_path):
    vertices, faces = generate_terrain(60, 21, 2.0)
    terrain.write_ply(tmp_path / "mm.ply", vertices * 1000.0, faces)
    assert "scale 0.001" in terrain.preprocess_meshes([tmp_path / "mm.ply"], samples=1000)[1]["warnings"][0]
    (v, _), report = terrain.preprocess_meshes([tmp_path / "mm.ply"], scale=0.001, samples=1000)
    assert report["warnings"] == []
    assert np.ptp(v, axis=0).max() == pytest.approx(60.0)


def test_without_a_tolerance_no_mesh_is_too_fine_to_be_merged():
    """1 mm, but of edges of 0.5 mm a quarter."""
    (vertices, faces), tiny = grid(21), np.random.default_rng(1).normal(0.0, 1e-6, (21 * 21, 3))
    for scale in (1e-3, 1.0):
        doubled = joining.join([(vertices * scale, faces), (vertices * scale + tiny, faces)])
        assert len(terrain.preprocess(*doubled)[0]) == 21 * 21


def test_more_vertices_than_there_are_are_not_made_up_and_this_is_said(tmp_path):
    terrain.write_ply(tmp_path / "flat.ply", *grid(21))
    (vertices, _), report = terrain.preprocess_meshes([tmp_path / "flat.ply"], 1000, samples=1000)
    assert len(vertices) == 21 * 21
    assert "1000 vertices were asked for, but the surface has only 441" in report["warnings"][0]


def test_a_merge_tolerance_is_compared_with_the_median_edge():
    assert joining.median_edge(*grid(21)) == pytest.approx(0.5)
    with pytest.raises(InputError, match="median edge"):
        terrain.merge_near(*grid(21), 0.3)
