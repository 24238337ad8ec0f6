import numpy as np
import pytest
import trimesh

from varos_warp.errors import InputError
from varos_warp.scene.geometry import terrain
from varos_warp.scene.geometry.mesh_files import load_mesh
from varos_warp.scene.geometry.procedural import add_detail, fractal_field, generate_terrain, grid_mesh
from varos_warp.scene.geometry.query import heights_at


def tile(offset, n=11):
    axis = np.linspace(0.0, 10.0, n)
    x = np.broadcast_to(axis, (n, n))
    vertices, faces = grid_mesh(axis, axis, 0.1 * x)
    return vertices + offset, faces


def soup(vertices, faces):
    return vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


def test_tiles_that_nearly_touch_become_one_surface():
    joined = terrain.join([soup(*tile([0, 0, 0])), soup(*tile([10.0004, 0, 1.0]))])
    vertices, faces = terrain.preprocess(*joined, merge_tolerance_m=0.001)
    assert len(vertices) == 2 * 121 - 11
    assert len(faces) == 400
    assert trimesh.Trimesh(vertices, faces, process=False).body_count == 1
    apart, _ = terrain.preprocess(*joined, merge_tolerance_m=0.0001)
    assert len(apart) == 2 * 121


def test_degenerate_and_repeated_faces_and_unused_vertices_go():
    vertices, faces = tile([0, 0, 0])
    extra = np.vstack([faces, faces[:3], faces[5:6, [1, 2, 0]], [[0, 0, 1], [0, 1, 2]]])  # the last on one line
    cleaned = terrain.clean(np.vstack([vertices, [[99, 99, 99]]]), extra)
    assert (len(cleaned[0]), len(cleaned[1])) == (len(vertices), len(faces))


def test_a_merge_tolerance_beyond_the_edges_is_refused():
    with pytest.raises(InputError, match="median edge") as caught:
        terrain.preprocess(*tile([0, 0, 0]), merge_tolerance_m=2.0, key="terrain.preprocess")
    assert caught.value.key == "terrain.preprocess.merge_tolerance_m"


def test_rasterised_heights_are_those_of_the_surface():
    vertices, faces = generate_terrain(20, 41, 2.0, seed=4)
    axis = np.linspace(-9.9, 9.9, 57)
    z = terrain.rasterise(vertices, faces, axis, axis, chunk=5000)
    x, y = np.meshgrid(axis, axis)
    expected = [heights[-1] for heights in heights_at(vertices, faces, np.column_stack([x.ravel(), y.ravel()]))]
    np.testing.assert_allclose(z.ravel(), expected, atol=1e-9)


def test_shrinkwrap_closes_holes_smoothly_and_keeps_the_outline():
    vertices, faces = tile([5e5, 7e6, 0], n=41)
    hole = np.linalg.norm(vertices[faces].mean(axis=1)[:, :2] - [5e5 + 5, 7e6 + 5], axis=1) < 1.5
    v, f = terrain.shrinkwrap(vertices, faces[~hole], 61)
    facts = terrain.mesh_facts(v, f)
    assert facts["boundary_edges"] == 4 * 60  # the outline only
    np.testing.assert_allclose(v[:, 2], 0.1 * (v[:, 0] - 5e5), atol=1e-3)  # a plane is harmonic


def test_shrinkwrap_of_an_l_shape_does_not_bridge_its_notch():
    vertices, faces = tile([0, 0, 0], n=41)
    centre = vertices[faces].mean(axis=1)
    v, f = terrain.shrinkwrap(vertices, faces[(centre[:, 0] < 5) | (centre[:, 1] < 5)], 41)
    assert trimesh.Trimesh(v, f, process=False).area == pytest.approx(0.75 * 100 * np.sqrt(1.01), rel=1e-6)


def test_a_region_is_cut_out_exactly_with_a_shrinkwrap_and_must_be_on_the_terrain():
    v, _ = terrain.preprocess(*tile([0, 0, 0]), region=[2.2, 3.3, 7.7, 6.6], shrinkwrap_resolution=23)
    np.testing.assert_allclose([v[:, 0].min(), v[:, 1].min(), v[:, 0].max(), v[:, 1].max()], [2.2, 3.3, 7.7, 6.6])
    with pytest.raises(InputError, match="beside the terrain"):
        terrain.preprocess(*tile([0, 0, 0]), region=[20, 20, 30, 30])


def test_walls_alone_cannot_be_shrinkwrapped():
    vertices, faces = tile([0, 0, 0])
    upright = vertices @ np.array([[1, 0, 0], [0, 0, 1], [0, 0, 0]], float)
    with pytest.raises(InputError, match="seen from above"):
        terrain.preprocess(upright, faces, shrinkwrap_resolution=9)


def test_decimation_meets_its_target_and_a_flat_terrain_stays_flat():
    vertices, faces = tile([5e5, 7e6, 0], n=81)
    v, f = terrain.decimate(vertices, faces, 500)
    assert len(v) == pytest.approx(500, rel=0.15)
    np.testing.assert_allclose(v[:, 2], 0.1 * (v[:, 0] - 5e5), atol=1e-4)
    # The outline may lose what lies outside a straight line between its remaining vertices.
    area = trimesh.Trimesh(v, f, process=False).area
    assert 0.99 < area / (100 * np.sqrt(1.01)) < 1.0 + 1e-6


def test_the_report_of_preprocessing_tells_counts_and_the_error_made(tmp_path):
    vertices, faces = generate_terrain(30, 121, 2.0)
    terrain.write_ply(tmp_path / "a.ply", *soup(vertices, faces))
    (v, f), report = terrain.preprocess_meshes([tmp_path / "a.ply"], 2000, samples=10_000)
    assert report["before"]["vertices"] == 121 * 121
    assert report["after"]["vertices"] == len(v) == pytest.approx(2000, rel=0.15)
    assert report["after"]["triangles"] == len(f)
    coarse = terrain.preprocess_meshes([tmp_path / "a.ply"], 300, samples=10_000)[1]
    exact = terrain.preprocess_meshes([tmp_path / "a.ply"], samples=10_000)[1]
    assert exact["distance_to_result_m"]["max"] < 30 * 2.0**-23  # the BVH is in float32
    rms = [r["distance_to_result_m"]["rms"] for r in (exact, report, coarse)]
    assert rms == sorted(rms)
    assert 0.001 < rms[1] < 0.1


def test_one_sided_distance_of_a_lifted_plane_is_the_lift():
    v, f = tile([0, 0, 0])
    flat = (v * [1, 1, 0], f)
    d = terrain.one_sided_distance((flat[0] + [0, 0, 0.25], f), flat, samples=500)
    assert [d["rms"], d["p95"], d["max"]] == pytest.approx([0.25] * 3)


def test_a_written_ply_keeps_double_precision_and_leaves_no_partial_file(tmp_path):
    vertices, faces = generate_terrain(10, 9, 1.0)
    vertices += [569_000.123456789, 7_035_000.987654321, 0.0]
    terrain.write_ply(tmp_path / "a.ply", vertices, faces)
    loaded = load_mesh(tmp_path / "a.ply")[:2]
    np.testing.assert_array_equal(loaded[0][np.lexsort(loaded[0].T)], vertices[np.lexsort(vertices.T)])
    with pytest.raises(InputError, match="cannot be written"):
        terrain.write_ply(tmp_path / "nowhere" / "a.ply", vertices, faces)
    assert [p.name for p in tmp_path.iterdir()] == ["a.ply"]


# -------------------------------------------------------------------------------------------------------- procedural


def test_a_procedural_terrain_follows_from_its_seed_and_has_the_measures_asked_for():
    a, faces = generate_terrain(30.0, 65, relief_m=2.5, seed=7)
    b, _ = generate_terrain(30.0, 65, relief_m=2.5, seed=7)
    c, _ = generate_terrain(30.0, 65, relief_m=2.5, seed=8)
    np.testing.assert_array_equal(a, b)
    assert np.abs(a - c).max() > 0.1
    assert np.ptp(a, axis=0) == pytest.approx([30.0, 30.0, 2.5])
    normals = np.cross(a[faces[:, 1]] - a[faces[:, 0]], a[faces[:, 2]] - a[faces[:, 0]])
    assert (normals[:, 2] > 0.0).all()


def test_rockiness_makes_more_of_the_floor_steep():
    def steep_share(rockiness):
        v, f = generate_terrain(60, 129, 3.0, rockiness=rockiness, seed=2)
        n = np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])
        return np.mean(n[:, 2] / np.linalg.norm(n, axis=1) < np.cos(np.radians(25.0)))

    shares = [steep_share(r) for r in (0.05, 0.3, 0.6)]
    assert shares == sorted(shares)
    assert shares[2] > 2.0 * shares[0]


def test_the_fractal_field_has_the_spectral_slope_asked_for():
    """Ring means of the amplitude over many seeds; the fit's own standard error gives the tolerance."""
    n, roughness = 128, 2.2
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(n) * n, np.fft.fftfreq(n) * n))
    rings = np.array([4, 8, 16, 32])
    power = np.array(
        [
            [
                np.mean(np.abs(np.fft.fft2(fractal_field(n, seed, 2.0, roughness)))[np.abs(k - r) < 0.5] ** 2)
                for r in rings
            ]
            for seed in range(20)
        ]
    )
    slopes = np.polyfit(np.log(rings), np.log(power).T, 1)[0]
    assert abs(slopes.mean() + 2.0 * roughness) < 4.0 * slopes.std() / np.sqrt(len(slopes)) + 0.02


def test_detail_moves_a_terrain_only_up_and_down_by_its_relief():
    vertices, _ = tile([5e5, 7e6, -30], n=101)
    detailed = add_detail(vertices, relief_m=0.8, feature_m=4.0, rockiness=0.4, seed=1)
    lift = detailed - vertices
    np.testing.assert_array_equal(lift[:, :2], 0.0)
    assert 0.6 < np.ptp(lift[:, 2]) <= 0.8
    assert abs(np.median(lift[:, 2])) < 0.05
