"""What preprocessing may not do silently: ruin a shell, make shards of a rough survey, count wrongly."""

import numpy as np
import pytest
from typer.testing import CliRunner

from varos_warp.cli import app
from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry import terrain
from varos_warp.scene.geometry.procedural import generate_terrain, grid_mesh
from varos_warp.scene.geometry.terrain.smoothing import roughness_deg, smooth
from varos_warp.scene.geometry.topology import boundary_edges


def shell(thickness=0.02, n=25):
    """A two-sided terrain, closed along its rim, far thinner than a cell of the first grid."""
    axis = np.linspace(0.0, 100.0, n)
    x, y = np.meshgrid(axis, axis)
    top, faces = grid_mesh(axis, axis, 40.0 * np.sin(x / 30.0) * np.cos(y / 40.0))
    a, b = boundary_edges(faces).T
    c, d = a + len(top), b + len(top)
    walls = np.concatenate([np.column_stack([b, a, c]), np.column_stack([b, c, d])])
    return np.vstack([top, top - [0, 0, thickness]]), np.vstack([faces, faces[:, ::-1] + len(top), walls]).astype(int)


def rough(noise, n=61):
    axis = np.linspace(0.0, 60.0, n)
    x = np.broadcast_to(axis, (n, n))
    return grid_mesh(axis, axis, 5.0 * np.sin(x / 20.0) + noise * np.random.default_rng(0).normal(size=(n, n)))


def test_a_thin_shell_is_refused_by_the_verb_and_nothing_is_written(tmp_path):
    terrain.write_ply(tmp_path / "a.ply", *shell())
    arguments = ["preprocess", tmp_path / "a.ply", "-o", tmp_path / "out.ply", "-q", "--shrinkwrap"]
    result = CliRunner().invoke(app, [str(a) for a in (*arguments, 65)])
    assert result.exit_code == 2
    assert "Leave the shrinkwrap out" in result.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["a.ply"]
    result = CliRunner().invoke(app, [str(a) for a in (*arguments, "none", "--vertices", 300)])
    assert result.exit_code == 0


def test_a_thin_shell_is_refused_as_the_key_of_a_scene(tmp_path):
    from varos_warp.scene.geometry.build import build_parts

    terrain.write_ply(tmp_path / "a.ply", *shell())
    scene = scene_from_dict(
        {
            "terrain": {"file": str(tmp_path / "a.ply"), "preprocess": {"shrinkwrap_resolution": 65}},
            "trajectory": {"poses": [{"position": (0, 0, 50)}]},
        }
    )
    with pytest.raises(InputError, match="Leave the shrinkwrap out") as caught:
        build_parts(scene)
    assert caught.value.key == "terrain.preprocess.shrinkwrap_resolution"


@pytest.mark.parametrize("close", ["none", "skirt", "solid"])
def test_the_number_of_vertices_asked_is_that_at_the_end(close):
    vertices, _ = terrain.preprocess(
        *generate_terrain(30, 61, 2.0), shrinkwrap_resolution=81, target_vertices=1500, close=close
    )
    assert 0.98 * 1500 <= len(vertices) <= 1500


def test_a_rough_survey_is_warned_of_and_smoothed_without_losing_its_shape_or_outline():
    vertices, faces = rough(0.7)
    with pytest.warns(UserWarning, match="shards"):
        terrain.preprocess(vertices, faces, target_vertices=400)
    calm = smooth(vertices, faces, 10)
    assert roughness_deg(calm, faces) < 0.4 * roughness_deg(vertices, faces)
    truth = 5.0 * np.sin(calm[:, 0] / 20.0)
    assert np.std(calm[:, 2] - truth) < 0.5 * 0.7
    np.testing.assert_array_equal(np.ptp(calm[:, :2], axis=0), np.ptp(vertices[:, :2], axis=0))


def test_smoothing_keeps_a_wave_of_many_edges():
    vertices, faces = rough(0.0)
    inner = (np.abs(vertices[:, :2] - 30.0) < 20.0).all(axis=1)
    assert np.abs(smooth(vertices, faces, 10) - vertices)[inner, 2].max() < 5.0 * 10 * (np.pi / 125.0) ** 4 * 10
