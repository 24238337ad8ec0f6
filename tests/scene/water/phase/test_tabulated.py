"""Tables of phase functions: what they become, and which are refused."""

import numpy as np
import pytest

import varos_warp as vw
from varos_warp.errors import InputError
from varos_warp.scene.water.phase.fournier_forand import FournierForand
from varos_warp.scene.water.phase.tabulated import Tabulated

SCENE = """\
water: {coefficients: {sigma_s: [0.2, 0.2, 0.2], sigma_a: [0.1, 0.1, 0.1], phase: {kind: tabulated, file: vsf.csv}}}
trajectory: {poses: [{position: [0, 0, 0]}]}
"""


def s_at(degrees):
    return np.sin(0.5 * np.radians(np.asarray(degrees, float))) ** 2


def phase_of(tmp_path, table: str | None):
    (tmp_path / "scene.yaml").write_text(SCENE)
    if table is not None:
        (tmp_path / "vsf.csv").write_text(table)
    return vw.phase_function(vw.load_scene(tmp_path / "scene.yaml"))


def test_a_table_of_a_known_function_becomes_that_function(tmp_path):
    """Fine rows of Fournier and Forand's, in another scale."""
    known = FournierForand(1.10, 3.5835)
    angles = np.geomspace(0.01, 180.0, 2000)
    rows = [f"{a:.10g},{p:.10g}" for a, p in zip(angles, 7.0 * known.eval_s(s_at(angles)), strict=True)]
    phase = phase_of(tmp_path, "angle_deg,p\n" + "\n".join(rows))
    assert phase.integral == pytest.approx(7.0, rel=1e-4)
    np.testing.assert_allclose(
        phase.eval_s(s_at([0.001, 1, 30, 90, 179])), known.eval_s(s_at([0.001, 1, 30, 90, 179])), rtol=1e-3
    )
    np.testing.assert_allclose(phase.moments(64), known.moments(64), atol=1e-4)


def test_between_rows_and_beyond_them(tmp_path):
    phase = phase_of(tmp_path, "# measured\nangle_deg , sd, p\n1, 0.1, 100\n\n10, 0.1, 1\n90, 0.1, 0.01\n170,, 0.02\n")
    assert isinstance(phase, Tabulated)
    p = phase.eval_s(s_at([1, 10**0.5, 10, 30, 90, 170, 175, 180])) * phase.integral
    between = 0.01 ** (np.log(3) / np.log(9))
    np.testing.assert_allclose(p, [100, 10, 1, between, 0.01, 0.02, 0.02, 0.02], rtol=1e-9)
    ahead = phase.eval_s(s_at([0.01, 0.1])) / phase.eval_s(s_at([0.1, 1.0]))
    np.testing.assert_allclose(ahead, 10**1.9, rtol=1e-4)  # a slope of -2 would be light without end
    facts = phase.describe()
    assert facts["integral"] == pytest.approx(phase.integral)
    assert 0.0 < facts["share_behind_last_row"] < 1e-3 < facts["share_ahead_of_first_row"] < 1.0


def test_a_table_may_begin_straight_ahead_and_hold_zeros():
    phase = Tabulated([0.0, 90.0, 120.0, 180.0], [1.0, 1.0, 0.0, 0.0])
    p = phase.eval_s(s_at([0.0, 45.0, 120.0, 180.0])) * phase.integral
    np.testing.assert_allclose(p, [1.0, 1.0, 1e-6, 1e-6])
    assert phase.moments(0)[0] == pytest.approx(1.0)


def test_the_key_depends_on_the_rows_alone(tmp_path):
    one, same, other = (Tabulated([0.1, 180.0], [9.0, last]) for last in (1.0, 1.0, 2.0))
    assert one.key == same.key != other.key
    assert hash(one.key) == hash(same.key)


GOOD = "angle_deg,p\n0.1,5\n10,1\n180,0.1\n"


@pytest.mark.parametrize(
    ("table", "line", "value", "says"),
    [
        (None, None, None, "there is no such table"),
        ("", None, None, "has no column angle_deg and p"),
        ("angle,p\n1,2\n2,3\n", None, None, "has no column angle_deg"),
        ("angle_deg,p\n1,2\n", None, None, "has 1 row of numbers"),
        (GOOD.replace("10,1", "10,-1"), 3, -1.0, "p is negative"),
        (GOOD.replace("10,1", "10,"), 3, "", "p is missing"),
        (GOOD.replace("10,1", "10"), 3, "", "p is missing"),
        (GOOD.replace("10,1", "10,nan"), 3, "nan", "p is missing"),
        (GOOD.replace("10,1", ",1"), 3, "", "angle_deg is missing"),
        (GOOD.replace("10,1", "ten,1"), 3, "ten", "angle_deg is not a number"),
        (GOOD.replace("10,1", "0.1,1"), 3, 0.1, "angle_deg does not increase"),
        (GOOD.replace("10,1", "0.01,1"), 3, 0.01, "angle_deg does not increase"),
        (GOOD.replace("180,", "181,"), 4, 181.0, "angle_deg is not between 0 and 180"),
        (GOOD.replace("0.1,5", "-0.1,5"), 2, -0.1, "angle_deg is not between 0 and 180"),
        (GOOD.replace("0.1,5", "0,5").replace("10,1", "0.00001,1"), 3, 1e-5, "has two angles up to 0.0001 degrees"),
        ("angle_deg,p\n1,0\n2,0\n", None, None, "p is 0 everywhere"),
    ],
)
def test_a_bad_table_is_named_with_file_line_key_value_and_remedy(tmp_path, table, line, value, says):
    with pytest.raises(InputError) as caught:
        phase_of(tmp_path, table)
    error = caught.value
    assert (error.file.name, error.line, error.value) == ("vsf.csv", line, value)
    assert error.key == "water.coefficients.phase.file"
    assert says in error.message
    assert error.remedy
    assert "\n" not in error.message


def test_a_table_in_another_encoding_is_refused(tmp_path):
    (tmp_path / "vsf.csv").write_bytes(b"\xff\xfe\x00a")
    with pytest.raises(InputError, match="not a text file"):
        phase_of(tmp_path, None)
