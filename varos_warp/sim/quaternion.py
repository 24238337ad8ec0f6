"""Quaternions (w, x, y, z) of plain floats, for the loop that runs 200 times per simulated second.

SciPy's ``Rotation`` serves arrays; on single values its overhead is fifty times the arithmetic. Hamilton product;
``q`` of a body attitude maps body to outer coordinates.
"""

from math import atan2, cos, sin, sqrt

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product: the rotation ``b``, then ``a``."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """The inverse of a unit quaternion."""
    return (q[0], -q[1], -q[2], -q[3])


def normalize(q: Quaternion) -> Quaternion:
    """``q`` at unit length."""
    w, x, y, z = q
    scale = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return (w * scale, x * scale, y * scale, z * scale)


def exp(rotvec: Vector) -> Quaternion:
    """Quaternion of a rotation vector [rad]."""
    x, y, z = rotvec
    angle = sqrt(x * x + y * y + z * z)
    # below 1e-4 rad the next term of the series is less than half a unit in the last place
    scale = sin(0.5 * angle) / angle if angle > 1e-4 else 0.5 - angle * angle / 48.0
    return (cos(0.5 * angle), scale * x, scale * y, scale * z)


def log(q: Quaternion) -> Vector:
    """Rotation vector [rad] the short way round; ``q`` and ``-q`` give the same."""
    w, x, y, z = q if q[0] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])
    sine = sqrt(x * x + y * y + z * z)
    scale = 2.0 * atan2(sine, w) / sine if sine > 1e-8 else 2.0 / w
    return (scale * x, scale * y, scale * z)


def rotate(q: Quaternion, v: Vector) -> Vector:
    """``v`` in outer coordinates: R(q) v."""
    w, x, y, z = q
    vx, vy, vz = v
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return (vx + w * tx + y * tz - z * ty, vy + w * ty + z * tx - x * tz, vz + w * tz + x * ty - y * tx)


def rotate_back(q: Quaternion, v: Vector) -> Vector:
    """``v`` in body coordinates: R(q)^T v."""
    return rotate((q[0], -q[1], -q[2], -q[3]), v)


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product of a and b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
