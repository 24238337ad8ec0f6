"""The image of a body: a disc with a soft edge, drawn out by motion, whose pixels share its light.

Values at the pixels' centres are scaled so that they sum to the body's light, whatever its size and place. Bodies are
loose: they thin out towards their edge, as discs of defocus do behind a real lens, and a point is a soft spot. Those
that are larger than a pixel are no circles: each has an outline of its own, and is denser here than there.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

OPTICS_PX = wp.constant(1.0)
"""Radius of the image of a point in focus, where it has half its height: lens, pixel and the colours' mosaic."""
LOOSE, LENS_EDGE = wp.constant(0.9), wp.constant(0.5)
"""Width of a body's edge, and of a disc of defocus, over their radius."""
ROUND_PX = wp.constant(1.2)
"""Bodies below this radius in the image are seen round."""
ELONGATED, BENT, ROUGH = wp.constant(0.28), wp.constant(0.15), wp.constant(0.09)
"""Amplitudes of an outline's second, third and fifth harmonic, over the radius."""
UNEVEN = wp.constant(0.52)
"""Most by which an outline departs from a circle: their sum."""
THIN = wp.constant(0.3)
"""Most by which a body is thinner in one place than in another."""
LARGEST_PX = wp.constant(4000.0)
"""Of a disc; blurred more, it would not be seen."""
SUMMED_PX = wp.constant(128)
"""Side of the box whose pixels are all summed up; of larger ones that are uneven, as many along the longer side."""
TILE = wp.constant(8)
"""Side of the squares of pixels, each of which has a list of the splats that it shows."""


@wp.struct
class Splat:
    """The image of a body."""

    x: float
    y: float
    """Its middle [pixels]."""
    along: wp.vec2
    """From the middle to the end of its streak [pixels]."""
    radius: float
    """Of the disc, where it has half its height [pixels]."""
    edge: float
    """Width over which it falls from 1 to 0, twice the radius at most [pixels]."""
    uneven: float
    """Share of `UNEVEN` by which its outline is no circle."""
    turn: float
    """Angle of its outline [rad]."""
    phases: wp.vec3
    """Of the outline's harmonics [rad]."""
    scale: float
    """One over the sum of its profile over all pixels."""
    flux: wp.vec3
    """Sum of its radiance over all pixels."""
    cover: float
    """Area that it hides [pixels]."""
    t: float
    """Distance of the body along its ray in the water [m]."""
    flow: wp.vec2
    """To its image in the next frame [pixels]."""


@wp.struct
class SplatList:
    """The splats of the cells of one class of sizes, one for each tile that they show in, cell after cell."""

    counts: wp.array(dtype=int)
    """Of each cell."""
    ends: wp.array(dtype=int)
    """Where those of each cell end; empty: they are to be counted."""
    tiles: wp.array(dtype=int)
    splats: wp.array(dtype=Splat)


@wp.func
def edge_of(size: float, blur: float):
    """Width of the edge of a disc of a body's radius, defocus and `OPTICS_PX` [pixels]; a point is all edge."""
    body, lens = LOOSE * size, LENS_EDGE * blur
    return wp.sqrt(body * body + lens * lens + 4.0 * OPTICS_PX * OPTICS_PX)


@wp.func
def splat_reach(splat: Splat):
    """How far the disc reaches from its streak [pixels]."""
    return (splat.radius + 0.5 * splat.edge) / (1.0 - UNEVEN * splat.uneven)


@wp.func
def splat_box(splat: Splat):
    """Corners (left, top, right, bottom) of the pixels around a splat."""
    reach = splat_reach(splat)
    across = reach + wp.abs(splat.along[0])
    down = reach + wp.abs(splat.along[1])
    return wp.vec4i(
        int(wp.floor(splat.x - across - 0.5)),
        int(wp.floor(splat.y - down - 0.5)),
        int(wp.ceil(splat.x + across - 0.5)),
        int(wp.ceil(splat.y + down - 0.5)),
    )


@wp.func
def unevenness(splat: Splat, at: wp.vec2):
    """By what the distance of a place from the middle is multiplied, and how dense the body is there."""
    a = wp.atan2(at[1], at[0]) + splat.turn
    bent = ELONGATED * wp.cos(2.0 * a + splat.phases[0]) + BENT * wp.cos(3.0 * a + splat.phases[1])
    bent += ROUGH * wp.cos(5.0 * a + splat.phases[2])
    # lumps as large as its radius, which turn with it
    away = 3.0 * wp.length(at) / splat.radius
    lumps = wp.sin(away * wp.cos(a) + splat.phases[1]) * wp.sin(away * wp.sin(a) + splat.phases[2])
    return wp.vec2(1.0 + splat.uneven * bent, 1.0 - 0.5 * THIN * splat.uneven * (1.0 - lumps))


@wp.func
def ramps_of(edge: float):
    """Lengths of two boxes whose convolution is the slope of an edge of this width [pixels].

    The longer is a pixel at least: so pixels of a straight edge sum up to its integral, wherever it lies, up to a width
    of two pixels exactly, and beyond nearly.
    """
    longer = wp.max(0.5 * edge, 1.0)
    return wp.vec2(longer, edge - longer)


@wp.func
def inside(splat: Splat, distance: float):
    """Share of a disc at a distance from its middle: 1 inside, falling to 0 over its edge."""
    ramps = ramps_of(splat.edge)
    x = splat.radius - distance
    left = wp.max(0.5 * splat.edge - wp.abs(x), 0.0)
    if left > ramps[1]:
        return 0.5 + x / ramps[0]
    tail = 0.5 * left * left / (ramps[0] * ramps[1])
    return wp.where(x > 0.0, 1.0 - tail, tail)


@wp.func
def profile(splat: Splat, col: int, row: int):
    """What a pixel has of a splat, up to a factor: 1 inside, falling to 0 over its edge."""
    at = wp.vec2(float(col) + 0.5 - splat.x, float(row) + 0.5 - splat.y)
    length = wp.dot(splat.along, splat.along)
    if length > 0.0:
        at -= wp.clamp(wp.dot(at, splat.along) / length, -1.0, 1.0) * splat.along
    distance = wp.length(at)
    dense = float(1.0)
    if splat.uneven > 0.0 and distance > 0.0:
        shape = unevenness(splat, at)
        distance *= shape[0]
        dense = shape[1]
    return dense * inside(splat, distance)


@wp.func
def profile_sum(splat: Splat):
    """Sum of the profile over all pixels, those outside of the image too; of large ones its integral, or of some."""
    box = splat_box(splat)
    step = 1 + wp.max(box[2] - box[0], box[3] - box[1]) / SUMMED_PX
    if step > 1 and splat.uneven == 0.0:
        ramps = ramps_of(splat.edge)
        round_ends = wp.pi * (splat.radius * splat.radius + wp.dot(ramps, ramps) / 12.0)
        return round_ends + 4.0 * wp.length(splat.along) * splat.radius
    total = float(0.0)
    row = box[1]
    while row <= box[3]:
        of_row = float(0.0)
        col = box[0]
        while col <= box[2]:
            of_row += profile(splat, col, row)
            col += step
        total += of_row
        row += step
    return total * float(step * step)


@wp.func
def tiles_of(splat: Splat, width: int, height: int):
    """Tiles (first column, first row, columns, rows) of an image that a splat may show in; none: 0 columns."""
    box = splat_box(splat)
    left = wp.max(box[0], 0) / TILE
    top = wp.max(box[1], 0) / TILE
    right = wp.min(box[2], width - 1)
    bottom = wp.min(box[3], height - 1)
    if right < 0 or bottom < 0 or box[0] >= width or box[1] >= height:
        return wp.vec4i(0, 0, 0, 0)
    return wp.vec4i(left, top, right / TILE - left + 1, bottom / TILE - top + 1)


@wp.func
def list_splat(splat: Splat, box: wp.vec4i, width: int, first: int, listed: SplatList):
    """Write a splat once for each of its tiles (`tiles_of`) from place ``first`` on; returns the place after them."""
    across = (width + TILE - 1) / TILE
    place = first
    for row in range(box[1], box[1] + box[3]):
        for col in range(box[0], box[0] + box[2]):
            listed.tiles[place] = row * across + col
            listed.splats[place] = splat
            place += 1
    return place
