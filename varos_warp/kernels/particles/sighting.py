"""Sightings of bodies while rows are exposed: in which row a camera sees one, and along which way through the image."""

from typing import NamedTuple

import warp as wp

from varos_warp.kernels.particles.bodies import Body, Particles, body_at
from varos_warp.kernels.particles.image import Directions, Image, camera_between, make_image_of
from varos_warp.kernels.spec import SceneSpec
from varos_warp.kernels.transport.moments import Moments

wp.set_module_options({"enable_backward": False})

STRAIGHT_PX, MOST_PARTS = wp.constant(0.1), wp.constant(16)
"""A streak is drawn in parts, each of which is straight up to this, but no more of them."""
LEAST_GAIN = wp.constant(0.1)
"""An image that moves along with the rows is stretched no more than by one over this."""
ROUNDS = 3
"""Rounds in which the row of a rolling shutter that sees a body is found."""


@wp.struct
class Exposure:
    """A camera, while the rows of an image are exposed."""

    moments: Moments
    """Moments of one camera at least."""
    begin_s: float
    """Beginning of the first instant, from the frame's time [s]."""
    length_s: float
    """Length of an instant [s]."""
    after_s: float
    """Time of its frame after that of the image [s]: the frame interval, of the next frame; else 0."""
    way: wp.vec3
    """How far the water has moved meanwhile [m]."""
    current: wp.vec3
    """Velocity of the water at its frame [m/s]."""
    table: Directions
    width: int
    height: int


@wp.struct
class Sighting:
    """A body in an image: where, in which row's exposure, or a part of that."""

    image: Image
    p: wp.vec3
    begin: float
    end: float
    """The exposure of its row, or a part of it, in instants; image and place are those of its middle."""
    row: int
    stretch: float
    """How much longer its image is than at one instant, for rows are not seen at once."""


@wp.func
def exposure_of_row(moments: Moments, row: int):
    """Begin and end of a row's exposure, or of what is lit of it, in instants; equal where it is one instant."""
    begin = float(row) * moments.per_row
    if moments.open == 0.0:
        return wp.vec2(begin + 0.5, begin + 0.5)
    end = begin + moments.open
    if moments.lit_end > 0:
        begin = wp.clamp(begin, float(moments.lit_begin), float(moments.lit_end))
        end = wp.clamp(end, begin, float(moments.lit_end))
    return wp.vec2(begin, end)


@wp.func
def place_at(exposure: Exposure, particles: Particles, body: Body, instant: float):
    """Place of a body at a place in the instants."""
    time = exposure.begin_s + instant * exposure.length_s
    return body_at(particles, body, exposure.after_s + time, exposure.way + time * exposure.current)


class Sightings(NamedTuple):
    """Functions of bodies in images."""

    sighting_of: wp.Function
    """A body in the exposure of the row that it is seen in."""
    parts_of: wp.Function
    """Number of parts in which its way through the image is straight and even."""
    part_of: wp.Function
    """One of these parts, by its number."""
    half_streak: wp.Function
    """Half of the way of its image in a part."""


def make_sightings(spec: SceneSpec) -> Sightings:
    """Functions of bodies in images, with the optics of a scene, under a rolling shutter or a global one."""
    image_of = make_image_of(spec.optics)

    @wp.func
    def image_at(exposure: Exposure, particles: Particles, body: Body, instant: float, channel: int):
        p = place_at(exposure, particles, body, instant)
        return image_of(camera_between(exposure.moments, instant), exposure.table, p, channel)

    @wp.func
    def part_of(
        exposure: Exposure, particles: Particles, body: Body, whole: Sighting, k: int, parts: int, channel: int
    ):
        """A body in the k-th of so many parts of its exposure."""
        found = whole
        length = (whole.end - whole.begin) / float(parts)
        found.begin = whole.begin + float(k) * length
        found.end = found.begin + length
        middle = found.begin + 0.5 * length
        found.image = image_at(exposure, particles, body, middle, channel)
        found.p = place_at(exposure, particles, body, middle)
        return found

    @wp.func
    def sighting_of(exposure: Exposure, particles: Particles, body: Body, channel: int):
        """A body in the exposure of the row that it is seen in."""
        found = Sighting()
        found.row = exposure.height / 2
        found.stretch = 1.0
        row = float(found.row) + 0.5
        for _ in range(wp.static(ROUNDS if spec.rolling else 1)):
            open_at = exposure_of_row(exposure.moments, found.row)
            found.begin = open_at[0]
            found.end = open_at[1]
            found = part_of(exposure, particles, body, found, 0, 1, channel)
            if wp.static(spec.rolling):
                # Newton's method: the image moves while the next row is awaited
                later = 0.5 * (found.begin + found.end) + exposure.moments.per_row
                gain = 1.0 - image_at(exposure, particles, body, later, channel).y + found.image.y
                gain = wp.where(gain < 0.0, wp.min(gain, -LEAST_GAIN), wp.max(gain, LEAST_GAIN))
                row += (found.image.y - row) / gain
                found.row = wp.clamp(int(row), 0, exposure.height - 1)
                found.stretch = 1.0 / wp.abs(gain)
        return found

    @wp.func
    def parts_of(exposure: Exposure, particles: Particles, body: Body, found: Sighting, channel: int):
        """Number of parts in which a body's way through the image is straight and even while its row is exposed."""
        if found.end <= found.begin:
            return 1
        first = image_at(exposure, particles, body, found.begin, channel)
        last = image_at(exposure, particles, body, found.end, channel)
        if first.seen + found.image.seen + last.seen == 0:
            return 1
        if first.seen * found.image.seen * last.seen == 0:
            return MOST_PARTS
        bend = wp.vec2(0.5 * (first.x + last.x) - found.image.x, 0.5 * (first.y + last.y) - found.image.y)
        change = wp.max(first.area, last.area) / wp.min(first.area, last.area)
        parts = wp.sqrt(wp.length(bend) / STRAIGHT_PX + 10.0 * (change - 1.0) * (change - 1.0))
        return wp.clamp(int(wp.ceil(parts)), 1, MOST_PARTS)

    @wp.func
    def half_streak(exposure: Exposure, particles: Particles, body: Body, found: Sighting, channel: int):
        """Half of the way of an image in a part of an exposure [pixels]."""
        if found.end <= found.begin:
            return wp.vec2(0.0)
        first = image_at(exposure, particles, body, found.begin, channel)
        last = image_at(exposure, particles, body, found.end, channel)
        if first.seen == 0 or last.seen == 0:
            return wp.vec2(0.0)
        return 0.5 * wp.vec2(last.x - first.x, last.y - first.y)

    return Sightings(sighting_of, parts_of, part_of, half_streak)
