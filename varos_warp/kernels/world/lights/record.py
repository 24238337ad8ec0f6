"""The records of lights and of what others ask them for."""

import warp as wp


@wp.struct
class Light:
    """A point with a cone: ``intensity`` [W/sr] inside, falling to 0 over the soft edge ``blend`` (Blender's spot).

    With a ``profile`` the soft edge is only where quadratures along rays are divided.
    """

    position: wp.vec3
    axis: wp.vec3
    cos_half: float
    """Cosine of the half angle of the cone; -1 for all directions."""
    blend: float
    radius: float
    """Radius of a disk across the axis [m], each point of which shines as a point light there (disk.py); 0 for point
    lights."""
    intensity: wp.vec3
    profile: wp.array(dtype=float)
    """Relative intensity in its place, at even steps of the sine of half the angle to the axis; may be empty."""
    planes: int
    """Number of such profiles, if over 1: one after the other, in even steps around the axis."""
    sheet: int
    """1 if it shines only between four planes: those of x dot (axis +- right) = 0 and x dot (axis +- up) = 0, with x
    from the light."""
    right: wp.vec3
    up: wp.vec3
    """Perpendicular to the axis and to each other, and of a sheet as long as the cotangents of its half angles. Else
    unit; of a light with planes, the first plane holds -up, and the next is a turn about -axis away: seen from behind
    the light, counter-clockwise. (``up`` is the axis y of the light's own, which are those of a camera.)"""


@wp.struct
class LitInterval:
    """The part [ya, yb] of a ray inside a light's cone, measured from the light's foot on the ray.

    ``h`` is the light's distance from the line of the ray, ``foot`` the distance of the foot along the ray, ``angle``
    the integral of 1/d^2 to the light over the interval; 0 if nothing is lit, and where only `lit_part` was asked for.
    """

    foot: float
    h: float
    ya: float
    yb: float
    angle: float


@wp.struct
class LightSample:
    """A light as seen from a point.

    A point light is the limit of a small one, in which only the ratio of ``L`` and ``pdf`` stays finite: both are given
    for a projected area of 1 m^2.
    """

    p: wp.vec3
    """Position of the light."""
    d: wp.vec3
    """Unit direction and distance [m] to it, at least NEAR."""
    distance: float
    L: wp.vec3
    """Radiance towards the point [W/sr/m^2], without the water between."""
    pdf: float
    """Density of the direction [1/sr]."""
