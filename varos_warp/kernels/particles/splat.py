"""The image of a body: a disc with a soft edge or a floc, drawn out by motion, whose pixels share its light.

Values of a disc at the pixels' centres are scaled so that they sum to the body's light, whatever its size and place. Of
a floc they sum to it in the mean over its places, and nearly at each.
"""

import warp as wp

from varos_warp.kernels.particles.bodies import Grain
from varos_warp.kernels.particles.disc import disc_area, inside, off_streak
from varos_warp.kernels.particles.floc import Floc, share_of_floc

wp.set_module_options({"enable_backward": False})

LARGEST_PX = wp.constant(4000.0)
"""Largest radius of a disc; blurred more, it would not be seen."""
SUMMED_PX = wp.constant(128)
"""Side of the box whose pixels are all summed up; larger discs are integrated."""
TILE = wp.constant(8)
"""Side of the squares of pixels, each of which has a list of the splats that it shows."""


@wp.struct
class Splat:
    """The image of a body."""

    x: float
    y: float
    """Place of the image's middle [pixels]."""
    along: wp.vec2
    """Way from the middle to the end of its streak [pixels]."""
    radius: float
    """Radius of the disc, at which it has half its height [pixels]."""
    edge: float
    """Width over which it falls from 1 to 0, twice the radius at most [pixels]."""
    reach: wp.vec2
    """Distance to which the image reaches from its streak, right or left and up or down [pixels]."""
    floc: Floc
    """Shape of the body, where it is seen."""
    scale: float
    """One over the sum of the profile over all pixels, of a body that is seen round."""
    flux: wp.vec3
    """Sum of its radiance over all pixels."""
    cover: float
    """Area that it hides [pixels]."""
    t: float
    """Distance of the body along its ray in the water [m]."""
    flow: wp.vec2
    """Flow to its image in the next frame [pixels]."""


@wp.struct
class SplatList:
    """The splats of the bodies of one class of sizes, one for each tile that they show in, body after body."""

    counts: wp.array(dtype=int)
    """Number of splats of each body."""
    ends: wp.array(dtype=int)
    """Ends of those of each body; empty: they are to be counted."""
    tiles: wp.array(dtype=int)
    splats: wp.array(dtype=Splat)


@wp.func
def splat_box(splat: Splat):
    """Corners (left, top, right, bottom) of the pixels around a splat."""
    across = splat.reach[0] + wp.abs(splat.along[0])
    down = splat.reach[1] + wp.abs(splat.along[1])
    return wp.vec4i(
        int(wp.floor(splat.x - across - 0.5)),
        int(wp.floor(splat.y - down - 0.5)),
        int(wp.ceil(splat.x + across - 0.5)),
        int(wp.ceil(splat.y + down - 0.5)),
    )


@wp.func
def from_middle(splat: Splat, col: int, row: int):
    """A pixel's centre as seen from a splat's middle [pixels]."""
    return wp.vec2(float(col) + 0.5 - splat.x, float(row) + 0.5 - splat.y)


@wp.func
def profile(splat: Splat, at: wp.vec2):
    """What a place has of a splat that is seen round, up to a factor: 1 inside, falling to 0 over its edge."""
    return inside(splat.radius, splat.edge, wp.length(off_streak(at, splat.along)))


@wp.func
def profile_sum(splat: Splat):
    """Sum of the profile over all pixels, those outside of the image too; of large ones its integral."""
    box = splat_box(splat)
    if wp.max(box[2] - box[0], box[3] - box[1]) >= SUMMED_PX:
        return disc_area(splat.radius, splat.edge, wp.length(splat.along))
    total = float(0.0)
    for row in range(box[1], box[3] + 1):
        of_row = float(0.0)
        for col in range(box[0], box[2] + 1):
            of_row += profile(splat, from_middle(splat, col, row))
        total += of_row
    return total


@wp.func
def share_of(splat: Splat, grains: wp.array2d(dtype=Grain), col: int, row: int):
    """Share of a splat's light that a pixel has."""
    at = from_middle(splat, col, row)
    beside = wp.abs(at[0]) - wp.abs(splat.along[0]) > splat.reach[0]
    if beside or wp.abs(at[1]) - wp.abs(splat.along[1]) > splat.reach[1]:
        return 0.0
    if splat.floc.loose > 0.0:
        return share_of_floc(splat.floc, grains, splat.along, at)
    return splat.scale * profile(splat, at)


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
