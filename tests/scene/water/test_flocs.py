"""Shapes of marine snow: grains that stick to each other, with the law of measured flocs and the light of a sphere."""

import numpy as np
import pytest

from varos_warp.kernels.particles.bodies import FARTHEST_GRAIN
from varos_warp.scene.water.flocs import DIMENSIONS, GRAINS, OPACITIES, PREFACTOR, SHAPES, TOUCH, WIDEST, flocs


def distances(shape):
    """Of the grains of a shape from each other, over the sums of their radii."""
    at, radius = flocs().at[shape], flocs().radius[shape]
    apart = np.linalg.norm(at[:, None] - at, axis=-1) / (radius[:, None] + radius)
    return apart + np.diag(np.full(GRAINS, np.inf))


@pytest.mark.parametrize("shape", range(0, SHAPES, 9))
def test_grains_stick_to_each_other_and_none_lies_within_another(shape):
    apart = distances(shape)
    assert apart.min() > TOUCH - 2e-3  # places are rounded
    near, reached = apart < TOUCH + 2e-3, {0}
    for _ in range(GRAINS):
        reached |= set(np.nonzero(near[sorted(reached)].any(0))[0].tolist())
    assert len(reached) == GRAINS


def test_radii_of_gyration_follow_the_law_of_fractals():
    """N = k_f (R_g / a)^D of each shape with its own D: within what the best of the places that were tried leaves."""
    at, radius, _ = flocs()
    gyration = np.sqrt(((at - at.mean(1, keepdims=True)) ** 2).sum(-1).mean(1))
    grains = PREFACTOR * (gyration / radius.mean(1)) ** np.linspace(*DIMENSIONS, SHAPES)
    assert np.median(np.abs(np.log(grains / GRAINS))) < 0.03
    assert np.abs(np.log(grains / GRAINS)).max() < 0.3


def test_a_shape_has_the_cross_section_of_a_sphere_of_radius_1_about_its_middle():
    at, radius, share = flocs()
    np.testing.assert_allclose(share.sum(1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(np.einsum("sg,sgi->si", share, at), 0.0, atol=2e-4)
    opacity = share / radius**2  # so the sum of cross sections, pi opacity radius^2, is pi
    assert opacity.min() == pytest.approx(min(OPACITIES), rel=0.05)
    assert opacity.max() == pytest.approx(max(OPACITIES), rel=0.05)
    assert (radius.max(1) / radius.min(1)).max() <= WIDEST * 1.002


def test_no_grain_lies_farther_out_than_kernels_look_for_it():
    at, radius, _ = flocs()
    most = (np.linalg.norm(at, axis=-1) + radius).max()
    assert 0.9 * FARTHEST_GRAIN < most <= FARTHEST_GRAIN


def test_shapes_are_longer_than_wide_and_no_two_are_alike():
    """Aspect ratios of 1.5 to 4 are usual; here that of the second moments in three dimensions, longest over middle."""
    at, _, share = flocs()
    length = np.sqrt(np.linalg.eigvalsh(np.einsum("sg,sgi,sgj->sij", share, at, at)))
    aspect = length[:, 2] / length[:, 1]
    assert 1.5 < np.median(aspect) < 5
    assert len(np.unique(np.round(length, 3), axis=0)) == SHAPES
