"""The shift of C against the slopes of D, of surfaces that bend at the edges of their triangles only."""

import numpy as np
import pytest

from varos_warp.dataset.validate import surfaces
from varos_warp.dataset.validate.outcome import Validation

HEIGHT, WIDTH = 54, 96


def normals(amplitude=0.05):
    """C [H, W, 3] of gentle hills."""
    row, col = np.indices((HEIGHT, WIDTH))
    tilted = np.stack([np.sin(0.2 * col + 0.1 * row), np.cos(0.13 * row - 0.05 * col), np.zeros((HEIGHT, WIDTH))], -1)
    return amplitude * tilted + (0.0, 0.0, 1.0)


def of_facets(normal, size, start):
    """The same [H, W, 3] with one normal for each facet: the mean, as a flat triangle has it."""
    row, col = ((grid + start) // size for grid in np.indices((HEIGHT, WIDTH)))
    number = row * WIDTH + col
    count = np.bincount(number.ravel())
    sums = np.stack([np.bincount(number.ravel(), x.ravel()) for x in np.moveaxis(normal, -1, 0)])
    means = sums / np.maximum(count, 1)
    return np.moveaxis(means[:, number], 0, -1)


def problems(normal, slope, frames=1):
    found = Validation(None)
    surfaces.check_slopes(found, "M0", frames * surfaces.slope_sums(normal, slope, 1e-4, 0, HEIGHT))
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
