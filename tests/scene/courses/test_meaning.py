"""What headers of recorded courses say of units, order and axes is followed, or refused by name."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError

PLACES = "0 1 2 3 0 0 0 1\n1 4 5 6 0 0 0 1\n"
"""Rows of TUM, unrotated."""
W_FIRST = "0 1 2 3 1 0 0 0\n1 4 5 6 1 0 0 0\n"
YAWED = Rotation.from_euler("z", 90, degrees=True)
COLUMNS = {"time": "t", "position": ["x", "y", "z"]}


def refusal(course, text, **keys):
    with pytest.raises(InputError) as caught:
        course(text, **keys)
    return caught.value


# -------------------------------------------------------------------------------------------------------------- units


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("mm", 1e-3), ("cm", 1e-2), ("ft", 0.3048), ("km", 1e3), ("M", 1.0), ("inch", 0.0254), ("fathoms", 1.8288)],
)
@pytest.mark.parametrize("written", ["x [{}]", "x {}", "x({})", "x_{}", "x/{}", "x..{}."])
def test_the_unit_of_a_column_of_the_position_is_followed(course, written, unit, metres):
    names = [written.format(unit).replace("x", axis, 1) for axis in "xyz"]
    text = f"t,{','.join(names)}\n0,1,2,3\n1,4,5,6\n"
    np.testing.assert_allclose(
        course(text, attitude="unrotated").position, metres * np.array([[1, 2, 3], [4, 5, 6]]), rtol=1e-15
    )


def test_columns_of_one_position_may_have_different_units_and_be_chosen_by_number(course):
    text = "t,n,a [cm],b [m],c [ft]\n0,9,100,2,10\n1,9,200,3,20\n"
    stops = course(text, columns={"time": 1, "position": [3, 4, 5]}, attitude="unrotated")
    np.testing.assert_allclose(stops.position, [[1, 2, 3.048], [2, 3, 6.096]], rtol=1e-15)


@pytest.mark.parametrize(
    ("header", "says"),
    [
        ("t,x [furlong],y [furlong],z [furlong]", "column 'x [furlong]' is in 'furlong', which is no unit of length"),
        ("t,x [s],y [m],z [m]", "column 'x [s]' is in 's', which is no unit of length"),
        ("t,x [deg],y [deg],z [m]", "column 'x [deg]' holds degrees"),
        ("t,lon,lat,z", "column 'lon' holds degrees"),
        ("t,Latitude (deg),Longitude (deg),depth", "holds degrees"),
        ("t (ticks),x,y,z", "column 't (ticks)' is in 'ticks', which is no unit of time"),
        ("t [m],x,y,z", "column 't [m]' is in 'm', which is no unit of time"),
    ],
)
def test_a_unit_that_is_not_known_is_refused_by_name(course, header, says):
    error = refusal(course, f"{header}\n0,1,2,3\n1,4,5,6\n", attitude="unrotated")
    assert says in error.message
    assert (error.line, error.key) == (1, "trajectory.file")
    assert error.remedy


def test_degrees_are_refused_for_columns_that_the_scene_names_or_numbers_too(course):
    text = "t,lon,lat,z\n0,10,63,3\n1,10,63,4\n"
    for position in (["lon", "lat", "z"], [2, 3, 4]):
        found = refusal(course, text, columns={"time": "t", "position": position}, attitude="unrotated")
        assert "holds degrees" in found.message


@pytest.mark.parametrize(
    ("name", "second_ns"),
    [
        ("t [min]", 60 * 10**9),
        ("t (h)", 3600 * 10**9),
        ("time_hours", 3600 * 10**9),
        ("t/ms", 10**6),
        ("stamp [\u03bcs]", 10**3),
        ("t_h", 3600 * 10**9),
        ("time [days]", 86400 * 10**9),
    ],
)
def test_times_in_other_units_are_nanoseconds_without_rounding(course, name, second_ns):
    stops = course(f"{name},x,y,z\n0.1,0,0,0\n0.3,1,0,0\n1.1,1,0,0\n", attitude="unrotated")
    assert stops.time_ns.tolist() == [0, second_ns // 5, second_ns]


def test_a_unit_of_time_that_is_not_known_may_be_stated(course):
    columns = COLUMNS | {"time": "t (ticks)", "time_unit": "min"}
    stops = course("t (ticks),x,y,z\n0,0,0,0\n1,1,0,0\n", columns=columns, attitude="unrotated")
    assert stops.time_ns.tolist() == [0, 60 * 10**9]


@pytest.mark.parametrize(
    ("form", "unit", "value"),
    [
        ("euler", "rad", np.pi / 2),
        ("euler", "mrad", 500 * np.pi),
        ("euler_deg", "deg", 90),
        ("euler_deg", "cdeg", 9000),
        ("euler_deg", "\xb0", 90),
        ("euler_deg", "gon", 100),
    ],
)
@pytest.mark.parametrize("by_number", [False, True])
def test_the_unit_of_angles_is_followed_within_its_kind(course, form, unit, value, by_number):
    names = [f"{angle} [{unit}]" for angle in ("roll", "pitch", "yaw")]
    row = f"0,0,{value!r}".replace("np.float64(", "").replace(")", "")
    stops = course(
        f"t,x,y,z,{','.join(names)}\n0,0,0,0,{row}\n1,0,0,0,{row}\n",
        columns=COLUMNS | {form: [5, 6, 7] if by_number else names},
        of="imu",
        vehicle={"imu": {}},
    )
    np.testing.assert_allclose(stops.attitude.as_matrix()[0], YAWED.as_matrix(), atol=1e-12)


@pytest.mark.parametrize(
    ("form", "unit", "says"),
    [
        ("euler", "deg", "columns.euler is in radians"),
        ("euler_deg", "rad", "columns.euler_deg is in degrees"),
        ("euler_deg", "turns", "is in 'turns', which is no unit of angle"),
        ("euler", "gon", "columns.euler is in radians"),
    ],
)
@pytest.mark.parametrize("by_number", [False, True])
def test_a_unit_of_angles_of_the_other_kind_is_refused(course, form, unit, says, by_number):
    names = [f"{angle} [{unit}]" for angle in ("roll", "pitch", "yaw")]
    text = f"t,x,y,z,{','.join(names)}\n0,0,0,0,0,0,1\n1,0,0,0,0,0,1\n"
    error = refusal(course, text, columns=COLUMNS | {form: [5, 6, 7] if by_number else names})
    assert says in error.message


# ------------------------------------------------------------------------------------------------- headers and remarks


@pytest.mark.parametrize(
    "remarks",
    [
        "# timestamp tx ty tz qw qx qy qz\n# all in metres and seconds\n",
        "# timestamp, tx, ty, tz, qw, qx, qy, qz\n",
        "#format: timestamp tx ty tz qw qx qy qz\n",
        "# t [s] x [m] y [m] z [m] qw qx qy qz\n#\n# end of head\n",
        "t x y z qw qx qy qz\n",
        "t (s) x (m) y (m) z (m) qw () qx () qy () qz ()\n",
        "# made by a tracker\n# timestamp(s) tx(m) ty(m) tz(m) qw qx qy qz\n# x\n",
    ],
)
def test_names_above_blanks_tell_the_order_of_the_quaternion_wherever_they_stand(course, remarks):
    np.testing.assert_allclose(course(remarks + W_FIRST, body="rfu").attitude.as_matrix(), [np.eye(3)] * 2, atol=1e-15)


@pytest.mark.parametrize(
    "remark",
    [
        "# quaternions are qw qx qy qz",
        "# 8 columns, orientation wxyz",
        "# time x y z w x y z",
        "# scalar first",
        "# q_w, q_x, q_y, q_z in the world",
    ],
)
def test_a_remark_of_another_order_than_that_of_tum_is_not_passed_over(course, remark):
    error = refusal(course, f"{remark}\n{W_FIRST}")
    assert (error.line, error.key) == (1, "trajectory.file")
    assert "quaternion: [5, 6, 7, 8]" in error.remedy


@pytest.mark.parametrize(
    "remark",
    [
        "# quaternions are qx qy qz qw",
        "# orientation xyzw",
        "# time x y z x y z w",
        "# the x, y and z axes of a world",
        "# all w.r.t. x, y, z of the map",
    ],
)
def test_a_remark_of_the_order_of_tum_or_of_none_changes_nothing(course, remark):
    assert course(f"{remark}\n{PLACES}", body="rfu").about["format"] == "TUM"


# ------------------------------------------------------------------------------------------------------ order and axes


@pytest.mark.parametrize(
    "names",
    [
        ["yaw", "pitch", "roll"],
        ["roll", "yaw", "pitch"],
        ["psi", "theta", "phi"],
        ["heading", "pitch", "roll"],
        ["rz", "ry", "rx"],
    ],
)
@pytest.mark.parametrize("by_number", [False, True])
def test_names_of_angles_in_another_order_than_they_turn_are_refused(course, names, by_number):
    text = f"t,x,y,z,{','.join(names)}\n0,0,0,0,0,0,90\n1,0,0,0,0,0,90\n"
    error = refusal(course, text, columns=COLUMNS | {"euler_deg": [5, 6, 7] if by_number else names})
    assert f"by their names: {', '.join(names)}" in error.message
    assert "euler_order" in error.remedy


def test_names_in_the_order_in_which_they_turn_are_read(course):
    """Yaw, pitch and roll of aviation, about the turned axes z, y, x, are roll, pitch and yaw about fixed x, y, z."""
    text = "t,x,y,z,yaw,pitch,roll\n0,0,0,0,30,20,10\n1,0,0,0,30,20,10\n"
    one = course(text, columns=COLUMNS | {"euler_deg": ["yaw", "pitch", "roll"], "euler_order": "ZYX"})
    other = course(text, columns=COLUMNS | {"euler_deg": ["roll", "pitch", "yaw"]})
    np.testing.assert_allclose(one.attitude.as_matrix(), other.attitude.as_matrix(), atol=1e-15)


def test_roll_of_a_body_whose_x_axis_points_right_is_about_y(course):
    text = "t,x,y,z,pitch,roll,yaw\n0,0,0,0,0,0,0\n1,0,0,0,0,0,0\n"
    course(text, columns=COLUMNS | {"euler_deg": ["pitch", "roll", "yaw"]}, body="rfu")
    error = refusal(course, text, columns=COLUMNS | {"euler_deg": ["roll", "pitch", "yaw"]}, body="rfu")
    assert "about y, x, z of a body rfu" in error.message


@pytest.mark.parametrize(
    ("names", "order"),
    [
        ("northing,easting,depth", [1, 0, 2]),
        ("easting,northing,depth", [0, 1, 2]),
        ("n,e,d", [1, 0, 2]),
        ("E [m],N [m],Depth [m]", [0, 1, 2]),
        ("pos_n,pos_e,pos_d", [1, 0, 2]),
    ],
)
def test_names_that_say_north_east_and_depth_are_followed_where_there_are_no_attitudes(course, names, order):
    stops = course(f"t,{names}\n0,1,2,3\n1,4,5,6\n", attitude="along_path")
    numbers = np.array([[1, 2, 3], [4, 5, 6]])[:, order] * [1, 1, -1]
    np.testing.assert_array_equal(stops.position, numbers)
    assert stops.about["frame"] == "ned"


@pytest.mark.parametrize("names", ["easting,northing,height", "east,north,up", "E,N,U", "utm_e,utm_n,elevation"])
def test_names_that_say_east_north_and_height_are_our_axes(course, names):
    stops = course(f"t,{names},qw,qx,qy,qz\n0,1,2,3,1,0,0,0\n1,4,5,6,1,0,0,0\n")
    np.testing.assert_array_equal(stops.position, [[1, 2, 3], [4, 5, 6]])


def test_depths_beside_attitudes_need_a_word_for_the_frame_of_both(course):
    text = "t,northing,easting,depth,qw,qx,qy,qz\n0,1,2,3,1,0,0,0\n1,4,5,6,1,0,0,0\n"
    assert "trajectory.frame: ned" in refusal(course, text).remedy
    np.testing.assert_array_equal(course(text, frame="ned").position, [[2, 1, -3], [5, 4, -6]])


@pytest.mark.parametrize(
    ("position", "frame"),
    [
        (["e", "n", "d"], "ned"),
        (["e", "n", "d"], None),
        (["n", "e", "d"], "enu"),
        (["n", "e", "u"], None),
        (["n", "e", "u"], "enu"),
        ([2, 3, 5], None),
    ],
)
def test_columns_that_point_other_ways_than_the_frame_are_refused(course, position, frame):
    text = "t,e,n,u,d\n0,1,2,3,-3\n1,4,5,6,-6\n"
    keys = {} if frame is None else {"frame": frame}
    error = refusal(course, text, columns={"time": "t", "position": position}, attitude="unrotated", **keys)
    assert re.search(r"columns of the position are .*, but of frame", error.message)


# -------------------------------------------------------------------------------------------------------------- doubts


@pytest.mark.parametrize(
    ("frame", "name", "told"),
    [("enu", "heading", True), ("enu", "yaw", False), ("ned", "heading", False), ("enu", "Hdg [deg]", True)],
)
def test_a_heading_that_would_be_read_from_east_is_told_of(course, frame, name, told):
    text = f"t,x,y,z,roll,pitch,{name}\n0,0,0,0,0,0,90\n1,0,0,0,0,0,90\n"
    messages = course(text, columns=COLUMNS | {"euler_deg": [5, 6, 7]}, frame=frame).messages
    assert ["clockwise from north" in words for words in messages] == [True] * told


def test_what_is_taken_for_granted_of_tum_and_euroc_is_told(course):
    (tum,) = course(PLACES).messages
    assert "mostly those of a camera, and taken for the vehicle's in axes flu" in tum
    euroc = "#timestamp,p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
    (told,) = course(euroc + W_FIRST.replace(" ", ",")).messages
    assert "mostly those of an IMU" in told
    assert "trajectory.of: imu" in told
    for keys in ({"of": "vehicle"}, {"of": "M0"}, {"body": "flu"}, {"attitude": "unrotated"}):
        assert course(PLACES, **keys).messages == ()


@pytest.mark.parametrize(("rolls", "told"), [((0, 0, 180), False), ((0, 170, 180), True), ((90, 90, 90), False)])
def test_a_vehicle_that_is_upside_down_most_of_the_time_is_told_of(course, rolls, told):
    rows = "".join(f"{k},{k},0,0,{roll}\n" for k, roll in enumerate(rolls))
    text = f"t,x,y,z,roll\n{rows}".replace("roll\n", "roll,pitch,yaw\n").replace("0\n", "0,0,0\n")
    messages = course(text, columns=COLUMNS | {"euler_deg": ["roll", "pitch", "yaw"]}).messages
    assert [("upside down at 67%" in words) for words in messages] == [True] * told


@pytest.mark.parametrize(
    ("key", "value"),
    [("speed", 1.0), ("max_acceleration", 2.0), ("dwell_s", 1.0), ("overlap", 0.1), ("max_angular_speed_deg", 10.0)],
)
def test_keys_for_waypoints_are_refused_beside_a_file(course, key, value):
    error = refusal(course, PLACES, **{key: value})
    assert f"{key}: for waypoints" in error.message
    assert error.key.startswith("trajectory")
