"""A vehicle with thrusters, turbulence and hull-following in a scene: what it does, and what is said of it."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh

from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.errors import InputError
from varos_warp.scene.checks import check_scene
from varos_warp.scene.file.load import scene_from_dict, scene_to_dict
from varos_warp.scene.frames import attitudes
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.course import find_course
from varos_warp.scene.geometry.surface import Surface
from varos_warp.scene.info import scene_info
from varos_warp.sim.trajectory import simulate
from varos_warp.sim.vehicle.thrusters import PITCH, ROLL, thrusters

S = 0.5**0.5
VECTORED = [
    {"position": (x * 0.11, y * 0.16, 0.02), "direction": (-x * S, y * S, 0.0), "max_force": 40.0}
    for x in (1, -1)
    for y in (1, -1)
]
ROLLING = [{"position": (x * 0.12, 0.0, 0.0), "direction": (0.0, 0.0, 1.0), "max_force": 40.0} for x in (1, -1)]
EIGHT = VECTORED + [
    {"position": (x * 0.12, y * 0.12, 0.0), "direction": (0, 0, 1), "max_force": 40.0} for x in (1, -1) for y in (1, -1)
]
SIX = VECTORED + ROLLING
ROV = {
    "inertia": (0.26, 0.23, 0.37),
    "added_mass": (7.1, 6.4, 18.7, 0.19, 0.12, 0.22),
    "linear_drag": (18.0, 14.0, 60.0, 1.1, 0.9, 1.2),
    "quadratic_drag": (60.0, 40.0, 90.0, 1.6, 1.3, 1.6),
}
TURBULENCE = {"rms": (0.06, 0.06, 0.04), "correlation_time_s": 5.0}
LANE = [{"position": (0.0, 0.0, 0.0)}, {"position": (0.0, 4.0, 0.0)}]


def scene(engines=SIX, waypoints=LANE, current=None, trajectory=None, **vehicle):
    body = {"mass_kg": 13.5, "metacentric_height": 0.06, "rigid_body": ROV | {"thrusters": engines}} | vehicle
    return scene_from_dict(
        {
            "vehicle": body,
            "current": current or {},
            "surface_depth_m": 20.0,
            "trajectory": trajectory or {"waypoints": waypoints, "speed": 0.4},
        }
    )


def tilt(simulation) -> np.ndarray:
    """Heading, pitch and roll [N, 3] [degrees]."""
    return simulation.trajectory.rotation().as_euler("ZXY", degrees=True)


# ---------------------------------------------------------------------------------------------------------- thrusters


def allocated(engines, righted=True):
    return thrusters(scene(engines).vehicle.rigid_body.thrusters, 0.15, righted)


@pytest.mark.parametrize(
    ("engines", "free"),
    [(EIGHT, ()), (SIX, (PITCH,)), (VECTORED + [ROLLING[0] | {"position": (0, 0, 0)}], (PITCH, ROLL))],
)
def test_thrusters_give_what_is_asked_of_the_axes_that_they_control(engines, free):
    share = allocated(engines)
    assert share.free == free
    force, torque, limited = share.deliver((3.0, -5.0, 2.0), (0.2, -0.1, 0.3))
    asked = np.array([3.0, -5.0, 2.0, 0.2, -0.1, 0.3])
    held = [i for i in range(6) if i not in free]
    np.testing.assert_allclose(np.array([*force, *torque])[held], asked[held], atol=1e-13)
    assert not limited


def test_the_pseudo_inverse_shares_by_hand_between_four_vectored_thrusters():
    """10 N ahead: each gives 10/(4 cos 45) N; 2 cm above the centre of mass they pitch the nose down by 0.2 N m."""
    share = allocated(SIX)
    np.testing.assert_allclose(np.abs(share.allocation @ [0, 10.0, 0, 0, 0, 0])[:4] * 40.0, 2.5 / S, rtol=1e-12)
    assert share.deliver((0.0, 10.0, 0.0), (0.0, 0.0, 0.0))[1] == pytest.approx((-0.2, 0.0, 0.0), abs=1e-13)
    assert share.deliver((0.0, 1e4, 0.0), (0.0, 0.0, 0.0))[0] == pytest.approx((0.0, 160.0 * S, 0.0), abs=1e-10)


def test_no_force_that_is_promised_is_refused():
    share, rng = allocated(EIGHT), np.random.default_rng(1)
    for d in rng.normal(size=(200, 3)):
        d *= 0.999 / np.linalg.norm(d)
        assert not share.deliver(tuple(d * share.max_force), (0.0, 0.0, 0.0))[2]
        assert not share.deliver((0.0, 0.0, 0.0), tuple(d * share.max_torque))[2]


@pytest.mark.parametrize(
    ("vehicle", "says"),
    [
        ({"engines": VECTORED}, "no force upwards"),
        ({"engines": [e | {"position": (0, 0, 0)} for e in EIGHT]}, "no yaw moment"),
        ({"engines": ROLLING}, "together they give no"),
        ({"metacentric_height": 0.0}, "nothing else holds the vehicle upright"),
    ],
)
def test_thrusters_that_cannot_hold_a_vehicle_are_refused(vehicle, says):
    with pytest.raises(InputError, match=says) as error:
        simulate(scene(**vehicle))
    assert error.value.key == "vehicle.rigid_body.thrusters"
    assert error.value.remedy


@pytest.mark.parametrize(
    ("vehicle", "says"),
    [
        ({"max_force": 10.0}, "not both"),
        ({"rigid_body": {"inertia": (1.0, 1.0, 3.0)}}, "sum of the other two"),
        ({"rigid_body": {"thrusters": []}}, "too few items"),
        ({"rigid_body": {"thrusters": [{"position": (0, 0, 0), "direction": (0, 0, 0), "max_force": 1}]}}, "direction"),
        ({"rigid_body": {"added_mass": (1, 2, 3)}}, "added_mass"),
    ],
)
def test_a_body_that_cannot_be_is_refused(vehicle, says):
    with pytest.raises(InputError, match=says):
        scene(**vehicle)


def test_a_metacentric_height_too_large_for_the_clock_is_refused_and_a_large_one_is_cut_into_substeps():
    with pytest.raises(InputError, match="metacentric_height"):
        simulate(scene(metacentric_height=500.0))
    run = simulate(scene(EIGHT, metacentric_height=2.0))
    assert np.abs(tilt(run)[:, 1:]).max() < 1.0


# -------------------------------------------------------------------------------------------------------- what it does


def test_thrusters_above_the_centre_of_mass_push_the_nose_down_as_the_righting_moment_allows():
    """In steady motion: the moments of thrust, flow and buoyancy balance; ours and the hand's pitch within 10 %."""
    run = simulate(
        scene(
            waypoints=[LANE[0], {"position": (0.0, 12.0, 0.0)}],
            trajectory={"waypoints": [LANE[0], {"position": (0.0, 12.0, 0.0)}], "speed": 0.4, "constant_speed": True},
        )
    )
    pitch, speed = np.radians(np.median(tilt(run)[1500:-1500, 1])), 0.4
    thrust = (14.0 + 40.0 * speed) * speed
    # nose down by p, the water comes from above by v sin p: Munk's moment turns it further
    stiffness = 13.5 * 9.81 * 0.06 - (18.7 - 6.4) * speed**2
    assert pitch == pytest.approx(-0.02 * thrust / stiffness, rel=0.1)
    assert np.abs(tilt(run)[:, 2]).max() < 0.1


def test_pitch_that_the_thrusters_do_not_control_is_left_out_and_said():
    posed = [w | {"rotation_euler_deg": (-30.0, 0.0, 0.0)} for w in LANE]
    run = simulate(scene(waypoints=posed))
    assert any("do not control pitch" in message and "30 deg" in message for message in run.messages)
    assert np.abs(tilt(run)[:, 1]).max() < 10.0
    held = simulate(scene(EIGHT, waypoints=posed))
    assert not held.messages
    np.testing.assert_allclose(tilt(held)[-400:, 1], -30.0, atol=0.5)  # it starts with its thrusters at rest


def test_what_the_thrusters_or_the_righting_moment_cannot_hold_is_said():
    fast = simulate(
        scene(
            trajectory={
                "waypoints": [LANE[0], {"position": (0, 30, 0)}],
                "speed": 3.0,
                "max_acceleration": 2.0,
                "handover_timeout_s": 1.0,
            }
        )
    )
    assert any("vehicle.rigid_body.thrusters" in m and "cannot go faster" in m for m in fast.messages)
    assert any("turns the vehicle across" in m for m in simulate(scene(metacentric_height=0.01)).messages)
    swept = simulate(scene(current={"velocity": (5.0, 0, 0)}, trajectory={"waypoints": LANE, "duration_s": 1.0}))
    assert any("swept away" in m for m in swept.messages)


def test_turbulence_makes_roll_pitch_and_heave_live_and_readings_stay_consistent(tmp_path):
    lively = scene(current={"turbulence": TURBULENCE})
    produce(lively, tmp_path / "out", images=False, quiet=True)
    assert validate(tmp_path / "out", quiet=True).problems == []
    still, run = simulate(scene()), simulate(lively)
    assert np.ptp(tilt(run)[:, 2]) > 10.0 * np.ptp(tilt(still)[:, 2])
    assert np.ptp(run.trajectory.position[:, 2]) > 2.0 * np.ptp(still.trajectory.position[:, 2])
    brief = {"waypoints": LANE, "speed": 0.4, "duration_s": 2.0}
    one, again, other = (
        simulate(scene(current={"turbulence": TURBULENCE | seed}, trajectory=brief)).trajectory
        for seed in ({}, {}, {"seed": 1})
    )
    assert again.position.tobytes() == one.position.tobytes() != other.position.tobytes()


def test_what_is_absent_is_not_written():
    plain = scene_to_dict(scene_from_dict({"trajectory": {"waypoints": LANE}}))
    assert "rigid_body" not in plain["vehicle"]
    assert "turbulence" not in plain["current"]
    assert scene_to_dict(scene_from_dict(scene_to_dict(scene()))) == scene_to_dict(scene())


# ------------------------------------------------------------------------------------------------------ hull-following


PIPE = {"kind": "pipe", "radius": 1.0, "length": 10.0, "wall": 0.2, "rotation_euler_deg": (90, 0, 0)}
HULL = {
    "kind": "hull_following",
    "surface": "objects.0",
    "distance_m": 1.5,
    "through": [(2, -3, 0.5), (2, 3, 0.5), (0, 3, -2), (0, -3, -2)],
}


def along(pattern=HULL, **blocks):
    return scene_from_dict({"objects": [PIPE], "trajectory": {"speed": 0.4, "pattern": pattern}} | blocks)


def test_the_course_keeps_its_distance_from_the_hull_and_faces_it():
    """A cylinder about y: 2.5 m from its axis, within what its chords leave; always looking at the axis."""
    run = simulate(along())
    p, forward = run.trajectory.position, run.trajectory.rotation().as_matrix()[:, :, 1]
    radius = np.hypot(p[:, 0], p[:, 2])
    assert np.abs(radius - 2.5).max() < 0.03 + 0.25**2 / (8 * 2.5)  # tracking; chords of the course
    towards = -p * [1, 0, 1] / radius[:, None]
    assert np.degrees(np.arccos(np.clip((forward * towards).sum(axis=1), -1, 1))).max() < 3.0
    assert p[0] == pytest.approx(2.5 * np.array([2, 0, 0.5]) / np.hypot(2, 0.5) + [0, -3, 0], abs=1e-2)
    assert p[-1] == pytest.approx([0, -3, -2.5], abs=0.03)


def test_about_an_edge_the_course_is_an_arc_and_its_waypoints_are_never_farther_apart_than_asked(tmp_path):
    """From the side of a box to its end: a straight line, and a quarter circle about the edge."""
    trimesh.creation.box((2.0, 10.0, 2.0)).export(tmp_path / "box.ply")
    pattern = HULL | {"through": [(2, 3, 0), (0.5, 8, 0)], "spacing_m": 0.2}
    s = scene_from_dict({"objects": [{"file": "box.ply"}], "trajectory": {"pattern": pattern}}, tmp_path)
    find_course(s)
    p = np.array([stop.position for stop in s.trajectory.stops])
    assert np.linalg.norm(np.diff(p, axis=0), axis=1).max() <= 0.2
    from_box = np.linalg.norm(np.maximum(np.abs(p) - [1.0, 5.0, 1.0], 0.0), axis=1)
    np.testing.assert_allclose(from_box, 1.5, rtol=1e-9)
    assert np.count_nonzero((p[:, 1] > 5.1) & (p[:, 0] > 1.1)) >= 10
    turned = attitudes(s.trajectory.stops)
    turns = np.degrees([(a.inv() * b).magnitude() for a, b in pairwise(turned)])
    assert turns.max() <= np.degrees(2.0 * np.arcsin(0.2 / 3.0)) * 1.001
    assert turns.sum() == pytest.approx(90.0)


def test_above_terrain_it_flies_at_its_distance_and_looks_down_at_it():
    ground = {"kind": "procedural", "size_m": 20, "resolution": 65, "relief_m": 0.5, "feature_m": 8, "seed": 1}
    s = along(HULL | {"surface": "terrain", "through": [(-3, 0, 0), (3, 1, -5)], "distance_m": 2.0}, terrain=ground)
    parts = build_parts(s)
    find_course(s, parts)
    p = np.array([stop.position for stop in s.trajectory.stops])
    np.testing.assert_allclose(Surface(parts[0].vertices, parts[0].faces).nearest(p)[0], 2.0, rtol=0.01)
    assert (p[:, 2] > 1.0).all()
    assert (np.array([a.as_matrix()[2, 1] for a in attitudes(s.trajectory.stops)]) < 0.0).all()
    assert not [w for w in check_scene(s, parts) if "under" in w or "nearer" in w]
    assert scene_info(s, parts)["trajectory"]["pattern"] == "hull_following"


@pytest.mark.parametrize(
    ("change", "key", "says"),
    [
        ({"surface": "objects.3"}, "trajectory.pattern.surface", "no such surface"),
        ({"surface": "terrain"}, "trajectory.pattern.surface", "no such surface"),
        ({"distance_m": 0.9, "through": [(0.0, 0.0, 0.0), (0, 3, 0)]}, "trajectory.pattern.through", "hollow"),
        ({"through": [(2, 0, 0), (-2, 0, 0)]}, "trajectory.pattern.through", "on the other side"),
        ({"spacing_m": 1e-5}, "trajectory.pattern.spacing_m", "more than"),
    ],
)
def test_a_hull_that_cannot_be_followed_is_refused(change, key, says):
    with pytest.raises(InputError, match=says) as error:
        simulate(along(HULL | change))
    assert error.value.key.startswith(key)
    assert error.value.remedy
