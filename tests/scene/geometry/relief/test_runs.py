import numpy as np
import pytest
from surfaces import ball, sheet

from varos_warp.scene.geometry.relief.recipes.masks import neighbours_of
from varos_warp.scene.geometry.relief.recipes.runs import slopes_of

STEP = 0.01


def wall(turn_deg=0.0):
    """A wall of 81 x 81 vertices in the xz plane, its grid turned by an angle, and the number of its middle one."""
    p, faces, _ = sheet(81, STEP)
    a = np.radians(turn_deg)
    flat = p[:, :2] @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
    p = np.column_stack([flat[:, 0], 0.0 * p[:, 0], flat[:, 1]])
    return p, faces, np.broadcast_to([0.0, -1.0, 0.0], p.shape), 40 * 81 + 40


def ran(p, faces, n, source, length):
    """How far what starts at one vertex has yet to run."""
    start = np.zeros(len(p))
    start[source] = length
    return slopes_of(p, n, neighbours_of(len(p), faces)).runs(start)


def test_a_run_on_a_wall_goes_straight_down_for_its_length():
    p, faces, n, source = wall()
    left = ran(p, faces, n, source, 0.205)
    below = (np.abs(p[:, 0]) < 1e-9) & (p[:, 2] <= 1e-9) & (p[:, 2] > -0.205)
    np.testing.assert_allclose(left[below], 0.205 + p[below, 2], atol=1e-5)
    assert np.count_nonzero(left) == 21 == np.count_nonzero(below)


def test_on_a_slope_a_run_is_shorter_by_its_sine():
    p, faces, _, source = wall()
    tilt = np.radians(30.0)
    x = np.column_stack([p[:, 0], p[:, 2] * np.cos(tilt), p[:, 2] * np.sin(tilt)])
    left = ran(x, faces, np.broadcast_to([0.0, -np.sin(tilt), np.cos(tilt)], p.shape), source, 0.205)
    assert np.count_nonzero(left) == 11  # edges of 1 cm take 2 cm of the length


@pytest.mark.parametrize("turn_deg", [10.0, 22.5, 37.0])
def test_runs_go_down_on_average_whatever_the_directions_of_edges(turn_deg):
    """Ends of runs from many vertices side by side: their mean lies below that of their starts."""
    p, faces, n, _ = wall(turn_deg)
    slopes = slopes_of(p, n, neighbours_of(len(p), faces))
    inside = np.flatnonzero(np.hypot(p[:, 0], p[:, 2] + 0.15) < 0.1)
    at = inside
    for _ in range(20):
        at = slopes.above[at]
    moved = p[at] - p[inside]
    # about 20 independent choices, of up to half an edge aside each; ways that meet do not part again
    assert abs(moved[:, 0].mean()) < 3.0 * 0.5 * STEP * np.sqrt(20.0)
    assert moved[:, 2].mean() > 0.1


def test_of_runs_that_meet_the_longer_counts():
    p, faces, n, source = wall()
    slopes = slopes_of(p, n, neighbours_of(len(p), faces))
    start = np.zeros(len(p))
    start[source] = 0.3
    start[source - 5 * 81] = 0.02  # five edges below
    left = slopes.runs(start)
    assert left[source - 5 * 81] == pytest.approx(0.25, abs=1e-5)
    assert left[source - 10 * 81] == pytest.approx(0.2, abs=1e-5)


def test_nothing_runs_on_flat_ground_and_from_where_nothing_starts():
    p, faces, n = sheet(40, STEP)
    start = np.zeros(len(p))
    start[820] = 1.0
    slopes = slopes_of(p, n, neighbours_of(len(p), faces))
    np.testing.assert_array_equal(slopes.runs(start), start.astype(np.float32))
    p, faces, n = ball(0.5, 4)
    assert not slopes_of(p, n, neighbours_of(len(p), faces)).runs(np.zeros(len(p))).any()


def test_what_runs_down_a_ball_comes_from_above():
    p, faces, n = ball(0.5, 5)
    slopes = slopes_of(p, n, neighbours_of(len(p), faces))
    moves = slopes.above != np.arange(len(p))
    assert np.all(p[slopes.above[moves], 2] > p[moves, 2])
    assert moves[np.abs(n[:, 2]) < 0.98].all()
