"""Distorted lenses and ports in camera axes, origin at the lens: what bends a ray between image point and water.

scene/optics does the same in float64, and says what the models are.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

wp.set_module_options({"enable_backward": False})

HALVINGS, NEWTON_STEPS = wp.constant(8), wp.constant(6)
"""Of the inverse of a distortion: an interval of 1/256 of the whole, then all digits of float32. Close to a fold that
takes six steps, elsewhere three."""
Coefficients = wp.types.vector(5, float)


@dataclass(frozen=True)
class OpticsSpec:
    """What a camera's rays are compiled for; what it lacks costs nothing."""

    lens: str = "none"
    """none, brown_conrady or kannala_brandt."""
    port: str = "none"
    """none, flat or dome."""
    dispersion: bool = False
    """The water's index differs between the channels, and each has rays of its own."""
    rim: bool = False
    """Some rays miss the port's glass by its size."""

    @property
    def bends(self) -> bool:
        """Whether the camera is more than a pinhole or a thin lens in the water."""
        return self.lens != "none" or self.port != "none"


STRAIGHT = OpticsSpec()
"""A pinhole or thin lens."""


@wp.struct
class Optics:
    """Lens and port."""

    k: Coefficients
    """Coefficients of the distortion, in OpenCV's order."""
    reach: float
    """Tangent (brown_conrady) or angle [rad] (kannala_brandt) of the axis that no image point exceeds."""
    axis: wp.vec3
    """Flat: unit normal towards the water. Dome: centre [m]."""
    distance: float
    """Flat: from the lens to the glass. Dome: radius of the inner surface [m]."""
    thickness: float
    """Of the glass [m]."""
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
def brown_conrady_step(k: Coefficients, x: float, y: float, at: wp.vec2):
    """The next of Newton's steps towards the point that is seen at ``at``."""
    q = x * x + y * y
    scale = 1.0 + q * (k[0] + q * (k[1] + q * k[4]))
    slope = k[0] + q * (2.0 * k[1] + q * 3.0 * k[4])
    off_x = x * scale + 2.0 * k[2] * x * y + k[3] * (q + 2.0 * x * x) - at[0]
    off_y = y * scale + k[2] * (q + 2.0 * y * y) + 2.0 * k[3] * x * y - at[1]
    across = 2.0 * x * y * slope + 2.0 * (k[2] * x + k[3] * y)
    J = wp.mat22(scale + 2.0 * x * x * slope + 2.0 * k[2] * y + 6.0 * k[3] * x, across,
                 across, scale + 2.0 * y * y * slope + 6.0 * k[2] * y + 2.0 * k[3] * x)
    return wp.vec2(x, y) - wp.inverse(J) * wp.vec2(off_x, off_y)


@cache
def make_undistorted(lens: str) -> wp.Function:
    """The function ``undistorted``: direction, of any length, that a lens sees at a point of the image plane."""
    if lens == "none":
        @wp.func
        def straight(optics: Optics, at: wp.vec2):
            return wp.vec3(at[0], at[1], 1.0)

        return straight

    radius = {"brown_conrady": brown_conrady_radius, "kannala_brandt": kannala_brandt_radius}[lens]

    @wp.func
    def undone(optics: Optics, r: float):
        """Tangent or angle at which the distance from the centre is ``r``."""
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

    @wp.func
    def undistorted(optics: Optics, at: wp.vec2):
        r = wp.length(at)
        scale = float(1.0)
        x = undone(optics, r)
        if wp.static(lens == "brown_conrady"):
            if r > 0.0:
                scale = x / r
            xy = scale * at
            for _ in range(NEWTON_STEPS):
                xy = brown_conrady_step(optics.k, xy[0], xy[1], at)
            return wp.vec3(xy[0], xy[1], 1.0)
        else:
            if r > 0.0:
                scale = wp.sin(x) / r
            return wp.vec3(scale * at[0], scale * at[1], wp.cos(x))

    return undistorted


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
    """Where a ray from within a sphere around the origin leaves it."""
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
