"""Moments: what differs from sample to sample of one image, tabulated before it is rendered.

While a shutter is open, the camera and the lights move with the vehicle, objects move, and strobes flash; and every
point of a disk shines as a point light there would. A sample sees the camera, the lights and the objects of one instant
and one place on the disks, so the image is the mean over all of them. Kernels are compiled for moments only where an
image has them.
"""

import warp as wp

from varos_warp.kernels.sampler import Sampler
from varos_warp.kernels.sampling import half_key
from varos_warp.kernels.sobol import sobol2
from varos_warp.kernels.world.camera import Camera
from varos_warp.kernels.world.intersect import Instance
from varos_warp.kernels.world.lights.record import Light

wp.set_module_options({"enable_backward": False})

TIME = wp.constant(wp.uint32(0x85EBCA6B))
"""Difference between the key of a sample's other random numbers and that of its moment."""


@wp.struct
class Moments:
    """Camera, objects and lights by instant, and of each instant lights by place on the disks."""

    cameras: wp.array(dtype=Camera)
    moving: wp.array2d(dtype=Instance)
    """[instant, object that moves]"""
    lights: wp.array2d(dtype=Light)
    """[instant * places + place, light]"""
    places: int
    per_row: float
    """Instants from the beginning of one row's exposure to that of the next: whole if over 1; 0: a global shutter."""
    open: float
    """Length of a row's exposure, in instants; 0: it is one instant."""
    lit_begin: int
    lit_end: int
    """The first instant with some light on and the one after the last, where rows leave out what is dark; else 0."""


@wp.struct
class Moment:
    """Where in the tables a sample looks."""

    instant: int
    lights: int


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
def moment_of(moments: Moments, row: int, sampler: Sampler):
    """The moment of a sample in a row of the image; even and odd samples have sequences of their own."""
    u = sobol2(half_key(sampler.key + TIME, sampler.sample & 1), sampler.pixel, sampler.sample >> 1, 0)
    moment = Moment()
    moment.instant = instant_of_row(moments, row, u[0])
    moment.lights = moment.instant * moments.places + int(u[1] * float(moments.places))
    return moment
