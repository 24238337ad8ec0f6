"""The beams of a Doppler velocity log, and the velocity and altitude that it makes of them."""

from dataclasses import dataclass

import numpy as np

from varos_warp.scene.description import vehicle as description
from varos_warp.sim.motion import product

AZIMUTHS_DEG = (45.0, 135.0, 225.0, 315.0)
"""Of the beams about the sensor's z, from its x towards its y."""
FEWEST_BEAMS = 3
"""That a velocity follows from."""


@dataclass(frozen=True)
class Dvl:
    """Readings of a DVL, instantaneous, one row per sample; NaN where there is no bottom lock."""

    time_ns: np.ndarray
    """int64 [M]"""
    velocity: np.ndarray
    """Of the sensor over the bottom, in its own axes [M, 3] [m/s]: least squares of the beams that are locked, NaN
    where fewer than three are."""
    altitude: np.ndarray
    """Along the sensor's downward axis [M] [m]: the mean of the beams that are locked, NaN where none is."""
    range: np.ndarray
    """Along each beam [M, 4] [m], NaN without lock."""
    beam_velocity: np.ndarray
    """Of what each beam meets, along it and away from the sensor [M, 4] [m/s], NaN without lock."""


def beam_directions(dvl: description.Dvl) -> np.ndarray:
    """Unit vectors [4, 3] of the beams, away from the sensor, in its axes."""
    theta, phi = np.radians(dvl.beam_angle_deg), np.radians(AZIMUTHS_DEG)
    return np.column_stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.full(4, -np.cos(theta))])


def bottom_track(time_ns: np.ndarray, beams: np.ndarray, distance: np.ndarray, beam_velocity: np.ndarray) -> Dvl:
    """Readings that follow from the beams.

    Args:
        time_ns: int64 [M].
        beams: Unit vectors [4, 3], sensor axes.
        distance: Along each beam [M, 4] [m], NaN without lock.
        beam_velocity: [M, 4] [m/s].
    """
    locked = np.isfinite(distance)
    beam_velocity = np.where(locked, beam_velocity, np.nan)
    velocity = np.full((len(distance), 3), np.nan)
    for pattern in np.unique(locked, axis=0):
        if pattern.sum() >= FEWEST_BEAMS:
            rows = (locked == pattern).all(axis=1)
            velocity[rows] = product(-beam_velocity[rows][:, pattern], np.linalg.pinv(beams[pattern]).T)
    below = np.where(locked, -beams[:, 2] * distance, 0.0).sum(axis=1)
    altitude = np.where(locked.any(axis=1), below / np.maximum(locked.sum(axis=1), 1), np.nan)
    return Dvl(time_ns, velocity, altitude, distance, beam_velocity)
