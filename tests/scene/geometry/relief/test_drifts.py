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


def test_the_distance_from_copies_is_that_from_their_surfaces():
    T = np.tile(np.eye(4), (2, 1, 1))
    T[1, :3, :3] *= 2.0
    T[1, 0, 3] = 10.0
    group = Instances("scatter.0", MESH.vertices, np.array(MESH.faces, np.int32), Diffuse(), T)
    clear, _ = drifts.surroundings(ground((1.5, 0), (12.7, 0)), [group], STILL)
    assert clear == pytest.approx([0.5, 0.7], abs=4e-3)  # of facets inside of the balls


def test_far_from_everything_the_ground_stays():
    clear, height = drifts.surroundings(ground((30, 0)), [ball(0, 1)], np.array([1.0, 0.0]))
    assert np.isinf(clear).all()
    assert height == 0.0


def test_a_bank_lies_against_the_foot_and_a_moat_before_the_current():
    """With the current along x: highest in the lee, deepest upstream."""
    _, height = drifts.surroundings(
        ground((1.01, 0), (-1.01, 0), (1.8, 0), (-1.8, 0)), [ball(0, 1)], np.array([1.0, 0.0])
    )
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


def test_small_stones_around_a_large_one_do_not_hide_it():
    T = np.tile(np.eye(4), (151, 1, 1))
    T[1:, :3, :3] *= 0.04
    angle = np.linspace(0, 2 * np.pi, 150, endpoint=False)
    T[1:, 0, 3], T[1:, 1, 3] = 1.1 * np.cos(angle), 1.1 * np.sin(angle)
    group = Instances("scatter.0", MESH.vertices, np.array(MESH.faces, np.int32), Diffuse(), T)
    clear, height = drifts.surroundings(ground((1.05, 0)), [group], STILL)
    assert clear[0] == pytest.approx(0.05, abs=1e-3)  # from the large one: 1 cm from a small one is as much as that
    assert height[0] > 0.05


def test_what_lies_about_a_small_stone_is_in_proportion_to_it():
    """Stones that stand 8 and 4 cm out of the ground, at a quarter of that; and one of a metre, at its own distance."""
    places, stones = ground((0.10, 0), (1.05, 0), (6.25, 0)), [ball(0, 0.08), ball(1, 0.04), ball(5, 1)]
    clear, _ = drifts.surroundings(places, stones, STILL)
    assert clear == pytest.approx([0.25 * drifts.WHOLE_M, 0.25 * drifts.WHOLE_M, 0.25], abs=2e-3)


def test_drifts_turn_with_a_body(monkeypatch):
    """But for the noise that makes them uneven, which lies in the world."""
    monkeypatch.setattr(drifts, "UNEVEN", 0.0)
    box = trimesh.creation.box((8.0, 0.4, 0.4))
    spin = np.array([[np.cos(0.7), -np.sin(0.7), 0], [np.sin(0.7), np.cos(0.7), 0], [0, 0, 1]])
    places = ground((0, 0.25), (3.0, 0.3), (0, -0.35))
    current = np.array([0.0, 1.0])
    plain, turned = (
        drifts.surroundings(
            places @ R.T,
            [Part("objects.0", box.vertices @ R.T, np.array(box.faces, np.int32), Diffuse())],
            (R[:2, :2] @ current),
        )[1]
        for R in (np.eye(3), spin)
    )
    np.testing.assert_allclose(turned, plain, atol=2e-3)
    assert np.ptp(plain) > 5e-3


@pytest.mark.parametrize("height", [0.55, -0.55, 1.0])
def test_what_does_not_stand_in_the_ground_leaves_no_trace(height):
    box = trimesh.creation.box((1.0, 1.0, 1.0)).apply_translation((0, 0, height))
    part = Part("objects.0", np.array(box.vertices), np.array(box.faces, np.int32), Diffuse())
    _, drifted = drifts.surroundings(ground((0, 0), (0.6, 0), (0.9, 0)), [part], STILL)
    assert (drifted == 0.0).all()


def test_a_bank_falls_from_the_wall_to_its_toe_and_is_steepest_at_the_wall():
    x = np.linspace(0.0, drifts.BANK_WIDTH, 50)
    height = drifts.drift(x, 1.0, 1.0)  # in the lee, where there is no moat
    slope = np.diff(height)
    assert height[0] == pytest.approx(drifts.BANK + drifts.APRON)
    assert (slope < 0.0).all()
    assert slope[0] < 3.0 * slope[-1]


def test_banks_are_uneven_along_a_body():
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    _, height = drifts.surroundings(
        ground(*np.column_stack([1.01 * np.cos(angle), 1.01 * np.sin(angle)])), [ball(0, 1)], STILL
    )
    assert 0.1 * height.mean() < height.std() < 0.6 * height.mean()
    assert height.min() > 0.0


def test_what_is_buried_to_its_top_has_hardly_a_bank():
    """Banks go by what stands out of the ground: of 2 cm of a ball of 2 m no bank of decimetres."""
    deep = Part("objects.0", MESH.vertices - [0, 0, 0.98], np.array(MESH.faces, np.int32), Diffuse())
    _, height = drifts.surroundings(ground((0.25, 0)), [deep], STILL)
    assert 0.0 < height[0] < 0.02


def test_points_within_a_radius_are_those_that_a_search_of_all_finds():
    rng = np.random.default_rng(0)
    points, middles = rng.uniform(-3.0, 5.0, (2000, 2)), rng.uniform(-5.0, 7.0, (50, 2))
    squares = drifts.Squares(points, 0.7)
    for middle, radius in zip(middles, rng.uniform(0.0, 2.0, len(middles)), strict=True):
        expected = np.flatnonzero(np.hypot(*(points - middle).T) <= radius)
        assert sorted(squares.within(middle, radius)) == expected.tolist()
