"""What remarks above recorded poses, and longer names of columns, say of units and ways is followed, or refused."""

import numpy as np
import pytest

from varos_warp.errors import InputError

ROWS = "0 1 2 3 0 0 0 1\n1 4 5 6 0 0 0 1\n"
"""Rows of TUM, unrotated."""
NUMBERS = np.array([[1.0, 2, 3], [4, 5, 6]])
COLUMNS = {"time": 1, "position": [2, 3, 4]}


def refusal(course, text, **keys):
    with pytest.raises(InputError) as caught:
        course(text, **keys)
    assert caught.value.remedy
    return caught.value


def table(header):
    return f"{header}\n0,1,2,3\n1,4,5,6\n"


# -------------------------------------------------------------------------------------------------------------- remarks


@pytest.mark.parametrize(
    "remark", ["# ms mm mm mm 1 1 1 1", "#[ms] [mm] [mm] [mm] [] [] [] []", "# units: ms, mm, mm, mm, -, -, -, -"]
)
@pytest.mark.parametrize("names", ["", "# timestamp tx ty tz qx qy qz qw\n", "timestamp tx ty tz qx qy qz qw\n"])
def test_a_row_of_units_that_fits_the_columns_is_followed(course, names, remark):
    stops = course(f"{remark}\n{names}{ROWS}")
    np.testing.assert_allclose(stops.position, 1e-3 * NUMBERS, rtol=1e-15)
    assert stops.time_ns.tolist() == [0, 1_000_000]


def test_a_row_of_units_against_a_name_of_a_column_is_refused(course):
    error = refusal(course, "# s mm mm mm\n# t x y z_cm\n0 1 2 3\n1 4 5 6\n", attitude="unrotated")
    assert "column 'z_cm' is in 'mm' by the remark in line 1" in error.message


@pytest.mark.parametrize(
    ("remark", "unit"),
    [
        ("# [s] [mm] [mm]", "mm"),
        ("# units: mm", "mm"),
        ("# position in millimetres", "millimetres"),
        ("# t[s] x[mm] y[mm] z[mm] q[xyzw]", "mm"),
        ("# time(ms) x(mm) y(mm) z(mm) quaternion(x,y,z,w)", "ms"),
        ("# z in cm", "cm"),
        ("# UNITS: MM", "mm"),
        ("# X_MM Y_MM", "mm"),
        ("# time in min", "min"),
        ("# t [h]", "h"),
        ("# all in feet", "feet"),
        ("# fathoms", "fathoms"),
        ("# tms xmm", "ms"),
        ("# stamps in us", "us"),
        ("# t/h", "h"),
        ("# unit: in", "in"),
        ("# x in milli metres", "millimetres"),
        ("# mm are units of all of these", "mm"),
    ],
)
def test_a_remark_of_a_unit_that_is_not_followed_is_refused_with_its_line(course, remark, unit):
    error = refusal(course, f"# made by a tracker\n{remark}\n{ROWS}")
    assert (error.line, error.key) == (2, "trajectory.file")
    assert f"may say that its numbers are in {unit}, which is not followed" in error.message


@pytest.mark.parametrize(
    "remark",
    [
        "# all in metres and seconds",
        "# [s] [m] [m] [m]",
        "# in this file",
        "# drift of 3 cm/s",
        "# speeds in cm/s",
        "# in US waters",
        "# min and max",
        "# three days of it",
        "# aboard MS Fram",
        "# quaternions, not degrees",
    ],
)
def test_a_remark_of_other_things_or_of_the_unit_that_is_used_changes_nothing(course, remark):
    stops = course(f"{remark}\n{ROWS}", of="vehicle")
    np.testing.assert_array_equal(stops.position, NUMBERS)
    assert stops.messages == ()


@pytest.mark.parametrize("remark", ["# accurate to 5 mm", "# was in mm, now in metres"])
def test_a_remark_of_a_unit_that_may_mean_something_else_is_told_of(course, remark):
    (told,) = course(f"{remark}\n{ROWS}", of="vehicle").messages
    assert "the remark in line 1" in told
    assert "trajectory.columns.position_unit" in told


@pytest.mark.parametrize("remark", ["# hours since start", "# time, minutes"])
def test_a_remark_of_times_with_a_word_for_a_unit_is_told_of(course, remark):
    (told,) = course(f"{remark}\n{ROWS}", of="vehicle").messages
    assert "trajectory.columns.time_unit" in told


def test_words_that_are_as_many_as_numbered_columns_are_looked_at_for_units(course):
    error = refusal(course, table("# mm are used here"), columns=COLUMNS, attitude="unrotated")
    assert (error.line, "in mm, which is not followed" in error.message) == (1, True)


def test_the_line_that_tells_spreadsheets_the_separator_is_passed_over(course):
    stops = course("sep=;\n" + table("t;x;y;z").replace(",", ";"), attitude="unrotated")
    np.testing.assert_array_equal(stops.position, NUMBERS)


def test_a_z_that_is_taken_for_a_depth_by_its_neighbours_is_told_of(course):
    columns = {"time": "t", "position": ["n", "e", "z"]}
    (told,) = course(table("t,n,e,z"), columns=columns, attitude="unrotated").messages
    assert "'z' is taken for a depth" in told
    assert course(table("t,n,e,z"), columns=columns, attitude="unrotated", frame="ned").messages == ()


def test_a_unit_that_the_scene_or_the_header_states_needs_no_remark(course):
    text = "# all in mm\n0,1,2,3\n1,4,5,6\n"
    for unit, metres in (("mm", 1e-3), ("m", 1.0), ("us_ft", 1200 / 3937)):
        stops = course(text, columns=COLUMNS | {"position_unit": unit, "time_unit": "s"}, attitude="unrotated")
        np.testing.assert_allclose(stops.position, metres * NUMBERS, rtol=1e-15)
        assert stops.messages == ()
    stops = course(f"# drawings are in mm\n{table('t [s],x [cm],y [cm],z [cm]')}", attitude="unrotated")
    np.testing.assert_allclose(stops.position, 1e-2 * NUMBERS, rtol=1e-15)


def test_a_stated_unit_against_that_of_a_name_is_refused(course):
    columns = {"time": "t", "position": ["x_cm", "y_cm", "z_cm"], "position_unit": "mm"}
    error = refusal(course, table("t,x_cm,y_cm,z_cm"), columns=columns, attitude="unrotated")
    assert "column 'x_cm' is in cm by its name, in mm by columns.position_unit" in error.message


@pytest.mark.parametrize(("form", "remark"), [("euler", "# angles in degrees"), ("euler_deg", "# roll etc. [rad]")])
def test_a_remark_of_the_other_unit_of_angles_is_refused(course, form, remark):
    error = refusal(course, f"{remark}\n0,1,2,3,0,0,1\n1,4,5,6,0,0,1\n", columns=COLUMNS | {form: [5, 6, 7]})
    assert error.line == 1


@pytest.mark.parametrize("remark", ["# clock,N,E,D,roll,pitch,yaw", "# clock N E D roll pitch yaw"])
def test_a_remark_of_as_many_names_as_numbered_columns_is_their_header(course, remark):
    text = f"# course 7\n{remark}\n0,1,2,3,0,0,1\n1,4,5,6,0,0,1\n"
    error = refusal(course, text, columns=COLUMNS | {"euler_deg": [5, 6, 7]})
    assert (error.line, "are ned by the names" in error.message) == (2, True)
    stops = course(text, columns=COLUMNS | {"euler_deg": [5, 6, 7]}, frame="ned")
    np.testing.assert_array_equal(stops.position, NUMBERS[:, [1, 0, 2]] * [1, 1, -1])


# ---------------------------------------------------------------------------------------------------------------- names


@pytest.mark.parametrize("name", ["x_mm_ned", "mm_x", "xmm", "X_MM_UTM", "x.mm.map"])
def test_a_unit_inside_the_name_of_a_position_is_refused_unless_it_is_stated(course, name):
    text = table(f"t,{name},b,c")
    error = refusal(course, text, columns={"time": "t", "position": [2, 3, 4]}, attitude="unrotated", frame="ned")
    assert f"column '{name}' may be in 'mm' by its name" in error.message
    stops = course(
        text, columns={"time": "t", "position": [2, 3, 4], "position_unit": "mm"}, attitude="unrotated", frame="ned"
    )
    np.testing.assert_allclose(stops.position, 1e-3 * NUMBERS[:, [1, 0, 2]] * [1, 1, -1], rtol=1e-15)


@pytest.mark.parametrize("name", ["timestamp_ms_utc", "tms", "ms_since_start", "timestampMs"])
def test_a_unit_inside_the_name_of_a_time_is_refused_unless_it_is_stated(course, name):
    columns = {"time": name, "position": ["x", "y", "z"]}
    error = refusal(course, table(f"{name},x,y,z"), columns=columns, attitude="unrotated")
    assert f"column '{name}' may be in 'ms' by its name" in error.message
    stops = course(table(f"{name},x,y,z"), columns=columns | {"time_unit": "ms"}, attitude="unrotated")
    assert stops.time_ns.tolist() == [0, 1_000_000]


@pytest.mark.parametrize(("form", "name"), [("euler", "roll_mrad_body"), ("euler_deg", "roll_cdeg_body")])
def test_a_unit_inside_the_name_of_an_angle_is_refused(course, form, name):
    text = f"t,x,y,z,{name},b,c\n0,1,2,3,0,0,1\n1,4,5,6,0,0,1\n"
    assert "by its name" in refusal(course, text, columns=COLUMNS | {form: [5, 6, 7]}).message


def test_metres_inside_a_name_are_metres(course):
    stops = course(table("t,x_metres_map,b,c"), columns=COLUMNS, attitude="unrotated")
    np.testing.assert_array_equal(stops.position, NUMBERS)


@pytest.mark.parametrize("names", ["n,e,altitude", "north,east,alt_msl", "n,e,z_up"])
def test_altitudes_are_no_depths(course, names):
    columns = {"time": "t", "position": names.split(",")}
    for keys in ({}, {"frame": "ned"}):
        error = refusal(course, table(f"t,{names}"), columns=columns, attitude="along_path", **keys)
        assert "columns of the position are" in error.message


@pytest.mark.parametrize("names", ["x,y,depth", "north,y,depth", "x,y,z_down"])
def test_a_depth_alone_does_not_say_which_columns_are_north_and_east(course, names):
    columns = {"time": "t", "position": names.split(",")}
    error = refusal(course, table(f"t,{names}"), columns=columns, attitude="along_path")
    assert "do not both say whether they are north or east" in error.message
    stops = course(table(f"t,{names}"), columns=columns, attitude="along_path", frame="ned")
    np.testing.assert_array_equal(stops.position, NUMBERS[:, [1, 0, 2]] * [1, 1, -1])


@pytest.mark.parametrize(
    "names",
    [
        "x_north,y_east,z_down",
        "north_x,east_y,down_z",
        "x_ned,y_ned,z_ned",
        "ned_x,ned_y,ned_z",
        "pn,pe,pd",
        "PosN,PosE,PosD",
        "posNorth,posEast,posDown",
    ],
)
def test_names_that_say_ned_in_other_words_are_followed_or_need_the_frame(course, names):
    columns = {"time": "t", "position": names.split(",")}
    stops = course(table(f"t,{names}"), columns=columns, attitude="along_path")
    np.testing.assert_array_equal(stops.position, NUMBERS[:, [1, 0, 2]] * [1, 1, -1])
    text = f"t,{names},w,i,j,k\n0,1,2,3,1,0,0,0\n1,4,5,6,1,0,0,0\n"
    error = refusal(course, text, columns=columns | {"quaternion": ["w", "i", "j", "k"]})
    assert "its positions are ned by the names of their columns, not enu" in error.message


@pytest.mark.parametrize(
    ("whole", "part"),
    [("stamp.sec", "stamp.nanosec"), ("head.stamp.secs", "head.stamp.nsecs"), ("sec", "nanosec"), ("t_sec", "t_usec")],
)
def test_whole_seconds_beside_a_column_of_their_parts_are_refused(course, whole, part):
    text = f"{whole},{part},x,y,z\n0,5,1,2,3\n1,5,4,5,6\n"
    error = refusal(course, text, columns={"time": whole, "position": ["x", "y", "z"]}, attitude="unrotated")
    assert f"'{part}' the rest of the time" in error.message
    refusal(course, text, attitude="unrotated")
