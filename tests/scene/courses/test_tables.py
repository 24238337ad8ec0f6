"""Tables of poses are read as their formats say, to the nanosecond and the last digit, or refused by file and line."""

import re
import tracemalloc

import numpy as np
import pytest
from evo.tools import file_interface

from varos_warp.errors import InputError

TUM = """# ground truth
# timestamp tx ty tz qx qy qz qw
1403636579.763555527 1.5 -2.25 3.125 0.5 0.5 0.5 0.5
1403636579.768555527 1.75 -2 3 -0.5 -0.5 -0.5 -0.5
1403636580.013555527 2e0 -2 3 0 0 0 1
"""
VICON = """#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []
1403636579763555584,1.5,-2.25,3.125,0.5,0.5,0.5,0.5
1403636579768555584,1.75,-2,3,-0.5,-0.5,-0.5,-0.5
1403636580013555584,2,-2,3,1,0,0,0
"""
STATES = (
    VICON.replace("#timestamp [ns]", "#timestamp")
    .replace("q_RS_z []", "q_RS_z [], v_RS_R_x [m s^-1]")
    .replace("0.5\n", "0.5, 0.125\n")
    .replace("0,0,0\n", "0,0,0,1\n")
)
TABLE = """t_ms;label;north;east;down;w;x;y;z
1000;a;1.5;-2.25;3.125;0.5;0.5;0.5;0.5
1005;b;1.75;-2;3;-0.5;-0.5;-0.5;-0.5
1250;c;2;-2;3;1;0;0;0
"""
COLUMNS = {"time": "t_ms", "position": ["north", "east", "down"], "quaternion": ["w", "x", "y", "z"]}
PLACES = np.array([[1.5, -2.25, 3.125], [1.75, -2, 3], [2, -2, 3]])
QUATERNIONS = np.array([[0.5, 0.5, 0.5, 0.5], [0.5, 0.5, 0.5, 0.5], [1, 0, 0, 0]])
TIMES = [0, 5_000_000, 250_000_000]


def quaternions(stops):
    return stops.attitude.as_quat(canonical=True, scalar_first=True)


# -------------------------------------------------------------------------------------------------------- the formats


@pytest.mark.parametrize(
    ("text", "form"), [(TUM, "TUM"), (TUM.replace(" ", "\t"), "TUM"), (VICON, "EuRoC"), (STATES, "EuRoC")]
)
def test_tum_and_euroc_are_known_without_a_word(course, text, form):
    stops = course(text, body="rfu")
    assert stops.about["format"] == form
    assert stops.time_ns.tolist() == TIMES
    np.testing.assert_array_equal(stops.position, PLACES)
    np.testing.assert_allclose(quaternions(stops), QUATERNIONS, atol=1e-15)


def test_evo_reads_the_same_from_a_file_of_tum(course, tmp_path):
    stops = course(TUM, body="rfu")
    evo = file_interface.read_tum_trajectory_file(tmp_path / "course.txt")
    np.testing.assert_array_equal(evo.positions_xyz, stops.position)
    np.testing.assert_allclose(
        [np.outer(q, q) for q in evo.orientations_quat_wxyz], [np.outer(q, q) for q in quaternions(stops)], atol=1e-15
    )
    np.testing.assert_allclose(evo.timestamps - evo.timestamps[0], 1e-9 * stops.time_ns, atol=3e-7)  # ulp of 1.4e9 s


def test_a_table_is_read_by_the_names_of_its_columns(course):
    stops = course(TABLE, columns=COLUMNS, frame="ned", body="frd")
    assert stops.time_ns.tolist() == TIMES
    np.testing.assert_array_equal(stops.position, PLACES[:, [1, 0, 2]] * [1, 1, -1])


def test_a_table_without_a_header_is_read_by_the_numbers_of_its_columns(course):
    text = TABLE.partition("\n")[2]
    columns = {"time": 1, "time_unit": "ms", "position": [3, 4, 5], "quaternion": [6, 7, 8, 9]}
    stops = course(text, columns=columns, body="rfu")
    assert stops.time_ns.tolist() == TIMES
    np.testing.assert_array_equal(stops.position, PLACES)
    np.testing.assert_allclose(quaternions(stops), QUATERNIONS, atol=1e-15)


def test_usual_names_need_no_columns(course):
    text = TABLE.replace("north;east;down;w;x;y;z", "x;y;z;qw;qx;qy;qz")
    np.testing.assert_array_equal(course(text, body="rfu").position, PLACES)
    text = TABLE.replace(";w;x;y;z", ";qw;qx;qy;qz")
    np.testing.assert_array_equal(course(text, frame="ned").position, PLACES[:, [1, 0, 2]] * [1, 1, -1])


def test_names_in_a_remark_above_blanks_tell_the_order(course):
    """Some programs write the scalar first, and say so."""
    lines = [line.split() for line in TUM.splitlines()[2:]]
    text = "# timestamp tx ty tz qw qx qy qz\n" + "".join(" ".join([*r[:4], r[7], *r[4:7]]) + "\n" for r in lines)
    np.testing.assert_allclose(quaternions(course(text, body="rfu")), QUATERNIONS, atol=1e-15)


def test_a_remark_of_as_many_words_names_nothing(course):
    text = TUM.replace("timestamp tx ty tz qx qy qz qw", "these poses were written by the new tracker")
    np.testing.assert_array_equal(course(text, body="rfu").position, PLACES)


@pytest.mark.parametrize(
    "changed",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace("\n", "\n\n"),
        lambda text: text.rstrip("\n"),
        lambda text: text + "# the end\n",
        lambda text: text.replace(" ", "   "),
    ],
)
def test_line_ends_marks_blanks_and_remarks_change_nothing(course, changed):
    stops = course(changed(TUM), body="rfu")
    assert stops.time_ns.tolist() == TIMES
    np.testing.assert_array_equal(stops.position, PLACES)


@pytest.mark.parametrize(
    "changed",
    [
        lambda text: text.replace(",", ", "),
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", "\t"),
        lambda text: text.replace("\n1", ",\n1").replace("0,0,0\n", "0,0,0,\n").replace("[],\n", "[]\n"),
        lambda text: text.replace(",1.5,", ',"1.5",'),
    ],
)
def test_separators_and_quotes_change_nothing(course, changed):
    np.testing.assert_array_equal(course(changed(VICON), body="rfu").position, PLACES)


# -------------------------------------------------------------------------------------------------------------- times


@pytest.mark.parametrize(
    ("unit", "cells"),
    [
        ("ns", ["1700000000000000001", "1700000000000000002", "1700000000000000004"]),
        ("us", ["1700000000000000.001", "1700000000000000.002", "1700000000000000.004"]),
        ("ms", ["1700000000000.000001", "1700000000000.000002", "1700000000000.000004"]),
        ("s", ["1700000000.000000001", "1700000000.000000002", "1.700000000000000004e9"]),
        ("s", ["-0.000000001", "0", "2e-9"]),
    ],
)
def test_times_keep_every_nanosecond_whatever_their_epoch(course, unit, cells):
    """float64 of 1.7e18 ns is good to 256 ns."""
    rows = "".join(f"{cell},{k},0,0\n" for k, cell in enumerate(cells))
    stops = course(
        f"t,x,y,z\n{rows}", columns={"time": "t", "time_unit": unit, "position": ["x", "y", "z"]}, attitude="unrotated"
    )
    assert stops.time_ns.tolist() == [0, 1, 3]


@pytest.mark.parametrize(
    ("name", "step_s"),
    [("t", 1.0), ("time [ms]", 1e-3), ("stamp_us", 1e-6), ("t_ns", 1e-9), ("Time (s)", 1.0), ("timestamp [ns]", 1e-9)],
)
def test_the_unit_is_what_the_name_of_the_column_says(course, name, step_s):
    stops = course(f"{name},x,y,z\n0,0,0,0\n1,1,0,0\n2,2,0,0\n", attitude="unrotated")
    assert stops.time_ns.tolist() == [0, round(1e9 * step_s), round(2e9 * step_s)]


def test_whole_times_of_which_nothing_says_that_they_are_seconds_are_told_of(course):
    text = "t,x,y,z\n0,0,0,0\n5,1,0,0\n10,2,0,0\n"
    assert any("taken for seconds" in words for words in course(text, attitude="unrotated").messages)
    columns = {"time": "t", "time_unit": "ms", "position": ["x", "y", "z"]}
    assert course(text, columns=columns, attitude="unrotated").messages == ()


def test_gaps_are_told_of_with_their_line(course):
    rows = "".join(f"{t},{t},0,0\n" for t in [0.0, 0.1, 0.2, 0.3, 1.4, 1.5])
    (words,) = course(f"t,x,y,z\n{rows}", attitude="unrotated").messages
    assert words.startswith(
        "trajectory.file: 1 gap of more than 10 times the usual 0.1 s, the longest of 1.1 s after "
        "line 5, 0.3 s from the first pose"
    )


# ---------------------------------------------------------------------------------------------------------- bad input

ROW = "1,1,0,0,1,0,0,0\n"
HEADER = "t,x,y,z,qw,qx,qy,qz\n"
GOOD = HEADER + "0,0,0,0,1,0,0,0\n" + ROW


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        ("", None, "is empty"),
        ("\n \n", None, "is empty"),
        ("# only remarks\n", None, "has no poses"),
        (HEADER, None, "has 0 poses, but a course two at least"),
        (HEADER + ROW, None, "has 1 pose, but a course two at least"),
        (GOOD + "2,nan,0,0,1,0,0,0\n", 4, "x 'nan' is missing"),
        (GOOD + "2,,0,0,1,0,0,0\n", 4, "x is missing"),
        (GOOD + "2,inf,0,0,1,0,0,0\n", 4, "x 'inf' is not a finite number"),
        (GOOD + "2,one,0,0,1,0,0,0\n", 4, "x 'one' is not a number"),
        (GOOD + "later,1,0,0,1,0,0,0\n", 4, "t 'later' is not a number"),
        (GOOD + "nan,1,0,0,1,0,0,0\n", 4, "t 'nan' is missing"),
        (GOOD + "1e30,1,0,0,1,0,0,0\n", 4, "t '1e30' is too large for a time in s"),
        (GOOD + "1e999999999,1,0,0,1,0,0,0\n", 4, "t '1e999999999' is not a finite number"),
        (GOOD + "2,1,0,0,1,0,0\n", 4, "has 7 cells parted by commas, where others have 8"),
        (GOOD + "2 1 0 0 1 0 0 0\n", 4, "has 1 cells parted by commas"),
        (GOOD + "2,1 0,0,1,0,0,0,0\n", 4, "x '1 0' is more than one number"),
        (GOOD + "2,1,5,0,0,0,1,0,0,0,0\n", 4, "write numbers with a decimal point"),
        (GOOD.replace(",", ";").replace("1;1;", "1;1,5;"), 3, "x '1,5' has a decimal comma"),
        (GOOD + "1,2,0,0,1,0,0,0\n", 4, "its time is that of line 3"),
        (GOOD + "0.5,2,0,0,1,0,0,0\n", 4, "its time is before that of line 3"),
        (GOOD + "2,1e10,0,0,1,0,0,0\n", 4, "its place is farther than 1e+09 m: 1e+10, 0, 0"),
        (GOOD + "2,1,0,0,0.9,0,0,0\n", 4, "the length of its quaternion is not 1: 0.9, 0, 0, 0"),
        (GOOD + "2,1,0,0,0,0,0,0\n", 4, "the length of its quaternion is not 1"),
        (GOOD.replace(",x,y,z,", ",x,y,x,"), 1, "no column that may be a position"),
        (GOOD.replace("t,x", "x,x"), 1, "no column that may be the time"),
        (GOOD.replace("t,x,y,z,qw", "t,x,y,z,x").replace(",qx,qy,qz", ",a,b,c"), 1, "has 2 columns named 'x'"),
        (GOOD.replace("t,x", "t,time"), 1, "several columns that may be the time"),
        (GOOD.replace("qw,qx,qy,qz", "roll,pitch,yaw,a"), 1, "what may be an attitude (roll, pitch, yaw)"),
        (GOOD.replace("qw,qx,qy,qz", "a,b,c,d"), 1, "has no attitudes"),
        (GOOD.replace("x,y,z,", "n,e,d,"), 1, "its positions are ned by the names of their columns, not enu"),
        (
            GOOD.replace("\n0,0", "\n1700000000000,0").replace("\n1,1", "\n1700000001000,1"),
            2,
            "is too large for a time in s",
        ),
        (GOOD.partition("\n")[2], 1, "rows of 8 numbers have no header"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2, 1, "poses of KITTI, which have no times"),
        (TUM.replace("1.75", "x"), 4, "tx 'x' is not a number"),
        (TUM.replace("1.75", "1,75"), 4, "tx '1,75' has a decimal comma"),
        (TUM.replace("1.75 -2", "1.75"), 4, "has 7 cells parted by blanks, where others have 8"),
        (GOOD.encode("utf-16"), None, "is not a text file in UTF-8"),
        (b"\x00\xff\x12" * 9, None, "is not a text file in UTF-8"),
        ("0 " * 70_000, None, "has a line of more than 65536 characters"),
    ],
)
def test_a_bad_file_is_refused_with_its_line(course, tmp_path, text, line, says):
    with pytest.raises(InputError, match=re.escape(says)) as error:
        course(text)
    assert (error.value.file, error.value.line) == (tmp_path / "course.txt", line)
    assert error.value.key == "trajectory.file"
    assert error.value.remedy


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ({"time": "time"}, "has no column 'time'"),
        ({"position": ["x", "y", "zz"]}, "has no column 'zz'"),
        ({"position": ["x", "y", "y"]}, "column y is to hold two things"),
        ({"position": ["y", "x", "z"]}, "columns.position is x, y, z, but its names say y, x, z"),
        ({"quaternion": ["qx", "qy", "qz", "qw"]}, "columns.quaternion is w, x, y, z, but its names say x, y, z, w"),
        ({"time": 9}, "has no column 9"),
        ({"time": "s_ms", "time_unit": "ns"}, "column 's_ms' is in ms by its name, in ns by columns.time_unit"),
        (
            {"quaternion": None, "euler": ["roll_deg", "pitch_deg", "yaw_deg"]},
            "columns.euler is in radians, but its names",
        ),
        ({"quaternion": None, "euler_deg": ["roll_rad", "pitch_rad", "yaw_rad"]}, "columns.euler_deg is in degrees"),
        ({"time": "twice"}, "has 2 columns named 'twice'"),
    ],
)
def test_columns_that_do_not_fit_are_refused(course, columns, says):
    more = "s_ms,roll_deg,pitch_deg,yaw_deg,roll_rad,pitch_rad,yaw_rad,twice,twice"
    text = GOOD.replace("\n", ",1,0,0,0,0,0,0,0,0\n").replace(",1,0,0,0,0,0,0,0,0\n", f",{more}\n", 1)
    given = {"time": "t", "position": ["x", "y", "z"], "quaternion": ["qw", "qx", "qy", "qz"]} | columns
    with pytest.raises(InputError, match=re.escape(says)) as error:
        course(text if "time" not in columns or columns["time"] != 9 else GOOD, columns=given)
    assert error.value.key == "trajectory.file"


@pytest.mark.parametrize(
    ("form", "angle", "told"),
    [
        ("euler", "1.57", None),
        ("euler", "90", "up to 90 radians; if they are in degrees"),
        ("euler_deg", "90", None),
        ("euler_deg", "-1.57", "up to 1.57 degrees; if they are in radians"),
        ("euler_deg", "0", None),
    ],
)
def test_angles_that_may_be_in_the_other_unit_are_told_of(course, form, angle, told):
    text = f"t,x,y,z,a,b,c\n0,0,0,0,0,0,0\n1,0,0,0,0,0,{angle}\n"
    messages = course(text, columns={"time": "t", "position": ["x", "y", "z"], form: ["a", "b", "c"]}).messages
    assert [told in words for words in messages] == [True] * bool(told)


def test_angles_without_digits_for_a_turn_are_refused(course):
    columns = {"time": "t", "position": ["x", "y", "z"], "euler": ["a", "b", "c"]}
    with pytest.raises(InputError, match="its angles are too large: 0, 0, 1e\\+07") as error:
        course("t,x,y,z,a,b,c\n0,0,0,0,0,0,0\n1,0,0,0,0,0,1e7\n", columns=columns)
    assert error.value.line == 3


def test_a_file_that_is_not_there_is_refused(course):
    with pytest.raises(InputError, match="there is no such course file"):
        course(TUM, file="curse.txt")


def test_no_more_poses_are_read_than_the_limit(course, monkeypatch):
    monkeypatch.setenv("VAROS_WARP_MAX_POSES", "2")
    with pytest.raises(InputError, match="3 poses are more than the limit of 2"):
        course(TUM)


# -------------------------------------------------------------------------------------------------------------- sizes


def test_many_poses_take_little_more_memory_than_their_numbers(course):
    """Each is 10 numbers in the end, and a few copies of some on the way: 500 bytes; a block of text takes 60 MB."""
    cells = " ".join(map(repr, np.random.default_rng(1).normal(size=3).tolist())) + " 0.0 0.6 0.0 0.8\n"
    peaks = []
    for count in (30_000, 90_000):
        text = "".join(f"{1_600_000_000 + k // 200}.{k % 200 * 5_000_000:09d} {cells}" for k in range(count))
        tracemalloc.start()
        assert course(text).time_ns[-1] == (count - 1) * 5_000_000
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[0] < 60e6
    assert peaks[1] - peaks[0] < 60_000 * 500
