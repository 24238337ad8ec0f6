"""Thrusters that are fixed to the vehicle: what force and moment they give together, and which they are to give.

Thruster i with direction d_i at r_i gives the force d_i f_i and the moment r_i x d_i f_i: the columns of the
configuration matrix B [6, n], tau = B f. Of all f that give an asked tau the pseudo-inverse takes that with the least
sum of (f_i / max_force_i)^2 (Fossen 2021, 11.2). A vehicle that cannot pitch or roll at will, as most ROVs, leaves
that to its righting moment: then the asked moment about that axis is not looked at, and what the thrusters give there
besides is felt.
"""

from dataclasses import dataclass

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.description import body as description
from varos_warp.sim.quaternion import Vector

PITCH, ROLL = 3, 4
"""Rows of B: moments about the vehicle's x (right) and y (forward)."""
AXES = (
    "force to the right (x)",
    "force forwards (y)",
    "force upwards (z)",
    "pitch moment (about x)",
    "roll moment (about y)",
    "yaw moment (about z)",
)
LEAST = 1e-3
"""Smallest singular value of what can be controlled, by the largest; moments are taken at the hull's radius."""


@dataclass(frozen=True)
class Thrusters:
    """Thrusters and how they share what is asked of them."""

    allocation: np.ndarray
    """Shares of their largest force that thrusters take for a force [N] and moment [N m], [n, 6]; of what is not
    controlled 0."""
    delivered: np.ndarray
    """Force and moment by what was asked, [6, 6]."""
    free: tuple[int, ...]
    """Rows of B that are not controlled: `PITCH`, `ROLL`."""
    largest: tuple[float, float]
    """Bounds on the force [N] and moment [N m] that all of them give in any direction."""

    @property
    def max_force(self) -> float:
        """Force that can be had in every direction [N], without moments that are controlled."""
        return 1.0 / float(np.linalg.norm(self.allocation[:, :3], axis=1).max())

    @property
    def max_torque(self) -> float:
        """Moment that can be had about every controlled axis [N m]."""
        return 1.0 / float(np.linalg.norm(self.allocation[:, 3:], axis=1).max())

    @property
    def along(self) -> tuple[float, ...]:
        """Largest forces along x, y and z alone [N]."""
        return tuple((1.0 / np.abs(self.allocation[:, :3]).max(axis=0)).tolist())

    def deliver(self, force: Vector, torque: Vector) -> tuple[Vector, Vector, bool]:
        """What the thrusters make of a command, all in vehicle axes, and whether one was at its limit.

        Then all are scaled down alike, which keeps the direction of force and moment.
        """
        asked = np.array([*force, *torque])
        peak = float(np.abs(self.allocation @ asked).max())
        given = (self.delivered @ asked / max(peak, 1.0)).tolist()
        return tuple(given[:3]), tuple(given[3:]), peak > 1.0


def thrusters(blocks: list[description.Thruster], radius: float, righted: bool) -> Thrusters:
    """Allocation for a vehicle's thrusters; the radius of the hull [m] only compares moments with forces.

    Refused if they cannot push in all directions and turn, or nothing holds the axes that they do not control: a
    righting moment holds roll and pitch where the vehicle is ``righted``.
    """
    directions = np.array([np.divide(block.direction, np.linalg.norm(block.direction)) for block in blocks]).T
    arms, most = np.array([block.position for block in blocks]).T, np.array([block.max_force for block in blocks])
    B = np.vstack([directions, np.cross(arms, directions, axis=0)]) * most
    even = B / np.array([1.0, 1.0, 1.0, radius, radius, radius])[:, None]
    for free in ((), (PITCH,), (ROLL,), (PITCH, ROLL)):
        rows = [i for i in range(6) if i not in free]
        U, sizes, _ = np.linalg.svd(even[rows], full_matrices=True)
        weakest = U[:, -1]
        if len(sizes) == len(rows) and sizes[-1] > LEAST * sizes[0]:
            break
    else:
        raise InputError(
            f"together they give no {AXES[rows[int(np.abs(weakest).argmax())]]}",
            key="vehicle.rigid_body.thrusters",
            remedy="A vehicle needs forces along its three axes and a "
            "yaw moment, each without the others: add a thruster or turn one",
        )
    if free and not righted:
        raise InputError(
            f"they give no {' and no '.join(AXES[i] for i in free)} of its own, and nothing else holds "
            "the vehicle upright",
            key="vehicle.rigid_body.thrusters",
            remedy="Give a vehicle.metacentric_height, such as 0.02, or add thrusters",
        )
    allocation = np.zeros((len(blocks), 6))
    allocation[:, rows] = np.linalg.pinv(even[rows]) / np.where(np.array(rows) < 3, 1.0, radius)
    return Thrusters(allocation, B @ allocation, free, (float(most.sum()), float(np.linalg.norm(B[3:], axis=0).sum())))
