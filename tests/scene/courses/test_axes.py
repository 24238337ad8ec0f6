"""Axes of recorded courses: where the vehicle is, looks and is upright, each from the meaning of the angles in words.

Expected values are written out of east, north and up, without the matrices of the package.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError
from varos_warp.scene.description.vehicle import Vehicle
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import camera_pose

EAST, NORTH, UP = np.eye(3)
RNG = np.random.default_rng(5)
TURNS = Rotation.random(4, rng=RNG)
PLACES = RNG.normal(size=(4, 3)) * 10.0
HEADER = "t,x,y,z,qw,qx,qy,qz\n"
COLUMNS = {"time": "t", "position": ["x", "y", "z"]}


def table(places, turns=TURNS):
    q = turns.as_quat(scalar_first=True)
    return HEADER + "".join(
        f"{k},{','.join(map(repr, [*p, *r]))}\n"
        for k, (p, r) in enumerate(zip(np.asarray(places).tolist(), q.tolist(), strict=True))
    )


def axes(stops, k=0):
    """Right, forward and up of the vehicle, east, north, up each."""
    return stops.attitude[k].as_matrix().T


def test_north_east_down_becomes_east_north_up(course):
    north, east, down = PLACES.T
    np.testing.assert_array_equal(course(table(PLACES), frame="ned").position, np.stack([east, north, -down], axis=1))


@pytest.mark.parametrize(("heading", "pitch", "roll"), [(0, 0, 0), (90, 0, 0), (30, 10, 0), (0, 0, 20), (200, -35, 65)])
def test_heading_pitch_and_roll_of_aviation(course, heading, pitch, roll):
    """Heading clockwise from north, pitch with the nose up, roll with the right side down; x forward, z down."""
    text = f"t,x,y,z,roll,pitch,yaw\n0,0,0,0,{roll},{pitch},{heading}\n1,1,0,0,{roll},{pitch},{heading}\n"
    stops = course(text, frame="ned", columns=COLUMNS | {"euler_deg": ["roll", "pitch", "yaw"]})
    h, p, r = np.radians([heading, pitch, roll])
    level, side = np.sin(h) * EAST + np.cos(h) * NORTH, np.cos(h) * EAST - np.sin(h) * NORTH
    forward, top = np.cos(p) * level + np.sin(p) * UP, np.cos(p) * UP - np.sin(p) * level
    expected = [np.cos(r) * side - np.sin(r) * top, forward, np.cos(r) * top + np.sin(r) * side]
    np.testing.assert_allclose(axes(stops), expected, atol=1e-15)


@pytest.mark.parametrize("yaw", [0.0, 90.0, -140.0])
def test_yaw_of_ros_is_anticlockwise_from_east_and_x_looks_forward(course, yaw):
    """REP 103: east, north, up; forward, left, up."""
    a = np.radians(yaw)
    q = Rotation.from_rotvec(np.tile(a * UP, (4, 1)))
    forward = np.cos(a) * EAST + np.sin(a) * NORTH
    np.testing.assert_allclose(
        axes(course(table(PLACES, q))), [np.sin(a) * EAST - np.cos(a) * NORTH, forward, UP], atol=1e-15
    )


@pytest.mark.parametrize(
    ("body", "right", "forward", "up"),
    [
        ("rfu", (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ("flu", (0, -1, 0), (1, 0, 0), (0, 0, 1)),
        ("frd", (0, 1, 0), (1, 0, 0), (0, 0, -1)),
    ],
)
@pytest.mark.parametrize("frame", ["enu", "ned"])
def test_the_letters_of_a_body_are_its_axes(course, frame, body, right, forward, up):
    stops = course(table(PLACES), frame=frame, body=body)
    for k, turn in enumerate(TURNS):
        in_file = turn.apply([right, forward, up])
        world = in_file if frame == "enu" else in_file[:, [1, 0, 2]] * [1, 1, -1]
        np.testing.assert_allclose(axes(stops, k), world, atol=1e-15)


def test_without_a_word_bodies_are_those_of_rep_103_and_of_aviation(course):
    for frame, body in (("enu", "flu"), ("ned", "frd")):
        said, silent = course(table(PLACES), frame=frame, body=body), course(table(PLACES), frame=frame)
        np.testing.assert_array_equal(said.attitude.as_quat(), silent.attitude.as_quat())
        assert silent.about["body"] == body


def test_an_opposite_quaternion_is_the_same_attitude(course):
    q = TURNS.as_quat() * np.array([1, -1, -1, 1])[:, None]
    np.testing.assert_allclose(
        course(table(PLACES, Rotation.from_quat(q))).attitude.as_matrix(),
        course(table(PLACES)).attitude.as_matrix(),
        atol=1e-15,
    )


@pytest.mark.parametrize("order", ["zyx", "ZYX", "XYZ", "xzy"])
def test_angles_are_about_the_axes_of_the_order_one_after_the_other(course, order):
    angles = np.radians([20.0, -30.0, 110.0])
    turns = [
        Rotation.from_rotvec(angle * np.eye(3)["xyz".index(axis.lower())])
        for angle, axis in zip(angles, order, strict=True)
    ]
    first, second, third = turns
    expected = third * second * first if order.islower() else first * second * third
    row = ",".join(map(repr, angles.tolist()))
    stops = course(
        f"t,x,y,z,a,b,c\n0,0,0,0,{row}\n1,0,0,0,{row}\n",
        body="rfu",
        columns=COLUMNS | {"euler": ["a", "b", "c"], "euler_order": order},
    )
    np.testing.assert_allclose(stops.attitude[0].as_matrix(), expected.as_matrix(), atol=1e-15)


CAMERA = {"id": "L0", "position": [-0.1, 0.4, 0.2], "rotation_euler_deg": [-20, 5, 30]}


def recorded_camera(frame):
    """Poses of a camera in OpenCV's axes, and what they are in our world."""
    down, along = TURNS.apply([0, 1, 0]), TURNS.apply([0, 0, 1])
    if frame == "ned":
        down, along = (v[:, [1, 0, 2]] * [1, 1, -1] for v in (down, along))
        return PLACES[:, [1, 0, 2]] * [1, 1, -1], down, along
    return PLACES, down, along


@pytest.mark.parametrize("frame", ["enu", "ned"])
def test_of_a_camera_the_vehicle_is_where_the_camera_is_as_recorded(course, frame):
    """The image's y axis, down, and the optical axis are those of the file, in optical axes."""
    vehicle = {"cameras": [{"id": "M0"}, CAMERA]}
    stops = course(table(PLACES), vehicle, of="L0", frame=frame)
    camera = Vehicle.model_validate(vehicle).cameras[1]
    T = np.tile(np.eye(4), (4, 1, 1))
    T[:, :3, :3], T[:, :3, 3] = stops.attitude.as_matrix(), stops.position
    T_w_c = camera_pose(camera, T)
    place, down, along = recorded_camera(frame)
    np.testing.assert_allclose(T_w_c[:, :3, 3], place, atol=1e-14)
    np.testing.assert_allclose(T_w_c[:, :3, 1], down, atol=1e-14)
    np.testing.assert_allclose(T_w_c[:, :3, 2], along, atol=1e-14)


def test_an_unrotated_camera_that_looks_north_is_on_a_vehicle_that_does(course):
    """Optical axes: x east, y down, z north."""
    turn = Rotation.from_matrix(np.stack([EAST, -UP, NORTH], axis=1))
    stops = course(table(PLACES, Rotation.concatenate([turn] * 4)), {"cameras": [{"id": "M0"}]}, of="M0")
    np.testing.assert_allclose(axes(stops), [EAST, NORTH, UP], atol=1e-15)


def test_of_the_imu_poses_are_those_of_its_own_axes(course):
    imu = {"position": [0.1, -0.2, 0.05], "rotation_euler_deg": [0, 0, 90]}
    stops = course(table(PLACES), {"imu": imu}, of="imu")
    R_v_s = Rotation.from_euler("z", 90, degrees=True)
    for k, turn in enumerate(TURNS):
        expected = turn * R_v_s.inv()
        np.testing.assert_allclose(stops.attitude[k].as_matrix(), expected.as_matrix(), atol=1e-15)
        np.testing.assert_allclose(stops.position[k] + expected.apply(imu["position"]), PLACES[k], atol=1e-14)


def test_coordinates_of_utm_keep_their_digits_from_an_origin(course):
    origin = np.array([569_000.0, 7_033_000.0, -80.0])
    stops = course(table(PLACES + origin), origin=origin.tolist(), body="rfu")
    np.testing.assert_array_equal(stops.position, (PLACES + origin) - origin)
    north_first = origin[[1, 0, 2]] * [1, 1, -1]
    stops = course(table(PLACES + north_first), origin=north_first.tolist(), frame="ned")
    np.testing.assert_allclose(stops.position, PLACES[:, [1, 0, 2]] * [1, 1, -1], atol=2e-9)


# ------------------------------------------------------------------------------------------------- without attitudes


def without_attitudes(places, step_s=0.1):
    return "t,x,y,z\n" + "".join(f"{k * step_s!r},{','.join(map(repr, p))}\n" for k, p in enumerate(places.tolist()))


def test_without_attitudes_a_file_is_refused_unless_the_scene_says_what_to_do(course):
    text = without_attitudes(PLACES)
    with pytest.raises(InputError, match=r"has no attitudes.*attitude: along_path, or unrotated"):
        course(text)
    np.testing.assert_array_equal(course(text, attitude="unrotated").attitude.as_rotvec(), np.zeros((4, 3)))


def test_along_the_path_the_vehicle_looks_where_it_goes_and_keeps_that_at_rest(course):
    """East and up at 30 degrees, a rest, then north: splines through straight lines and rests, away from the bends."""
    leg = np.linspace(0.0, 3.0, 31)[:, None]
    rise = np.cos(np.pi / 6) * EAST + 0.5 * UP
    places = np.vstack([leg * rise, np.tile(3.0 * rise, (40, 1)), 3.0 * rise + leg * NORTH])
    stops = course(without_attitudes(places), attitude="along_path")
    right, forward, _ = axes(stops, 15)
    np.testing.assert_allclose(forward, rise, atol=1e-6)
    np.testing.assert_allclose(right, -NORTH, atol=1e-6)
    np.testing.assert_allclose(axes(stops, 50)[1], axes(stops, 45)[1], atol=1e-12)
    np.testing.assert_allclose(axes(stops, 90), [EAST, NORTH, UP], atol=1e-6)


def test_along_the_path_a_camera_is_where_it_was_recorded(course):
    places = np.linspace(0.0, 1.0, 5)[:, None] * EAST
    stops = course(without_attitudes(places), {"cameras": [CAMERA]}, of="L0", attitude="along_path")
    np.testing.assert_allclose(stops.position + stops.attitude.apply(CAMERA["position"]), places, atol=1e-15)


# ---------------------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("trajectory", "vehicle", "key", "says"),
    [
        ({"of": "X9"}, {}, "trajectory.of", r"no camera has the id 'X9' \(there are: M0; or vehicle, imu\)"),
        ({"of": "camera"}, {}, "trajectory.of", "vehicle, imu or the id of a camera"),
        ({"of": "imu"}, {"imu": None}, "trajectory.of", "the vehicle has no imu"),
        ({"of": "M0"}, {"cameras": [{"id": "M0", "mount": "world"}]}, "trajectory.of", "stands in the world"),
        ({"of": "M0", "body": "flu"}, {}, "trajectory.body", "body: the axes of a vehicle"),
        ({"body": "flu", "attitude": "unrotated"}, {}, "trajectory.body", "attitude is unrotated"),
        ({"frame": "nwu"}, {}, "trajectory.frame", "is not one of the choices"),
        ({"constant_speed": True}, {}, "trajectory", "constant_speed is for waypoints"),
        ({"poses": [{"position": [0, 0, 0]}]}, {}, "trajectory", "give exactly one of waypoints, poses, pattern, file"),
        (
            {"columns": COLUMNS | {"euler": ["a", "b", "c"], "euler_deg": ["a", "b", "c"]}},
            {},
            "trajectory.columns",
            "give one of quaternion, euler, euler_deg",
        ),
        ({"columns": COLUMNS | {"euler_order": "xxy"}}, {}, "trajectory.columns.euler_order", "twice in a row"),
    ],
)
def test_what_a_scene_says_of_a_course_must_fit(course, trajectory, vehicle, key, says):
    with pytest.raises(InputError, match=says) as error:
        course(table(PLACES), vehicle, **trajectory)
    assert error.value.key == key


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("frame", "ned"),
        ("of", "M0"),
        ("body", "flu"),
        ("start_s", 1.0),
        ("columns", COLUMNS),
        ("smoothing_s", 1.0),
        ("origin", [0, 0, 0]),
    ],
)
def test_keys_of_a_recorded_course_mean_nothing_without_one(key, value):
    with pytest.raises(InputError, match=f"{key}: for a recorded course only"):
        scene_from_dict({"trajectory": {"poses": [{"position": [0, 0, 0]}], key: value}})


def test_a_file_in_the_place_of_poses_is_told_its_key():
    with pytest.raises(InputError, match=r"a file of them is a recorded course, trajectory\.file") as error:
        scene_from_dict({"trajectory": {"poses": "recorded.csv"}})
    assert (error.value.key, error.value.value) == ("trajectory.poses", "recorded.csv")
