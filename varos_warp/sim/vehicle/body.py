"""The vehicle: a sphere in water with drag and thrusters (paper 3.3.2, figure 4).

Translation in world axes:  m_t dv/dt = f - (d1 + d2 |v_r|) v_r + (rho V + m_a) dv_c/dt + W up,   v_r = v - v_c
Rotation in vehicle axes:   J domega/dt = tau - (r1 + r2 |omega|) omega + righting moment

The inertia of a sphere is isotropic, so omega x J omega vanishes and the two do not couple. Potential flow adds half
the displaced mass to the translation and nothing to the rotation.
"""

from dataclasses import dataclass
from functools import cached_property
from math import exp, inf, log, pi, sqrt

from varos_warp.scene.description import vehicle as description
from varos_warp.scene.hull import displaced_volume, sphere_radius
from varos_warp.scene.seawater import WATER_DENSITY
from varos_warp.sim import quaternion
from varos_warp.sim.quaternion import Quaternion, Vector

PRESETS = {
    "mass_kg": (12.0, 40.0, 100.0),
    "linear_drag": (5.0, 10.0, 20.0),
    "quadratic_drag": (22.0, 50.0, 92.0),
    "linear_rotational_drag": (0.10, 0.40, 1.2),
    "quadratic_rotational_drag": (0.60, 3.0, 14.0),
    "actuator_frequency": (20.0, 15.0, 10.0),
    "max_force": (40.0, 120.0, 250.0),
    "max_torque": (4.0, 15.0, 40.0),
}
"""A mini ROV, a mid-size one and a small work-class one; published fits of real ones bracket them."""


def preset(name: str, mass_kg: float) -> float:
    """A parameter of a vehicle of this mass: a power law through two neighbouring presets, continued outside."""
    masses, values = PRESETS["mass_kg"], PRESETS[name]
    lower = 0 if mass_kg < masses[1] else 1
    exponent = log(values[lower + 1] / values[lower]) / log(masses[lower + 1] / masses[lower])
    nearer = min((lower, lower + 1), key=lambda i: abs(mass_kg - masses[i]))
    return values[nearer] * (mass_kg / masses[nearer]) ** exponent


@dataclass(frozen=True)
class Sphere:
    """Parameters of the vehicle in SI units; names as in the scene file."""

    mass_kg: float
    linear_drag: float
    quadratic_drag: float
    linear_rotational_drag: float
    quadratic_rotational_drag: float
    actuator_frequency: float
    actuator_damping: float
    max_force: float
    max_torque: float
    net_buoyancy: float = 0.0
    metacentric_height: float = 0.0
    gravity: float = 9.81

    @property
    def limit_keys(self) -> tuple[str, str]:
        """Keys of the scene for ``max_force`` and ``max_torque``."""
        return "vehicle.max_force", "vehicle.max_torque"

    @property
    def free(self) -> tuple[int, ...]:
        """Axes of rotation that thrusters leave to the righting moment: none."""
        return ()

    @cached_property
    def volume(self) -> float:
        """Displaced volume [m^3]; a neutral vehicle displaces its own mass."""
        return displaced_volume(self.mass_kg, self.net_buoyancy, self.gravity)

    @cached_property
    def radius(self) -> float:
        """Radius of the sphere of that volume [m]."""
        return sphere_radius(self.volume)

    @cached_property
    def virtual_mass(self) -> float:
        """m_t = M + m_a with the added mass of a sphere in potential flow, rho V / 2 [kg]."""
        return self.mass_kg + 0.5 * WATER_DENSITY * self.volume

    @cached_property
    def inertia(self) -> float:
        """J = 2/5 M R^2 of a homogeneous sphere [kg m^2]."""
        return 0.4 * self.mass_kg * self.radius**2

    @cached_property
    def carried(self) -> float:
        """(rho V + m_a) / m_t: share of the water's acceleration that the body inherits; 1 when neutral."""
        return 1.5 * WATER_DENSITY * self.volume / self.virtual_mass

    def acceleration(self, v: Vector, force: Vector, current: Vector, current_rate: Vector) -> Vector:
        """Acceleration [m/s^2] from velocity, thrust [N], and velocity and acceleration of the water, in world axes."""
        x, y, z = v[0] - current[0], v[1] - current[1], v[2] - current[2]
        drag = self.linear_drag + self.quadratic_drag * sqrt(x * x + y * y + z * z)
        per_mass, carried = 1.0 / self.virtual_mass, self.carried
        return (
            (force[0] - drag * x) * per_mass + carried * current_rate[0],
            (force[1] - drag * y) * per_mass + carried * current_rate[1],
            (force[2] - drag * z + self.net_buoyancy) * per_mass + carried * current_rate[2],
        )

    def angular_acceleration(self, omega: Vector, torque: Vector) -> Vector:
        """Angular acceleration [rad/s^2] from the balance of moments, all in vehicle axes."""
        x, y, z = omega
        drag = self.linear_rotational_drag + self.quadratic_rotational_drag * sqrt(x * x + y * y + z * z)
        per_inertia = 1.0 / self.inertia
        return (
            (torque[0] - drag * x) * per_inertia,
            (torque[1] - drag * y) * per_inertia,
            (torque[2] - drag * z) * per_inertia,
        )

    def righting_moment(self, q: Quaternion) -> Vector:
        """M g h (z_v x z_w) in vehicle axes [N m]: the centre of buoyancy lies h above the centre of mass."""
        up_x, up_y, _ = quaternion.rotate_back(q, (0.0, 0.0, 1.0))
        moment = self.mass_kg * self.gravity * self.metacentric_height
        return (-moment * up_y, moment * up_x, 0.0)

    def drag_force(self, speed: float) -> float:
        """Drag [N] at ``speed`` [m/s] through the water."""
        return (self.linear_drag + self.quadratic_drag * speed) * speed

    def drag_torque(self, rate: float) -> float:
        """Rotational drag [N m] at ``rate`` [rad/s]."""
        return (self.linear_rotational_drag + self.quadratic_rotational_drag * rate) * rate

    @property
    def max_speed(self) -> float:
        """Terminal speed at full thrust [m/s]."""
        return terminal_rate(self.linear_drag, self.quadratic_drag, self.max_force)

    def stiffness(self, current_speed: float = 0.0) -> float:
        """Fastest rate lambda [1/s] of the motion: of decay by drag, at the largest speeds, or of swing upright."""
        peak = peak_gain(self.actuator_damping)
        speed = terminal_rate(self.linear_drag, self.quadratic_drag, peak * self.max_force + abs(self.net_buoyancy))
        righting = self.mass_kg * self.gravity * self.metacentric_height
        rate = terminal_rate(
            self.linear_rotational_drag, self.quadratic_rotational_drag, peak * self.max_torque + righting
        )
        return max(
            slope(self.linear_drag, self.quadratic_drag, max(speed, current_speed)) / self.virtual_mass,
            slope(self.linear_rotational_drag, self.quadratic_rotational_drag, rate) / self.inertia,
            sqrt(righting / self.inertia),
        )


def slope(linear: float, quadratic: float, rate: float) -> float:
    """Derivative of the drag (linear + quadratic |x|) x."""
    return linear + 2.0 * quadratic * rate if quadratic > 0.0 else linear


def terminal_rate(linear: float, quadratic: float, drive: float) -> float:
    """Steady x > 0 with (linear + quadratic x) x = drive; infinite without any drag."""
    if linear == 0.0 and quadratic == 0.0:
        return inf
    # this form of the root loses no digits when one kind of drag dominates
    return 2.0 * drive / (linear + sqrt(linear**2 + 4.0 * quadratic * drive))


def peak_gain(damping: float) -> float:
    """Largest output of a second-order filter over the largest input: 1 unless it rings."""
    if damping >= 1.0:
        return 1.0
    overshoot = exp(-pi * damping / sqrt(1.0 - damping**2))
    return (1.0 + overshoot) / (1.0 - overshoot)


def sphere(vehicle: description.Vehicle, gravity: float = 9.81) -> Sphere:
    """The simulated body of a scene's vehicle block; what the block leaves out follows from its mass."""
    displaced_volume(vehicle.mass_kg, vehicle.net_buoyancy, gravity)  # refuses what has none
    given = {name: getattr(vehicle, name) for name in Sphere.__dataclass_fields__ if name != "gravity"}
    return Sphere(
        gravity=gravity,
        **{name: preset(name, vehicle.mass_kg) if value is None else value for name, value in given.items()},
    )
