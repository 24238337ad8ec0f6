"""Moments: what differs from sample to sample of one image.

While a shutter is open, the camera and the lights move with the vehicle, objects move, and strobes flash: that is
tabulated before an image is rendered. And every point of a disk shines as a point light there would. A sample sees the
camera, the lights and the objects of one instant and one point of each disk, all along its path, so the image is the
mean over all of them, and light from disks is found as well as that from points. Kernels are compiled for instants and
for disks only where an image has them.
"""

import warp as wp

from varos_warp.kernels.sampler import Sampler
from varos_warp.kernels.sampling import half_key
from varos_warp.kernels.sobol import sobol2
from varos_warp.kernels.world.camera import Camera
from varos_warp.kernels.world.intersect import Instance, SceneData
from varos_warp.kernels.world.lights.disk import sample_point
from varos_warp.kernels.world.lights.light import get_light, light_count
from varos_warp.kernels.world.lights.record import Light

wp.set_module_options({"enable_backward": False})

TIME = wp.constant(wp.uint32(0x85EBCA6B))
"""Difference between the key of a sample's other random numbers and that of its moment."""
INSTANT, PLACE = wp.constant(0), wp.constant(1)
"""What pairs of those numbers are for."""


@wp.struct
class Moments:
    """Camera, objects and lights by instant."""

    cameras: wp.array(dtype=Camera)
    moving: wp.array2d(dtype=Instance)
    """[instant, object that moves]"""
    lights: wp.array2d(dtype=Light)
    """[instant, light]"""
    per_row: float
    """Instants from the beginning of one row's exposure to that of the next: whole if over 1; 0: a global shutter."""
    open: float
    """Length of a row's exposure, in instants; 0: it is one instant."""
    lit_begin: int
    lit_end: int
    """The first instant with some light on and the one after the last, where rows leave out what is dark; else 0."""


@wp.func
def instant_of_row(moments: Moments, row: int, u: float):
    """Number of the instant at a share ``u`` of a row's exposure, or of what is lit of it; if nothing is, any."""
    begin = float(row) * moments.per_row
    if moments.lit_end > 0:
        end = wp.min(begin + moments.open, float(moments.lit_end))
        begin = wp.max(begin, float(moments.lit_begin))
        return wp.clamp(int(begin + u * (end - begin)), moments.lit_begin, moments.lit_end - 1)
    return wp.min(int(begin + u * moments.open), moments.cameras.shape[0] - 1)


@wp.func
def first_instant(moments: Moments):
    """The first instant that samples are of."""
    return wp.where(moments.lit_end > 0, moments.lit_begin, 0)


@wp.func
def instants_taken(moments: Moments):
    """Number of the instants that samples are of."""
    return wp.where(moments.lit_end > 0, moments.lit_end, moments.cameras.shape[0]) - first_instant(moments)


@wp.func
def draw_moment(sampler: Sampler, pair: int):
    """Two numbers in [0, 1) for the moment of a sample; even and odd samples have sequences of their own."""
    return sobol2(half_key(sampler.key + TIME, sampler.sample & 1), sampler.pixel, sampler.sample >> 1, pair)


@wp.func
def instant_of(moments: Moments, row: int, sampler: Sampler):
    """The instant of a sample in a row of the image."""
    return instant_of_row(moments, row, draw_moment(sampler, INSTANT)[0])


@wp.func
def place_of(sampler: Sampler):
    """Point of the unit square that selects the point of every disk light that a sample sees."""
    return draw_moment(sampler, PLACE)


@wp.func
def with_points(scene: SceneData, lights: wp.array(dtype=Light), u: wp.vec2, drawn: wp.array(dtype=Light)):
    """The scene with a point for each disk of ``lights``, all at the same place ``u`` of theirs, put in ``drawn``."""
    for i in range(light_count(lights)):
        drawn[i] = sample_point(get_light(lights, i), u)
    after = scene
    after.lights = drawn
    return after
