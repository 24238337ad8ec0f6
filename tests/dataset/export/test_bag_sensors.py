"""DVL, magnetometer and pressure in a bag, as the reader of the MCAP project has them."""

import numpy as np
import pytest
import standins
from bags import decoded, vectors
from readback import ROUNDING, matrices

from varos_warp.dataset.export import export
from varos_warp.dataset.noise_pass import add_noise
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.scene.description.noise_profile import NoiseProfile

FLOOR = {"kind": "procedural", "relief_m": 0.0, "size_m": 40.0, "resolution": 5, "position": [0, 0, -3]}
DVL = {"position": [0.1, 0.2, -0.2], "rotation_euler_deg": [5, 1, 30], "rate_hz": 20, "range_m": [0.5, 3.4]}
MAGNETOMETER = {"position": [0, 0, 0.2], "rotation_euler_deg": [0, 10, 20], "rate_hz": 50}
PROFILE = NoiseProfile(
    name="all",
    dvl={"velocity_std": 0.01, "range_std": 0.05},
    magnetometer={"noise_density": 2e-9},
    depth_gauge={"noise_density": 0.01, "resolution": 0.02},
)


@pytest.fixture(scope="module")
def sailed(tmp_path_factory):
    """A dataset with all sensors, whose DVL loses lock at times."""
    root = tmp_path_factory.mktemp("sailed") / "data"
    vehicle = standins.scene_dict()["vehicle"] | {"dvl": DVL, "magnetometer": MAGNETOMETER}
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(standins.make_scene({"outputs": ["A"]}, vehicle=vehicle, terrain=FLOOR), root, quiet=True)
    return Dataset(root)


@pytest.fixture(scope="module")
def bag(sailed, tmp_path_factory):
    return bag_of(sailed, tmp_path_factory.mktemp("sailed"))


@pytest.fixture(scope="module")
def noisy(sailed, tmp_path_factory):
    return add_noise(sailed.root, PROFILE, tmp_path_factory.mktemp("noisy") / "data", seed=7, quiet=True)


def bag_of(data, folder):
    export(data.root, "mcap", folder / "out")
    return decoded(folder / "out/bag/bag.mcap")


def mount(bag, frame):
    """T of a frame that is fixed to base_link."""
    (found,) = (
        each.transform
        for _, m in bag["/tf_static"]
        for each in m.transforms
        if (each.header.frame_id, each.child_frame_id) == ("base_link", frame)
    )
    p, q = found.translation, found.rotation
    return matrices([[p.x, p.y, p.z]], [[q.x, q.y, q.z, q.w]], scalar_first=False)[0]


def stamps(messages):
    return [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in messages]


def test_the_dvl_is_a_twist_where_it_has_lock_and_by_the_tree_that_of_the_base(sailed, bag):
    read, messages = sailed.dvl(), bag["/dvl0"]
    has = np.isfinite(read["velocity"]).all(axis=1)
    assert 2 < has.sum() < len(has)
    assert stamps(messages) == [t for t, _ in messages] == read["time_ns"][has].tolist()
    velocity = vectors(messages, lambda m: m.twist.twist.linear)
    np.testing.assert_array_equal(velocity, read["velocity"][has])
    T, moving = mount(bag, messages[0][1].header.frame_id), {t: m.twist.twist for t, m in bag["/ground_truth"]}
    base, turning = (
        vectors([(t, getattr(moving[t], part)) for t, _ in messages], lambda v: v) for part in ("linear", "angular")
    )
    there = base + np.cross(turning, T[:3, 3])
    np.testing.assert_allclose(velocity @ T[:3, :3].T, there, rtol=0, atol=1e-9)  # what the beams are good to
    assert np.abs(there).max() > 0.1


def test_the_magnetometer_reads_the_field_of_the_map_by_the_tree(sailed, bag):
    messages, truth = bag["/mag0"], np.array(sailed.meta["sensors"]["mag0"]["field_T"])
    assert stamps(messages) == [t for t, _ in messages] == sailed.magnetometer()["time_ns"].tolist()
    T = mount(bag, messages[0][1].header.frame_id)
    poses = {t: m.pose.pose.orientation for t, m in bag["/ground_truth"]}
    q = [[(r := poses[t]).x, r.y, r.z, r.w] for t, _ in messages]
    R = matrices(np.zeros((len(q), 3)), q, scalar_first=False)[:, :3, :3] @ T[:3, :3]
    field = np.einsum("nij,nj->ni", R, vectors(messages, lambda m: m.magnetic_field))
    np.testing.assert_allclose(field, np.tile(truth, (len(q), 1)), rtol=0, atol=ROUNDING * np.linalg.norm(truth))


def test_pressure_is_that_of_the_water_above_and_the_atmosphere(sailed, bag):
    """Sea water of 1025 kg/m^3 under 101 325 Pa."""
    messages, read = bag["/depth0/pressure"], sailed.depth_gauge()
    assert stamps(messages) == [t for t, _ in messages] == read["time_ns"].tolist()
    assert {m.header.frame_id for _, m in messages} == {"depth_gauge_link"}
    depth = (np.array([m.fluid_pressure for _, m in messages]) - 101_325.0) / (1025.0 * 9.81)
    np.testing.assert_allclose(depth, read["depth"], rtol=0, atol=1e-12)  # rounding of 1e5 Pa, over 1e4 Pa/m
    assert np.ptp(depth) > 0.01


def test_without_noise_covariances_are_unknown_and_no_dvl_measures_turns(bag):
    assert not any(m.variance for _, m in bag["/depth0/pressure"])
    assert not np.any([m.magnetic_field_covariance for _, m in bag["/mag0"]])
    for _, message in bag["/dvl0"]:
        covariance = np.reshape(message.twist.covariance, (6, 6))
        assert not covariance[:3].any()
        np.testing.assert_array_equal(covariance[3:, 3:], 1e6 * np.eye(3))


def test_covariances_are_those_of_the_stated_noise(noisy, tmp_path):
    """Of the DVL in closed form: with four beams at an angle a from its z, s^2 / (2 sin^2 a) across and s^2 / (4 cos^2
    a) along it; with three, what least squares of the noise of these gives.
    """
    bag, read = bag_of(noisy, tmp_path), noisy.dvl()
    np.testing.assert_allclose(
        bag["/mag0"][3][1].magnetic_field_covariance, 2e-9**2 * 50 * np.eye(3).ravel(), rtol=1e-14
    )
    rate = noisy.meta["sensors"]["depth0"]["rate_hz"]
    assert bag["/depth0/pressure"][3][1].variance == pytest.approx(
        (1025.0 * 9.81) ** 2 * (0.01**2 * rate + 0.02**2 / 12), rel=1e-12
    )
    beams = np.array(noisy.meta["sensors"]["dvl0"]["beams"])
    locked = dict(zip(read["time_ns"].tolist(), np.isfinite(read["range"]), strict=True))
    found = {int(locked[t].sum()): (np.reshape(m.twist.covariance, (6, 6))[:3, :3], locked[t]) for t, m in bag["/dvl0"]}
    a = np.radians(30.0)
    across, along = 1e-4 / (2 * np.sin(a) ** 2), 1e-4 / (4 * np.cos(a) ** 2)
    np.testing.assert_allclose(found[4][0], np.diag([across, across, along]), rtol=1e-12, atol=1e-18)
    covariance, which = found[3]
    np.testing.assert_allclose(covariance @ beams[which].T @ beams[which], 1e-4 * np.eye(3), rtol=0, atol=1e-16)
