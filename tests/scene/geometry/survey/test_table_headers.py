"""What headers and remarks of tables say of columns and units is followed, or refused by name."""

import numpy as np
import pytest

from varos_warp.errors import InputError
from varos_warp.scene.description.survey import Heights
from varos_warp.scene.geometry.survey import columns, read_survey
from varos_warp.scene.geometry.survey.content import Request

SWAPPED = "20 10 3\n21 10 4\n20 11 5\n21 11 6\n"
"""Lines of y, x and height."""
POINTS = np.array([[10, 20, 3], [10, 21, 4], [11, 20, 5], [11, 21, 6]], float)


def cloud(folder, text, name="a.csv", **keys):
    (folder / name).write_text(text, encoding="utf-8")
    path = folder / name
    return columns.read_points(Request(path, Heights(kind="heights", file=str(path), **keys), "terrain"))


def survey(folder, text, **keys):
    (folder / "a.csv").write_text(text, encoding="utf-8")
    return read_survey(Heights(kind="heights", file=str(folder / "a.csv"), **keys))


def refusal(folder, text, **keys):
    with pytest.raises(InputError) as caught:
        survey(folder, text, **keys)
    return caught.value


@pytest.mark.parametrize(
    "remark",
    [
        "# y x z\n",
        "# northing, easting, elevation\n",
        "// y x z\n# metres\n",
        "# columns: y x z\n",
        "% y (m) x (m) z (m)\n",
        "#Y\tX\tZ\n",
        "y (m) x (m) z (m)\n",
    ],
)
def test_names_in_a_remark_tell_the_order_of_the_columns(tmp_path, remark):
    np.testing.assert_array_equal(cloud(tmp_path, remark + SWAPPED).points, POINTS)


def test_the_remark_that_numpy_writes_names_the_columns(tmp_path):
    np.savetxt(tmp_path / "b.csv", POINTS[:, [1, 2, 0]], delimiter=",", header="y,z,x")
    np.testing.assert_array_equal(cloud(tmp_path, (tmp_path / "b.csv").read_text()).points, POINTS)


def test_columns_of_a_remark_may_be_named_by_the_scene(tmp_path):
    found = cloud(tmp_path, "# Hoch Rechts Kote\n" + SWAPPED, columns=["rechts", "Hoch", "Kote"])
    np.testing.assert_array_equal(found.points, POINTS)


def test_a_remark_of_degrees_depths_or_another_order_that_cannot_be_placed_is_refused(tmp_path):
    assert "are degrees" in refusal(tmp_path, "# lon lat z\n" + SWAPPED).message
    assert refusal(tmp_path, "# x y depth\n" + SWAPPED).key == "terrain.positive"
    assert refusal(tmp_path, "# the order is northing easting height\n" + SWAPPED).key == "terrain.columns"


def test_a_remark_of_the_usual_order_or_of_none_changes_nothing(tmp_path):
    for remark in ("# x, y and z of a sonar", "# made on a Monday", "#"):
        np.testing.assert_array_equal(cloud(tmp_path, f"{remark}\n{SWAPPED}").points[:, [1, 0, 2]], POINTS)


@pytest.mark.parametrize(
    "text",
    [
        '"y" "x" "z"\n"1" 20 10 3\n"2" 21 10 4\n"3" 20 11 5\n"4" 21 11 6\n',
        "y x z\n1 20 10 3\n2 21 10 4\n3 20 11 5\n4 21 11 6\n",
        '"y","x","z"\n"a","20","10",3\n"b",21,10,4\n"c",20,11,5\n"d",21,11,6\n',
        '"","y","x","z"\n"1",20,10,3\n"2",21,10,4\n"3",20,11,5\n"4",21,11,6\n',
    ],
)
def test_names_of_rows_that_r_writes_shift_no_column(tmp_path, text):
    """write.table gives the column of the rows' names no name of its own; write.csv an empty one."""
    np.testing.assert_array_equal(cloud(tmp_path, text).points, POINTS)


def test_a_separator_at_the_end_of_rows_is_no_column(tmp_path):
    text = "y,x,z\n" + SWAPPED.replace(" ", ",").replace("\n", ",\n")
    np.testing.assert_array_equal(cloud(tmp_path, text).points, POINTS)


@pytest.mark.parametrize("header", ["x y z", "x y z a b c"])
def test_a_header_of_another_number_of_names_is_refused_unless_columns_have_numbers(tmp_path, header):
    text = f"{header}\n0.5 20 10 3 9\n1.5 21 10 4 9\n0.5 20 11 5 9\n1.5 21 11 6 9\n"
    error = refusal(tmp_path, text)
    assert (error.key, "does not name 5 columns" in error.message) == ("terrain.columns", True)
    np.testing.assert_array_equal(cloud(tmp_path, text, columns=[3, 2, 4]).points, POINTS)


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("mm", 1e-3), ("cm", 1e-2), ("km", 1e3), ("fathoms", 1.8288), ("metres", 1.0), ("us_ft", 1200 / 3937)],
)
@pytest.mark.parametrize("written", ["{} [{}]", "{}_{}", "{} ({})"])
def test_the_unit_of_a_column_is_followed(tmp_path, written, unit, metres):
    header = ",".join(written.format(axis, unit) for axis in "yxz")
    keys = {"unit": None} if unit != "us_ft" else {"height_unit": "us_ft"}
    facts = survey(tmp_path, f"{header}\n" + SWAPPED.replace(" ", ","), **keys).facts
    np.testing.assert_allclose(facts["extent_m"], metres * np.array([10, 20, 11, 21]), rtol=1e-12)
    np.testing.assert_allclose(facts["heights_m"], metres * np.array([3, 6]), rtol=1e-12)


def test_heights_may_have_a_unit_of_their_own(tmp_path):
    facts = survey(tmp_path, "y x depth_cm\n" + SWAPPED, positive="down").facts
    np.testing.assert_allclose(facts["heights_m"], [-0.06, -0.03], rtol=1e-12)
    assert facts["extent_m"] == [10, 20, 11, 21]


@pytest.mark.parametrize(
    ("header", "key"),
    [
        ("y [rod] x [rod] z", "terrain.unit"),
        ("y x z [rod]", "terrain.height_unit"),
        ("y [cm] x [mm] z", "terrain.unit"),
        ("y [cm] x [cm] z", "terrain.height_unit"),
        ("y [s] x [s] z [s]", "terrain.unit"),
    ],
)
def test_units_that_are_not_known_or_do_not_agree_are_asked_for(tmp_path, header, key):
    assert refusal(tmp_path, f"{header}\n{SWAPPED}").key == key


def test_a_scale_beside_a_unit_of_the_header_would_count_twice(tmp_path):
    text = f"y x z_cm\n{SWAPPED}"
    assert refusal(tmp_path, text, height_scale=0.01).key == "terrain.height_scale"
    assert survey(tmp_path, text, height_scale=0.01, height_unit="m").facts["heights_m"] == [0.03, 0.06]


@pytest.mark.parametrize("asked", [["lon", "lat", "z"], [1, 2, 3], ["LAT", "lon", "z"]])
@pytest.mark.parametrize("header", ["lon,lat,z", "lon_deg,lat (deg),z", "# lon lat z"])
def test_columns_that_are_chosen_may_not_be_degrees_either(tmp_path, header, asked):
    text = f"{header}\n" + SWAPPED.replace(" ", ",")
    names = [f"{name}_deg" if name == "lon" and "deg" in header else name for name in asked]
    if isinstance(asked[0], str) and "deg" in header:
        names = [{"lon": "lon_deg", "lat": "lat (deg)"}.get(name.lower(), name) for name in asked]
    assert "are degrees" in refusal(tmp_path, text, columns=names).message


def test_longitudes_beside_projected_columns_are_passed_over(tmp_path):
    rows = "".join(f"10.1,63.4,{line}\n" for line in SWAPPED.replace(" ", ",").splitlines())
    np.testing.assert_array_equal(cloud(tmp_path, f"lon,lat,y,x,z\n{rows}").points, POINTS)


@pytest.mark.parametrize("cell", ["", "NA", "nan", "null", '""'])
@pytest.mark.parametrize("separator", [",", "\t", ";"])
def test_an_empty_height_is_a_hole_and_told(tmp_path, separator, cell):
    text = "x,y,z\n0,0,1\n1,0,\n0,1,2\n1,1,3\n2,0,4\n2,1,5\n".replace("1,0,\n", f"1,0,{cell}\n").replace(",", separator)
    found = cloud(tmp_path, text)
    assert found.points[:, 2].tolist() == [1, 2, 3, 4, 5]
    assert found.notes == ["1 of its 6 points have no height"]


def test_an_empty_height_in_the_first_row_or_before_other_columns_shifts_none(tmp_path):
    assert cloud(tmp_path, "x,y,z\n0,0,\n0,1,2\n").points.tolist() == [[0, 1, 2]]
    assert cloud(tmp_path, "x\ty\tz\n0\t0\t\n0\t1\t2\n").points.tolist() == [[0, 1, 2]]
    assert cloud(tmp_path, "x,z,y\n0,,5\n0,1,2\n").points.tolist() == [[0, 2, 1]]


@pytest.mark.parametrize("row", ["1,5,2,3", "1,2", "1,,2,3", ",2,3"])
def test_a_row_with_other_separators_or_without_a_place_is_refused(tmp_path, row):
    assert "cannot be read" in refusal(tmp_path, f"x,y,z\n0,0,1\n{row}\n2,2,2\n").message


@pytest.mark.parametrize("text", [",,,\n1,2,3\n", ";\n;\n", ",\n", "x,y,z\n,,\n", '"\n"\n', "#\n#\n,"])
def test_lines_of_separators_alone_are_refused(tmp_path, text):
    assert refusal(tmp_path, text).key in ("terrain.columns", "terrain.file")
