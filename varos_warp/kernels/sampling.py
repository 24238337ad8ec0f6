"""Random numbers and distributions. Functions take uniform numbers ``u`` and return values; none has state."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def pcg4d(a: wp.uint32, b: wp.uint32, c: wp.uint32, d: wp.uint32):
    """Hash four words to four words (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering", JCGT 9(3))."""
    m = wp.uint32(1664525)
    k = wp.uint32(1013904223)
    x = a * m + k
    y = b * m + k
    z = c * m + k
    w = d * m + k
    x += y * w
    y += z * x
    z += x * y
    w += y * z
    s = wp.uint32(16)
    x = x ^ (x >> s)
    y = y ^ (y >> s)
    z = z ^ (z >> s)
    w = w ^ (w >> s)
    x += y * w
    y += z * x
    z += x * y
    w += y * z
    return x, y, z, w


@wp.func
def to_unit(x: wp.uint32):
    """The upper 24 bits of a word as a float in [0, 1)."""
    return float(x >> wp.uint32(8)) * 5.9604644775390625e-08


@wp.func
def uniforms(key: wp.uint32, pixel: int, sample: int, dimension: int):
    """Four numbers in [0, 1) that depend only on the arguments; ``key`` combines seed, frame and camera."""
    x, y, z, w = pcg4d(wp.uint32(pixel), wp.uint32(sample), wp.uint32(dimension), key)
    return wp.vec4(to_unit(x), to_unit(y), to_unit(z), to_unit(w))


HALF = wp.constant(wp.uint32(0x9E3779B9))
"""Difference between the keys of the two halves."""


@wp.func
def half_key(key: wp.uint32, half: int):
    """Key of the random numbers of one of the two independent halves (0 and 1) of an image's samples."""
    return key + HALF * wp.uint32(half)


@wp.func
def basis(axis: wp.vec3):
    """Two unit vectors perpendicular to ``axis`` and to each other (Duff et al. 2017, JCGT 6(1))."""
    s = wp.where(axis[2] < 0.0, -1.0, 1.0)
    a = -1.0 / (s + axis[2])
    b = axis[0] * axis[1] * a
    e1 = wp.vec3(1.0 + s * axis[0] * axis[0] * a, s * b, -s * axis[0])
    return e1, wp.vec3(b, s + axis[1] * axis[1] * a, -axis[1])


@wp.func
def from_polar(axis: wp.vec3, cos_theta: float, sin_theta: float, phi: float):
    """Unit vector at angle theta from ``axis``."""
    e1, e2 = basis(axis)
    return wp.normalize(sin_theta * wp.cos(phi) * e1 + sin_theta * wp.sin(phi) * e2 + cos_theta * axis)


@wp.func
def sample_cosine(n: wp.vec3, u: float, v: float):
    """Direction around ``n`` with density cos(theta)/pi."""
    return from_polar(n, wp.sqrt(1.0 - u), wp.sqrt(u), wp.tau * v)


@wp.func
def sample_hemisphere(n: wp.vec3, u: float, v: float):
    """Direction around ``n``, uniform over the hemisphere."""
    return from_polar(n, u, wp.sqrt(1.0 - u * u), wp.tau * v)


@wp.func
def sample_disk(u: float, v: float):
    """Point in the unit disk."""
    r = wp.sqrt(u)
    return wp.vec2(r * wp.cos(wp.tau * v), r * wp.sin(wp.tau * v))


@wp.func
def concentric_disk(u: wp.vec2):
    """Point in the unit disk: squares about the centre become circles, so what lies close together stays so.

    The map keeps areas in proportion (Shirley and Chiu 1997, "A Low Distortion Map Between Disk and Square").
    """
    x = 2.0 * u[0] - 1.0
    y = 2.0 * u[1] - 1.0
    if x == 0.0 and y == 0.0:
        return wp.vec2(0.0)
    if wp.abs(x) > wp.abs(y):
        angle = 0.25 * wp.pi * (y / x)
        return x * wp.vec2(wp.cos(angle), wp.sin(angle))
    angle = 0.25 * wp.pi * (x / y)
    return y * wp.vec2(wp.sin(angle), wp.cos(angle))


@wp.func
def asinh(x: float):
    """Inverse hyperbolic sine, odd and without cancellation for negative x."""
    a = wp.abs(x)
    return wp.sign(x) * wp.log(a + wp.sqrt(1.0 + a * a))


@wp.func
def equiangular_angle(h: float, ya: float, yb: float):
    """Angle [rad] over h [m] under which a point at distance ``h`` from a line sees the line from ya to yb.

    It is the integral of 1/(h^2 + y^2), and stays finite as h -> 0 if ya and yb have the same sign.
    """
    small = h * (yb - ya)
    large = h * h + ya * yb
    if large > 0.0 and small < 1.0e-4 * large:
        return (yb - ya) / large
    return wp.atan2(small, large) / h


@wp.func
def equiangular_point(h: float, ya: float, yb: float, angle: float, u: float):
    """Point y in [ya, yb] with density 1/(h^2 + y^2) / equiangular_angle, the given ``angle`` (Kulla and Fajardo 2012).

    The rational form is accurate as h -> 0; the usual one is used if the light's foot lies between ya and yb.
    """
    if ya * yb < 0.0:
        y = h * wp.tan(wp.atan2(ya, h) + u * angle * h)
    else:
        x = u * angle * h
        s = wp.where(x < 1.0e-4, u * angle, wp.tan(x) / h)
        # 1 - ya s, without cancellation where it matters: y = (ya + h^2 s) / (1 - ya s)
        y = (ya + h * h * s) / (1.0 - ya * s)
    return wp.clamp(y, ya, yb)


@wp.func
def inverse_distance_point(h: float, low: float, high: float, u: float):
    """Point y of a line, from the foot of a point at distance ``h``, with density 1 / `inverse_distance_area`.

    It falls as the inverse distance from the point, whose integral is asinh(y/h): ``low`` and ``high`` at the ends.
    """
    x = wp.lerp(low, high, u)
    return 0.5 * h * (wp.exp(x) - wp.exp(-x))


@wp.func
def inverse_distance_area(h: float, low: float, high: float, y: float):
    """Inverse density of `inverse_distance_point` at ``y``."""
    return (high - low) * wp.sqrt(h * h + y * y)


@wp.func
def one_minus_cos_at(y: float, h: float, distance: float):
    """1 - cos(theta) = 1 + y/distance for scattering at y from a light's foot, without cancellation for y < 0."""
    if y < 0.0:
        return h * h / (distance * (distance - y))
    return 1.0 + y / distance


@wp.func
def joint_pdf(chord: float, most: float):
    """Density [1/sr] of directions around a light, proportional to (most - gamma)/sin(gamma), gamma up to ``most``.

    With pi, for all directions, that is the integral of 1/d^2 to the light along the whole ray (Kalos 1963; Georgiev et
    al. 2013): drawing a direction from it and then an equiangular point on the ray leaves no singularity in double
    scattering. ``chord`` is the distance between the two unit vectors, because their cosine has no float32 digits left
    for gamma < 1e-3, and rays close to a light would become thousands of times too bright.
    """
    gamma = 2.0 * wp.asin(wp.min(0.5 * chord, 1.0))
    if gamma > most:
        return 0.0
    sine = wp.max(chord * wp.sqrt(wp.max(1.0 - 0.25 * chord * chord, 0.0)), 1.0e-7)
    return wp.max(most - gamma, 1.0e-7) / (sine * wp.pi * most * most)


@wp.func
def sample_joint(to_light: wp.vec3, most: float, u: float, v: float):
    """Direction with density joint_pdf around ``to_light``."""
    gamma = most * (1.0 - wp.sqrt(1.0 - u))
    return from_polar(to_light, wp.cos(gamma), wp.sin(gamma), wp.tau * v)


LARGEST = wp.constant(1.0 - 2.0**-24)
"""The largest float32 below 1."""


@wp.struct
class Reservoir:
    """A choice among weighted candidates in one pass (reservoir sampling, Chao 1982)."""

    u: float
    """Uniform number, rescaled to [0, 1) after each decision."""
    index: int
    """The candidate held, -1 for none, and its weight."""
    weight: float
    total: float
    """Sum of the weights so far; total / weight is the inverse of the probability of the candidate."""


@wp.func
def make_reservoir(u: float):
    """An empty reservoir that decides with the uniform number ``u``."""
    reservoir = Reservoir()
    reservoir.u = u
    reservoir.index = -1
    return reservoir


@wp.func
def offer(reservoir: Reservoir, index: int, weight: float):
    """Take candidate ``index`` with a probability of its weight over the total that includes it."""
    after = reservoir
    after.total += weight
    if weight <= 0.0:
        return after
    # without a division, since an approximate one might reject the only candidate, as rounding of the least numbers may
    share = reservoir.u * after.total
    if share < weight or reservoir.index < 0:
        after.u = wp.min(share / weight, LARGEST)
        after.index = index
        after.weight = weight
    else:
        after.u = wp.min((share - weight) / (after.total - weight), LARGEST)
    return after
