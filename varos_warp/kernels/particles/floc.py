"""The image of a floc: grains that stick to each other, each of which is a disc.

A body's number says which of some shapes it has and how it lies in the water, so that it is the same from frame to
frame, and cameras see it from their sides. What is out of focus or moves is spread grain by grain, so that an outline
is lost as it is behind a lens.
"""

import warp as wp

from varos_warp.kernels.particles.bodies import Body, Grain, Particles
from varos_warp.kernels.particles.disc import OPTICS_PX, disc_area, edge_of, inside, off_streak, radius_of

wp.set_module_options({"enable_backward": False})

ROUND = wp.constant(0.5)
"""Bodies are seen round whose grains lie no farther from their middle than this, over the radius of a point's image."""
LONG = wp.constant(3.0)
"""Streaks of a half length of so many times that have less of a shape, and of twice that none."""


@wp.struct
class Floc:
    """The grains of a body as they lie in an image."""

    shape: int
    """Row of the table of grains."""
    loose: float
    """Share by which its grains are apart; at 0 the body is round."""
    size: float
    """Radius of its cross section [pixels]."""
    blur: float
    """Radius of the disc of defocus [pixels]."""
    across: wp.vec3
    down: wp.vec3
    """Image point of a grain from the body's middle, per coordinate of its place [pixels]."""


@wp.func
def shape_of(body: Body, shapes: int):
    """Which of so many shapes a body has; from late digits of a number whose early ones say how bright it is."""
    digits = body.u[3] * 4096.0
    return wp.min(int((digits - wp.floor(digits)) * float(shapes)), shapes - 1)


@wp.func
def lies_along(particles: Particles, body: Body, e: wp.vec3):
    """A direction of the world as seen from a body: it lies as its numbers say, and turns about an axis of its own."""
    a, b = wp.sqrt(1.0 - body.u[0]), wp.sqrt(body.u[0])
    lies = wp.quat(
        a * wp.sin(wp.tau * body.u[1]),
        a * wp.cos(wp.tau * body.u[1]),
        b * wp.sin(wp.tau * body.u[2]),
        b * wp.cos(wp.tau * body.u[2]),
    )
    own = wp.quat_rotate_inv(lies, e)
    turn = wp.where(body.u[3] < 0.5, particles.turn, -particles.turn)
    c, s = wp.cos(turn), wp.sin(turn)
    return wp.vec3(c * own[0] + s * own[1], c * own[1] - s * own[0], own[2])


@wp.func
def grain_at(floc: Floc, grain: Grain):
    """Image point of a grain from the body's middle [pixels]."""
    return wp.vec2(wp.dot(floc.across, grain.at), wp.dot(floc.down, grain.at))


@wp.func
def floc_extent(floc: Floc, grains: wp.array2d(dtype=Grain)):
    """How far the middles of its grains are from the body's, right or left and up or down at most [pixels]."""
    most = wp.vec2(0.0)
    for k in range(grains.shape[1]):
        at = grain_at(floc, grains[floc.shape, k])
        most = wp.vec2(wp.max(most[0], wp.abs(at[0])), wp.max(most[1], wp.abs(at[1])))
    return most


@wp.func
def looseness(extent: float, blur: float, length: float):
    """Share by which grains of a body are seen apart that reach so far, blurred and drawn out by so much [pixels]."""
    seen = extent / (ROUND * wp.sqrt(blur * blur + OPTICS_PX * OPTICS_PX)) - 1.0
    return wp.clamp(seen, 0.0, 1.0) * wp.clamp(2.0 - length / (LONG * extent), 0.0, 1.0)


@wp.func
def share_of_floc(floc: Floc, grains: wp.array2d(dtype=Grain), along: wp.vec2, at: wp.vec2):
    """Share of a floc's light at a place from its middle; its integral over an image is 1."""
    length = wp.length(along)
    share = float(0.0)
    for k in range(grains.shape[1]):
        grain = grains[floc.shape, k]
        size = floc.size * (1.0 + floc.loose * (grain.radius - 1.0))
        radius = radius_of(size, floc.blur)
        off = off_streak(at - grain_at(floc, grain), along)
        if wp.dot(off, off) < 4.0 * radius * radius:
            edge = edge_of(size, floc.blur)
            share += grain.share * inside(radius, edge, wp.length(off)) / disc_area(radius, edge, length)
    return share
