"""Several vehicles: lights and bodies of the others, against the same in a scene with one vehicle."""

import numpy as np
import pytest
from rig import TURBID
from test_lens import rectangle
from test_shutters import FOCAL, LAMPS, SIZE

from varos_warp.products.sensors.dvl import beam_directions
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.sim.companions import companions
from varos_warp.sim.trajectory import simulate

pytestmark = pytest.mark.subject("camera")

SECOND = 1_000_000_000
VIEW = {"id": "M0", "resolution": list(SIZE), "sensor_mm": [4.416, 4.416 * SIZE[1] / SIZE[0]], "focal_mm": 3.4}
STILL = {"poses": [{"position": [0, 0, 0]}]}


def stops(*positions, turn_deg=(0, 0, 0)):
    """Exact poses one second apart."""
    return [
        {"time_s": t, "position": list(at), "rotation_euler_deg": [t * angle for angle in turn_deg]}
        for t, at in enumerate(positions)
    ]


def scene_with(*others, lights=(), view=None, **more):
    """A vehicle at rest, with others beside it, or alone."""
    own = {"cameras": [VIEW | (view or {})], "lights": list(lights)}
    if not others:
        return scene_from_dict({"vehicle": own, "trajectory": STILL} | more)
    fleet = [own | {"id": "0", "trajectory": STILL}, *({"id": str(i)} | other for i, other in enumerate(others, 1))]
    return scene_from_dict({"vehicles": fleet} | more)


def wall():
    return rectangle((-9, 2, -9), (18, 0, 0), (0, 0, 18), 0.4, "wall")


def at_rest(T_w_v=None):
    T = np.eye(4) if T_w_v is None else T_w_v
    return lambda offset_ns: np.repeat(T[None], len(offset_ns), axis=0)


@pytest.mark.parametrize("integrator", ["path", "field", "reference"])
def test_lights_of_a_vehicle_at_rest_are_those_of_ones_own_at_that_place(any_field, integrator):
    """To the byte; the camera in the world has no table of the field along its rays in either scene."""
    water, view = {"coefficients": TURBID}, {"mount": "world"}
    position = LAMPS[1]["position"]
    carried = {
        "lights": [LAMPS[1] | {"position": [position[0] - 0.25, *position[1:]]}],
        "trajectory": {"poses": [{"position": [0.25, 0, 0]}]},
    }
    how = {"outputs": "A", "spp": 4, "integrator": integrator}
    scenes = (
        scene_with(lights=LAMPS, view=view, water=water),
        scene_with(carried, lights=LAMPS[:1], view=view, water=water),
    )
    alone, beside = (
        FrameRenderer(scene, "cpu", parts=[wall()]).render(np.eye(4), **how).A.radiance for scene in scenes
    )
    assert alone.mean() > 0.0
    assert np.array_equal(alone, beside)


def test_lights_move_with_their_vehicle_while_a_shutter_is_open():
    """A camera in the world sees the same, to the byte, whether its own vehicle or another carries the lights."""
    water, view = {"coefficients": TURBID}, {"mount": "world", "exposure": {"time_s": 0.2, "readout_s": 0.1}}
    course = {"poses": stops((0, 0, 0), (0.8, 0.1, 0.2), (1.0, 0, 0), turn_deg=(0, 10, 30))}
    how = {"outputs": "A", "spp": 4, "integrator": "path", "time_ns": SECOND // 2}
    scene = scene_with(lights=LAMPS, view=view, water=water).model_copy(
        update={"trajectory": scene_with({"trajectory": course}).companions["vehicles.1"].trajectory}
    )
    simulation = simulate(scene)
    T_w_v = simulation.trajectory.at([SECOND // 2]).T_w_v(0)
    mine = FrameRenderer(scene, "cpu", parts=[wall()]).render(T_w_v, motion=simulation.motion(SECOND // 2), **how)
    other = scene_with({"lights": LAMPS, "trajectory": course}, view=view, water=water)
    renderer = FrameRenderer(other, "cpu", parts=[wall()])
    theirs = renderer.render(np.eye(4), motion=at_rest(), **how)
    assert np.array_equal(mine.A.radiance, theirs.A.radiance)
    sharp = renderer.render(np.eye(4), **how)
    assert np.abs(sharp.A.radiance - theirs.A.radiance).max() > 0.1 * theirs.A.radiance.max()


def test_a_body_looks_as_an_object_on_that_path_does():
    """B with its blur, C, D and S to a rounding, and numbers after those of the objects."""
    body = {"kind": "boulder", "diameter": 1.2, "seed": 3}
    path = stops((-0.4, 2, 0), (0.3, 2.2, 0.2), (0.5, 2.4, 0), turn_deg=(0, 20, 60))
    view = {"exposure": {"time_s": 0.1}}
    how = {"outputs": "BCDS", "spp_b": 4, "motion": at_rest(), "time_ns": 700_000_000}
    other = scene_with({"body": body, "trajectory": {"poses": path}}, view=view)
    got, expected = (
        FrameRenderer(scene, "cpu").render(np.eye(4), **how)
        for scene in (other, scene_with(view=view, objects=[body | {"path": path}]))
    )
    assert other.number_of("vehicles.1") == 1
    assert (got.S.instance == 1).sum() > 100
    same = got.S.instance == expected.S.instance
    assert same.mean() > 0.998
    np.testing.assert_allclose(got.D.range[same], expected.D.range[same], atol=2e-6)
    assert (np.abs(got.C.normal - expected.C.normal)[same] > 1e-5).any(-1).mean() < 0.002  # an edge between triangles
    assert (np.abs(got.B.radiance - expected.B.radiance) > 1e-3).any(-1).mean() < 0.01


def test_each_sees_the_other_where_geometry_has_it():
    """A rod of 0.5 m before each: a disk of f r / Z pixels about the projection of its axis, at one time in both."""
    radius, length, apart, speed = 0.2, 0.5, 3.0, 0.3
    rod = {"kind": "pipe", "radius": radius, "length": length, "wall": 1, "rotation_euler_deg": [90, 0, 0]}
    back = {"rotation_euler_deg": [0, 0, 180]}
    scene = scene_from_dict(
        {
            "vehicles": [
                {"id": "a", "body": rod, "cameras": [VIEW], "trajectory": {"poses": stops((0, 0, 0), (speed, 0, 0))}},
                {
                    "id": "b",
                    "body": rod,
                    "cameras": [VIEW],
                    "trajectory": {
                        "poses": [{"time_s": t, "position": [0, apart, t * speed]} | back for t in range(2)]
                    },
                },
            ]
        }
    )
    seen = {each: scene.observed_by(each) for each in "ab"}
    for each, other, (x, z) in (("a", "b", (-speed, speed)), ("b", "a", (-speed, -speed))):
        T_w_v = simulate(seen[each]).frames.T_w_v(-1)
        S = FrameRenderer(seen[each], "cpu").render(T_w_v, outputs="S", time_ns=SECOND).S.instance
        row, col = np.nonzero(S)
        depth = apart - length / 2
        centre = (np.array(SIZE) - 1) / 2 + FOCAL / depth * np.array([x, -z])
        area = np.pi * (FOCAL * radius / depth) ** 2
        assert set(S[row, col]) == {scene.number_of(f"vehicles.{other}")}
        # the far end of the rod shows beside its face by less than this share of the radius
        beyond = np.hypot(x, z) * (1.0 - depth / (depth + length)) / radius
        assert len(row) == pytest.approx(area, rel=0.5 * beyond)
        np.testing.assert_allclose([col.mean(), row.mean()], centre, atol=0.5 * beyond * FOCAL * radius / depth + 0.3)


def test_a_vehicle_stays_where_its_sequence_ends():
    scene = scene_with({"trajectory": {"poses": stops((0, 2, 0), (1, 2, 0))}})
    time_ns = np.array([-SECOND, 0, SECOND // 2, SECOND, 5 * SECOND])
    T = companions(scene)["vehicles.1"](time_ns)
    np.testing.assert_allclose(T[1:, 0, 3], [0, 0.5, 1, 1], atol=1e-9)
    assert T[0, 0, 3] < 0.0  # before the first frame it goes back as all vehicles do


BOARD = {"kind": "calibration_board", "rows": 9, "columns": 9, "square_m": 0.8}


def test_a_dvl_finds_a_body_below_and_how_it_moves():
    """A board that sinks at 0.4 m/s and then stays: depth over the cosine of the beams' angle, speed times it."""
    sinks = {
        "body": BOARD | {"rotation_euler_deg": [-90, 0, 0]},
        "trajectory": {"poses": stops((0, 0, -2), (0, 0, -2.4))},
    }
    scene = scene_from_dict(
        {
            "vehicles": [
                {"id": "0", "dvl": {"rate_hz": 4}, "trajectory": STILL | {"duration_s": 1.6}},
                {"id": "1"} | sinks,
            ]
        }
    )
    dvl, cosine = simulate(scene, build_parts(scene)).dvl, np.cos(np.radians(30))
    time_s = 1e-9 * dvl.time_ns
    depth, rate = 2.0 + 0.4 * np.minimum(time_s, 1.0), np.where(time_s <= 1.0, 0.4, 0.0)
    assert np.unique(rate).tolist() == [0.0, 0.4]
    np.testing.assert_allclose(dvl.range, np.repeat((depth / cosine)[:, None], 4, 1), atol=1e-6)
    np.testing.assert_allclose(dvl.beam_velocity, np.repeat(rate[:, None] * cosine, 4, 1), atol=1e-9)
    np.testing.assert_allclose(dvl.velocity, rate[:, None] * [0, 0, 1], atol=1e-9)


def test_a_dvl_over_a_board_that_turns_feels_it_pass_by():
    """About an axis at a distance a, all of the board below moves at a x rate but for what circles about the sensor."""
    turns, away = np.radians(20.0), 1.5
    path = [{"time_s": t, "position": [away, 0, -2], "rotation_euler_deg": [-90, 0, 20 * t]} for t in range(2)]
    scene = scene_from_dict(
        {
            "objects": [BOARD | {"path": path}],
            "trajectory": STILL | {"duration_s": 1.0},
            "vehicle": {"dvl": {"rate_hz": 4}},
        }
    )
    dvl = simulate(scene, build_parts(scene)).dvl
    expected = -away * turns * beam_directions(scene.vehicle.dvl)[:, 1]
    np.testing.assert_allclose(dvl.beam_velocity, np.tile(expected, (len(dvl.time_ns), 1)), atol=1e-6)
