"""A disc with a soft edge, drawn out by motion: the image of a sphere in the water, through a lens.

Bodies are loose: they thin out towards their edge, as discs of defocus do behind a real lens, and a point is a soft
spot.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

OPTICS_PX = wp.constant(1.0)
"""Radius of the image of a point in focus, where it has half its height: lens, pixel and the colours' mosaic."""
LOOSE, LENS_EDGE = wp.constant(0.9), wp.constant(0.5)
"""Width of a body's edge, and of a disc of defocus, over their radius."""


@wp.func
def radius_of(size: float, blur: float):
    """Radius of a disc of a body's radius, defocus and `OPTICS_PX`, where it has half its height [pixels]."""
    return wp.sqrt(size * size + blur * blur + OPTICS_PX * OPTICS_PX)


@wp.func
def edge_of(size: float, blur: float):
    """Width of its edge, twice its radius at most [pixels]; a point is all edge."""
    body, lens = LOOSE * size, LENS_EDGE * blur
    return wp.sqrt(body * body + lens * lens + 4.0 * OPTICS_PX * OPTICS_PX)


@wp.func
def ramps_of(edge: float):
    """Lengths of two boxes whose convolution is the slope of an edge of this width [pixels].

    The longer is a pixel at least: so pixels of a straight edge sum up to its integral, wherever it lies, up to a width
    of two pixels exactly, and beyond nearly.
    """
    longer = wp.max(0.5 * edge, 1.0)
    return wp.vec2(longer, edge - longer)


@wp.func
def inside(radius: float, edge: float, distance: float):
    """Share of a disc at a distance from its middle: 1 inside, falling to 0 over its edge."""
    ramps = ramps_of(edge)
    x = radius - distance
    left = wp.max(0.5 * edge - wp.abs(x), 0.0)
    if left > ramps[1]:
        return 0.5 + x / ramps[0]
    tail = 0.5 * left * left / (ramps[0] * ramps[1])
    return wp.where(x > 0.0, 1.0 - tail, tail)


@wp.func
def off_streak(at: wp.vec2, along: wp.vec2):
    """A place as seen from the nearest of a streak, whose ends are at ``along`` and against it."""
    length = wp.dot(along, along)
    if length > 0.0:
        return at - wp.clamp(wp.dot(at, along) / length, -1.0, 1.0) * along
    return at


@wp.func
def disc_area(radius: float, edge: float, length: float):
    """Integral of `inside` over an image, of a disc that is drawn out by a half ``length`` to either side [pixels]."""
    ramps = ramps_of(edge)
    return wp.pi * (radius * radius + wp.dot(ramps, ramps) / 12.0) + 4.0 * length * radius
