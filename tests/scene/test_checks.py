import json

import numpy as np
import pytest
from test_examples import SMALL, with_little_on_it

from varos_warp.scene.checks import check_scene, looks_like_transmission, vehicle_radius
from varos_warp.scene.file.load import demo_scene_path, load_scene, scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.surface import Surface
from varos_warp.scene.geometry.terrain import write_ply
from varos_warp.scene.info import camera_info, scene_info
from varos_warp.sim.vehicle.body import sphere

TABLE_1 = {
    "principled": {
        "density": 0.125,
        "color": [0.014, 0.146, 0.345],
        "absorption_color": [0.0, 0.394, 1.0],
        "anisotropy": 0.8,
    }
}
LAMP = {"position": [0.15, -0.1, 0.0]}


def scene(tmp_path=".", waypoints=((0, 0, 1),), vehicle=None, **blocks):
    return scene_from_dict(
        {
            "trajectory": {"waypoints": [{"position": list(p)} for p in waypoints]},
            "surface_depth_m": 80.0,
            "vehicle": {"lights": [LAMP], **(vehicle or {})},
            "water": TABLE_1,
            **blocks,
        },
        tmp_path,
    )


def warnings(**blocks):
    s = scene(**blocks)
    return check_scene(s, build_parts(s))


FLAT = {"kind": "procedural", "resolution": 33, "relief_m": 0.0, "size_m": 20}


def test_a_sound_scene_gives_no_warning(few_bodies):
    assert warnings(terrain=FLAT, waypoints=[(0, 0, 1), (1, 0, 0.5)]) == []
    cheap = [*SMALL["demo"], *with_little_on_it(load_scene(demo_scene_path()))]
    demo = load_scene(demo_scene_path(), cheap)
    assert check_scene(demo, build_parts(demo)) == []


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ((0.905, 0.961, 0.982), True),  # Jerlov I's transmission, taken for an attenuation by a published simulator
        ((0.795, 0.88, 0.93), True),
        ((0.228, 0.062, 0.018), False),  # Jerlov I's absorption
        ((0.39, 0.348, 0.943), False),  # Jerlov 9C: murky, but not in order
        ((2.7, 3.1, 4.4), False),
        ((0.3, 0.3, 0.3), False),
        ((0.12500, 0.058, 0.0431), False),
        ((0.1, 0.2, 0.3), False),
    ],
)
def test_transmissions_given_as_coefficients_are_noticed(values, verdict):
    assert looks_like_transmission(values) == verdict


def test_the_warning_of_a_transmission_gives_the_coefficient_that_was_meant():
    water = {"coefficients": {"sigma_s": [0, 0, 0], "sigma_a": [0.905, 0.961, 0.982]}}
    (text,) = warnings(water=water)
    assert "0.0998, 0.0398, 0.0182" in text


def test_no_jerlov_type_is_taken_for_a_transmission():
    for kind in ("I", "IA", "IB", "II", "III", "1C", "3C", "5C", "7C", "9C"):
        assert not [w for w in warnings(water={"jerlov": {"type": kind}}) if "transmission" in w], kind


def test_water_too_murky_to_see_through_is_noticed():
    assert "nothing will be seen" in warnings(water={"coefficients": {"sigma_s": [9, 9, 9], "sigma_a": [1, 1, 1]}})[0]


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"speed": 0.7}, ["trajectory.speed: without effect beside poses"]),
        ({"dwell_s": 1.0, "max_acceleration": 0.1}, ["trajectory.max_acceleration: without effect", "dwell_s"]),
        ({"speed": 0.5}, []),
        ({}, []),
    ],
)
def test_keys_of_waypoints_beside_exact_poses_are_told(keys, told):
    poses = [{"time_s": 0.0, "position": [0, 0, 1]}, {"time_s": 1.0, "position": [1, 0, 1]}]
    s = scene_from_dict(
        {
            "trajectory": {"poses": poses, **keys},
            "terrain": FLAT,
            "water": TABLE_1,
            "surface_depth_m": 80.0,
            "vehicle": {"lights": [LAMP]},
        },
        ".",
    )
    found = [words for words in check_scene(s, build_parts(s)) if "without effect" in words]
    assert len(found) == bool(told)
    assert all(part in words for words in found for part in told)


@pytest.mark.parametrize(
    ("ground", "told"),
    [
        ({"relief": "rock", "wear": 0.8}, True),
        ({"relief": "sand", "steep": "rock", "wear": 0.0}, True),
        ({"relief": "rock"}, False),
        ({"relief": "sand", "steep": "concrete", "wear": 0.8}, False),
        ({"relief": "none", "wear": 0.8}, False),
    ],
)
def test_wear_of_what_does_not_wear_is_told(ground, told):
    s = scene(terrain=FLAT, waypoints=[(0, 0, 1), (1, 0, 0.5)], materials={"ground": {"kind": "layered", **ground}})
    found = [words for words in check_scene(s, build_parts(s)) if "materials.ground.wear: without effect" in words]
    assert len(found) == told


def test_waypoints_under_the_terrain_or_too_near_to_it_are_noticed_by_number():
    texts = warnings(terrain=FLAT, waypoints=[(0, 0, 1), (1, 1, -1), (2, 2, 0.1)])
    assert any("waypoint 1 is under the terrain, whose height there is 0.00 m" in t for t in texts)
    assert any("waypoint 2 is nearer to terrain than the vehicle's radius" in t and "0.10 m" in t for t in texts)
    assert any("vehicle.cameras.0 (M0): is under the terrain at waypoint 1" in t for t in texts)


def test_a_course_that_is_under_the_terrain_as_a_whole_is_told_first_and_with_the_remedy():
    flat = FLAT | {"position": [0, 0, -3]}
    texts = warnings(terrain=flat, waypoints=[(0, 0, -5), (1, 1, -6)])
    assert texts[0].startswith("trajectory: all 2 waypoints are under the terrain, whose height there is -3.00 m; ")
    assert "raise the course" in texts[0]
    many = warnings(terrain=flat, waypoints=[(0, 0, 1), *((0.1 * i, 0, -5) for i in range(7))])
    assert any("waypoints 1, 2, 3, 4, 5 and 2 more are under" in text for text in many)


BESIDE = [(60, 0, 1), (62, 0, 1)]


def test_a_course_beside_the_terrain_is_noticed_with_where_both_are():
    (text,) = warnings(terrain=FLAT, waypoints=BESIDE, vehicle={"cameras": [{"position": [0, 0.5, 0]}]})
    assert text.startswith("vehicle.cameras.0 (M0): sees no surface within 25 m (render.depth_range_m)")
    assert "at all 2 waypoints" in text
    assert "at waypoint 0 it is at (60, 0.5, 1), terrain and objects from (-10, -10, 0) to (10, 10, 0)" in text
    assert text.endswith("; move the course to them, or them to the course")


def test_some_looks_into_open_water_are_meant_and_most_are_not():
    away = {"rotation_euler_deg": [90, 0, 0]}
    assert warnings(terrain=FLAT, waypoints=[(0, 0, 1), BESIDE[0]]) == []
    (text,) = warnings(terrain=FLAT, waypoints=[(0, 0, 1), *BESIDE])
    assert "at waypoints 1, 2" in text
    (text,) = warnings(terrain=FLAT, vehicle={"cameras": [away]})
    assert "sees no surface" in text
    assert text.endswith("; turn the camera towards them (its rotation_euler_deg, or look_at of the trajectory)")
    (text,) = warnings(terrain=FLAT, vehicle={"cameras": [away | {"mount": "world", "position": [0, 0, 1]}]})
    assert text.endswith("; turn the camera towards them (its rotation_euler_deg)")
    assert warnings(waypoints=BESIDE) == []  # open water is asked for


def test_a_small_object_in_sight_and_one_that_moves_into_it_are_surfaces_enough():
    nut = {"kind": "nut", "size": "M8", "position": [0.07, 3.0, 1.04]}
    assert warnings(objects=[nut]) == []
    assert "sees no surface" in warnings(objects=[nut | {"position": [0, -3, 1]}])[0]
    moving = {"kind": "nut", "size": "M8", "path": [{"position": [0, -3, 1]}, {"position": [0, 3, 1], "time_s": 9}]}
    assert warnings(objects=[moving]) == []


@pytest.mark.parametrize(
    ("vehicle", "key"),
    [
        ({"cameras": [{"id": "L0", "position": [-60, 0, -100]}]}, "vehicle.cameras.0 (L0)"),
        ({"lights": [{"position": [150, -100, 0]}]}, "vehicle.lights.0"),
        ({"imu": {"position": [0, 0, 20]}}, "vehicle.imu"),
        ({"dvl": {"position": [0, 80, -20]}}, "vehicle.dvl"),
    ],
)
def test_mounting_positions_in_millimetres_are_noticed(vehicle, key):
    texts = [text for text in warnings(terrain=FLAT, vehicle=vehicle) if "positions are in metres" in text]
    position = next(iter(vehicle.values()))
    position = (position[0] if isinstance(position, list) else position)["position"]
    first = next(x for x in position if x)
    assert len(texts) == 1
    assert texts[0].startswith(
        f"{key}: {np.linalg.norm(position):.3g} m from the vehicle's origin; "
        f"positions are in metres ({abs(first) / 1000:g} for {abs(first):g} mm)"
    )


def straight(start, end, *, seconds=10.0, waypoint=1, reference_z=0.0):
    """Time, position, reference and waypoint of a vehicle that goes straight, at 5 cm steps or less."""
    count = int(np.ceil(np.linalg.norm(np.subtract(end, start)) / 0.05)) + 1
    position = np.linspace(start, end, count)
    return (
        np.linspace(0, seconds * 1e9, count).astype(np.int64),
        position,
        position + [0, 0, reference_z],
        np.full(count, waypoint),
    )


BOULDER = {"kind": "boulder", "diameter": 1.0, "position": [0, 5, 0]}


def path_warnings(path, **blocks):
    s = scene(waypoints=[path[1][0], path[1][-1]], **blocks)
    parts = build_parts(s)
    assert check_scene(s, parts) == []  # the waypoints themselves are clear
    return check_scene(s, parts, path)


def test_a_way_through_a_boulder_between_two_clear_waypoints_is_noticed_with_waypoint_and_time():
    (text,) = path_warnings(straight((0, 0, 0), (0, 10, 0)), objects=[BOULDER])
    assert "on the way to waypoint 1" in text
    assert "through objects.0" in text
    assert 4.0 < float(text.split(" s,")[0].split("at ")[1]) < 6.0


def test_a_way_close_by_is_noticed_with_its_distance_and_one_further_off_is_not():
    rock = build_parts(scene(objects=[BOULDER]))[0].vertices
    x = rock[:, 0].max() + 0.1
    beside = straight((x, 0, rock[rock[:, 0].argmax(), 2]), (x, 10, rock[rock[:, 0].argmax(), 2]))
    (text,) = path_warnings(beside, objects=[BOULDER])
    assert "nearer to objects.0 than its radius of 0.21 m" in text
    s = scene(objects=[BOULDER])
    (part,) = build_parts(s)
    assert f"({Surface(part.vertices, part.faces).nearest(beside[1])[0].min():.2f} m)" in text
    assert path_warnings(straight((1.0, 0, 0), (1.0, 10, 0)), objects=[BOULDER]) == []


def test_a_reference_that_touches_is_noticed_where_the_vehicle_happens_to_miss():
    path = straight((0, 0, 2.0), (0, 10, 2.0), reference_z=-2.0)
    (text,) = path_warnings(path, objects=[BOULDER])
    assert "the course leads" in text
    assert "through objects.0" in text


def test_a_way_that_dives_under_the_terrain_is_noticed():
    time_ns, position, _, waypoint = straight((0, -8, 0.4), (0, 8, 0.4))
    position[:, 2] -= 0.8 * np.exp(-(position[:, 1] ** 2))
    (text,) = path_warnings((time_ns, position, position, waypoint), terrain=FLAT)
    assert "through terrain" in text


def test_a_waypoint_under_the_terrain_is_not_told_again_as_a_place_on_the_way():
    s = scene(terrain=FLAT, waypoints=[(0, 0, 1), (0, 4, 0.05)])
    texts = check_scene(s, build_parts(s), straight((0, 0, 1), (0, 4, 0.05)))
    assert len(texts) == 1
    assert "waypoint 1 is nearer to terrain" in texts[0]


def test_a_camera_keeps_the_attitude_of_the_waypoint_before():
    """Half a metre ahead of the vehicle, which looks away from the rock at both waypoints."""
    s = scene_from_dict(
        {
            "trajectory": {
                "waypoints": [{"position": [0, 0, 0], "rotation_euler_deg": [0, 0, 180]}, {"position": [0, 0.1, 0]}]
            },
            "vehicle": {"lights": [LAMP], "cameras": [{"position": [0, 0.5, 0]}]},
            "surface_depth_m": 80.0,
            "objects": [{"kind": "boulder", "diameter": 0.5, "position": [0, 0.7, 0]}],
        }
    )
    (text,) = check_scene(s, build_parts(s))
    assert "sees no surface" in text


def test_a_camera_inside_an_object_is_noticed():
    rock = {"kind": "boulder", "diameter": 4.0, "position": [0, 0, 1]}
    texts = warnings(objects=[rock])
    assert any("vehicle.cameras.0 (M0): is inside objects.0 at waypoint 0" in t for t in texts)
    assert any("waypoint 0 is inside objects.0" in t for t in texts)


ROCK = {"kind": "boulder", "diameter": 0.6, "chord_error_m": 0.02, "position": [0, 3, 0.6]}


def test_a_lamp_inside_an_object_or_the_ground_is_noticed_at_the_stops_where_it_is():
    lamps = [LAMP, {"position": [0, 3, -0.4]}, {"kind": "point", "position": [0, 1, -1.5]}]
    texts = warnings(
        terrain=FLAT, objects=[ROCK], vehicle={"lights": lamps}, waypoints=[(0, 0, 1), (0.1, 0, 1), (3, 0, 2)]
    )
    assert [text for text in texts if "lights" in text] == [
        "vehicle.lights.2: is under the terrain at waypoints 0, 1, and none of its light leaves it",
        "vehicle.lights.1: is inside objects.0 at waypoints 0, 1, and none of its light leaves it",
    ]


def test_lamps_of_a_vehicle_that_is_itself_inside_are_not_told_one_by_one():
    texts = warnings(terrain=FLAT, waypoints=[(0, 0, 1), (1, 1, -2)], vehicle={"lights": [LAMP, LAMP]})
    assert any("waypoint 1 is under the terrain" in text for text in texts)
    assert not any("lights" in text for text in texts)


@pytest.mark.parametrize("sensor", ["altimeter", "dvl"])
def test_a_sensor_of_beams_inside_an_object_is_noticed(sensor):
    texts = warnings(
        vehicle={sensor: {"position": [0, 1, 0]}},
        waypoints=[(0, 0, 2), (5, 0, 2)],
        objects=[{"kind": "boulder", "diameter": 1.0, "position": [0, 1, 2]}],
    )
    assert [text for text in texts if "inside" in text] == [
        f"vehicle.{sensor}: is inside objects.0 at waypoint 0, and its beams meet the far side of that"
    ]


def test_sensors_without_beams_and_those_of_a_vehicle_that_is_itself_inside_are_not_told_of():
    boulder = {"kind": "boulder", "diameter": 1.0, "position": [0, 1, 2]}
    assert not any(
        "inside" in text
        for text in warnings(
            vehicle={"magnetometer": {"position": [0, 1, 0]}}, waypoints=[(0, 0, 2)], objects=[boulder]
        )
    )
    assert not any(
        "altimeter" in text
        for text in warnings(vehicle={"altimeter": {"position": [0, 0, 0]}}, waypoints=[(0, 1, 2)], objects=[boulder])
    )


def test_a_lamp_inside_one_copy_of_a_scatter_is_noticed_far_from_the_vehicle():
    scatter = [{"object": ROCK | {"position": [0, 0, 0], "diameter": 1.0}, "count": 1, "circle": [4.0, 4.0, 0.01]}]
    texts = warnings(terrain=FLAT, scatter=scatter, vehicle={"lights": [{"position": [4.0, 4.0, -0.95]}]})
    assert [text for text in texts if "inside" in text] == [
        "vehicle.lights.0: is inside scatter.0 at waypoint 0, and none of its light leaves it"
    ]


def test_a_camera_standing_in_the_world_is_checked_where_it_stands():
    cameras = [{"id": "M0"}, {"id": "M1", "mount": "world", "position": [2, 2, -0.5]}]
    assert warnings(terrain=FLAT, vehicle={"cameras": cameras}) == ["vehicle.cameras.1 (M1): is under the terrain"]


def test_lights_and_cameras_above_the_surface_are_noticed():
    texts = warnings(surface_depth_m=1.05, waypoints=[(0, 0, 1)], vehicle={"lights": [{"position": [0, 0, 0.1]}]})
    assert len(texts) == 1
    assert "vehicle.lights.0: is above the sea surface" in texts[0]
    texts = warnings(surface_depth_m=0.0)
    assert [t.split(":")[0] for t in texts] == ["vehicle.lights.0", "vehicle.cameras.0 (M0)"]
    assert warnings(surface_depth_m=0.0, water="none") == []


def test_missing_and_backward_lights_are_noticed():
    assert "no light" in warnings(vehicle={"lights": []})[0]
    assert "backwards" in warnings(vehicle={"lights": [{"direction": [0, -1, 0]}]})[0]


@pytest.mark.parametrize(
    ("camera", "says"),
    [
        ({"resolution": [1280, 960]}, "not square"),
        ({"focal_mm": 0.5}, "field of view"),
        ({"focal_mm": 90}, "field of view"),
        ({"f_stop": 0.1}, "f/0.1"),
        ({"f_stop": 2, "focus_m": 0.003}, "focus_m"),
    ],
)
def test_odd_cameras_are_noticed(camera, says):
    (text,) = warnings(vehicle={"cameras": [camera]})
    assert says in text


MEASURED = {"fx": 985.5, "fy": 901.5, "cx": 651.0, "cy": 340.25}


@pytest.mark.parametrize(
    ("camera", "says"),
    [
        ({"intrinsics": MEASURED}, []),  # pixels that are not square are measured
        ({"intrinsics": MEASURED | {"fx": 100.0}}, ["field of view of 162 degrees; check intrinsics and resolution"]),
        (
            {"intrinsics": MEASURED | {"cx": 320.0, "cy": 250.0}, "resolution": [1280, 720]},
            ["principal point is 25 % of the width and 15 % of the height off the middle"],
        ),
        ({"focal_mm": 1.5, "distortion": {"model": "double_sphere", "xi": -0.2, "alpha": 0.59}}, []),
    ],
)
def test_odd_measured_cameras_are_noticed(camera, says):
    found = warnings(vehicle={"cameras": [camera]})
    assert len(found) == len(says)
    assert all(words in text for words, text in zip(says, found, strict=True))


def test_odd_exposures_are_noticed():
    (text,) = warnings(render={"exposure": {"A": 1e6}})
    assert "render.exposure.A" in text


def test_millimetres_taken_for_metres_are_noticed(tmp_path):
    vertices = 500.0 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) + [0, 0, -30]
    write_ply(tmp_path / "mm.ply", vertices, np.array([[0, 1, 2]]))
    text = warnings(tmp_path=tmp_path, objects=[{"file": "mm.ply"}])[0]
    assert text.startswith("objects.0: 500 m across")
    assert "scale: 0.001" in text
    small = warnings(tmp_path=tmp_path, objects=[{"file": "mm.ply", "scale": 1e-6, "position": [0, 2, 1]}])
    assert "only 0.0005 m across with scale: 1e-06" in small[0]
    assert "check scale" in small[0]
    write_ply(tmp_path / "km.ply", 1e-6 * vertices, np.array([[0, 1, 2]]))
    assert "scale: 1000" in warnings(tmp_path=tmp_path, objects=[{"file": "km.ply", "position": [0, 2, 1]}])[0]


@pytest.mark.parametrize(
    ("blocks", "key", "degrees"),
    [
        (
            {"vehicle": {"cameras": [{"rotation_euler_deg": [-0.785, 0, 0]}]}},
            "vehicle.cameras.0.rotation_euler_deg",
            "[-45, 0, 0]",
        ),
        ({"vehicle": {"lights": [LAMP | {"cone_deg": 1.57}]}}, "vehicle.lights.0.cone_deg", "90"),
        (
            {
                "trajectory": {
                    "waypoints": [
                        {"position": [0, 0, 1], "rotation_euler_deg": [0, 0, turn]} for turn in (0, -1.5708, 3.14)
                    ]
                }
            },
            "trajectory.waypoints.1.rotation_euler_deg and 1 more",
            "[0, 0, -90]",
        ),
        (
            {
                "trajectory": {
                    "pattern": {
                        "kind": "lawn_mower",
                        "centre": [0, 0, 2],
                        "length_m": 4,
                        "width_m": 2,
                        "spacing_m": 1,
                        "pitch_deg": -1.047,
                    }
                }
            },
            "trajectory.pattern.pitch_deg",
            "-60",
        ),
    ],
)
def test_radians_given_in_degrees_are_noticed(blocks, key, degrees):
    (text,) = (text for text in warnings(terrain=FLAT, **blocks) if "radians" in text)
    assert text.startswith(f"{key}: ")
    assert text.endswith(f"_deg are in degrees, where that would be {degrees}")


def test_angles_of_other_sizes_are_degrees_and_a_narrow_cone_is_noticed():
    vehicle = {"cameras": [{"rotation_euler_deg": [-1.57, 0, 2]}], "lights": [LAMP | {"cone_deg": 6}]}
    assert warnings(terrain=FLAT, vehicle=vehicle) == []
    (text,) = warnings(terrain=FLAT, vehicle={"lights": [LAMP | {"cone_deg": 2}]})
    assert text.startswith("vehicle.lights.0.cone_deg: 2 degrees is a very narrow cone")


# ------------------------------------------------------------------------------------------------------------- info


def test_info_gives_the_water_of_table_1_in_oceanographers_terms():
    info = scene_info(scene(), [])["water"]
    assert info["b"] == pytest.approx([0.00175, 0.01825, 0.043125])
    assert info["a"] == pytest.approx([0.12325, 0.0397436, 0.0], rel=1e-5)
    assert info["c"] == pytest.approx([0.125, 0.0579936, 0.043125], rel=1e-5)
    assert info["albedo"][2] == 1.0
    assert info["mean_free_path_m"] == pytest.approx([8.0, 17.2433, 23.1884], rel=1e-4)
    assert np.exp(-np.multiply(info["c"], info["range_10_percent_m"])) == pytest.approx([0.1] * 3)


def test_info_of_no_water_is_infinitely_clear():
    info = scene_info(scene(water="none"), [])["water"]
    assert info["c"] == [0.0, 0.0, 0.0]
    assert info["mean_free_path_m"] == [None] * 3


def test_info_gives_the_papers_camera_in_both_pixel_conventions():
    info = camera_info(scene().vehicle.cameras[0])
    assert [info["fx"], info["fy"]] == pytest.approx([985.507, 985.507], abs=1e-3)
    assert [info["cx_colmap"], info["cy_opencv"]] == [640.0, 359.5]
    assert [info["horizontal_fov_deg"], info["vertical_fov_deg"]] == pytest.approx([66.0, 40.1], abs=0.05)


def test_info_gives_a_measured_camera_as_it_was_measured():
    info = camera_info(scene(vehicle={"cameras": [{"intrinsics": MEASURED}]}).vehicle.cameras[0])
    assert [info[key] for key in ("fx", "fy", "cx_opencv", "cy_opencv")] == [985.5, 901.5, 651.0, 340.25]
    assert [info["cx_colmap"], info["cy_colmap"]] == [651.5, 340.75]
    expected = np.degrees(
        [np.arctan(651.5 / 985.5) + np.arctan(628.5 / 985.5), np.arctan(340.75 / 901.5) + np.arctan(379.25 / 901.5)]
    )
    np.testing.assert_allclose([info["horizontal_fov_deg"], info["vertical_fov_deg"]], expected, rtol=1e-12)
    assert info["defaults"] == ["resolution"]
    assert (info["calibration"], info["lens_end"]) == (None, None)


def test_info_says_where_a_lens_ends():
    """An equidistant one whose radius a (1 - 0.3 a^2) is largest at 60.4 degrees, 2/3 of which it is then."""
    camera = {"distortion": {"model": "fisheye", "k": [-0.3, 0, 0, 0]}, "focal_mm": 3.0}
    end = camera_info(scene(vehicle={"cameras": [camera]}).vehicle.cameras[0])["lens_end"]
    angle = np.sqrt(1.0 / 0.9)
    assert end["half_angle_deg"] == pytest.approx(np.degrees(angle), rel=1e-12)
    assert end["radius_px"] == pytest.approx(3.0 / 4.416 * 1280 * 2.0 / 3.0 * angle, rel=1e-6)
    col, row = np.meshgrid(np.arange(1280) + 0.5 - 640, np.arange(720) + 0.5 - 360)
    assert end["pixels"] == (np.hypot(col, row) > end["radius_px"]).sum() > 10_000
    assert end["share"] == end["pixels"] / (1280 * 720)


def test_info_lists_meshes_and_is_json():
    s = scene(terrain=FLAT, objects=[{"kind": "nut", "size": "M8"}])
    info = json.loads(json.dumps(scene_info(s, build_parts(s)), allow_nan=False))
    assert [m["name"] for m in info["meshes"]] == ["terrain", "objects.0"]
    assert info["meshes"][0]["triangles"] == 2 * 32 * 32
    assert info["meshes"][0]["bounds_m"][1][:2] == [10.0, 10.0]
    assert info["trajectory"] == {"kind": "waypoints", "count": 1}


@pytest.mark.parametrize("buoyancy", [0.0, 98.1, -98.1])
def test_the_vehicle_displaces_its_mass_and_its_buoyancy(buoyancy):
    s = scene(vehicle={"net_buoyancy": buoyancy})
    assert 1025.0 * 4.0 / 3.0 * np.pi * vehicle_radius(s) ** 3 == pytest.approx(40.0 + buoyancy / 9.81)
    assert vehicle_radius(s) == sphere(s.vehicle, s.gravity).radius


def test_info_tells_where_cameras_are_how_far_apart_a_pair_is_and_what_was_not_given():
    pair = [
        {"id": "L0", "position": [-0.06, 0, 0], "focal_mm": 3.4},
        {
            "id": "R0",
            "position": [0.06, 0, 0],
            "rotation_euler_deg": [-90, 0, 0],
            "resolution": [64, 36],
            "sensor_mm": [4.4, 2.4],
            "focal_mm": 3.4,
        },
        {"id": "M1"},
    ]
    info = json.loads(json.dumps(scene_info(scene(vehicle={"cameras": pair}), [])))
    left, right, _ = info["cameras"]
    assert (left["position"], left["looks_along"]) == ([-0.06, 0.0, 0.0], [0.0, 1.0, 0.0])
    assert right["looks_along"] == [0.0, 0.0, -1.0]
    assert (left["defaults"], right["defaults"]) == (["resolution", "sensor_mm"], [])
    assert info["stereo"] == [{"cameras": ["L0", "R0"], "baseline_m": pytest.approx(0.12)}]


# ------------------------------------------------------------------------------------------------------------ shutters


def shutter_warnings(shutter, strobe=None):
    camera = {"id": "M0", "resolution": [64, 36], "exposure": shutter or {}}
    vehicle = {"lights": [LAMP | ({"strobe": strobe} if strobe else {})], "cameras": [camera]}
    return warnings(terrain=FLAT, vehicle=vehicle, render={"frame_rate_hz": 20})


def test_exposures_that_no_camera_makes_are_noticed():
    assert shutter_warnings({"time_s": 0.05, "readout_s": 0.05}) == []
    (text,) = shutter_warnings({"time_s": 0.06})
    assert "vehicle.cameras.0 (M0): exposure.time_s = 0.06 is longer than the 0.05 s from frame to frame" in text
    (text,) = shutter_warnings({"readout_s": 0.07})
    assert "exposure.readout_s = 0.07" in text


def test_a_gain_of_a_camera_far_from_any_picture_is_noticed():
    assert shutter_warnings({"gain": 2.0}) == []
    (text,) = shutter_warnings({"gain": 2e4})
    assert "vehicle.cameras.0 (M0): exposure.gain: a gain of 20000 makes the picture black or white" in text


def test_strobes_that_a_shutter_misses_are_noticed():
    assert shutter_warnings({"time_s": 0.01}, {"on_s": 0.001, "delay_s": 0.004}) == []
    assert shutter_warnings(None, {"on_s": 0.001}) == []
    assert shutter_warnings({"time_s": 0.01, "readout_s": 0.02}, {"on_s": 0.02}) == []
    (text,) = shutter_warnings({"time_s": 0.01}, {"on_s": 0.001, "delay_s": 0.006})
    assert "vehicle.lights.0: its strobe is on from 0.0055 to 0.0065 s about each frame" in text
    assert "camera M0 is exposed from -0.005 to 0.005 s: it never sees it" in text
    assert "never sees it" in shutter_warnings(None, {"on_s": 0.001, "delay_s": 0.002})[0]


def test_a_strobe_that_lights_some_rows_of_a_rolling_shutter_is_noticed():
    """Of 36 rows over 36 ms, each open for 2 ms, a flash of 1.2 ms in the middle meets those within 1.6 ms."""
    (text,) = shutter_warnings({"time_s": 0.002, "readout_s": 0.036}, {"on_s": 0.0012})
    assert "its strobe lights only rows 16 to 19 of the 36 of camera M0" in text


BALL = {"kind": "boulder", "diameter": 0.6}


ALONE = {"id": "a", "lights": [LAMP], "trajectory": {"waypoints": [{"position": [0, 0, 2]}]}}


def fleet(other, **blocks):
    s = scene_from_dict(
        {"water": TABLE_1, "surface_depth_m": 80.0, **blocks, "vehicles": [ALONE, {"id": "b", **other}]}
    )
    return check_scene(s, build_parts(s))


@pytest.mark.parametrize("others", [[], ["b", "c"]])
def test_info_tells_of_a_body_where_it_is_on_its_vehicle_and_who_sees_it(others):
    body = {
        "kind": "pipe",
        "radius": 0.2,
        "length": 0.6,
        "wall": 1,
        "position": [0, 0.1, 0],
        "rotation_euler_deg": [90, 0, 0],
    }
    s = scene_from_dict({"vehicles": [ALONE | {"body": body}, *(ALONE | {"id": name} for name in others)]})
    body = json.loads(json.dumps(scene_info(s, build_parts(s))["body"]))
    assert body["seen_by"] == others
    np.testing.assert_allclose(np.ptp(body["bounds_m"], axis=0), [0.4, 0.6, 0.4], atol=0.02)
    assert "body" not in scene_info(scene(), [])


def test_a_body_that_begins_in_the_ground_or_in_another_and_lamps_in_their_own_body_are_noticed():
    def at(*position):
        return {"body": BALL, "trajectory": {"waypoints": [{"position": list(position)}]}}

    assert fleet(at(0, 3, 1), terrain=FLAT) == []
    assert fleet(at(0, 3, 0.1), terrain=FLAT) == []  # it lies on the ground
    (text,) = fleet(at(0, 3, -0.2), terrain=FLAT)
    assert text.startswith("vehicles.b: the middle of it is under the terrain where it begins")
    path = [{"time_s": t, "position": [t, 3, 1]} for t in range(2)]
    (text,) = fleet(at(0.1, 3, 1), objects=[BALL | {"diameter": 2.0, "path": path}])
    assert text.startswith("objects.0: the middle of it is inside vehicles.b")
    (text,) = fleet(at(0, 3, 1) | {"lights": [LAMP, LAMP | {"position": [0.0, 0.9, 0.0]}]})
    assert text.startswith("vehicles.1.lights.0: is inside the body of its vehicle")


@pytest.mark.parametrize(("kind", "told"), [("z", True), ("range", False)])
def test_a_view_behind_the_lens_and_planar_depth_do_not_go_together(kind, told):
    fisheye = {
        "resolution": [96, 72],
        "intrinsics": {"fx": 25, "fy": 25, "cx": 47.5, "cy": 35.5},
        "distortion": {"model": "kannala_brandt", "k": [0, 0, 0, 0]},
    }
    scene = scene_from_dict(
        {
            "vehicle": {"cameras": [fisheye]},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            "render": {"depth_kind": kind},
        }
    )
    found = [words for words in check_scene(scene, []) if "render.depth_kind: range" in words]
    assert bool(found) == told


def test_coordinates_of_a_map_are_taken_to_the_origin_by_keys_that_the_warning_names(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(9.0).reshape(3, 3) - 20.0)
    (tmp_path / "course.csv").write_text("t,x,y,z\n0,400000,6100000,0\n1,400001,6100000,0\n")
    s = scene_from_dict(
        {
            "terrain": {"file": "a.npy", "pixel_m": 1.0, "first_row": "south"},
            "surface_depth_m": 80.0,
            "trajectory": {"file": "course.csv", "attitude": "unrotated"},
            "vehicle": {"lights": [LAMP], "cameras": [{}]},
        },
        tmp_path,
    )
    told = [text for text in check_scene(s, build_parts(s)) if "sees no surface" in text or "single precision" in text]
    how = " (terrain.origin and trajectory.origin: the place in a file's coordinates that becomes 0, 0, 0)"
    assert [text.endswith(how) for text in told] == [True, True]


@pytest.mark.parametrize(("density", "told"), [(1.7e-4, False), (2e-3, False), (0.005, True), (0.03, True)])
def test_a_gyroscope_whose_noise_looks_like_degrees_is_told_of(density, told):
    """0.005 degrees/s/sqrt(Hz) is what data sheets of the MPU-6050 say: 8.7e-5 rad/s/sqrt(Hz)."""
    noise = {"gyroscope_noise_density": density}
    found = [
        text
        for text in warnings(
            terrain=FLAT, vehicle={"cameras": [{"rotation_euler_deg": [-60, 0, 0]}], "imu": {"noise": noise}}
        )
        if "gyroscope" in text
    ]
    assert [text.startswith("vehicle.imu.noise.gyroscope_noise_density: ") for text in found] == [True] * told
    if told:
        assert f"if it is in degrees, give {np.radians(density):.3g}" in found[0]


@pytest.mark.parametrize(("resolution", "swapped"), [([480, 640], True), ([512, 640], True), ([640, 480], False)])
def test_swapped_sides_of_an_image_are_noticed(resolution, swapped):
    """Of which the principal point of an image of 640 x 480 would be in the middle the other way round."""
    camera = {"id": "M0", "resolution": resolution, "intrinsics": {"fx": 543.3, "fy": 542.4, "cx": 322.2, "cy": 236.9}}
    texts = warnings(terrain=FLAT, vehicle={"cameras": [camera]})
    says = [text for text in texts if "are width and height of resolution swapped?" in text]
    assert len(says) == swapped


def test_a_camera_that_stands_on_its_side_is_not_taken_for_a_swapped_one():
    camera = {"id": "M0", "resolution": [480, 640], "intrinsics": {"fx": 543.3, "fy": 542.4, "cx": 236.9, "cy": 322.2}}
    assert not [text for text in warnings(terrain=FLAT, vehicle={"cameras": [camera]}) if "swapped" in text]


def test_a_principal_point_outside_of_the_image_is_noticed():
    camera = {"id": "M0", "resolution": [640, 480], "intrinsics": {"fx": 543.3, "fy": 542.4, "cx": 3222, "cy": 236.9}}
    assert any("principal point" in text for text in warnings(terrain=FLAT, vehicle={"cameras": [camera]}))


LAMP_TABLES = {
    "angle_deg,intensity\n0,1\n0.5,0.8\n1.5708,0\n": "1.571 degrees at most",
    "angle_deg,intensity\n0,1\n30,0.8\n90,0\n": None,
    "polar_deg,azimuth_deg,intensity\n0,0,1\n1.5,0,0\n": "1.5 degrees at most",
}


@pytest.mark.parametrize(("text", "says"), LAMP_TABLES.items())
def test_a_table_of_a_lamp_whose_angles_look_like_radians_is_noticed(tmp_path, text, says):
    (tmp_path / "lamp.csv").write_text(text)
    texts = warnings(
        tmp_path=tmp_path, terrain=FLAT, vehicle={"lights": [LAMP | {"kind": "profile", "file": "lamp.csv"}]}
    )
    found = [text for text in texts if "radians" in text]
    assert len(found) == (says is not None)
    assert not says or (says in found[0] and found[0].startswith("vehicle.lights.0.file"))


def test_a_phase_function_whose_angles_look_like_radians_is_noticed(tmp_path):
    (tmp_path / "vsf.csv").write_text("angle_deg,p\n0.01,100\n1,1\n3.14,0.1\n")
    phase = {"kind": "tabulated", "file": "vsf.csv"}
    water = {"coefficients": {"sigma_s": [0.1, 0.1, 0.1], "sigma_a": [0.1, 0.1, 0.1], "phase": phase}}
    (text,) = (text for text in warnings(tmp_path=tmp_path, terrain=FLAT, water=water) if "radians" in text)
    assert text.startswith("water: ")
    assert "3.14 degrees at most" in text
