"""Drifts and moats lie around what stands in the ground, and nowhere else."""

import numpy as np
import pytest
import trimesh

from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.geometry.relief import drifts

MESH = trimesh.creation.icosphere(subdivisions=4)


def ball(x, radius):
    return Part("objects.0", MESH.vertices * radius + [x, 0, 0], np.array(MESH.faces, np.int32), Diffuse())


def ground(*xy):
    return np.column_stack([np.array(xy, float), np.zeros(len(xy))])


def test_distance_width_and_direction_are_those_of_the_nearest_object():
    near = drifts.neighbours(ground((1.5, 0), (-1.2, 0), (4.6, 0)), [ball(0, 1), ball(5, 0.25)])
    assert near.distance == pytest.approx([0.5, 0.2, 0.15], abs=2e-3)  # of facets inside of the balls
    assert near.width == pytest.approx([2.0, 2.0, 0.5], abs=5e-3)
    np.testing.assert_allclose(near.aside, [[1, 0], [-1, 0], [-1, 0]], atol=1e-9)


def test_copies_count_by_the_circle_that_they_fill():
    T = np.tile(np.eye(4), (2, 1, 1))
    T[1, :3, :3] *= 2.0
    T[1, 0, 3] = 10.0
    group = Instances("scatter.0", MESH.vertices, np.array(MESH.faces, np.int32), Diffuse(), T)
    near = drifts.neighbours(ground((1.0, 0), (12.0, 0)), [group])
    assert near.distance == pytest.approx([0.2, 0.4], abs=1e-6)
    assert near.width == pytest.approx([1.6, 2.5], abs=1e-6)


def test_far_from_everything_the_ground_stays():
    near = drifts.neighbours(ground((30, 0)), [ball(0, 1)])
    assert np.isinf(near.distance).all()
    assert drifts.drift(near, np.array([1.0, 0.0])) == 0.0


def test_a_bank_lies_against_the_foot_and_a_moat_before_the_current():
    """With the current along x: highest in the lee, deepest upstream."""
    near = drifts.neighbours(ground((1.01, 0), (-1.01, 0), (1.8, 0), (-1.8, 0)), [ball(0, 1)])
    lee, stoss, behind, before = drifts.drift(near, np.array([1.0, 0.0]))
    assert lee > stoss > 0.0
    assert before < -0.02
    assert behind > before
