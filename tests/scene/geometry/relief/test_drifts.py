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


STILL = np.zeros(2)


def test_the_distance_is_that_of_the_nearest_object():
    clear, _ = drifts.surroundings(ground((1.5, 0), (-1.2, 0), (4.6, 0)), [ball(0, 1), ball(5, 0.25)], STILL)
    assert clear == pytest.approx([0.5, 0.2, 0.15], abs=2e-3)  # of facets inside of the balls


def test_copies_count_by_the_circle_that_they_fill():
    T = np.tile(np.eye(4), (2, 1, 1))
    T[1, :3, :3] *= 2.0
    T[1, 0, 3] = 10.0
    group = Instances("scatter.0", MESH.vertices, np.array(MESH.faces, np.int32), Diffuse(), T)
    clear, _ = drifts.surroundings(ground((1.0, 0), (12.0, 0)), [group], STILL)
    assert clear == pytest.approx([0.2, 0.4], abs=1e-6)


def test_far_from_everything_the_ground_stays():
    clear, height = drifts.surroundings(ground((30, 0)), [ball(0, 1)], np.array([1.0, 0.0]))
    assert np.isinf(clear).all()
    assert height == 0.0


def test_a_bank_lies_against_the_foot_and_a_moat_before_the_current():
    """With the current along x: highest in the lee, deepest upstream."""
    _, height = drifts.surroundings(ground((1.01, 0), (-1.01, 0), (1.8, 0), (-1.8, 0)), [ball(0, 1)],
                                    np.array([1.0, 0.0]))
    lee, stoss, behind, before = height
    assert lee > stoss > 0.0
    assert before < -0.02
    assert behind > before


def test_the_ground_has_no_steps_between_bodies():
    """Of a large and a small body beside each other: heights 1 mm apart differ by less than a mild slope makes."""
    x = np.arange(-4.0, 4.0, 1e-3)
    T = np.tile(np.eye(4), (3, 1, 1)) * [[[0.1]]]
    T[:, 3, 3], T[:, 0, 3] = 1.0, [1.3, 1.6, 2.4]
    group = Instances("scatter.0", MESH.vertices, np.array(MESH.faces, np.int32), Diffuse(), T)
    _, height = drifts.surroundings(ground(*np.column_stack([x, 0.3 + 0 * x])), [ball(0, 1), group], STILL)
    assert np.ptp(height) > 0.03
    assert np.abs(np.diff(height)).max() < 1e-3
