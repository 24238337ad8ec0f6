"""The Doppler velocity log: its beams, and the velocity and altitude that it makes of them."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

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
from varos_warp.scene.block import Block, Coordinate, Positive
from varos_warp.scene.frames import attitude
from varos_warp.sim.motion import Trajectory, applied, product

SEED = 0x64766C
"""Parts its random numbers from those of other sensors."""
AZIMUTHS_DEG = (45.0, 135.0, 225.0, 315.0)
"""Azimuths of the beams about the sensor's z, from its x towards its y."""
NOT_MEASURED = 1e6
"""Variance of what a DVL does not measure, in ROS [rad^2/s^2]: filters refuse infinity."""
FEWEST_BEAMS = 3
"""Fewest beams that a velocity follows from."""


def _check_reach(value: tuple[float, float]) -> tuple[float, float]:
    if not 0.0 <= value[0] < value[1]:
        raise ValueError("a range is [least, most] with 0 <= least < most")
    return value


class Dvl(Mounted):
    """A Doppler velocity log with four beams in Janus configuration, downwards in its own axes.

    Beams point 45, 135, 225 and 315 degrees about the sensor's z, counted from its x towards its y.
    """

    rate_hz: Positive = 5.0
    """Readings per second [Hz]."""
    beam_angle_deg: Annotated[float, Field(ge=1.0, le=80.0)] = 30.0
    """Angle between each beam and the sensor's downward axis, -z [degrees]."""
    range_m: Annotated[tuple[Coordinate, Coordinate], AfterValidator(_check_reach)] = (0.05, 50.0)
    """Least and most distance along a beam at which the bottom is locked [m]."""


class DvlNoise(Block):
    """Errors of each beam of the DVL; its velocity and altitude are those of the beams that err."""

    velocity_std: NoiseDensity = 0.0
    """White noise of a reading, standard deviation [m/s]"""
    scale: Annotated[float, Field(gt=-1.0, le=1.0)] = 0.0
    """Share by which velocities are too large, as with a wrong speed of sound"""
    range_std: NoiseDensity = 0.0
    """White noise of a range, standard deviation [m]"""


@dataclass(frozen=True)
class DvlReadings:
    """Readings of a DVL, instantaneous, one row per sample; NaN where there is no bottom lock."""

    time_ns: np.ndarray
    """int64 [M]"""
    velocity: np.ndarray
    """Velocity of the sensor over the bottom, in its own axes [M, 3] [m/s]: least squares of the beams that are locked,
    NaN where fewer than three are."""
    altitude: np.ndarray
    """Altitude along the sensor's downward axis [M] [m]: the mean of the beams that are locked, NaN where none is."""
    range: np.ndarray
    """Range along each beam [M, 4] [m], NaN without lock."""
    beam_velocity: np.ndarray
    """Velocity of what each beam meets, along it and away from the sensor [M, 4] [m/s], NaN without lock."""


class DvlProduct(SensorProduct[Dvl, DvlNoise, DvlReadings]):
    """Beams d of the sensor: range along d to what is there, and velocity d . (u - R_sv (R_vw v + w x l)).

    u is the velocity of what a beam meets, in sensor axes: 0 where it stands still.
    """

    key, id, label = "dvl", "dvl0", "DVL"
    noise = DvlNoise
    columns = {
        "velocity": xyz("v_RS_S", "m s^-1"),
        "altitude": ["altitude [m]"],
        "range": [f"range_{i} [m]" for i in range(1, 5)],
        "beam_velocity": [f"beam_velocity_{i} [m s^-1]" for i in range(1, 5)],
    }
    curves = (
        Curve("velocity", "Velocity over the bottom (DVL)", "m/s", "xyz", viewed="velocity over the bottom [m/s]"),
        Curve("altitude", "Altitude (DVL)", "m", ["above the bottom"]),
    )
    stream_id = 40
    stream_fields = (
        "float64[12]: velocity over the bottom x y z [m/s], axes of the DVL; altitude [m]; ranges of four "
        "beams [m]; their velocities away from the sensor [m/s]; NaN without bottom lock"
    )
    convention = (
        "velocity of the sensor over the bottom in sensor axes, z up; beam velocities are those of the "
        "bottom along the beams, away from the sensor; nan without bottom lock"
    )
    chapter = """DVL (dvl0/dvl0_data.csv)
  v_RS_S is the velocity of the sensor over the bottom, in sensor axes: least squares of the beams with bottom lock. \
altitude
  is along the sensor's downward axis (-z): the mean of the locked beams. range_1 ... range_4 are distances along the \
beams
  to the terrain or an object; beam_velocity_1 ... that of what a beam meets, which may move, along it, away from the \
sensor.
  nan: no bottom lock (of the velocity: of fewer than three beams). Unit vectors of the beams, in sensor axes, are
  sensors.dvl0.beams of dataset.json; beams lock within sensors.dvl0.range_m. If noise is listed there, columns \
true_...
  are without it.
"""
    needs_solids, has_bias = True, False
    facts = {"beams": tuple[Vec3, Vec3, Vec3, Vec3], "range_m": tuple[float, float]}
    ros_types = {"": "geometry_msgs/msg/TwistWithCovarianceStamped"}

    def measure(self, there: Trajectory, sensor: Dvl, around: Surroundings) -> DvlReadings:
        """Ranges and velocities along the beams, and what follows from them."""
        beams, T_w_s = beam_directions(sensor), there.poses() @ self.mounting(sensor)
        velocity = applied(there.rotation().inv(), there.velocity)  # of the sensor, in vehicle axes
        velocity = velocity + np.cross(there.angular_velocity, np.asarray(sensor.position, float))
        distance, away = around.met_by_beams(there.time_ns, T_w_s, beams, sensor.range_m)
        along = product(product(velocity, attitude(sensor)), beams.T)
        return bottom_track(there.time_ns, beams, distance, away - along)

    def doubt(self, sensor: Dvl, read: DvlReadings) -> str:
        """Return whether it never has bottom lock."""
        if np.isfinite(read.range).any():
            return ""
        least, most = sensor.range_m
        return (
            f"none of its beams meets anything within range_m = [{least:g}, {most:g}] in the whole run, so all "
            "readings are nan"
        )

    def describe(self, sensor: Dvl) -> dict[str, Any]:
        """Unit vectors of the beams, and within which ranges they lock."""
        return {"beams": beam_directions(sensor).tolist(), "range_m": list(sensor.range_m)}

    def noisy(self, truth: Samples, about: dict[str, Any], model: DvlNoise, seed: int) -> tuple[Samples, None]:
        """Readings with an error of each beam."""
        return vars(dvl_noise(model, DvlReadings(**truth), np.array(about["beams"]), seed)), None

    def check(self, found: Evidence) -> None:
        """What follows from ranges and the vehicle's states; ranges against the scene's meshes; then the noise."""
        truth, about = DvlReadings(**found.truth), found.about
        velocity = found.motion.velocity_of(np.array(about["T_v_s"])[:3, 3])
        beams, (least, most) = np.array(about["beams"]), about["range_m"]
        from_still = -(velocity[:, None] @ found.T[:, :3, :3])[:, 0] @ beams.T
        away = _check_ranges(found, truth.range, beams)
        expected = np.where(np.isnan(away), truth.beam_velocity, from_still + away)
        locked = np.where((truth.range >= least) & (truth.range <= most), truth.range, np.nan)
        found.agree(
            "readings against ranges and states",
            vars(bottom_track(truth.time_ns, beams, locked, expected)),
            1e-9,
            "m, m/s",
            f"is not what its ranges and {found.states} make it",
        )
        if about.get("noise"):
            _check_noise(found, truth, beams)

    def ros(self, make: RosMessages, topic: str, time_ns: int, row: Samples, meta: dict[str, Any]) -> Any:
        """The velocity, of readings that have one, with the covariance that the beams' white noise gives it.

        It measures no turning: that is 0 with a variance that says so, for the message has no other word for it.
        """
        if np.isnan(row["velocity"]).any():
            return None
        about, covariance = meta["sensors"][self.id], NOT_MEASURED * np.eye(6)
        inverse = np.linalg.pinv(np.array(about["beams"])[np.isfinite(row["range"])])
        covariance[:3, :3] = (about.get("noise") or {}).get("velocity_std", 0.0) ** 2 * inverse @ inverse.T
        twist = make["geometry_msgs/msg/Twist"](make.vector(row["velocity"]), make.vector(np.zeros(3)))
        return make[self.ros_types[topic]](
            make.header(time_ns, self.ros_frame),
            make["geometry_msgs/msg/TwistWithCovariance"](twist, covariance.ravel()),
        )


def beam_directions(dvl: Dvl) -> np.ndarray:
    """Unit vectors [4, 3] of the beams, away from the sensor, in its axes."""
    theta, phi = np.radians(dvl.beam_angle_deg), np.radians(AZIMUTHS_DEG)
    return np.column_stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.full(4, -np.cos(theta))])


def bottom_track(
    time_ns: np.ndarray, beams: np.ndarray, distance: np.ndarray, beam_velocity: np.ndarray
) -> DvlReadings:
    """Readings that follow from beams [4, 3] and, along each, distance [M, 4] [m], NaN without lock, and velocity."""
    locked = np.isfinite(distance)
    beam_velocity = np.where(locked, beam_velocity, np.nan)
    velocity = np.full((len(distance), 3), np.nan)
    for pattern in np.unique(locked, axis=0):
        if pattern.sum() >= FEWEST_BEAMS:
            rows = (locked == pattern).all(axis=1)
            velocity[rows] = product(-beam_velocity[rows][:, pattern], np.linalg.pinv(beams[pattern]).T)
    below = np.where(locked, -beams[:, 2] * distance, 0.0).sum(axis=1)
    altitude = np.where(locked.any(axis=1), below / np.maximum(locked.sum(axis=1), 1), np.nan)
    return DvlReadings(time_ns, velocity, altitude, distance, beam_velocity)


def dvl_noise(model: DvlNoise, truth: DvlReadings, beams: np.ndarray, seed: int) -> DvlReadings:
    """Readings of the DVL, of true ones, for beams [4, 3] in its axes: each beam errs, and lock is as it was."""
    rng = np.random.default_rng([seed, SEED])
    velocity = (1.0 + model.scale) * truth.beam_velocity
    velocity = velocity + model.velocity_std * rng.standard_normal(velocity.shape)
    distance = truth.range + model.range_std * rng.standard_normal(truth.range.shape)
    return bottom_track(truth.time_ns, beams, distance, velocity)


DVL = DvlProduct()


def _check_ranges(found: Evidence, ranges: np.ndarray, beams: np.ndarray) -> np.ndarray:
    """Ranges are those to the scene's meshes, where all of their files are at hand; beams at an edge may differ.

    Returns:
        Velocity along the beams [M, 4] [m/s] of what they meet, which may move; NaN where that is not known.
    """
    met = found.met_by_beams(beams, found.about["range_m"])
    if met is None:
        return np.full(ranges.shape, np.nan if found.anything_moves else 0.0)
    expected, away = met
    same = np.isclose(ranges, expected, rtol=1e-9, atol=1e-6, equal_nan=True)
    found.measure(
        "beams with another range than to the scene's meshes", float(np.mean(~same)), 0.01 + 1.0 / same.size, ""
    )
    return np.where(same | (not found.anything_moves), away, np.nan)


def _check_noise(found: Evidence, truth: DvlReadings, beams: np.ndarray) -> None:
    """Velocity and altitude are those of the beams, which are no farther off than their noise can be."""
    model, read = found.about["noise"], DvlReadings(**found.read)
    found.agree(
        "readings against their own beams",
        vars(bottom_track(read.time_ns, beams, read.range, read.beam_velocity)),
        1e-9,
        "m, m/s",
        "is not what its beams make it",
        noisy=True,
    )
    exact = vars(truth) | {"beam_velocity": (1.0 + model["scale"]) * truth.beam_velocity}
    for name, quantity, std, unit in (
        ("range", "range", model["range_std"], "m"),
        ("beam velocity", "beam_velocity", model["velocity_std"], "m/s"),
    ):
        off = found.apart(found.read, {quantity: exact[quantity]})
        found.measure(f"{name} off the truth, at most", off.max(initial=0.0), 8 * std + 1e-9, unit)
    found.repeated(1e-9, "m, m/s")
