"""Distorted lenses and ports in camera axes, origin at the lens: what bends a ray between image point and water.

scene/optics does the same in float64, and says what the models are.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

wp.set_module_options({"enable_backward": False})

HALVINGS, NEWTON_STEPS = wp.constant(8), wp.constant(6)
"""Bisections and Newton steps that invert a distortion: bisection to an interval of 1/256 of the whole, then Newton's
method to all digits of float32. Close to a fold that takes six steps, elsewhere three."""
STEPS_TO_EDGE = wp.constant(12)
"""Newton steps for a lens that ends within the image or almost: each halves what is missing at its edge."""
SEEN_WITHIN = wp.constant(1.0e-5)
"""How far, over 1 and the distance from the centre, the inverse may be off where a lens sees something."""
Coefficients = wp.types.vector(8, float)


@dataclass(frozen=True)
class OpticsSpec:
    """What a camera's rays are compiled for; what it lacks costs nothing."""

    lens: str = "none"
    """none, brown_conrady, rational, kannala_brandt or double_sphere."""
    port: str = "none"
    """none, flat or dome."""
    dispersion: bool = False
    """The water's index differs between the channels, and each has rays of its own."""
    rim: bool = False
    """Some rays miss the port's glass by its size."""
    ends: bool = False
    """The lens ends within the image, so that points see nothing, or almost: the inverse is held back and checked."""

    @property
    def bends(self) -> bool:
        """True if the camera is more than a pinhole or a thin lens in the water."""
        return self.lens != "none" or self.port != "none"


STRAIGHT = OpticsSpec()
"""A pinhole or thin lens."""


@wp.struct
class Optics:
    """Lens and port."""

    k: Coefficients
    """Coefficients of the distortion, in OpenCV's order; xi and alpha of a double sphere."""
    reach: float
    """Tangent (brown_conrady, rational) or angle [rad] (kannala_brandt) of the axis that no image point exceeds."""
    axis: wp.vec3
    """Flat: unit normal towards the water. Dome: centre [m]."""
    distance: float
    """Flat: from the lens to the glass. Dome: radius of the inner surface [m]."""
    thickness: float
    """Thickness of the glass [m]."""
    n_glass: float
    n_water: wp.vec3
    rim: float
    """Flat: clear radius of the outer face [m]. Dome: cosine of its half angle."""


@wp.struct
class Bent:
    """A ray and the shares of its s and p waves that have passed the surfaces so far; 0 if there is no ray.

    All surfaces are crossed in one plane, so that s waves stay s waves.
    """

    o: wp.vec3
    d: wp.vec3
    T: wp.vec2


# ------------------------------------------------------------------------------------------------------------ lenses


@wp.func
def brown_conrady_radius(k: Coefficients, r: float):
    """Distance from the centre and its slope, without tangential distortion."""
    q = r * r
    value = r * (1.0 + q * (k[0] + q * (k[1] + q * k[4])))
    return wp.vec2(value, 1.0 + q * (3.0 * k[0] + q * (5.0 * k[1] + q * 7.0 * k[4])))


@wp.func
def kannala_brandt_radius(k: Coefficients, a: float):
    """Distance from the centre and its slope at an angle."""
    q = a * a
    value = a * (1.0 + q * (k[0] + q * (k[1] + q * (k[2] + q * k[3]))))
    return wp.vec2(value, 1.0 + q * (3.0 * k[0] + q * (5.0 * k[1] + q * (7.0 * k[2] + q * 9.0 * k[3]))))


@wp.func
def brown_conrady_scale(k: Coefficients, q: float):
    """Factor of the radius, and its slope, at the square of the radius."""
    return wp.vec2(1.0 + q * (k[0] + q * (k[1] + q * k[4])), k[0] + q * (2.0 * k[1] + q * 3.0 * k[4]))


@wp.func
def rational_scale(k: Coefficients, q: float):
    """Factor of the radius, and its slope, at the square of the radius."""
    above = brown_conrady_scale(k, q)
    below = 1.0 + q * (k[5] + q * (k[6] + q * k[7]))
    scale = above[0] / below
    return wp.vec2(scale, (above[1] - scale * (k[5] + q * (2.0 * k[6] + q * 3.0 * k[7]))) / below)


@wp.func
def rational_radius(k: Coefficients, r: float):
    """Distance from the centre and its slope, without tangential distortion."""
    scale = rational_scale(k, r * r)
    return wp.vec2(r * scale[0], scale[0] + 2.0 * r * r * scale[1])


@cache
def make_distorted(lens: str) -> wp.Function:
    """The function ``distorted`` of a lens that distorts a pinhole's image.

    It returns how far from ``at`` a point is seen, and Newton's step that leads there, in one vector.
    """
    scale_of = {"brown_conrady": brown_conrady_scale, "rational": rational_scale}[lens]

    @wp.func
    def distorted(k: Coefficients, x: float, y: float, at: wp.vec2):
        q = x * x + y * y
        factor = scale_of(k, q)
        scale, slope = factor[0], factor[1]
        off_x = x * scale + 2.0 * k[2] * x * y + k[3] * (q + 2.0 * x * x) - at[0]
        off_y = y * scale + k[2] * (q + 2.0 * y * y) + 2.0 * k[3] * x * y - at[1]
        across = 2.0 * x * y * slope + 2.0 * (k[2] * x + k[3] * y)
        J = wp.mat22(
            scale + 2.0 * x * x * slope + 2.0 * k[2] * y + 6.0 * k[3] * x,
            across,
            across,
            scale + 2.0 * y * y * slope + 6.0 * k[2] * y + 2.0 * k[3] * x,
        )
        step = wp.inverse(J) * wp.vec2(off_x, off_y)
        return wp.vec4(off_x, off_y, step[0], step[1])

    return distorted


@cache
def make_undone(lens: str) -> wp.Function:
    """The function ``undone``: tangent or angle, within the lens's reach, of a distance ``r`` from the centre."""
    radius = {
        "brown_conrady": brown_conrady_radius,
        "rational": rational_radius,
        "kannala_brandt": kannala_brandt_radius,
    }[lens]

    @wp.func
    def undone(optics: Optics, r: float):
        low = float(0.0)
        high = float(optics.reach)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            if radius(optics.k, middle)[0] < r:
                low = middle
            else:
                high = middle
        x = 0.5 * (low + high)
        for _ in range(NEWTON_STEPS):
            there = radius(optics.k, x)
            x -= (there[0] - r) / there[1]
        return x

    return undone


@cache
def make_undistorted(lens: str, ends: bool = False) -> wp.Function:
    """The function ``undistorted``: direction, of any length, that a lens sees at a point of the image plane.

    Zero where a lens that ``ends`` within the image sees nothing.
    """
    if lens == "none":

        @wp.func
        def straight(optics: Optics, at: wp.vec2):
            return wp.vec3(at[0], at[1], 1.0)

        return straight
    if lens == "double_sphere":
        return double_sphere_direction
    if lens == "kannala_brandt":
        return make_kannala_brandt_direction(ends)
    return make_perspective_direction(lens, ends)


@wp.func
def double_sphere_direction(optics: Optics, at: wp.vec2):
    """``undistorted`` of the double sphere."""
    xi = optics.k[0]
    alpha = optics.k[1]
    q = wp.dot(at, at)
    root = 1.0 - (2.0 * alpha - 1.0) * q
    if root < 0.0:
        return wp.vec3(0.0)
    z = (1.0 - alpha * alpha * q) / (alpha * wp.sqrt(root) + 1.0 - alpha)
    root = z * z + (1.0 - xi * xi) * q
    if root < 0.0:
        return wp.vec3(0.0)
    scale = (z * xi + wp.sqrt(root)) / (z * z + q)
    return wp.vec3(scale * at[0], scale * at[1], scale * z - xi)


@cache
def make_kannala_brandt_direction(ends: bool) -> wp.Function:
    """``undistorted`` of Kannala and Brandt's fisheye."""
    undone = make_undone("kannala_brandt")

    @wp.func
    def direction(optics: Optics, at: wp.vec2):
        r = wp.length(at)
        if wp.static(ends):
            if r > kannala_brandt_radius(optics.k, optics.reach)[0]:
                return wp.vec3(0.0)
        scale = float(1.0)
        x = undone(optics, r)
        if wp.static(ends):
            x = wp.clamp(x, 0.0, optics.reach)
        if r > 0.0:
            scale = wp.sin(x) / r
        return wp.vec3(scale * at[0], scale * at[1], wp.cos(x))

    return direction


@cache
def make_perspective_direction(lens: str, ends: bool) -> wp.Function:
    """``undistorted`` of a lens that distorts a pinhole's image."""
    undone, distorted = make_undone(lens), make_distorted(lens)

    @wp.func
    def within(optics: Optics, at: wp.vec2):
        return at * wp.min(1.0, optics.reach / wp.max(wp.length(at), 1.0e-12))

    @wp.func
    def direction(optics: Optics, at: wp.vec2):
        r = wp.length(at)
        scale = float(1.0)
        x = undone(optics, r)
        if r > 0.0:
            scale = x / r
        xy = scale * at
        for _ in range(NEWTON_STEPS):
            found = distorted(optics.k, xy[0], xy[1], at)
            xy -= wp.vec2(found[2], found[3])
        return wp.vec3(xy[0], xy[1], 1.0)

    @wp.func
    def direction_to_edge(optics: Optics, at: wp.vec2):
        r = wp.length(at)
        scale = float(1.0)
        x = wp.clamp(undone(optics, r), 0.0, optics.reach)
        if r > 0.0:
            scale = x / r
        xy = scale * at
        for _ in range(STEPS_TO_EDGE):
            found = distorted(optics.k, xy[0], xy[1], at)
            xy = within(optics, xy - wp.vec2(found[2], found[3]))
        found = distorted(optics.k, xy[0], xy[1], at)
        if wp.max(wp.abs(found[0]), wp.abs(found[1])) <= SEEN_WITHIN * (1.0 + r):
            return wp.vec3(xy[0], xy[1], 1.0)
        return wp.vec3(0.0)

    return direction_to_edge if ends else direction


# ------------------------------------------------------------------------------------------------------------- ports


@wp.func
def refracted(ray: Bent, p: wp.vec3, n: wp.vec3, before: float, after: float):
    """The ray behind a surface at ``p`` with normal ``n`` along its way (Snell), and what passes (Fresnel)."""
    behind = Bent()
    ratio = before / after
    cos_before = wp.dot(ray.d, n)
    cos_after = wp.sqrt(wp.max(1.0 - ratio * ratio * (1.0 - cos_before * cos_before), 0.0))
    s = (before * cos_before - after * cos_after) / (before * cos_before + after * cos_after)
    p_wave = (after * cos_before - before * cos_after) / (after * cos_before + before * cos_after)
    behind.o = p
    behind.d = ratio * ray.d + (cos_after - ratio * cos_before) * n
    behind.T = wp.cw_mul(ray.T, wp.vec2(1.0 - s * s, 1.0 - p_wave * p_wave))
    return behind


@wp.func
def sphere_exit(o: wp.vec3, d: wp.vec3, radius: float):
    """Point at which a ray from within a sphere around the origin leaves it."""
    along = wp.dot(o, d)
    return o + (wp.sqrt(wp.max(along * along - wp.dot(o, o) + radius * radius, 0.0)) - along) * d


@cache
def make_behind_port(port: str, rim: bool) -> wp.Function:
    """The function ``behind_port``: the ray in the water, for one channel, of a ray in air; none past the ``rim``."""
    if port == "none":

        @wp.func
        def no_port(optics: Optics, ray: Bent, channel: int):
            return ray

        return no_port

    @wp.func
    def behind_pane(optics: Optics, ray: Bent, channel: int):
        n = optics.axis
        if wp.dot(ray.d, n) <= 0.0:
            ray.T = wp.vec2(0.0)
            return ray
        inner = ray.o + (optics.distance - wp.dot(ray.o, n)) / wp.dot(ray.d, n) * ray.d
        in_glass = refracted(ray, inner, n, 1.0, optics.n_glass)
        outer = inner + optics.thickness / wp.dot(in_glass.d, n) * in_glass.d
        if wp.static(rim):
            if wp.length(outer - wp.dot(outer, n) * n) > optics.rim:
                in_glass.T = wp.vec2(0.0)
        return refracted(in_glass, outer, n, optics.n_glass, optics.n_water[channel])

    @wp.func
    def behind_dome(optics: Optics, ray: Bent, channel: int):
        radius = optics.distance + optics.thickness
        inner = sphere_exit(ray.o - optics.axis, ray.d, optics.distance)
        in_glass = refracted(ray, inner, inner / optics.distance, 1.0, optics.n_glass)
        outer = sphere_exit(inner, in_glass.d, radius)
        if wp.static(rim):
            if outer[2] < optics.rim * radius:
                in_glass.T = wp.vec2(0.0)
        in_water = refracted(in_glass, outer, outer / radius, optics.n_glass, optics.n_water[channel])
        in_water.o = outer + optics.axis
        return in_water

    return behind_pane if port == "flat" else behind_dome
