"""What a vehicle does on a recorded course, and what its sensors feel: closed forms, epochs, ends, and what is told."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError
from varos_warp.scene.checks import check_scene
from varos_warp.scene.courses.recorded import RecordedCourse, read_course
from varos_warp.scene.file.load import scene_from_dict, scene_to_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.course import local_origin, standpoints
from varos_warp.scene.info import scene_info
from varos_warp.sim import poses
from varos_warp.sim.companions import companions, motions
from varos_warp.sim.trajectory import course_facts, path_samples, simulate

RADIUS, RATE, STEP_S = 2.0, 0.5, 0.05
"""Of a circle [m], of the turn along it [rad/s], of its recording [s]."""


def circle(count=400, step_s=STEP_S, epoch="1403636579", rate=RATE):
    """A circle at constant speed about the origin, anticlockwise; of ROS, looking along the way."""
    rows = []
    for k in range(count):
        angle = rate * k * step_s
        yaw = angle + np.pi / 2
        ns = f"{k * round(1e9 * step_s) + 763_555_527:010d}"
        rows.append(
            f"{int(epoch) + int(ns[:-9])}.{ns[-9:]} {RADIUS * float(np.cos(angle))!r} "
            f"{RADIUS * float(np.sin(angle))!r} -5 0 0 {float(np.sin(yaw / 2))!r} {float(np.cos(yaw / 2))!r}\n"
        )
    return "".join(rows)


@pytest.fixture
def scene(tmp_path):
    def make(text, blocks=None, **trajectory):
        (tmp_path / "course.txt").write_text(text)
        course = {"file": "course.txt", "of": "vehicle", **trajectory}
        return scene_from_dict({"trajectory": course, **(blocks or {})}, tmp_path)

    return make


def test_the_imu_feels_the_circle(scene):
    """Centripetal acceleration v^2 / r to the left, gravity upwards, the turn about z.

    A cubic spline through an oscillation of rate w errs by (w h)^2 / 12 in its second derivative, away from its ends.
    """
    simulation = simulate(scene(circle()))
    inside = slice(400, -400)
    left = RADIUS * RATE**2
    order = (RATE * STEP_S) ** 2 / 12.0 * left
    np.testing.assert_allclose(
        simulation.imu.acceleration[inside],
        np.tile([-left, 0.0, 9.81], (len(simulation.imu.time_ns[inside]), 1)),
        atol=1.01 * order,
    )
    np.testing.assert_allclose(simulation.imu.angular_velocity[inside] - [0, 0, RATE], 0.0, atol=1e-12)
    np.testing.assert_allclose(
        simulation.trajectory.velocity[inside] - RATE * np.cross([0, 0, 1], simulation.trajectory.position[inside]),
        0.0,
        atol=1e-4 * RADIUS * RATE,
    )


def test_poses_on_ticks_are_those_of_the_file_and_frames_begin_with_the_first(scene):
    recorded = scene(circle(), {"render": {"frame_rate_hz": 20}})
    simulation = simulate(recorded)
    stops = recorded.trajectory.stops
    assert len(simulation.frames) == len(stops) == 400
    np.testing.assert_array_equal(simulation.frames.position, stops.position)
    np.testing.assert_allclose(simulation.frames.rotation().as_matrix(), stops.attitude.as_matrix(), atol=1e-15)


def test_the_epoch_of_the_times_does_not_matter_to_the_last_digit(scene):
    early, late = (simulate(scene(circle(epoch=epoch))) for epoch in ("0", "1700000000"))
    for name in early.trajectory.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(early.trajectory, name), getattr(late.trajectory, name))


def test_listed_poses_and_recorded_ones_give_the_same_course(scene):
    text = circle(40)
    recorded = scene(text)
    simulation = simulate(recorded)
    blocks = [
        {"time_s": 0.05 * k, "position": stop.position, "quaternion": stop.quaternion}
        for k, stop in enumerate(recorded.trajectory.stops)
    ]
    listed = simulate(scene_from_dict({"trajectory": {"poses": blocks}}))
    for name in listed.trajectory.__dataclass_fields__:
        np.testing.assert_allclose(getattr(simulation.trajectory, name), getattr(listed.trajectory, name), atol=1e-9)


def test_a_course_far_away_is_the_same_there(scene):
    far = [569_000.0, 7_033_000.0, 0.0]
    rows = [line.split() for line in circle().splitlines()]
    moved = "".join(
        " ".join([r[0], *(repr(float(x) + o) for x, o in zip(r[1:4], far, strict=True)), *r[4:]]) + "\n" for r in rows
    )
    near, there = simulate(scene(circle())), simulate(scene(moved))
    np.testing.assert_allclose(there.trajectory.position - far, near.trajectory.position, atol=4e-9)  # ulp of 7e6 m
    # 6 / h^2 times half an ulp, for each of three poses
    np.testing.assert_allclose(there.trajectory.acceleration, near.trajectory.acceleration, atol=24 / STEP_S**2 * 1e-9)


def test_a_long_course_is_as_smooth_where_its_pieces_meet(scene, monkeypatch):
    """What moves otherwise at every pose, in pieces of 100 poses and in one."""
    rng = np.random.default_rng(8)
    turns = Rotation.from_rotvec(np.cumsum(rng.normal(size=(1000, 3)) * 0.05, axis=0))
    text = "".join(
        f"{k * 0.05:.9f} {k * 0.05!r} 0 -5 {' '.join(map(repr, q))}\n" for k, q in enumerate(turns.as_quat().tolist())
    )
    whole = simulate(scene(text)).trajectory
    monkeypatch.setattr(poses, "MOST_KNOTS", 100)
    pieces = simulate(scene(text)).trajectory
    for name, atol in (("quaternion", 1e-12), ("angular_velocity", 1e-9), ("angular_acceleration", 1e-7)):
        np.testing.assert_allclose(getattr(pieces, name), getattr(whole, name), atol=atol)


@pytest.mark.parametrize("start_s", [3.0, 7.25])
def test_a_sequence_may_begin_within_the_file(scene, start_s):
    whole, part = simulate(scene(circle())), simulate(scene(circle(), start_s=start_s, duration_s=2.0))
    assert len(part.frames) == 20
    first = round(start_s * 200)
    np.testing.assert_allclose(
        part.trajectory.position, whole.trajectory.position[first : first + len(part.trajectory)], atol=1e-13
    )
    np.testing.assert_allclose(
        part.imu.acceleration, whole.imu.acceleration[first : first + len(part.imu.time_ns)], atol=1e-9
    )
    assert part.messages == []


def test_a_sequence_that_begins_after_the_file_ends_is_refused(scene):
    with pytest.raises(InputError, match=r"is not before the last pose.*last 19\.95 s") as error:
        simulate(scene(circle(), start_s=19.95))
    assert error.value.key == "trajectory.start_s"


def test_a_file_that_lasts_longer_than_a_day_needs_a_duration(scene):
    text = "".join(f"{k * 1000} {k} 0 -5 0 0 0 1\n" for k in range(100))
    with pytest.raises(InputError, match="the poses last 99000 s") as error:
        simulate(scene(text))
    assert error.value.key == "trajectory.file"
    assert len(simulate(scene(text, duration_s=1.0)).frames) == 10


def test_after_the_last_pose_the_vehicle_brakes_and_it_is_said(scene):
    simulation = simulate(scene(circle(), duration_s=24.0))
    assert any(
        words.startswith("trajectory.file: after the last pose at 19.95 s the vehicle brakes")
        for words in simulation.messages
    )
    np.testing.assert_array_equal(simulation.trajectory.velocity[-1], 0.0)


# ------------------------------------------------------------------------------------------------------- what is told


def noisy(amount_m, step_s=STEP_S):
    rng = np.random.default_rng(9)
    rows = [line.split() for line in circle(step_s=step_s).splitlines()]
    return "".join(
        " ".join([r[0], *(repr(float(x) + amount_m * rng.normal()) for x in r[1:4]), *r[4:]]) + "\n" for r in rows
    )


def test_noise_that_becomes_more_than_1_g_is_told_of_with_its_line_and_smoothing_mends_it(scene):
    (words,) = simulate(scene(noisy(0.02))).messages
    assert words.startswith("trajectory.file: line ")
    assert "no underwater vehicle does more than 9.81 m/s^2 (recorded poses have noise" in words
    assert "trajectory.smoothing_s" in words
    assert simulate(scene(noisy(0.02), smoothing_s=2.0)).messages == []


def test_facts_have_root_mean_square_and_peak_of_what_is_felt(scene):
    recorded = scene(circle(2000))
    facts = course_facts(simulate(recorded), recorded)
    assert facts["acceleration"]["rms"] == pytest.approx(RADIUS * RATE**2, rel=1e-3)
    assert facts["angular_velocity"]["peak"] == pytest.approx(RATE, rel=1e-9)
    assert facts["length_m"] == pytest.approx(RADIUS * RATE * 1999 * STEP_S, rel=1e-3)
    assert facts["heads_for"] is None


@pytest.mark.parametrize(("body", "told"), [("flu", False), ("rfu", True), ("frd", False)])
def test_a_vehicle_that_goes_sideways_most_of_the_time_is_told_of(scene, body, told):
    """Upside down is another matter, of which another message tells."""
    messages = simulate(scene(circle(), body=body)).messages
    assert [words for words in messages if "upside down" in words] == messages[: body == "frd"]
    assert [("goes sideways" in words) for words in messages[body == "frd" :]] == [True] * told


def test_info_says_how_the_file_was_read(scene):
    recorded = scene(circle(), {"terrain": {"kind": "procedural", "resolution": 17}})
    about = scene_info(recorded, build_parts(recorded))["trajectory"]
    assert (about["kind"], about["count"]) == ("poses", 400)
    assert about["recorded"] == {
        "file": "course.txt",
        "format": "TUM",
        "of": "vehicle",
        "frame": "enu",
        "attitude": "recorded",
        "body": "flu",
        "poses": 400,
        "step_s": STEP_S,
    }
    json.dumps(about)


# ------------------------------------------------------------------------------------------- whoever asks for stops


def test_stops_are_pose_blocks_made_when_asked_for(scene):
    recorded = scene(circle())
    simulate(recorded)
    stops = recorded.trajectory.stops
    assert isinstance(stops, RecordedCourse)
    assert [stop.time_s for stop in stops[:3]] == pytest.approx([0.0, 0.05, 0.1])
    assert stops[-1].position == tuple(stops.position[-1])
    assert len(list(stops)) == 400


def test_checks_look_at_some_of_many_poses_and_say_so(scene):
    blocks = {"terrain": {"kind": "procedural", "size_m": 40, "resolution": 33, "position": [0, 0, 5]}}
    recorded = scene(circle(5000, step_s=0.01, rate=0.1), blocks)
    parts = build_parts(recorded)
    found = check_scene(recorded, parts, path_samples(simulate(recorded)))
    assert any(
        words.startswith("trajectory: all 1000 poses that are looked at are under the terrain") for words in found
    )


def test_the_local_origin_is_in_the_middle_of_a_course_far_away(scene):
    text = "".join(f"{k} {569_000 + k} 7033000 -5 0 0 0 1\n" for k in range(11))
    recorded = scene(text)
    np.testing.assert_array_equal(local_origin(recorded, []), [569_005, 7_033_000, -5])
    assert len(standpoints(recorded, [])) == 11


def test_poses_outside_of_the_sequence_are_neither_looked_at_nor_in_the_middle(scene):
    """One pose each before and after the seconds 20 to 30 belongs to the splines there."""
    text = "".join(f"{k} {100 * k} 0 {-5 if 15 < k < 35 else 5} 0 0 0 1\n" for k in range(0, 100, 4))
    recorded = scene(text, {"water": {"jerlov": {"type": "IB"}}}, start_s=21.0, duration_s=8.0)
    assert check_scene(recorded, [])[0].startswith("vehicle.lights")  # that there is no light, but none above the sea
    np.testing.assert_array_equal(standpoints(recorded, [])[:, 0], [2000, 2400, 2800, 3200])
    np.testing.assert_array_equal(local_origin(recorded, []), [2600, 0, -5])


def test_a_scene_is_itself_whether_its_file_was_read_or_not(scene):
    read, other = scene(circle()), scene(circle())
    simulate(read)
    assert read == other
    assert scene_to_dict(read)["trajectory"]["file"] == "course.txt"


def test_scenes_without_a_recorded_course_are_written_without_its_keys():
    written = scene_to_dict(scene_from_dict({"trajectory": {"poses": [{"position": [0, 0, 0]}]}}))["trajectory"]
    assert not {"file", "columns", "frame", "of", "body", "attitude", "origin", "start_s", "smoothing_s"} & set(written)


def fleet(**other):
    return {
        "vehicles": [
            {"id": "0", "trajectory": {"poses": [{"position": [0, 0, 0]}], "duration_s": 2.0}},
            {
                "id": "1",
                "trajectory": {"file": "course.txt", **other},
                "body": {"kind": "boulder", "diameter": 0.5},
                "lights": [{"kind": "point", "intensity": [1, 1, 1]}],
            },
        ]
    }


def test_another_vehicle_goes_its_recorded_course(tmp_path):
    (tmp_path / "course.txt").write_text(circle())
    scene = scene_from_dict(fleet(), tmp_path)
    time_ns = np.array([0, 50_000_000, 1_000_000_000])
    T = companions(scene)["vehicles.1"](time_ns)
    np.testing.assert_allclose(T[:, 0, 3], RADIUS * np.cos(RATE * 1e-9 * time_ns), atol=1e-6)
    np.testing.assert_array_equal(motions(scene)["vehicles.1"](time_ns), T)
    body = next(part for part in build_parts(scene) if part.name == "vehicles.1")
    np.testing.assert_allclose(body.origin, [RADIUS, 0.0, -5.0])


def test_another_vehicles_course_is_read_anew_when_its_file_was_saved(tmp_path):
    (tmp_path / "course.txt").write_text(circle())
    before = companions(scene_from_dict(fleet(), tmp_path))["vehicles.1"](np.zeros(1, np.int64))
    (tmp_path / "course.txt").write_text(circle().replace(" -5 ", " -6.5 "))
    after = companions(scene_from_dict(fleet(), tmp_path))["vehicles.1"](np.zeros(1, np.int64))
    np.testing.assert_allclose((after - before)[0, 2, 3], -1.5)


def test_errors_of_another_vehicles_file_name_its_key(tmp_path):
    (tmp_path / "course.txt").write_text("0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n")
    for ask in (simulate, build_parts):
        with pytest.raises(InputError, match="is that of line 1") as error:
            ask(scene_from_dict(fleet(), tmp_path))
        assert (error.value.key, error.value.line) == ("vehicles.1.trajectory.file", 2)
    with pytest.raises(InputError, match="no camera has the id 'Q1'") as error:
        scene_from_dict(fleet(of="Q1"), tmp_path)
    assert error.value.key == "vehicles.1.trajectory.of"


# ----------------------------------------------------------------------------------- what was read, once it is outdated


def found(scene):
    read_course(scene)
    return scene.trajectory.stops


def test_a_changed_key_of_the_trajectory_holds_in_a_copy_and_the_original_keeps_its_poses(scene):
    original = scene(noisy(0.02))
    before = found(original).position
    copy = original.model_copy(update={"trajectory": original.trajectory.model_copy(update={"smoothing_s": 2.0})})
    assert "smoothing" in found(copy).about
    np.testing.assert_array_equal(original.trajectory.stops.position, before)


def test_a_course_of_a_camera_follows_the_cameras_mount(scene):
    """Of a camera that looks north, as the vehicle does: 2 m farther ahead on it puts the vehicle 2 m farther back."""
    text = "".join(f"{k} 0 {k} -5 -0.7071067811865476 0 0 0.7071067811865476\n" for k in range(5))
    near, far = ({"cameras": [{"id": "M0", "position": [0, y, 0]}]} for y in (1, 3))
    original = scene(text, {"vehicle": near}, of="M0")
    before = found(original).position
    moved = scene(text, {"vehicle": far}, of="M0").vehicle
    copy = original.model_copy(update={"vehicle": moved})
    np.testing.assert_allclose(found(copy).position - before, np.tile([0.0, -2.0, 0.0], (5, 1)), atol=1e-12)
    np.testing.assert_array_equal(found(original).position, before)


def test_a_file_that_was_saved_anew_is_read_anew(scene, tmp_path):
    original = scene(circle())
    before = found(original)
    assert found(original) is before
    (tmp_path / "course.txt").write_text(circle().replace(" -5 ", " -6.5 "))
    np.testing.assert_array_equal(found(original).position[:, 2], -6.5)
