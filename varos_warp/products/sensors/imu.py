"""The inertial measurement unit: specific force and angular velocity (paper 3.2.2), and their noise."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import accumulate
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field
from scipy.spatial.transform import Rotation

from varos_warp.products.sensors.differences import bend, changes, difference2, slope
from varos_warp.products.sensors.noise import EPS, Noise, noise, white_variance
from varos_warp.products.sensors.protocol import (
    Curve,
    Evidence,
    Mounted,
    NoiseDensity,
    RosMessages,
    Samples,
    SensorProduct,
    Surroundings,
    Vec3,
    xyz,
)
from varos_warp.scene.block import Block
from varos_warp.scene.frames import attitude
from varos_warp.sim.motion import Trajectory, applied, product

SEED = 0x696D75
"""Parts its random numbers from those of other sensors."""
BLOCK = 4096
"""Samples that a stream of noise draws at once after those of the sequence."""
WINDOW_S = 2.0
"""Time over which it is integrated from a pose to be checked."""
PARTS = {"acceleration": ("accelerometer", "m/s^2"), "angular_velocity": ("gyroscope", "rad/s")}
"""What reads a quantity, and its unit."""


class ImuNoise(Block):
    """White noise and bias of each axis; densities in Kalibr's units; all zero is no noise.

    The bias is the constant one, plus one drawn at random when the sensor is turned on, plus a random walk.
    """

    accelerometer_noise_density: NoiseDensity = 0.0
    """Density of the accelerometers' white noise [m/s^2/sqrt(Hz)]."""
    accelerometer_random_walk: NoiseDensity = 0.0
    """Random walk of the accelerometers' bias [m/s^3/sqrt(Hz)]."""
    gyroscope_noise_density: NoiseDensity = 0.0
    """Density of the gyroscopes' white noise [rad/s/sqrt(Hz)]."""
    gyroscope_random_walk: NoiseDensity = 0.0
    """Random walk of the gyroscopes' bias [rad/s^2/sqrt(Hz)]."""
    accelerometer_bias: Vec3 = (0.0, 0.0, 0.0)
    """Constant part of the accelerometers' bias, in sensor axes [m/s^2]."""
    accelerometer_turn_on_bias: NoiseDensity = 0.0
    """Standard deviation of the part of the bias that is drawn once per sequence [m/s^2]."""
    gyroscope_bias: Vec3 = (0.0, 0.0, 0.0)
    """Constant part of the gyroscopes' bias, in sensor axes [rad/s]."""
    gyroscope_turn_on_bias: NoiseDensity = 0.0
    """Standard deviation of the part of the bias that is drawn once per sequence [rad/s]."""


def _is_read(noise):  # type: ignore[no-untyped-def]
    """Files are read where a scene is loaded, for their paths are relative to its folder."""
    if isinstance(noise, str):
        raise ValueError(f"is a file, which load_scene and scene_from_dict read; here give the block: '{noise}'")
    return noise


def _or_file(schema: dict[str, Any]) -> None:
    schema["anyOf"].insert(1, {"type": "string"})


class Imu(Mounted):
    """An inertial measurement unit on the vehicle; without ``noise`` its readings are exact."""

    noise: Annotated[ImuNoise | None, BeforeValidator(_is_read), Field(json_schema_extra=_or_file)] = None
    """White noise and bias of the readings, or a file of them by Kalibr or imu_utils (docs/noise.md). Absent: they are
    exact; ``varos-warp noise`` adds noise later."""


@dataclass(frozen=True)
class ImuReadings:
    """Readings of the IMU in its own axes, instantaneous, one row per sample."""

    time_ns: np.ndarray
    """int64 [M]"""
    acceleration: np.ndarray
    """Specific force [M, 3] [m/s^2]: +9.81 along the up axis at rest."""
    angular_velocity: np.ndarray
    """[M, 3] [rad/s]"""
    acceleration_bias: np.ndarray
    angular_velocity_bias: np.ndarray
    """The slowly varying part of the noise in the readings [M, 3]; zero unless the scene asks for noise."""
    true_acceleration: np.ndarray
    true_angular_velocity: np.ndarray
    """The readings without noise [M, 3]."""


class ImuProduct(SensorProduct[Imu, ImuNoise, ImuReadings]):
    """Specific force and angular velocity of the sensor, in its own axes."""

    key, id, label = "imu", "imu0", "IMU"
    noise = ImuNoise
    columns = {"acceleration": xyz("a_RS_S", "m s^-2"), "angular_velocity": xyz("w_RS_S", "rad s^-1")}
    curves = (
        Curve("acceleration", "Specific force", "m/s²", "xyz", viewed="specific force [m/s²]"),
        Curve("angular_velocity", "Angular velocity", "rad/s", "xyz", viewed="angular velocity [rad/s]"),
    )
    stream_id = 10
    stream_fields = "float64[6]: specific force x y z [m/s^2], angular velocity x y z [rad/s], axes of the IMU"
    convention = (
        "specific force R_s_w (a - g), +9.81 on the up axis at rest, then angular velocity, both in sensor "
        "axes; instantaneous at the time stamp"
    )
    chapter = """IMU (imu0/imu0_data.csv)
  Acceleration first, then angular velocity, both in sensor axes. The accelerometer measures specific force,
  R_s_w (a - g) with g = (0, 0, -{GRAVITY}) m/s^2: at rest it reads +{GRAVITY} on the up axis. Readings are exact unless
  dataset.json lists noise under sensors.imu0. In that case imu0_bias.csv holds the bias contained in the readings, \
and the
  columns true_a_RS_S and true_w_RS_S hold the readings without noise.
"""
    is_standard = bias_apart = True
    ros_types = {"": "sensor_msgs/msg/Imu"}

    def measure(self, there: Trajectory, sensor: Imu, around: Surroundings) -> ImuReadings:
        """Eq. (2) of the paper: a = R_sv (R_vr (dd p - g) + ([w]x[w]x + [dw]x) l), omega = R_sv w.

        l is the lever arm in vehicle axes, R_vs how the sensor is turned, and g = (0, 0, -gravity).
        """
        omega, alpha, lever = there.angular_velocity, there.angular_acceleration, np.asarray(sensor.position, float)
        acceleration = applied(there.rotation().inv(), there.acceleration + [0.0, 0.0, around.gravity])
        acceleration += np.cross(omega, np.cross(omega, lever)) + np.cross(alpha, lever)
        R_v_s = attitude(sensor)
        acceleration, omega = product(acceleration, R_v_s), product(omega, R_v_s)  # rows: (R_sv x)' = x' R_vs
        none = np.zeros_like(omega)
        return ImuReadings(there.time_ns, acceleration, omega, none, none, acceleration, omega)

    def errors(self, sensor: Imu, count: int, seed: int) -> Callable[[ImuReadings], ImuReadings] | None:
        """Noise of ``vehicle.imu.noise``."""
        if sensor.noise is None:
            return None
        return partial(_with_noise, ImuNoiseStream(sensor.noise, count, sensor.rate_hz, seed))

    def noisy(self, truth: Samples, about: dict[str, Any], model: ImuNoise, seed: int) -> tuple[Samples, Samples]:
        """White noise and bias of each axis."""
        made = dict(zip(PARTS, imu_noise(model, len(truth["time_ns"]), about["rate_hz"], seed), strict=True))
        return (
            {**truth, **{quantity: truth[quantity] + each.white + each.bias for quantity, each in made.items()}},
            {quantity: each.bias for quantity, each in made.items()},
        )

    def check(self, found: Evidence) -> None:
        """Readings without noise against differences of the poses, the states and an integration; then the noise."""
        h = 1.0 / found.about["rate_hz"]
        found.guard(_against_states, found)
        if len(found.T) >= 5:
            _against_differences(found, h)
            _strapdown(found, h)
        if found.about.get("noise"):
            found.guard(_check_noise, found)

    def ros(self, make: RosMessages, topic: str, time_ns: int, row: Samples, meta: dict[str, Any]) -> Any:
        """-1 says that it has no orientation; the variance is of the white noise, and 0 says that it is not known."""
        force, rate = (
            white_variance(meta["sensors"][self.id], f"{sensor}_noise_density") * np.eye(3).ravel()
            for sensor, _ in PARTS.values()
        )
        return make[self.ros_types[topic]](
            make.header(time_ns, self.ros_frame),
            make.rotation((1, 0, 0, 0)),
            np.array([-1.0, *np.zeros(8)]),
            make.vector(row["angular_velocity"]),
            rate,
            make.vector(row["acceleration"]),
            force,
        )


IMU = ImuProduct()

# ------------------------------------------------------------------------------------------------------------- noise


def imu_noise(model: ImuNoise, count: int, rate_hz: float, seed: int) -> tuple[Noise, ...]:
    """Noise of the accelerometer [m/s^2] and of the gyroscope [rad/s], in this order."""
    starts = [
        (getattr(model, f"{sensor}_bias"), getattr(model, f"{sensor}_turn_on_bias")) for sensor, _ in PARTS.values()
    ]
    return _noises(model, count, rate_hz, (seed,), starts)


def _noises(
    model: ImuNoise, count: int, rate_hz: float, seeds: tuple[int, ...], starts: Sequence[tuple[Any, ...]]
) -> tuple[Noise, ...]:
    """Noise of both, whose biases start as the last arguments of `noise` say; the first seed is the scene's."""
    return tuple(
        noise(
            count,
            rate_hz,
            getattr(model, f"{sensor}_noise_density"),
            getattr(model, f"{sensor}_random_walk"),
            np.random.default_rng([seeds[0], SEED, i, *seeds[1:]]),
            *start,
        )
        for i, ((sensor, _), start) in enumerate(zip(PARTS.values(), starts, strict=True))
    )


class ImuNoiseStream:
    """Noise of an IMU, a few samples at a time; the first ``count`` are those that `imu_noise` draws at once.

    `imu_noise` draws the steps of the bias behind all white noise, so a walk depends on how long the sequence is, and
    ``count`` must be known from the beginning. The samples after these come in blocks with random numbers of their own.
    """

    def __init__(self, model: ImuNoise, count: int, rate_hz: float, seed: int):
        self._model, self._rate_hz, self._seed, self._taken, self._blocks = model, rate_hz, seed, 0, 1
        self._drawn = imu_noise(model, count, rate_hz, seed)

    def take(self, count: int) -> tuple[Noise, ...]:
        """The next samples, as `imu_noise` gives them."""
        while len(self._drawn[0].white) < self._taken + count:
            self._draw()
        rows = slice(self._taken, self._taken + count)
        self._taken += count
        return tuple(Noise(made.white[rows], made.bias[rows]) for made in self._drawn)

    def _draw(self) -> None:
        """Put a block behind the samples that are left; its bias walks on from the last one's."""
        ends = [(before.bias[-1],) for before in self._drawn]
        made = _noises(self._model, BLOCK + 1, self._rate_hz, (self._seed, self._blocks), ends)
        self._drawn = tuple(
            Noise(
                np.concatenate([old.white[self._taken :], new.white[1:]]),
                np.concatenate([old.bias[self._taken :], new.bias[1:]]),
            )
            for old, new in zip(self._drawn, made, strict=True)
        )
        self._taken, self._blocks = 0, self._blocks + 1


def _with_noise(stream: ImuNoiseStream, read: ImuReadings) -> ImuReadings:
    force, rate = stream.take(len(read.time_ns))
    return replace(
        read,
        acceleration=read.acceleration + force.white + force.bias,
        angular_velocity=read.angular_velocity + rate.white + rate.bias,
        acceleration_bias=force.bias,
        angular_velocity_bias=rate.bias,
    )


# ------------------------------------------------------------------------------------------------------------- check


def _against_states(found: Evidence) -> None:
    """Eq. (2) of the paper with the vehicle's states, exact at every sample."""
    there, T_v_s = found.motion, np.array(found.about["T_v_s"])
    w, alpha, lever = there.angular_velocity, there.angular_acceleration, T_v_s[:3, 3]
    felt = there.rotation().inv().apply(there.acceleration - found.meta["gravity"])
    felt = (felt + np.cross(w, np.cross(w, lever)) + np.cross(alpha, lever)) @ T_v_s[:3, :3]
    found.agree(
        "readings against the vehicle's states",
        {"acceleration": felt, "angular_velocity": w @ T_v_s[:3, :3]},
        1e-9,
        "m/s^2, rad/s",
        f"is not what {found.states} makes it",
    )


def _against_differences(found: Evidence, h: float) -> None:
    """Medians, since exact poses given by hand may have corners; rows where the course is even enough to tell.

    Limits: 1e-3 for the difference's own error (h^4 / 90 times the sixth derivative), the rounding of positions far
    from the origin, and for single rows twice as much as the acceleration changes about them: a corner is no flaw.
    """
    force, rate, T = found.truth["acceleration"], found.truth["angular_velocity"], found.T
    R, position = Rotation.from_matrix(T[:, :3, :3]), T[:, :3, 3] - T[0, :3, 3]
    acceleration = difference2(position, h)
    felt = R[2:-2].inv().apply(acceleration - found.meta["gravity"])
    limit = 1e-3 + 6 * EPS * np.abs(T[:, :3, 3]).max() / h**2
    apart = np.pad(force[2:-2] - felt, ((2, 2), (0, 0)))
    off = np.linalg.norm(apart[2:-2], axis=1)
    found.measure("specific force against poses, median", np.median(off), limit, "m/s^2")
    turned = (R[:-1].inv() * R[1:]).as_rotvec() / h
    turn_apart = (rate[:-1] + rate[1:]) / 2 - turned
    turn_off = np.linalg.norm(turn_apart, axis=1)
    found.measure("angular velocity against poses, median", np.median(turn_off), 1e-3, "rad/s")
    found.rows(
        "its specific force is not that of the poses",
        np.pad(off > limit + 2 * changes(acceleration), 2),
        apart,
        slice(0, 3),
    )
    found.rows(
        "its angular velocity is not that of the poses", turn_off > 1e-3 + 2 * changes(turned), turn_apart, slice(3, 6)
    )


def _strapdown(found: Evidence, h: float) -> None:
    """Integrate the IMU from a pose, and see how far off the pose after two seconds is; the worst such window.

    Trapezoids err by h/12 times the second differences of what they integrate, in each step. Those of the turns and
    of the acceleration between poses therefore bound the drift: of the attitude (theta), of the velocity (g theta and
    the acceleration's own) and of the position, each the sum of the one before. Twice that is allowed.
    """
    T = found.T
    length = min(round(WINDOW_S / h), len(T) - 5)
    starts = np.arange(2, max(3, len(T) - 2 - length), length)
    if length < 1:
        return
    R, p = Rotation.from_matrix(T[:, :3, :3]), T[:, :3, 3] - T[0, :3, 3]
    turned, g = (R[:-1].inv() * R[1:]).as_rotvec() / h, np.array(found.meta["gravity"])
    slope4, slope2 = slope(p, h), (p[3:-1] - p[1:-3]) / (2 * h)
    end_R, end_p = _integrate(found.truth, g, R[starts], slope4[starts - 2], p[starts], starts, length, h)
    far = EPS * np.abs(T[:, :3, 3]).max()
    bend_w = np.pad(bend(turned), 2, mode="edge")
    bend_a = np.pad(bend(np.pad(difference2(p, h), ((2, 2), (0, 0)), mode="edge")), 1, mode="edge")
    span = starts[:, None] + np.arange(length)
    theta = np.cumsum(h / 12 * bend_w[span], axis=1) + 8 * EPS * np.arange(length)
    start = np.linalg.norm(slope4 - slope2, axis=1)[starts - 2] + 2 * far / h
    velocity = start[:, None] + np.cumsum(h * np.linalg.norm(g) * theta + h / 12 * bend_a[span], axis=1)
    bound_p, bound_R = 2 * (h * velocity.sum(axis=1) + far), 2 * theta[:, -1]
    off_p = np.linalg.norm(end_p - p[starts + length], axis=1)
    off_R = (end_R.inv() * R[starts + length]).magnitude()
    for name, off, bound, scale, unit in (
        ("position", off_p, bound_p, 1e3, "mm"),
        ("attitude", off_R, bound_R + 1e-12, 1e6, "urad"),
    ):
        worst = int(np.argmax(off / bound))
        found.measure(
            f"integrated from {starts[worst] * h:.4g} s for {length * h:.4g} s, {name} against poses (worst)",
            scale * off[worst],
            scale * bound[worst],
            unit,
        )


def _integrate(
    imu: Samples,
    g: np.ndarray,
    attitude: Rotation,
    v: np.ndarray,
    p: np.ndarray,
    starts: np.ndarray,
    length: int,
    h: float,
) -> tuple[Rotation, np.ndarray]:
    """Attitude and position [W, 3] after ``length`` steps of trapezoids from each of W starting samples."""
    i = starts + np.arange(length + 1)[:, None]
    w, f = imu["angular_velocity"][i], imu["acceleration"][i]
    turn = h / 2 * (w[:-1] + w[1:]) + h * h / 12 * np.cross(w[:-1], w[1:])
    steps = Rotation.from_rotvec(turn.reshape(-1, 3)).as_matrix().reshape(*turn.shape, 3)
    R = np.array(list(accumulate(steps, np.matmul, initial=attitude.as_matrix())))
    a = np.einsum("twij,twj->twi", R, f) + g
    velocity = v + h / 2 * np.cumsum(np.concatenate([0 * a[:1], a[:-1] + a[1:]]), axis=0)
    p = p + np.sum(h * velocity[:-1] + h * h / 6 * (2 * a[:-1] + a[1:]), axis=0)
    return Rotation.from_matrix(R[-1]), p


def _check_noise(found: Evidence) -> None:
    """Readings are truth, bias and white noise of the density that dataset.json names, or of its profile and seed."""
    about, read, bias = found.about, found.read, found.bias
    for k, (quantity, (sensor, unit)) in enumerate(PARTS.items()):
        white = read[quantity] - found.truth[quantity] - bias[quantity]
        sigma = about["noise"][f"{sensor}_noise_density"] * np.sqrt(about["rate_hz"])
        # the standard error of a variance over 5: less than one false alarm in a million
        found.measure(
            f"white noise of the {sensor}, off by",
            abs(white.std() - sigma),
            5 * sigma / np.sqrt(2 * white.size) + 1e-9,
            unit,
        )
        found.rows(
            f"its {quantity} is off by more than noise can be",
            np.abs(white).max(1) > 8 * sigma + 1e-9,
            white,
            slice(3 * k, 3 * k + 3),
            noisy=True,
        )
    found.repeated(1e-9, "m/s^2, rad/s")
