"""Where light transport ends over surfaces: distances, grazing light, needles, scale, places; on either side."""

import numpy as np
import pytest

from benchmarks.stability.transport_surfaces import (
    depth_error,
    grazing_errors,
    map_errors,
    needle_errors,
    scale_errors,
    scaled_image,
)


@pytest.mark.parametrize("distance", [1e-7, 1e-4, 1.0, 1e5, 7e8])
def test_depth_is_right_until_rays_end(distance):
    assert depth_error(distance) < 1e-6
    assert np.isnan(depth_error(1.1e9))


@pytest.mark.parametrize("angle", [1.0, 1e-2, 1e-4, 1e-5])
def test_grazing_light_is_the_cosine_law_to_1e_5_radians(angle):
    """A pixel spans 1e-6 of the angle or 1e-6 rad, whose rounding is 6e-8 rad: 0.6 % at 1e-5."""
    distance, direct = grazing_errors(angle)
    assert distance < 1e-6 + 6e-8 / angle
    assert direct < 1e-5 + 2e-7 / angle


@pytest.mark.parametrize("aspect", [1e1, 1e3, 1e5, 1e7, 1e9])
def test_walls_of_needles_are_closed_and_lit_alike(aspect):
    lost, direct = needle_errors(aspect)
    assert lost == 0.0
    assert direct < 1e-5
    assert needle_errors(aspect, at_edges=True)[0] < 0.05


def test_a_world_of_any_size_from_millimetres_on_looks_the_same():
    truth = scaled_image(1.0)
    for scale in (1e-3, 0.1, 1e3, 1e7):
        assert max(scale_errors(scale, truth)) < 1e-3
    assert max(scale_errors(1e-5, truth)) > 5e-3


@pytest.mark.parametrize(("reach", "error"), [(1e2, 2e-5), (1e4, 2e-3), (1e5, 2e-2)])
def test_a_course_is_as_right_as_single_precision_at_its_ends(reach, error):
    """Half a spacing of float32 there, 3e-8 of it, is up to 0.2 m x 2 / 2.5 m^2 of the light of a lamp 0.15 m aside."""
    assert max(map_errors(reach, spread=True)) < error
    assert max(map_errors(reach, spread=False)) < 1e-6


def test_beyond_10_000_km_nothing_is_right_at_the_ends_of_a_course():
    assert max(map_errors(1e7, spread=True)) > 0.1
    assert max(map_errors(1e7, spread=False)) < 1e-6
