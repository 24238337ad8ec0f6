"""DVL and magnetometer against closed forms: ranges to planes, velocities with lever arms, lock, noise, fields."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from varos_warp.products.sensors.dvl import DVL, Dvl, DvlNoise, beam_directions, bottom_track, dvl_noise
from varos_warp.products.sensors.magnetometer import MAGNETOMETER, Magnetometer, MagnetometerNoise, magnetometer_noise
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.geometry.query import ranges
from varos_warp.sim.clock import times_ns
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.sensors.suite import measured
from varos_warp.sim.sensors.surroundings import Around
from varos_warp.sim.trajectory import simulate

ROUNDING = 1e-14
FAR = np.array([569_000.0, 7_035_000.0, 0.0])
TURNED = Rotation.from_euler("xyz", [(0, 0, 0), (0, 0, 130), (12, 0, 0), (-7, 15, 40), (20, -10, -80)], degrees=True)


def measure_dvl(trajectory, dvl, parts):
    return measured(DVL, trajectory, dvl, Around(parts=parts))


def measure_field(trajectory, magnetometer):
    return measured(MAGNETOMETER, trajectory, magnetometer, Around())


def motion(turned: Rotation, height=3.0, velocity=0.0, omega=0.0, at=(0.0, 0.0, 0.0)) -> Trajectory:
    """Rows 0.2 s apart, so that a DVL of 5 Hz reads each of them."""
    vectors = (np.broadcast_to(x, (len(turned), 3)).astype(float) for x in ([*at[:2], height], velocity, 0.0))
    rates = (np.broadcast_to(x, (len(turned), 3)).astype(float) for x in (omega, 0.0))
    return Trajectory(times_ns(len(turned), 5.0), *vectors, turned.as_quat(canonical=True, scalar_first=True), *rates)


def mesh(name, shape, **placed) -> Part:
    return Part(name, np.array(shape.vertices), np.array(shape.faces, np.int32), Diffuse(), **placed)


def floor(at=(0.0, 0.0, 0.0), size=100.0) -> Part:
    """The plane z = 0, in two triangles."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * size + at
    return Part("terrain", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Diffuse())


# --------------------------------------------------------------------------------------------------------------- beams


@pytest.mark.parametrize("angle", [5.0, 20.0, 30.0])
def test_upright_over_a_flat_floor_all_beams_are_as_long_as_height_over_cosine(angle):
    read = measure_dvl(motion(TURNED[:2]), Dvl(beam_angle_deg=angle), [floor()])
    np.testing.assert_allclose(read.range, 3.0 / np.cos(np.radians(angle)), rtol=ROUNDING)
    np.testing.assert_allclose(read.altitude, 3.0, rtol=ROUNDING)


def test_beams_point_down_at_their_angle_to_the_right_front_the_left_front_and_so_on():
    beams = beam_directions(Dvl(beam_angle_deg=30.0))
    np.testing.assert_allclose(beams @ [0.0, 0.0, -1.0], np.cos(np.radians(30.0)), rtol=ROUNDING)
    np.testing.assert_array_equal(np.sign(beams), [[1, 1, -1], [-1, 1, -1], [-1, -1, -1], [1, -1, -1]])
    np.testing.assert_allclose(np.abs(beams[:, 0]), np.abs(beams[:, 1]), rtol=ROUNDING)


def test_over_a_flat_floor_a_turned_sensor_ranges_its_height_over_the_fall_of_each_beam():
    """The height is that of the sensor, its lever arm turned with the vehicle."""
    dvl = Dvl(position=(0.4, -0.3, -0.2), rotation_euler_deg=(5.0, -10.0, 70.0))
    read = measure_dvl(motion(TURNED), dvl, [floor()])
    height = 3.0 + TURNED.apply(dvl.position)[:, 2]
    mounted = Rotation.from_euler("xyz", dvl.rotation_euler_deg, degrees=True)
    fall = np.array([-(turned * mounted).apply(beam_directions(dvl))[:, 2] for turned in TURNED])
    np.testing.assert_allclose(read.range, height[:, None] / fall, rtol=10 * ROUNDING)


def test_far_from_the_origin_ranges_are_the_same():
    """UTM coordinates are good to a nanometre."""
    near = measure_dvl(motion(TURNED), Dvl(), [floor()])
    far = measure_dvl(motion(TURNED, at=FAR), Dvl(), [floor(FAR)])
    np.testing.assert_allclose(far.range, near.range, atol=1e-8)


def test_the_velocity_is_that_of_the_sensor_with_its_lever_arm_in_its_own_axes():
    velocity, omega = np.array([0.5, -0.3, 0.1]), np.array([0.2, -0.1, 0.6])
    dvl = Dvl(position=(0.4, -0.3, -0.2), rotation_euler_deg=(5.0, -10.0, 70.0))
    read = measure_dvl(motion(TURNED, velocity=velocity, omega=omega), dvl, [floor()])
    mounted = Rotation.from_euler("xyz", dvl.rotation_euler_deg, degrees=True)
    expected = mounted.inv().apply(TURNED.inv().apply(velocity) + np.cross(omega, dvl.position))
    np.testing.assert_allclose(read.velocity, expected, atol=ROUNDING)
    np.testing.assert_allclose(read.beam_velocity, -expected @ beam_directions(dvl).T, atol=ROUNDING)


def test_over_a_flat_floor_beam_velocities_are_the_rates_of_the_ranges_when_the_vehicle_sinks():
    """Straight down over a plane, r = h / cos falls with v / cos of the height, its Doppler part with v cos."""
    read = measure_dvl(motion(TURNED[:1], velocity=(0.0, 0.0, -0.4)), Dvl(beam_angle_deg=30.0), [floor()])
    np.testing.assert_allclose(read.beam_velocity, -0.4 * np.cos(np.radians(30.0)), rtol=ROUNDING)


# ---------------------------------------------------------------------------------------------------------------- lock


@pytest.mark.parametrize(("height", "locks"), [(0.2, False), (0.5, True), (3.4, True), (3.5, False), (50.0, False)])
def test_the_bottom_is_locked_within_the_range_of_the_beams_alone(height, locks):
    """4 m along a beam of 30 degrees are 3.464 m of height, 0.5 m are 0.433 m."""
    read = measure_dvl(motion(TURNED[:1], height, velocity=0.3), Dvl(range_m=(0.5, 4.0)), [floor()])
    for name in ("velocity", "altitude", "range", "beam_velocity"):
        assert np.isfinite(getattr(read, name)).all() == locks
        assert np.isnan(getattr(read, name)).all() != locks


def test_over_nothing_there_is_no_lock():
    assert np.isnan(measure_dvl(motion(TURNED), Dvl(), []).range).all()


def test_three_beams_give_the_velocity_and_two_do_not():
    """A floor of half the world: of an upright vehicle two beams meet it; turned by 45 degrees, one or three."""
    velocity = np.array([0.5, -0.3, 0.1])
    half = floor(at=(100.5, 0.0, 0.0))  # from x = 0.5 on
    turned = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, 0.0, 45.0]], degrees=True)
    at = [measure_dvl(motion(turned, velocity=velocity, at=(x, 0.0)), Dvl(), [half]) for x in (0.0, 1.0)]
    assert [np.isfinite(read.range).sum(axis=1).tolist() for read in at] == [[2, 1], [2, 3]]
    for read in at:
        two = np.isfinite(read.range).sum(axis=1) < 3
        assert np.isnan(read.velocity[two]).all()
        np.testing.assert_allclose(read.velocity[~two], turned.inv().apply(velocity)[~two], atol=4 * ROUNDING)
        np.testing.assert_allclose(read.altitude, 3.0, rtol=ROUNDING)


# ------------------------------------------------------------------------------------------------- objects and copies


def brute_force(parts, points, directions, reach):
    """Over all triangles of all parts and copies, in float64 (Moeller and Trumbore)."""
    t = np.full(len(points), np.inf)
    for part in (copy for group in parts for copy in (group.parts() if isinstance(group, Instances) else [group])):
        for a, b, c in part.vertices[part.faces]:
            cross = np.cross(directions, c - a)
            det = cross @ (b - a)
            with np.errstate(divide="ignore", invalid="ignore"):
                u = (cross * (points - a)).sum(axis=1) / det
                other = np.cross(points - a, b - a)
                v, s = (other * directions).sum(axis=1) / det, other @ (c - a) / det
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (s > 0) & (s <= reach)
            t = np.where(hit, np.minimum(t, s), t)
    return t


def test_ranges_are_those_to_the_nearest_of_all_triangles_of_terrain_objects_and_copies():
    rng = np.random.default_rng(3)
    stone = trimesh.creation.icosphere(subdivisions=1, radius=0.5)
    T = np.tile(np.eye(4), (40, 1, 1))
    T[:, :3, :3] = Rotation.random(40, rng=rng).as_matrix() * rng.uniform(0.3, 2.0, 40)[:, None, None]
    T[:, :3, 3] = rng.uniform(-6, 6, (40, 3)) * [1, 1, 0.1]
    ball = trimesh.creation.icosphere(subdivisions=1, radius=1.5)
    ball.apply_translation([2.0, 1.0, 0.5])
    stones = Instances("scatter.0", np.array(stone.vertices), np.array(stone.faces, np.int32), Diffuse(), T_w_o=T)
    parts = [floor(), mesh("objects.0", ball), stones]
    points = np.column_stack([rng.uniform(-6, 6, (2000, 2)), rng.uniform(2.5, 5.0, 2000)])
    directions = Rotation.random(2000, rng=rng).apply([0.0, 0.0, 1.0])
    directions[:, 2] = -np.abs(directions[:, 2])
    found, expected = ranges(parts, points, directions, 12.0), brute_force(parts, points, directions, 12.0)
    only_floor, no_copies = (ranges(parts[:n], points, directions, 12.0) for n in (1, 2))
    assert min((found < no_copies).sum(), (no_copies < only_floor).sum(), np.isinf(found).sum()) > 40
    # a ray within single precision of an edge may take the face beside it, or what is behind it
    same = np.isclose(found, expected, rtol=1e-9)
    assert (~same).sum() <= 2000 * 1e-3


def test_a_dvl_sees_the_terrain_of_its_scene_and_without_one_no_mesh_is_loaded(monkeypatch):
    scene = {
        "terrain": {"kind": "procedural", "relief_m": 0.0, "size_m": 40.0, "resolution": 9},
        "trajectory": {"poses": [{"position": (0, 0, 2)}]},
    }
    read = simulate(Scene(**scene, vehicle={"dvl": {"rate_hz": 29.97}}, render={"frame_rate_hz": 10})).dvl
    assert read.time_ns.tolist() == [0]
    np.testing.assert_allclose(read.altitude, 2.0, rtol=ROUNDING)
    monkeypatch.setattr("varos_warp.scene.geometry.build.build_parts", lambda scene: pytest.fail("loaded"))
    assert simulate(Scene(**scene)).dvl is None


# --------------------------------------------------------------------------------------------------------------- noise


COUNT = 40_000


def test_noise_of_the_beams_becomes_that_of_the_velocity_by_the_geometry_of_the_beams():
    """Of beams at theta: sigma / (sqrt(2) sin theta) across, sigma / (2 cos theta) along the axis."""
    dvl, velocity = Dvl(beam_angle_deg=25.0), np.array([0.4, -0.2, 0.1])
    beams, model = beam_directions(dvl), DvlNoise(velocity_std=0.02, scale=0.05, range_std=0.1)
    along = np.broadcast_to(-beams @ velocity, (COUNT, 4))
    truth = bottom_track(times_ns(COUNT, 5.0), beams, np.full((COUNT, 4), 3.0), along)
    read = dvl_noise(model, truth, beams, seed=4)
    theta, error = np.radians(25.0), 4.0 / np.sqrt(2.0 * COUNT)
    spread = np.array([0.02 / (np.sqrt(2.0) * np.sin(theta))] * 2 + [0.02 / (2.0 * np.cos(theta))])
    np.testing.assert_allclose(read.velocity.std(axis=0), spread, rtol=error)
    assert (np.abs(read.velocity.mean(axis=0) - 1.05 * velocity) < 4.0 * spread / np.sqrt(COUNT)).all()
    np.testing.assert_allclose(read.beam_velocity.std(axis=0), 0.02, rtol=error)
    np.testing.assert_allclose(read.range.std(axis=0), 0.1, rtol=error)
    np.testing.assert_allclose(read.altitude.std(), 0.1 * np.cos(theta) / 2.0, rtol=error)
    np.testing.assert_array_equal(dvl_noise(model, truth, beams, seed=4).velocity, read.velocity)
    assert (dvl_noise(model, truth, beams, seed=5).velocity != read.velocity).all()


def test_noise_leaves_lock_as_it_was():
    beams = beam_directions(Dvl())
    distance = np.where(np.arange(12).reshape(3, 4) % 5 == 0, np.nan, 3.0)
    read = dvl_noise(
        DvlNoise(velocity_std=1.0, range_std=1.0),
        bottom_track(times_ns(3, 5.0), beams, distance, np.ones((3, 4))),
        beams,
        seed=1,
    )
    np.testing.assert_array_equal(np.isnan(read.range), np.isnan(distance))
    np.testing.assert_array_equal(np.isnan(read.beam_velocity), np.isnan(distance))


# -------------------------------------------------------------------------------------------------------- magnetometer


def test_a_magnetometer_reads_the_worlds_field_in_its_own_axes():
    """Level and turned left by 90 degrees the north lies to the right; nose up by 90 degrees it lies below."""
    turned = Rotation.from_euler("xyz", [(0, 0, 0), (0, 0, 90), (90, 0, 0)], degrees=True)
    read = measure_field(motion(turned), Magnetometer(rate_hz=5.0, field_T=(0.0, 1e-5, 0.0), position=(1.0, 2.0, 3.0)))
    np.testing.assert_allclose(read.field, [[0, 1e-5, 0], [1e-5, 0, 0], [0, 0, -1e-5]], atol=1e-5 * ROUNDING)
    on_its_side = measure_field(
        motion(turned[:1]), Magnetometer(field_T=(0.0, 1e-5, 2e-5), rotation_euler_deg=(90.0, 0.0, 0.0))
    )
    np.testing.assert_allclose(on_its_side.field, [[0, 2e-5, -1e-5]], atol=1e-5 * ROUNDING)


def test_noise_of_a_magnetometer_has_its_density_its_walk_and_its_hard_iron():
    rate, model = 50.0, MagnetometerNoise(noise_density=1e-9, random_walk=1e-10, bias=(1e-6, -2e-6, 0.0))
    made = magnetometer_noise(model, COUNT, rate, seed=3)
    np.testing.assert_array_equal(made.bias[0], model.bias)
    error = 4.0 / np.sqrt(2.0 * COUNT)
    np.testing.assert_allclose(made.white.std(axis=0), 1e-9 * np.sqrt(rate), rtol=error)
    np.testing.assert_allclose(np.diff(made.bias, axis=0).std(axis=0), 1e-10 / np.sqrt(rate), rtol=error)
