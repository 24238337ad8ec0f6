"""Patterns are the courses that their keys say, and constant speed is constant."""

import numpy as np
import pytest

from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.errors import InputError
from varos_warp.scene.description import Scene
from varos_warp.scene.description.patterns import STEP_DEG
from varos_warp.scene.file.load import scene_from_dict, scene_to_dict
from varos_warp.scene.frames import attitudes
from varos_warp.scene.info import scene_info
from varos_warp.sim.guidance import TICK_S, Guidance, plan
from varos_warp.sim.trajectory import course_facts, simulate

LAWN_MOWER = {"kind": "lawn_mower", "centre": (3.0, -2.0, 1.5), "length_m": 8.0, "width_m": 5.0, "spacing_m": 2.0}
ORBIT = {"kind": "orbit", "centre": (1.0, 2.0, 0.5), "radius_m": 3.0, "height_m": 1.0}
SPIRAL = {"kind": "spiral", "centre": (0.0, 0.0, 0.0), "radius_m": 2.0, "rise_m": 1.5, "turns": -1.5}
THERE_AND_BACK = {"kind": "there_and_back", "start": (1.0, 0.0, 1.0), "end": (4.0, 4.0, 1.0), "times": 2}
TRACKING_M = 0.03
"""Distance of a vehicle with the default thrusters from its reference at accelerations of 0.25 m/s^2."""


def scene(pattern: dict | None = None, **trajectory) -> Scene:
    return scene_from_dict({"trajectory": trajectory | ({"pattern": pattern} if pattern else {})})


def stops_of(pattern: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions [N, 3] of the waypoints, and the vehicle's forward and right directions there [N, 3]."""
    stops = scene(pattern).trajectory.stops
    R = np.array([a.as_matrix() for a in attitudes(stops)])
    return np.array([stop.position for stop in stops]), R[:, :, 1], R[:, :, 0]


def speed(trajectory) -> np.ndarray:
    return np.linalg.norm(trajectory.velocity, axis=1)


def circle(radius: float, count: int) -> list[dict]:
    return [{"position": (radius * np.sin(a), radius * np.cos(a), 0.0)} for a in np.linspace(0.0, 2 * np.pi, count + 1)]


# ----------------------------------------------------------------------------------------------------------- geometry


@pytest.mark.parametrize("heading", [0.0, 90.0, 217.0])
def test_lanes_of_a_lawn_mower_share_the_width_and_lie_around_its_centre(heading):
    """5 m with at most 2 m between lanes are four lanes, 5 / 3 m apart; headings turn from north (+y) to east (+x)."""
    places, forward, _ = stops_of(LAWN_MOWER | {"heading_deg": heading})
    along = np.array([np.sin(np.radians(heading)), np.cos(np.radians(heading)), 0.0])
    right = np.array([along[1], -along[0], 0.0])
    x, y = (places - LAWN_MOWER["centre"]) @ right, (places - LAWN_MOWER["centre"]) @ along
    ends = np.flatnonzero(np.abs(np.abs(forward @ along) - 1.0) < 1e-12)
    np.testing.assert_allclose(x[ends], np.repeat([-2.5, -2.5 / 3, 2.5 / 3, 2.5], 2), atol=1e-12)
    np.testing.assert_allclose(y[ends], [-4, 4, 4, -4, -4, 4, 4, -4], atol=1e-12)
    np.testing.assert_allclose(forward[ends] @ along, [1, 1, -1, -1, 1, 1, -1, -1], atol=1e-12)
    np.testing.assert_allclose(places[:, 2], 1.5, atol=1e-12)


def test_a_width_of_whole_spacings_is_covered_without_a_lane_more():
    assert scene(LAWN_MOWER | {"width_m": 0.3, "spacing_m": 0.1}).trajectory.pattern.lanes == 4


def test_lanes_are_joined_by_half_circles_along_which_the_vehicle_looks():
    places, forward, _ = stops_of(LAWN_MOWER | {"width_m": 2.0})
    arc = slice(1, -1)  # two lanes: the end of the first, the half circle, the beginning of the second
    centre = np.array([3.0, 2.0, 1.5])
    np.testing.assert_allclose(np.linalg.norm(places[arc] - centre, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.sum((places[arc] - centre) * forward[arc], axis=1), 0.0, atol=1e-12)
    assert places[arc][:, 1].max() == pytest.approx(3.0)


def test_pitch_lowers_the_nose_and_nothing_rolls():
    for pattern in (LAWN_MOWER, THERE_AND_BACK):
        _, forward, right = stops_of(pattern | {"pitch_deg": -30.0})
        np.testing.assert_allclose(forward[:, 2], -0.5, atol=1e-12)
        np.testing.assert_allclose(right[:, 2], 0.0, atol=1e-12)


@pytest.mark.parametrize(("turns", "bearing"), [(1.0, 0.0), (-0.25, 90.0), (2.5, -30.0)])
def test_an_orbit_goes_round_by_compass_and_looks_at_its_centre(turns, bearing):
    places, forward, _ = stops_of(ORBIT | {"turns": turns, "bearing_deg": bearing})
    out = places - ORBIT["centre"]
    np.testing.assert_allclose(np.linalg.norm(out[:, :2], axis=1), 3.0, atol=1e-12)
    np.testing.assert_allclose(out[:, 2], 1.0, atol=1e-12)
    np.testing.assert_allclose(np.cross(forward, out), 0.0, atol=1e-12)
    assert (np.sum(forward * out, axis=1) < 0.0).all()
    passed = np.unwrap(np.arctan2(out[:, 0], out[:, 1]))
    np.testing.assert_allclose(np.degrees(passed), np.linspace(bearing, bearing + 360.0 * turns, len(out)), atol=1e-9)
    assert np.abs(np.diff(passed)).max() <= np.radians(STEP_DEG) * (1.0 + 1e-12)


def test_a_spiral_rises_evenly_and_looks_level_at_its_axis():
    places, forward, _ = stops_of(SPIRAL)
    np.testing.assert_allclose(places[:, 2], np.linspace(0.0, 1.5, len(places)), atol=1e-12)
    np.testing.assert_allclose(places * [1, 1, 0] + 2.0 * forward, 0.0, atol=1e-12)


def test_there_and_back_ends_where_it_starts_and_faces_the_end():
    places, forward, _ = stops_of(THERE_AND_BACK)
    np.testing.assert_array_equal(places[::2], [(1.0, 0.0, 1.0)] * 3)
    np.testing.assert_array_equal(places[1::2], [(4.0, 4.0, 1.0)] * 2)
    np.testing.assert_allclose(forward, [(0.6, 0.8, 0.0)] * 5, atol=1e-12)


# ------------------------------------------------------------------------------------------------------------- driven


@pytest.fixture(scope="module")
def orbit():
    return simulate(scene(ORBIT, constant_speed=None))


def test_the_vehicle_keeps_its_distance_from_what_it_orbits_and_looks_at_it(orbit):
    """Within the tracking error, and the 0.1 % by which chords of 5 degrees lie inside their circle."""
    out = orbit.trajectory.position - ORBIT["centre"]
    chord = 3.0 * (1.0 - np.cos(np.radians(STEP_DEG / 2.0)))
    assert np.abs(np.linalg.norm(out[:, :2], axis=1) - 3.0).max() < TRACKING_M + chord
    forward = orbit.trajectory.rotation().as_matrix()[:, :, 1]
    past = np.linalg.norm(np.cross(forward, -out), axis=1)  # how far from the centre the line of sight passes
    assert past.max() < 2.0 * TRACKING_M


@pytest.mark.parametrize("count", [36, 72, 200])
def test_constant_speed_keeps_the_speed_past_closely_spaced_waypoints(count):
    """Once it is up: 2 s from rest, if the acceleration is on average 0.17 m/s^2, and a few legs more."""
    trajectory = simulate(scene(waypoints=circle(3.0, count), constant_speed=True)).trajectory
    cruising = speed(trajectory)[int(6.0 / TICK_S) : -int(6.0 / TICK_S)]
    np.testing.assert_allclose(cruising, 0.5, rtol=0.02)
    assert speed(trajectory)[0] == 0.0


def test_without_it_the_speed_is_the_papers_which_brakes_at_every_waypoint():
    trajectory = simulate(scene(waypoints=circle(3.0, 36))).trajectory
    assert speed(trajectory)[int(6.0 / TICK_S) : -int(6.0 / TICK_S)].mean() < 0.25


def test_patterns_keep_the_speed_unless_told_otherwise(orbit):
    assert speed(orbit.trajectory).max() < 0.52
    assert np.median(speed(orbit.trajectory)) == pytest.approx(0.5, rel=0.02)
    braking = plan(scene(ORBIT, constant_speed=False).trajectory)
    assert all(leg.blends is None for leg in braking.legs)


def test_lanes_are_driven_at_the_speed_asked_and_turns_as_the_acceleration_allows():
    """Half circles 2 m wide at 0.41 m/s: v^2 / R is at most max_acceleration / 1.5, the peak of a hand-over."""
    run = simulate(scene(LAWN_MOWER | {"width_m": 2.0, "length_m": 10.0, "pitch_deg": -20.0}))
    y = run.trajectory.position[:, 1] - LAWN_MOWER["centre"][1]
    v, t = speed(run.trajectory), run.trajectory.time_ns * 1e-9
    on_lane = (np.abs(y) < 2.0) & (t > 6.0)
    np.testing.assert_allclose(v[on_lane], 0.5, rtol=0.02)
    turning = y > 5.5
    np.testing.assert_allclose(v[turning], np.sqrt(0.25 * 1.0 / 1.5), rtol=0.04)  # legs of 43.4 ticks; 43 or 44
    assert np.linalg.norm(run.trajectory.acceleration, axis=1).max() < 0.25 * 1.15
    assert run.messages == []


def test_a_leg_between_equal_ones_is_driven_at_exactly_the_speed_asked():
    """The speeds of two legs that hand over add up to it."""
    points = [{"position": (0, y, 0)} for y in (0, 3, 4, 5, 8)]
    legs = plan(scene(waypoints=points, constant_speed=True).trajectory).legs
    t, starts = np.arange(0.0, 20.0, TICK_S), np.cumsum([0.0, *(leg.duration - leg.blends[1] for leg in legs)])
    total = sum(
        np.where((t >= s) & (t <= s + leg.duration), leg.weight(t - s)[1] * leg.step[1], 0.0)
        for s, leg in zip(starts, legs, strict=False)
    )
    np.testing.assert_allclose(total[(t > 3.0) & (t < starts[-1] - 3.0)], 0.5, rtol=1e-12)


def test_a_leg_of_constant_speed_ends_at_its_waypoint_and_its_rates_are_derivatives():
    leg = plan(scene(waypoints=[{"position": (0, y, 0)} for y in (0, 3, 4)], constant_speed=True).trajectory).legs[0]
    t = np.linspace(0.0, leg.duration, 20_001)
    w, rate, acceleration = leg.weight(t)
    assert w[0] == 0.0
    assert w[-1] == pytest.approx(1.0, abs=1e-14)
    h = t[1] - t[0]
    jerk = 6.0 / min(leg.blends) ** 2 / leg.ideal_time
    np.testing.assert_allclose(rate[1:-1], (w[2:] - w[:-2]) / (2 * h), atol=jerk * h**2)
    np.testing.assert_allclose(acceleration[1:-1], (rate[2:] - rate[:-2]) / (2 * h), atol=jerk * h)


@pytest.mark.parametrize("seed", range(5))
def test_the_reference_keeps_to_max_acceleration_and_ends_at_the_last_waypoint(seed):
    """Past corners and reversals, long legs and short ones; ticks shorten a change of velocity by two at most."""
    random = np.random.default_rng(seed)
    steps = random.normal(size=(7, 3)) * 10.0 ** random.uniform(-1.0, 1.0, (7, 1))
    steps[3] = -steps[2]
    places = np.cumsum(steps, axis=0)
    course = plan(scene(waypoints=[{"position": tuple(p)} for p in places], constant_speed=True).trajectory)
    guide, last, rows = Guidance(course), tuple(places[0]), []
    while not guide.finished:
        reference = guide.reference(len(rows), last, (1.0, 0.0, 0.0, 0.0))
        last = reference.position
        rows.append(reference.acceleration)
    shortest = min(min(leg.blends) for leg in course.legs)
    assert np.linalg.norm(rows, axis=1).max() <= 0.25 * (1.0 + 3.0 * TICK_S / shortest)
    np.testing.assert_allclose(last, places[-1], atol=1e-12)
    # no gate holds up a vehicle that is where it should be, though it is still far from a corner that it will round
    assert len(rows) * TICK_S == pytest.approx(course.duration, abs=2.0 * TICK_S)


def test_at_constant_speed_the_vehicle_still_stops_where_it_is_told_to():
    points = [
        {"position": (0, 0, 0)},
        {"position": (0, 2, 0), "dwell_s": 2.0},
        {"position": (0, 4, 0), "strict": True},
        {"position": (0, 6, 0)},
    ]
    trajectory = simulate(scene(waypoints=points, constant_speed=True)).trajectory
    for goal, rest in ((2.0, 2.0), (4.0, 0.25)):
        assert (np.abs(trajectory.position[:, 1] - goal) < 0.005).sum() * TICK_S >= rest


def test_the_reference_heads_for_the_waypoints_of_the_scene_though_legs_are_divided():
    run = simulate(
        scene(
            waypoints=[{"position": p} for p in ((0, 0, 0), (0, 8, 0), (0.3, 8, 0), (0.3, 0, 0))], constant_speed=True
        )
    )
    assert len(plan(scene(LAWN_MOWER).trajectory).legs) > len(scene(LAWN_MOWER).trajectory.stops) - 1
    assert list(np.unique(run.waypoint)) == [1, 2, 3]
    assert (np.diff(run.waypoint) >= 0).all()


def test_a_constant_speed_that_no_leg_has_is_said_once():
    said = simulate(scene(ORBIT | {"radius_m": 0.3})).messages
    assert len(said) == 1
    assert "trajectory.speed: asked for 0.5 m/s" in said[0]


@pytest.mark.parametrize("pattern", [LAWN_MOWER, ORBIT, SPIRAL, THERE_AND_BACK], ids=lambda p: p["kind"])
def test_imu_and_depth_gauge_of_a_pattern_are_consistent(tmp_path, pattern):
    short = {"duration_s": 15.0, "pattern": pattern}
    produce(scene_from_dict({"surface_depth_m": 20.0, "trajectory": short}), tmp_path / "out", images=False, quiet=True)
    assert validate(tmp_path / "out", quiet=True).problems == []


# -------------------------------------------------------------------------------------------------- what is said of it


def test_info_states_the_course(orbit):
    assert scene_info(scene(ORBIT), [])["trajectory"] == {"kind": "waypoints", "count": 73, "pattern": "orbit"}
    facts = course_facts(orbit, scene(ORBIT))
    assert facts["length_m"] == pytest.approx(2.0 * np.pi * 3.0, rel=0.01)
    assert facts["duration_s"] == pytest.approx(orbit.frames.time_ns[-1] * 1e-9)


@pytest.mark.parametrize("pattern", [LAWN_MOWER, ORBIT, SPIRAL, THERE_AND_BACK], ids=lambda p: p["kind"])
def test_a_scene_with_a_pattern_is_written_as_it_was_given(pattern):
    written = scene_to_dict(scene(pattern))["trajectory"]
    assert written["pattern"]["kind"] == pattern["kind"]
    assert written["waypoints"] is None
    assert scene_from_dict({"trajectory": written}) == scene(pattern)


def test_a_scene_without_a_pattern_is_written_as_before():
    assert not {"pattern", "constant_speed"} & set(scene_to_dict(scene(waypoints=circle(1.0, 3)))["trajectory"])


@pytest.mark.parametrize(
    ("trajectory", "key", "says"),
    [
        ({"pattern": ORBIT, "waypoints": circle(1.0, 3)}, "trajectory", "exactly one of waypoints, poses, pattern"),
        ({}, "trajectory", "exactly one of waypoints, poses, pattern"),
        ({"poses": [{"position": (0, 0, 0)}], "constant_speed": True}, "trajectory", "constant_speed"),
        ({"pattern": ORBIT | {"kind": "orbti"}}, "trajectory.pattern", "Did you mean 'orbit'?"),
        ({"pattern": {"centre": (0, 0, 0)}}, "trajectory.pattern", "Known here: lawn_mower, orbit"),
        ({"pattern": ORBIT | {"radius_m": 0.0}}, "trajectory.pattern.radius_m", "above 0"),
        ({"pattern": ORBIT | {"turns": 0.0}}, "trajectory.pattern.turns", "hundredth"),
        ({"pattern": ORBIT | {"rise_m": 1.0}}, "trajectory.pattern.rise_m", "unknown key"),
        ({"pattern": LAWN_MOWER | {"spacing_m": 1e-6}}, "trajectory.pattern.spacing_m", "more than 500 lanes"),
        ({"pattern": THERE_AND_BACK | {"end": (1.0, 0.0, 1.0)}}, "trajectory.pattern", "must differ"),
        ({"pattern": THERE_AND_BACK | {"times": 0}}, "trajectory.pattern.times", "at least 1"),
    ],
)
def test_a_bad_pattern_is_refused_by_its_key(trajectory, key, says):
    with pytest.raises(InputError) as error:
        scene_from_dict({"trajectory": trajectory})
    assert error.value.key == key
    assert says in str(error.value)


@pytest.mark.parametrize("limit", ["speed", "max_acceleration", "max_angular_speed_deg"])
def test_a_pattern_that_takes_for_ever_is_refused(limit):
    with pytest.raises(InputError, match="the course takes") as error:
        simulate(scene(ORBIT, **{limit: 5e-324}))
    assert error.value.key == "trajectory.pattern"
