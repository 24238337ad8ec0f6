"""A peak of a lamp's file that falls between the steps of a table: how much of it is lost, and what then is refused."""

import numpy as np
import pytest
from ies_by_hand import ies_text

from varos_warp.errors import InputError
from varos_warp.scene.lights.distribution import of_profile
from varos_warp.scene.lights.goniometry import NODES, Profile
from varos_warp.scene.lights.profiles import read_profile

STEPS = 2.0 * np.arcsin(np.linspace(0.0, np.sin(np.pi / 4.0), NODES + 1))
"""Angles of a table that ends at 90 degrees [rad]."""
BETWEEN = 0.5 * (STEPS[256] + STEPS[257])
PEDESTAL = 0.3


def spike_over_a_pedestal(kind, width, folder):
    """A triangle up to 1 half way between two steps, over light of PEDESTAL; in half planes, or in one direction."""
    angle = np.array([0.0, BETWEEN - width, BETWEEN, BETWEEN + width, np.pi / 2.0])
    row = np.array([PEDESTAL, PEDESTAL, 1.0, PEDESTAL, PEDESTAL])
    if kind == "round":
        return Profile(angle, np.zeros(1), row[None], kind)
    if kind == "half planes":
        return Profile(angle, np.radians([0.0, 180.0]), np.array([row, np.full(5, PEDESTAL)]), kind)
    horizontal = np.degrees([-np.pi / 2.0, *angle])
    vertical = np.degrees([-np.pi / 2.0, -width, 0.0, width, np.pi / 2.0])
    candela = np.full((6, 5), PEDESTAL)
    candela[3, 2] = 1.0
    (folder / "lamp.ies").write_text(ies_text(kind, vertical, horizontal, candela))
    return read_profile(folder / "lamp.ies", "file")


@pytest.mark.parametrize("kind", ["round", "half planes", "A", "B"])
def test_a_peak_between_steps_leaves_the_rest_of_the_light_at_its_share_of_the_files_peak(tmp_path, kind):
    """Half a step from the peak, of a slope of 0.7 in 30 steps, are 1.2 % of it."""
    shape = of_profile(spike_over_a_pedestal(kind, 30.0 * (STEPS[257] - STEPS[256]), tmp_path))
    assert max(shape.profile) == pytest.approx(1.0 - 0.7 / 60.0, rel=1e-4)  # of angles written to 1e-6 degrees
    np.testing.assert_allclose(shape.at(np.radians([0.0, 10.0, 80.0])), PEDESTAL, rtol=1e-14)


@pytest.mark.parametrize("kind", ["round", "half planes", "A", "B"])
def test_a_peak_of_which_a_table_would_lose_more_than_a_fiftieth_is_refused(tmp_path, kind):
    with pytest.raises(InputError, match="its brightest beam is so narrow"):
        of_profile(spike_over_a_pedestal(kind, 15.0 * (STEPS[257] - STEPS[256]), tmp_path))
