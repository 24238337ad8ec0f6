"""IMU and depth gauge against closed forms (eq. (2) of the paper) and against the poses they belong to."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from varos_warp.products.sensors.depth_gauge import DEPTH_GAUGE
from varos_warp.products.sensors.imu import IMU, Imu
from varos_warp.products.sensors.protocol import Mounted
from varos_warp.scene.description import Scene
from varos_warp.sim.clock import times_ns
from varos_warp.sim.sensors.suite import measured
from varos_warp.sim.sensors.surroundings import Around
from varos_warp.sim.trajectory import Trajectory, simulate

pytestmark = pytest.mark.subject("IMU and depth gauge")

H, G = 0.005, 9.81
EQ2 = "eq. (2) of the paper"
ROUNDING = 1e-14
UP_DOWN_SIDEWAYS = [(0.0, 0.0, 0.0), (90.0, 0.0, 0.0), (20.0, -70.0, 130.0)]


def measure_imu(trajectory, imu, gravity):
    return measured(IMU, trajectory, imu, Around(gravity))


def motion(turned: Rotation, *, position=0.0, velocity=0.0, acceleration=0.0, omega=0.0, alpha=0.0) -> Trajectory:
    count = len(turned)
    vectors = (np.broadcast_to(x, (count, 3)).astype(float) for x in (position, velocity, acceleration))
    rates = (np.broadcast_to(x, (count, 3)).astype(float) for x in (omega, alpha))
    return Trajectory(times_ns(count, 200.0), *vectors, turned.as_quat(canonical=True, scalar_first=True), *rates)


@pytest.mark.parametrize("angles", UP_DOWN_SIDEWAYS)
def test_at_rest_the_imu_feels_minus_gravity_in_its_own_axes(truth, angles):
    turned = Rotation.from_euler("xyz", [angles] * 3, degrees=True)
    read = measure_imu(motion(turned), Imu(position=(0.3, 0.1, -0.2)), G)
    truth(
        f"specific force [m/s^2], attitude {angles} degrees",
        source="-R_vw g",
        expected=turned.inv().apply([0.0, 0.0, G]),
        got=read.acceleration,
        tolerance=G * ROUNDING,
        reason="rounding",
    )
    assert (read.angular_velocity == 0.0).all()


def test_an_upright_imu_at_rest_reads_plus_g_on_its_up_axis(truth):
    read = measure_imu(motion(Rotation.from_rotvec([[0.0, 0.0, 0.7]])), Imu(), G)
    truth(
        "specific force [m/s^2]",
        source="+9.81 up at rest",
        expected=[[0.0, 0.0, 9.81]],
        got=read.acceleration,
        tolerance=G * ROUNDING,
        reason="rounding",
    )


def test_in_free_fall_the_imu_feels_nothing(truth):
    turned = Rotation.random(5, rng=1)
    read = measure_imu(motion(turned, acceleration=(0.0, 0.0, -G)), Imu(), G)
    truth(
        "specific force [m/s^2], five attitudes",
        source="principle of equivalence",
        expected=0.0,
        got=read.acceleration,
        tolerance=G * ROUNDING,
        reason="rounding",
    )


def circling(radius, rate) -> Trajectory:
    """A vehicle on a circle that looks along its way; its x axis points outwards."""
    angle = np.linspace(0.0, 2.0 * np.pi, 50)
    outward = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(50)])
    return motion(
        Rotation.from_rotvec(np.outer(angle, [0.0, 0.0, 1.0])),
        position=radius * outward,
        acceleration=-radius * rate**2 * outward,
        omega=(0.0, 0.0, rate),
    )


def test_on_a_circle_the_lever_arm_adds_to_the_radius_of_the_centripetal_acceleration(truth):
    radius, rate, lever = 3.0, 0.7, 0.25
    read = measure_imu(circling(radius, rate), Imu(position=(lever, 0.0, 0.0)), G)
    expected = [-(rate**2) * (radius + lever), 0.0, G]
    truth(
        "specific force [m/s^2]",
        source="-w^2 (r + l)",
        expected=expected,
        got=read.acceleration,
        tolerance=G * ROUNDING,
        reason="rounding",
    )
    truth(
        "angular velocity [rad/s]",
        source="w about the vertical",
        expected=[0.0, 0.0, rate],
        got=read.angular_velocity,
        tolerance=ROUNDING,
        reason="rounding",
    )


def test_an_imu_that_moves_outwards_on_a_turntable_feels_the_force_of_coriolis(truth):
    """At (r0 + u t)(cos wt, sin wt, 0): along the radius -w^2 r, along the way round +2 w u."""
    r0, u, w, t = 1.0, 0.4, 0.9, np.linspace(0.0, 5.0, 40)
    radius = r0 + u * t
    out = np.column_stack([np.cos(w * t), np.sin(w * t), 0 * t])
    along = np.column_stack([-np.sin(w * t), np.cos(w * t), 0 * t])
    table = motion(
        Rotation.from_rotvec(np.outer(w * t, [0.0, 0.0, 1.0])),
        position=radius[:, None] * out,
        velocity=u * out + w * radius[:, None] * along,
        acceleration=-(w**2) * radius[:, None] * out + 2 * w * u * along,
        omega=(0.0, 0.0, w),
    )
    truth(
        "specific force [m/s^2] in the table's axes",
        source="(-w^2 r, 2 w u, g)",
        tolerance=2 * G * ROUNDING,
        expected=np.column_stack([-(w**2) * radius, np.full(40, 2 * w * u), np.full(40, G)]),
        got=measure_imu(table, Imu(), G).acceleration,
        reason="rounding",
    )
    lever = measure_imu(table, Imu(position=(0.0, 0.3, 0.0)), G).acceleration
    truth(
        "the same, with a lever arm of 0.3 m ahead",
        source="adds -w^2 l",
        tolerance=2 * G * ROUNDING,
        expected=np.column_stack([-(w**2) * radius, np.full(40, 2 * w * u - 0.3 * w**2), np.full(40, G)]),
        got=lever,
        reason="rounding",
    )


def test_spinning_up_pushes_a_lever_arm_sideways_by_alpha_cross_l(truth):
    alpha, lever = np.array([0.5, -1.0, 2.0]), np.array([0.2, 0.3, -0.1])
    read = measure_imu(motion(Rotation.identity(2), alpha=alpha), Imu(position=tuple(lever)), G)
    truth(
        "specific force less gravity [m/s^2]",
        source="alpha x l",
        expected=np.cross(alpha, lever),
        got=read.acceleration - [0.0, 0.0, G],
        tolerance=G * ROUNDING,
        reason="rounding",
    )


def test_a_turned_imu_reads_the_same_vectors_in_its_own_axes():
    trajectory = motion(
        Rotation.random(7, rng=2), acceleration=(0.3, -0.2, 0.1), omega=(0.5, 0.1, -0.4), alpha=(1.0, 0.0, 0.5)
    )
    plain = measure_imu(trajectory, Imu(position=(0.1, 0.2, 0.3)), G)
    turned = measure_imu(trajectory, Imu(position=(0.1, 0.2, 0.3), rotation_euler_deg=(30.0, -50.0, 110.0)), G)
    R_v_s = Rotation.from_euler("xyz", (30.0, -50.0, 110.0), degrees=True)
    for name in ("acceleration", "angular_velocity"):
        np.testing.assert_allclose(R_v_s.apply(getattr(turned, name)), getattr(plain, name), atol=G * ROUNDING)


def test_the_depth_gauge_reads_its_own_depth_positive_down(truth):
    pitched = Rotation.from_rotvec(np.outer([0.0, 90.0, -90.0], [1.0, 0.0, 0.0]), degrees=True)
    read = measured(
        DEPTH_GAUGE,
        motion(pitched, position=(1.0, 2.0, -3.0)),
        Mounted(position=(0.0, 0.5, 0.25)),
        Around(surface_depth_m=80.0),
    )
    # z of the gauge: upright its z, nose up its y, nose down minus its y
    truth(
        "depth [m]: upright, nose up, nose down",
        source="z_surface - (p + R l)_z",
        expected=[82.75, 82.5, 83.5],
        got=read.depth,
        tolerance=80.0 * ROUNDING,
        reason="rounding",
    )


# ------------------------------------------------------------------------------------------ against a simulated course


COURSE = [
    {"position": (0, 0, 0), "look_at": (0, 5, -1)},
    {"position": (0, 5, 0), "rotation_euler_deg": (-10, 0, 40)},
    {"position": (3, 6, 0.5), "rotation_euler_deg": (15, 10, -60)},
    {"position": (0, 9, 1)},
]


@cache
def driven(lever=(0.0, 0.0, 0.0)):
    return simulate(
        Scene(
            trajectory={"waypoints": COURSE}, vehicle={"imu": {"position": lever}, "depth_gauge": {"position": lever}}
        )
    )


def test_the_accelerometer_agrees_with_second_differences_of_the_sensor_positions(truth):
    """Lever arm, rotation and gravity, all from eq. (2), against nothing but the poses."""
    lever = (0.4, -0.3, 0.2)
    simulation = driven(lever)
    trajectory, turned = simulation.trajectory, simulation.trajectory.rotation()
    p = trajectory.position + turned.apply(lever)
    second = (-p[:-4] + 16.0 * p[1:-3] - 30.0 * p[2:-2] + 16.0 * p[3:-1] - p[4:]) / (12.0 * H**2)
    felt = turned[2:-2].apply(simulation.imu.acceleration[2:-2]) - [0.0, 0.0, G]
    # the held commands step, which kinks the third derivative: at most wn^2 times the step of the acceleration
    step = max(
        np.abs(np.diff(trajectory.acceleration, axis=0)).max(),
        np.linalg.norm(lever) * np.abs(np.diff(trajectory.angular_acceleration, axis=0)).max(),
    )
    rounding = 64.0 / 12.0 * np.finfo(float).eps * np.abs(p).max() / H**2
    truth(
        "specific force less gravity [m/s^2], a course in world axes",
        source=EQ2 + "; fourth-order differences of poses",
        expected=second,
        got=felt,
        tolerance=15.0**2 * step * H**2 + rounding,
        reason="kinks of the third derivative where commands step, and rounding of the differences",
    )
    assert np.abs(second).max() > 1e3 * (15.0**2 * step * H**2 + rounding)


def test_the_gyroscope_agrees_with_the_turns_between_the_poses(truth):
    simulation = driven()
    turned, w = simulation.trajectory.rotation(), simulation.imu.angular_velocity
    alpha = simulation.trajectory.angular_acceleration
    between = (turned[:-1].inv() * turned[1:]).as_rotvec() / H
    mean = 0.5 * (w[:-1] + w[1:]) - H / 12.0 * (alpha[1:] - alpha[:-1]) + H / 12.0 * np.cross(w[:-1], w[1:])
    step = np.abs(np.diff(alpha, axis=0)).max()
    rounding = 4.0 * np.finfo(float).eps / H
    truth(
        "angular velocity [rad/s], a course",
        source="logarithm of the turns between poses, Magnus to order 3",
        expected=between,
        got=mean,
        tolerance=15.0**2 * step * H**3 + rounding,
        reason="kinks where commands step, and rounding",
    )


def test_the_depth_gauge_agrees_with_the_poses():
    lever = (0.4, -0.3, 0.2)
    simulation = driven(lever)
    z = np.array([(simulation.trajectory.T_w_v(k) @ [*lever, 1.0])[2] for k in range(0, 2000, 97)])
    np.testing.assert_allclose(simulation.depth_gauge.depth[:2000:97], -z, atol=ROUNDING)


def strapdown(imu, trajectory, stride) -> float:
    """Error [m] at the end of the position integrated from every ``stride``-th IMU row."""
    w, a, h = imu.angular_velocity[::stride], imu.acceleration[::stride], stride * H
    turns = Rotation.from_rotvec(0.5 * h * (w[:-1] + w[1:]) + h * h / 12.0 * np.cross(w[:-1], w[1:]))
    attitude, v, p = trajectory.rotation()[0], trajectory.velocity[0], trajectory.position[0]
    gravity = np.array([0.0, 0.0, G])
    before = attitude.apply(a[0]) - gravity
    for i in range(len(turns)):
        attitude = attitude * turns[i]
        after = attitude.apply(a[i + 1]) - gravity
        p, v = p + h * v + h * h / 6.0 * (2.0 * before + after), v + 0.5 * h * (before + after)
        before = after
    return float(np.linalg.norm(p - trajectory.position[len(turns) * stride]))


def test_integrating_the_imu_returns_to_the_poses_with_the_second_power_of_the_interval(truth):
    simulation = driven()
    errors = [strapdown(simulation.imu, simulation.trajectory, stride) for stride in (8, 4)]
    truth(
        "error at 25 Hz over error at 50 Hz",
        source="trapezoid strapdown: 2^2",
        expected=4.0,
        got=errors[0] / errors[1],
        tolerance=0.4,
        reason="terms of fourth order",
    )
    assert errors[1] < 0.02  # 16 times that of every row: about a millimetre over the course


# -------------------------------------------------------------------------------------------------------- exact poses


POSES = [
    {"time_s": 2.5, "position": (0, 0, 0)},
    {"time_s": 3.5, "position": (0.6, 0.5, 0), "rotation_euler_deg": (9, 0, 40)},
    {"time_s": 5.0, "position": (1.4, 0.9, 0.3), "rotation_euler_deg": (-20, 10, 90)},
    {"time_s": 6.0, "position": (2.4, 0.9, 0.5), "rotation_euler_deg": (0, 35, 60)},
]


@cache
def posed(duration=None):
    return simulate(
        Scene(trajectory={"poses": POSES, "duration_s": duration}, vehicle={"imu": {"position": (0.3, 0, 0)}})
    )


@pytest.mark.parametrize("duration", [None, 10.0], ids=["to the last pose", "until it is at rest"])
def test_integrating_the_imu_follows_exact_poses_from_rest_to_their_end(truth, duration):
    """No speed comes or goes that the IMU does not feel, where a course begins, at its last row, and after it."""
    simulation = posed(duration)
    trajectory, turned = simulation.trajectory, simulation.trajectory.rotation()
    centre = replace(
        trajectory,
        position=trajectory.position + turned.apply((0.3, 0.0, 0.0)),
        velocity=trajectory.velocity + turned.apply(np.cross(trajectory.angular_velocity, (0.3, 0, 0))),
    )
    errors = [strapdown(simulation.imu, centre, stride) for stride in (4, 2)]  # the poses are on these rows
    truth(
        "error at 50 Hz over error at 100 Hz, exact poses",
        source="trapezoid strapdown: 2^2",
        expected=4.0,
        got=errors[0] / errors[1],
        tolerance=0.4,
        reason="terms of fourth order",
    )
