"""Turbulence of the water that moves the vehicle, and the vehicle as a rigid body with thrusters (docs/vehicle.md)."""

from typing import Annotated

import numpy as np
from pydantic import Field, field_validator

from varos_warp.scene.block import Block, Position, Vec3

Rms = Annotated[float, Field(ge=0.0, le=10.0)]
"""Standard deviation of a turbulent velocity [m/s]."""
EddyTime = Annotated[float, Field(ge=0.1, le=1e6)]
"""Time constant of turbulence [s]; at least 20 ticks."""


class Turbulence(Block):
    """Velocity of the water as an Ornstein-Uhlenbeck process, averaged by the hull over a time (docs/vehicle.md)."""

    rms: tuple[Rms, Rms, Rms] = Field(examples=[[0.06, 0.06, 0.04]])
    """Standard deviation along world x, y and z of what the vehicle meets [m/s]."""
    correlation_time_s: EddyTime = 10.0
    """Correlation time of the process [s]."""
    smoothing_s: EddyTime = 0.25
    """Time constant [s] of each of two first-order lags, by which smaller eddies average out over the hull."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    """Seed of the turbulence, together with that of the scene."""


class Thruster(Block):
    """A thruster that is fixed to the vehicle and pushes either way along ``direction``."""

    position: Position = Field(examples=[[0.11, 0.16, 0.0]])
    """Point at which the thruster pushes, in vehicle axes [m]."""
    direction: Vec3 = Field(examples=[[-1.0, 1.0, 0.0]])
    """Direction of the thrust in vehicle axes, a vector of any length."""
    max_force: Annotated[float, Field(gt=0.0, le=1e6)] = Field(examples=[40])
    """Most force either way [N]."""

    @field_validator("direction")
    @classmethod
    def _has_length(cls, value):
        if not 1e-6 <= np.linalg.norm(value) <= 1e6:
            raise ValueError("the direction of a thruster must be 1e-6 to 1e6 long")
        return value


Inertia = Annotated[float, Field(gt=0.0, le=1e15)]
"""Moment of inertia [kg m^2]."""
Load = Annotated[float, Field(ge=0.0, le=1e12)]
Loads = tuple[Load, Load, Load, Load, Load, Load]
"""Six values along and about the axes of the vehicle: sway (x), surge (y), heave (z), then pitch (about x), roll (y),
yaw (z)."""


class RigidBody(Block):
    """A body with six coupled degrees of freedom in place of the sphere; what is absent is the sphere's.

    The origin of the vehicle is its centre of mass, and its axes are principal axes.
    """

    inertia: tuple[Inertia, Inertia, Inertia] | None = Field(default=None, examples=[[0.26, 0.23, 0.37]])
    """Moments of inertia about x, y and z, without that of the water [kg m^2]."""
    added_mass: Loads | None = Field(default=None, examples=[[7.1, 6.4, 18.7, 0.19, 0.12, 0.22]])
    """Added mass along the axes [kg], then about them [kg m^2]."""
    linear_drag: Loads | None = Field(default=None, examples=[[18, 14, 60, 1.1, 0.9, 1.2]])
    """Linear drag along the axes [N s/m], then about them [N m s]."""
    quadratic_drag: Loads | None = Field(default=None, examples=[[60, 40, 90, 1.6, 1.3, 1.6]])
    """Quadratic drag along [N s^2/m^2], then about the axes [N m s^2]: of a component times the whole speed."""
    thrusters: Annotated[list[Thruster], Field(min_length=1, max_length=100)] | None = None
    """Thrusters. Absent: any force up to ``max_force`` and moment up to ``max_torque`` of the vehicle."""

    @field_validator("inertia")
    @classmethod
    def _of_a_body(cls, value):
        if value is not None and 2.0 * max(value) > sum(value) * (1.0 + 1e-9):
            raise ValueError("no body has a moment of inertia larger than the sum of the other two")
        return value
