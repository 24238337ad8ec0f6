"""CSV files of intensity by two angles."""

import random

import numpy as np
import pytest
from ies_by_hand import ies_text, measured, smooth

from varos_warp.errors import InputError
from varos_warp.scene.lights.distribution import of_profile
from varos_warp.scene.lights.profiles import read_profile

HEADER = "polar_deg,azimuth_deg,intensity"


def table(polar, azimuth, intensity):
    rows = [
        f"{p:g},{a:g},{i:.9g}"
        for a, row in zip(azimuth, intensity, strict=True)
        for p, i in zip(polar, row, strict=True)
    ]
    return [HEADER, *rows]


def profile_of(folder, lines):
    (folder / "lamp.csv").write_text("\n".join(lines) + "\n")
    return read_profile(folder / "lamp.csv", "key")


POLAR, AZIMUTH = np.arange(0.0, 91.0, 15.0), np.arange(0.0, 360.0, 30.0)


def test_a_table_of_two_angles_is_the_ies_file_of_the_same_lamp(tmp_path):
    """Azimuth 0 is up and 90 is left from behind the lamp, as C of type C; in any order of the rows."""
    intensity = measured("C", POLAR, AZIMUTH)
    (tmp_path / "lamp.ies").write_text(ies_text("C", POLAR, np.append(AZIMUTH, 360.0), intensity[[*range(12), 0]]))
    header, *rows = table(POLAR, AZIMUTH, intensity)
    random.Random(1).shuffle(rows)
    one, other = of_profile(profile_of(tmp_path, [header, *rows])), of_profile(read_profile(tmp_path / "lamp.ies", ""))
    assert one.planes == other.planes == 12
    np.testing.assert_allclose(one.profile, other.profile, atol=1e-8)
    left = smooth(np.cos(1.0), 0.0, -np.sin(1.0)) / intensity.max()
    chord = 6.0 * np.radians(15.0) ** 2 / 8.0  # a second derivative of 6 over steps of 15 degrees
    assert one.at(1.0, np.radians(90.0)) == pytest.approx(left, abs=chord)


@pytest.mark.parametrize("azimuth", [np.arange(-180.0, 180.0, 30.0), np.arange(0.0, 361.0, 30.0)])
def test_azimuths_may_be_those_of_any_turn(tmp_path, azimuth):
    one = of_profile(profile_of(tmp_path, table(POLAR, azimuth, measured("C", POLAR, azimuth % 360.0))))
    np.testing.assert_allclose(
        one.profile, of_profile(profile_of(tmp_path, table(POLAR, AZIMUTH, measured("C", POLAR, AZIMUTH)))).profile
    )


@pytest.mark.parametrize("azimuth", [np.array([0.0, 7.3, 33.4, 100.0, 170.0, 200.0, 280.0, 301.1])])
def test_uneven_azimuths_become_even_ones_that_differ_little(tmp_path, azimuth):
    """720 half planes; in the middle between two of the file, where lines are straight, they agree to rounding."""
    profile = profile_of(tmp_path, table(POLAR, azimuth, measured("C", POLAR, azimuth)))
    shape = of_profile(profile)
    middle = 0.5 * (azimuth[1:] + azimuth[:-1])
    mean = 0.5 * (profile.intensity[1:, 3] + profile.intensity[:-1, 3]) / profile.intensity.max()
    assert shape.planes == 720
    np.testing.assert_allclose(shape.at(np.radians(45.0), np.radians(middle)), mean, rtol=1e-3)


def test_a_table_of_one_azimuth_is_round(tmp_path):
    profile = profile_of(tmp_path, table([0, 40, 80], [0], [[5, 3, 0]]))
    assert profile.is_round
    assert of_profile(profile).at(np.radians(20.0), 2.0) == pytest.approx(0.8, abs=1e-3)


GOOD = table([0, 45, 90], [0, 90, 180, 270], np.arange(12.0).reshape(4, 3))


@pytest.mark.parametrize(
    ("lines", "why"),
    [
        ([HEADER.replace("polar", "angle"), *GOOD[1:]], "no column polar_deg"),
        (GOOD[:-1], "no intensity at polar_deg 90, azimuth_deg 270"),
        ([*GOOD, "45,90,99"], "two intensities in one direction"),
        ([*GOOD[:4], "0,90,-1", *GOOD[5:]], "intensity is negative"),
        ([*GOOD[:4], "0,90,x", *GOOD[5:]], "intensity is not a number"),
        ([*GOOD[:4], "-1,90,1", *GOOD[5:]], "polar_deg is not between"),
        ([*GOOD[:4], "0,361,1", *GOOD[5:]], "azimuth_deg is not between"),
        (table([0, 45], [0, 90, 180], np.ones((3, 2)) + np.eye(3, 2)), "no azimuth in a gap of 180 degrees"),
        (
            table([0, 0.8], [0, 1.57, 3.14, 4.71], np.ones((4, 2)) + np.eye(4, 2)),
            "These look like radians: give degrees",
        ),
        (table([45], [0, 90, 180, 270], np.ones((4, 1))), "one angle to the axis"),
        (table([0, 45], [0, 90, 180, 270], np.zeros((4, 2))), "0 everywhere"),
    ],
)
def test_tables_that_are_no_lamp_are_refused_with_the_reason(tmp_path, lines, why):
    with pytest.raises(InputError, match=why) as refused:
        profile_of(tmp_path, lines)
    assert (refused.value.key, refused.value.file) == ("key", tmp_path / "lamp.csv")


def test_a_line_that_csv_cannot_hold_is_refused(tmp_path):
    with pytest.raises(InputError, match="is no CSV file"):
        profile_of(tmp_path, [HEADER, f'0,0,"{"1" * 200_000}'])
