"""Tables of two angles have hundreds of thousands of values: what they weigh, and how they are told apart."""

import numpy as np
import pytest

from varos_warp.scene.description.lights import LampPort
from varos_warp.scene.lights.distribution import behind_port, of_profile
from varos_warp.scene.lights.goniometry import NODES, Profile


def oval(bend=0.5):
    """A lamp of 720 half planes."""
    azimuth, polar = np.radians(np.arange(0.0, 360.0, 0.5)), np.radians(np.arange(0.0, 91.0))
    return of_profile(Profile(polar, azimuth, np.outer(1.0 + bend * np.cos(azimuth), np.cos(polar).clip(0.0)), "oval"))


def test_a_value_takes_eight_bytes():
    assert oval().profile.nbytes == 8 * 720 * (NODES + 1)


def test_what_is_told_apart_by_its_values_cannot_be_written():
    with pytest.raises(ValueError, match="read-only"):
        oval().profile[0] = 2.0


def test_distributions_are_equal_by_their_values_as_keys_too():
    one, same, other = oval(), oval(), oval(0.5 + 1e-12)
    assert (one == same, hash(one) == hash(same)) == (True, True)
    assert one != other
    assert {one: 1}[same] == 1
    assert behind_port(one, LampPort()) is behind_port(same, LampPort())


def test_few_tables_are_kept_for_lamps_behind_ports():
    """Each with its original; 16 of them weigh 50 MB at most."""
    assert behind_port.cache_info().maxsize * 2 * oval().profile.nbytes < 50e6
