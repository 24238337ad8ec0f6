"""A rigid body with six degrees of freedom in moving water: Fossen's equations, in vehicle axes.

    M dnu_r/dt + C(nu_r) nu_r + D(nu_r) nu_r + g(eta) = tau,    nu_r = (v - v_c, omega)

The vehicle's origin is its centre of mass and its axes are principal axes of body and added mass, so M is diagonal,
and the terms of C are Kirchhoff's: omega x P of the force, and omega x L + v_r x P of the moment, with P = M_1 v_r and
L = M_2 omega. The centre of buoyancy lies a metacentric height above the origin. Water that accelerates carries the
body along by its pressure, rho V dv_c/dt at the centre of buoyancy. With the sphere's numbers and neutral buoyancy
these are the sphere's equations.
"""

from dataclasses import asdict, dataclass
from functools import cached_property
from math import inf, sqrt

from varos_warp.scene.description import vehicle as description
from varos_warp.scene.seawater import WATER_DENSITY
from varos_warp.sim import quaternion
from varos_warp.sim.quaternion import Quaternion, Vector, cross
from varos_warp.sim.vehicle.body import Sphere, peak_gain, slope, sphere, terminal_rate
from varos_warp.sim.vehicle.thrusters import Thrusters, thrusters

Six = tuple[float, float, float, float, float, float]
FASTEST = 15.0
"""Speed [m/s] that no vehicle exceeds, for one without drag."""


@dataclass(frozen=True, kw_only=True)
class RigidBody(Sphere):
    """Parameters by axis, x, y, z in the vehicle's axes; the numbers of `Sphere` are the least of them."""

    masses: Vector
    """Mass of the body with added mass [kg]."""
    inertias: Vector
    """Moments of inertia of the body with that of the water [kg m^2]."""
    linear: Six
    """Drag along [N s/m], then about the axes [N m s]."""
    quadratic: Six
    """[N s^2/m^2], [N m s^2]: times a component and the length of its vector."""
    thrusters: Thrusters | None = None

    @cached_property
    def virtual_mass(self) -> float:
        """The least of the masses [kg]."""
        return min(self.masses)

    @cached_property
    def inertia(self) -> float:
        """The least of the moments of inertia [kg m^2]."""
        return min(self.inertias)

    @property
    def free(self) -> tuple[int, ...]:
        """`PITCH` and `ROLL` where thrusters do not control them."""
        return self.thrusters.free if self.thrusters else ()

    @property
    def limit_keys(self) -> tuple[str, str]:
        """Names of the limits, as of `Sphere.limit_keys`."""
        key = "vehicle.rigid_body.thrusters"
        return (f"the force of {key}", f"the moment of {key}") if self.thrusters else super().limit_keys

    @property
    def max_speed(self) -> float:
        """Terminal speed at full thrust along the fastest axis [m/s]."""
        forces = self.thrusters.along if self.thrusters else 3 * (self.max_force,)
        return max(map(terminal_rate, self.linear[:3], self.quadratic[:3], forces))

    @property
    def broaching_speed(self) -> float:
        """Speed ahead [m/s] at which the pitch moment of the flow (Munk's) grows faster than the righting moment."""
        turning = self.masses[2] - self.masses[1]
        return sqrt(self.displaced * self.gravity * self.metacentric_height / turning) if turning > 0.0 else inf

    @cached_property
    def displaced(self) -> float:
        """Mass of the water in its place [kg]."""
        return WATER_DENSITY * self.volume

    def loads(self, r: Vector, omega: Vector, up: Vector, water: Vector) -> tuple[Vector, Vector]:
        """Force [N] and moment [N m] besides thrust, vehicle axes: drag, weight, buoyancy, and -C(nu_r) nu_r.

        r [m/s] is the velocity through the water, ``up`` a unit vector, ``water`` [m/s^2] the acceleration of the
        water.
        """
        m, J, d, k = self.masses, self.inertias, self.linear, self.quadratic
        speed = sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        rate = sqrt(omega[0] * omega[0] + omega[1] * omega[1] + omega[2] * omega[2])
        P, L = (m[0] * r[0], m[1] * r[1], m[2] * r[2]), (J[0] * omega[0], J[1] * omega[1], J[2] * omega[2])
        turned, gyro, munk = cross(omega, P), cross(omega, L), cross(r, P)
        extra, h = self.displaced - self.mass_kg, self.metacentric_height * self.displaced
        righting = (-h * (self.gravity * up[1] + water[1]), h * (self.gravity * up[0] + water[0]), 0.0)
        return (
            tuple(
                self.net_buoyancy * up[i] + extra * water[i] - (d[i] + k[i] * speed) * r[i] - turned[i]
                for i in range(3)
            ),
            tuple(righting[i] - (d[3 + i] + k[3 + i] * rate) * omega[i] - gyro[i] - munk[i] for i in range(3)),
        )

    def accelerations(
        self,
        q: Quaternion,
        v: Vector,
        omega: Vector,
        thrust: tuple[Vector, Vector],
        current: Vector,
        current_rate: Vector,
    ) -> tuple[Vector, Vector]:
        """Acceleration [m/s^2] in world and angular acceleration [rad/s^2] in vehicle axes.

        v, the current and its rate are in world axes, omega, force [N] and moment [N m] of ``thrust`` in those of the
        vehicle.
        """
        r = quaternion.rotate_back(q, (v[0] - current[0], v[1] - current[1], v[2] - current[2]))
        force, moment = self.loads(
            r, omega, quaternion.rotate_back(q, (0.0, 0.0, 1.0)), quaternion.rotate_back(q, current_rate)
        )
        carried = cross(omega, r)  # the axes turn with the body
        a = quaternion.rotate(q, tuple((force[i] + thrust[0][i]) / self.masses[i] + carried[i] for i in range(3)))
        return (
            (a[0] + current_rate[0], a[1] + current_rate[1], a[2] + current_rate[2]),
            tuple((moment[i] + thrust[1][i]) / self.inertias[i] for i in range(3)),
        )

    def needed(self, q: Quaternion, v: Vector, omega: Vector, a: Vector, alpha: Vector) -> tuple[Vector, Vector]:
        """Thrust [N] and moment [N m], vehicle axes, for a motion in still water; arguments as in `accelerations`."""
        r, there = quaternion.rotate_back(q, v), quaternion.rotate_back(q, a)
        force, moment = self.loads(r, omega, quaternion.rotate_back(q, (0.0, 0.0, 1.0)), (0.0, 0.0, 0.0))
        carried = cross(omega, r)
        return (
            tuple(self.masses[i] * (there[i] - carried[i]) - force[i] for i in range(3)),
            tuple(self.inertias[i] * alpha[i] - moment[i] for i in range(3)),
        )

    def stiffness(self, current_speed: float = 0.0) -> float:
        """Fastest rate lambda [1/s] of the motion: of decay by drag, of swing upright, or of broaching to the flow."""
        peak, (force, torque) = peak_gain(self.actuator_damping), (self.max_force, self.max_torque)
        if self.thrusters:
            force, torque = self.thrusters.largest
        righting = self.displaced * self.gravity * self.metacentric_height
        speed = max(
            current_speed,
            terminal_rate(min(self.linear[:3]), min(self.quadratic[:3]), peak * force + abs(self.net_buoyancy)),
        )
        across = min(speed, FASTEST + current_speed)
        munk = (max(self.masses) - min(self.masses)) * across * across
        rate = terminal_rate(min(self.linear[3:]), min(self.quadratic[3:]), peak * torque + righting + munk)
        sizes, slowest = (*self.masses, *self.inertias), min(self.inertias)
        return max(
            sqrt(righting / slowest),
            sqrt(munk / slowest),
            *(slope(self.linear[i], self.quadratic[i], speed if i < 3 else rate) / sizes[i] for i in range(6)),
        )


def rigid_body(vehicle: description.Vehicle, gravity: float = 9.81) -> RigidBody:
    """The simulated body of a vehicle block with ``rigid_body``; what that leaves out is the sphere's."""
    ball, block = sphere(vehicle, gravity), vehicle.rigid_body or description.RigidBody()
    added = block.added_mass or (*(3 * [ball.virtual_mass - ball.mass_kg]), 0.0, 0.0, 0.0)
    linear = block.linear_drag or (*(3 * [ball.linear_drag]), *(3 * [ball.linear_rotational_drag]))
    quadratic = block.quadratic_drag or (*(3 * [ball.quadratic_drag]), *(3 * [ball.quadratic_rotational_drag]))
    inertia, engines = block.inertia or 3 * [ball.inertia], None
    least = {
        "linear_drag": min(linear[:3]),
        "linear_rotational_drag": min(linear[3:]),
        "quadratic_drag": min(quadratic[:3]),
        "quadratic_rotational_drag": min(quadratic[3:]),
    }
    if block.thrusters is not None:
        engines = thrusters(block.thrusters, ball.radius, ball.metacentric_height > 0.0)
        least |= {"max_force": engines.max_force, "max_torque": engines.max_torque}
    return RigidBody(
        **asdict(ball) | least,
        masses=tuple(ball.mass_kg + added[i] for i in range(3)),
        inertias=tuple(inertia[i] + added[3 + i] for i in range(3)),
        linear=linear,
        quadratic=quadratic,
        thrusters=engines,
    )


def body_of(vehicle: description.Vehicle, gravity: float = 9.81) -> Sphere:
    """The simulated body of a scene's vehicle: the sphere, or what ``rigid_body`` says."""
    return sphere(vehicle, gravity) if vehicle.rigid_body is None else rigid_body(vehicle, gravity)
