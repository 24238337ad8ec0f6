import numpy as np
import pytest
from surfaces import ball, mean_edge, sheet

from varos_warp.scene.geometry.relief.recipes.masks import convexity_of, neighbours_of, shape_of, smoothed


@pytest.mark.parametrize("scale", [0.05, 0.1])
def test_the_convexity_of_a_ball_follows_from_its_radius(scale):
    """x, y and z have the eigenvalue -2 / R^2 of its Laplacian: q = p / (1 + 2 s^2 / R^2)."""
    radius = 0.5
    p, faces, n = ball(radius, 6)
    found = convexity_of(p, n, neighbours_of(len(p), faces), scale)
    ratio = 2.0 * (scale / radius) ** 2
    np.testing.assert_allclose(found.mean(), radius / scale * ratio / (1.0 + ratio), rtol=0.01)
    assert found.std() < 0.1 * found.mean()  # the triangles of an icosphere are not all alike


def test_smoothing_damps_a_wave_by_its_length():
    """On a plane exp(ikx) has the eigenvalue -k^2: away from the rim it becomes 1 / (1 + s^2 k^2) of itself."""
    p, faces, _ = sheet(160, 0.01)
    k, scale = 2.0 * np.pi / 0.2, 0.03
    wave = np.cos(k * p[:, [0, 0, 0]])
    found = smoothed(wave, p, neighbours_of(len(p), faces), scale)
    inside = np.abs(p[:, :2]).max(axis=1) < 0.5
    share = (found * wave)[inside].sum() / (wave**2)[inside].sum()
    assert share == pytest.approx(1.0 / (1.0 + (scale * k) ** 2), rel=0.03)


def test_a_hollow_ball_is_as_concave_as_a_ball_is_convex():
    p, faces, n = ball(0.5, 5)
    joined = neighbours_of(len(p), faces)
    np.testing.assert_allclose(convexity_of(p, -n, joined, 0.1), -convexity_of(p, n, joined, 0.1), atol=1e-12)


def test_masks_of_a_plane_find_nothing():
    p, faces, n = sheet(40, 0.01)
    shape = shape_of(p, neighbours_of(len(p), faces), n, np.full(len(p), 0.011))
    assert np.abs(shape.convexity).max() < 1e-5
    assert not shape.hollow.max() > 1e-4
    np.testing.assert_allclose(shape.exposure, 0.8, atol=1e-4)
    np.testing.assert_allclose(shape.up, 1.0)


def test_a_groove_is_hollow_and_sheltered_and_a_ridge_is_not():
    p, faces, n = sheet(81, 0.01, lambda x, y: np.where(np.abs(x) < 0.035, np.abs(x) - 0.035, 0.0))
    shape = shape_of(p, neighbours_of(len(p), faces), n, np.full(len(p), 0.01))
    middle = np.abs(p[:, 1]) < 0.2
    groove, rim = middle & (np.abs(p[:, 0]) < 0.004), middle & (np.abs(np.abs(p[:, 0]) - 0.03) < 0.008)
    assert shape.hollow[groove].min() > 0.3
    assert shape.convexity[rim].mean() > 0.03
    assert shape.exposure[groove].max() < shape.exposure[rim].min()


def test_masks_do_not_depend_on_where_a_mesh_lies():
    p, faces, n = ball(0.5, 5)
    edge = np.full(len(p), mean_edge(p, faces))
    joined = neighbours_of(len(p), faces)
    there, here = shape_of(p + 1000.0, joined, n, edge), shape_of(p, joined, n, edge)
    np.testing.assert_allclose(there.convexity, here.convexity, atol=1e-4)


def test_every_vertex_may_have_its_own_scale():
    """Half a ball at one scale, half at another: away from the border each is as of a ball at that scale alone."""
    p, faces, n = ball(0.5, 6)
    joined = neighbours_of(len(p), faces)
    fine, coarse = (convexity_of(p, n, joined, scale) for scale in (0.03, 0.06))
    both = convexity_of(p, n, joined, np.where(p[:, 2] > 0.0, 0.06, 0.03))
    np.testing.assert_allclose(both[p[:, 2] > 0.35], coarse[p[:, 2] > 0.35], rtol=0.1, atol=2e-3)
    np.testing.assert_allclose(both[p[:, 2] < -0.35], fine[p[:, 2] < -0.35], rtol=0.1, atol=2e-3)


def test_what_no_face_uses_stays_where_it_is():
    p, faces, n = ball(0.5, 3)
    alone = np.vstack([p, [[2.0, 0.0, 0.0]]]), np.vstack([n, [[1.0, 0.0, 0.0]]])
    assert convexity_of(*alone, neighbours_of(len(p) + 1, faces), 0.05)[-1] == pytest.approx(0.0, abs=1e-5)
