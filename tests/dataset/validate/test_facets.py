"""The shift of C against the slopes of D, of surfaces that bend at the edges of their triangles only."""

import numpy as np
import pytest

from varos_warp.dataset.validate import surfaces
from varos_warp.dataset.validate.outcome import Validation

SHAPE = 54, 96


def normals(shape=SHAPE, amplitude=0.05):
    """C [H, W, 3] of gentle hills, as many whatever the shape."""
    row, col = SHAPE[0] / shape[0] * np.indices(shape)
    tilted = np.stack([np.sin(0.2 * col + 0.1 * row), np.cos(0.13 * row - 0.05 * col), np.zeros(shape)], -1)
    return amplitude * tilted + (0.0, 0.0, 1.0)


def of_facets(normal, size, start):
    """The same [H, W, 3] with one normal for each facet: the mean, as a flat triangle has it."""
    row, col = ((grid + start) // size for grid in np.indices(normal.shape[:2]))
    number = row * normal.shape[1] + col
    count = np.bincount(number.ravel())
    sums = np.stack([np.bincount(number.ravel(), x.ravel()) for x in np.moveaxis(normal, -1, 0)])
    means = sums / np.maximum(count, 1)
    return np.moveaxis(means[:, number], 0, -1)


def problems(normal, slope, frames=1):
    found = Validation(None)
    surfaces.check_slopes(found, "M0", frames * surfaces.slope_sums(normal, slope, 1e-4, 0, len(normal)))
    assert any("shift" in measure["name"] for measure in found.measures)
    return found.problems


@pytest.mark.parametrize("size", [27, 40])
def test_large_triangles_are_not_taken_for_a_shift(size):
    """By a limit that does not know of the scatter, 4 of these 19 were, by up to 0.67 px."""
    for start in range(0, size, -(-size // 12)):
        assert problems(normals(), of_facets(normals(), size, start)) == []


def test_a_shift_of_a_pixel_is_found_on_gentle_hills_in_one_frame_and_in_equal_ones():
    for frames in (1, 20):
        assert "shift: " in problems(normals(), np.roll(normals(), 1, 1), frames)[0]
        assert problems(normals(), normals(), frames) == []


def test_a_shift_is_found_on_hills_of_triangles():
    """Of two pixels; of one, such hills show half."""
    for shape, size in (((180, 320), 16), ((360, 640), 32)):
        sound = normals(shape)
        assert problems(sound, of_facets(sound, size, 0)) == []
        assert "shift: " in problems(np.roll(sound, 2, 1), of_facets(sound, size, 0))[0]


@pytest.mark.parametrize("axis", [0, 1])
def test_a_step_in_depth_is_no_slope_whether_it_lies_between_rows_or_columns(axis):
    """A wall of two heights, seen from above: beside the step nothing is told, elsewhere its normal."""
    row, col = np.indices((12, 12))
    depth = np.where((row, col)[axis] < 6, 2.0, 3.0)
    rays = np.stack([0.1 * (col - 5.5), 0.1 * (row - 5.5), np.ones(row.shape)], -1)
    found = surfaces.normals_of(rays * depth[..., None], rays)[1:-1, 1:-1]
    told = np.isfinite(found).all(-1)
    beside = np.isin((row, col)[axis][1:-1, 1:-1], (5, 6))
    assert (told == ~beside).all()
    assert found[told] == pytest.approx(np.tile([0.0, 0.0, -1.0], (told.sum(), 1)), abs=1e-9)
