"""The random numbers of one sample of a pixel, vertex by vertex of its path.

Each vertex has groups of four numbers of its own, by what they are for: an integrator names what it draws for, and
steps on when its path does.
"""

import warp as wp

from varos_warp.kernels.sampling import half_key, uniforms
from varos_warp.kernels.sobol import sobol4

wp.set_module_options({"enable_backward": False})

LOW_DIMENSIONS = wp.constant(14)
"""Number of groups of four numbers that are low-discrepancy points; later vertices hardly benefit."""


@wp.struct
class Sampler:
    """Which sample of which pixel, and where on its path it is."""

    key: wp.uint32
    """Key of the image: combines seed, frame and camera."""
    pixel: int
    sample: int
    group: int
    """First group of the vertex that the path is at."""


@wp.func
def make_sampler(key: wp.uint32, pixel: int, sample: int):
    """The numbers of a sample, at the camera."""
    sampler = Sampler()
    sampler.key = key
    sampler.pixel = pixel
    sampler.sample = sample
    return sampler


@wp.func
def next_vertex(sampler: Sampler, groups: int):
    """The sampler at the next vertex, of which the one left behind had so many groups."""
    after = sampler
    after.group += groups
    return after


@wp.func(inline=False)
def draw_group(key: wp.uint32, pixel: int, sample: int, group: int):
    """Four numbers in [0, 1): two pairs of a Sobol sequence, or independent numbers far down a path.

    Even and odd samples have sequences of their own.
    """
    half = half_key(key, sample & 1)
    if group < LOW_DIMENSIONS:
        return sobol4(half, pixel, sample >> 1, 2 * group)
    return uniforms(half, pixel, sample >> 1, group)


@wp.func
def draw(sampler: Sampler, purpose: int):
    """Four numbers in [0, 1) for one purpose, a group of the sampler's vertex."""
    return draw_group(sampler.key, sampler.pixel, sampler.sample, sampler.group + purpose)


@wp.func
def draw_independent(sampler: Sampler, purpose: int):
    """`draw`, of numbers that know nothing of other samples."""
    return uniforms(sampler.key, sampler.pixel, sampler.sample, sampler.group + purpose)
