"""What remarks and longer names of text files of points say of units and columns is followed, or refused by name."""

import numpy as np
import pytest

from varos_warp.errors import InputError
from varos_warp.scene.description.survey import Heights
from varos_warp.scene.geometry.survey import read_survey

POINTS = "10 20 3\n10 21 4\n11 20 5\n11 21 6\n"


@pytest.fixture
def survey(tmp_path):
    """Reads a text as points, with keys of the block."""

    def read(text, **keys):
        (tmp_path / "a.csv").write_text(text, encoding="utf-8")
        return read_survey(Heights(kind="heights", file=str(tmp_path / "a.csv"), **keys))

    return read


def refusal(survey, text, **keys):
    with pytest.raises(InputError) as caught:
        survey(text, **keys)
    assert caught.value.remedy
    return caught.value


@pytest.mark.parametrize("first", [(10, 20, 30, 40), (0, 1, 2, 3), (2, 3, 4, 5), (1, 2, 3, 5)])
def test_whole_numbers_that_do_not_count_up_from_one_are_no_names_of_rows(survey, first):
    rows = "".join(f"{number} {line}\n" for number, line in zip(first, POINTS.splitlines(), strict=True))
    error = refusal(survey, f"x y z\n{rows}")
    assert (error.key, "does not name 4 columns" in error.message) == ("terrain.columns", True)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_the_index_that_pandas_writes_shifts_no_column(survey, separator):
    rows = "".join(f"{i} {line}\n" for i, line in enumerate(POINTS.splitlines()))
    facts = survey(f" y x z\n{rows}".replace(" ", separator)).facts
    assert facts["extent_m"] == [20, 10, 21, 11]


@pytest.mark.parametrize("remark", ["# a b z_cm", "# m m cm", "# [m] [m] [cm]", "# units: m, m, cm"])
def test_names_and_units_of_numbered_columns_are_followed(survey, remark):
    facts = survey(f"{remark}\n{POINTS}", columns=[1, 2, 3]).facts
    np.testing.assert_allclose(facts["heights_m"], [0.03, 0.06], rtol=1e-12)
    assert facts["extent_m"] == [10, 20, 11, 21]


def test_a_row_of_units_belongs_to_the_header_above_or_below_it(survey):
    facts = survey(f"# [m] [m] [cm]\nx y z\n{POINTS}").facts
    np.testing.assert_allclose(facts["heights_m"], [0.03, 0.06], rtol=1e-12)
    error = refusal(survey, f"# [m] [m] [cm]\nx y z_mm\n{POINTS}")
    assert "column 'z_mm' is in 'cm' by a remark" in error.message


@pytest.mark.parametrize(
    ("remark", "unit"),
    [
        ("# units: mm", "mm"),
        ("# depths in fathoms", "fathoms"),
        ("# z in cm", "cm"),
        ("// heights: feet", "feet"),
        ("# zcm", "cm"),
    ],
)
@pytest.mark.parametrize("header", ["", "x y z\n"])
def test_a_remark_of_a_unit_that_is_not_followed_is_refused_with_its_line(survey, header, remark, unit):
    error = refusal(survey, f"# a sonar\n{remark}\n{header}{POINTS}")
    assert error.key == "terrain.unit"
    assert "line 2" in error.message
    assert f"its numbers are in {unit}, which is not followed" in error.message


def test_a_remark_of_a_unit_is_passed_over_where_the_block_or_the_header_states_one(survey):
    for text, keys in ((f"# z in cm\n{POINTS}", {"unit": "m"}), (f"# made in mm\nx_m y_m z_m\n{POINTS}", {})):
        assert not any("not followed" in words for words in survey(text, **keys).warnings)


@pytest.mark.parametrize(
    ("text", "keys"), [(f"# cells of 5 cm\n{POINTS}", {}), (f"# z in cm\n{POINTS}", {"height_scale": 0.01})]
)
def test_a_remark_of_a_unit_that_may_mean_something_else_is_told_of(survey, text, keys):
    assert any("in cm, which is not followed" in words for words in survey(text, **keys).warnings)


def test_a_remark_of_degrees_above_coordinates_that_may_be_degrees_is_refused(survey):
    assert refusal(survey, f"# decimal degrees\n{POINTS}").key == "terrain.unit"
    assert refusal(survey, f"# lat and lon of WGS 84\n{POINTS}").key == "terrain.unit"
    survey("# slopes are in degrees\n" + POINTS.replace("10 ", "5000 ").replace("11 ", "5001 "))


@pytest.mark.parametrize("name", ["z_mm_MSL", "mm_z", "zmm"])
def test_a_unit_inside_the_name_of_a_height_is_refused_unless_it_is_stated(survey, name):
    error = refusal(survey, f"x y {name}\n{POINTS}", columns=[1, 2, 3])
    assert (error.key, f"{name} has 'mm'" in error.message) == ("terrain.height_unit", True)
    facts = survey(f"x y {name}\n{POINTS}", columns=[1, 2, 3], height_unit="m", height_scale=0.001).facts
    np.testing.assert_allclose(facts["heights_m"], [0.003, 0.006], rtol=1e-12)


@pytest.mark.parametrize("header", ["x;y;z\n", ""])
def test_the_line_that_tells_spreadsheets_the_separator_is_passed_over(survey, header):
    assert survey(f"sep=;\n{header}" + POINTS.replace(" ", ";")).facts["extent_m"] == [10, 20, 11, 21]
