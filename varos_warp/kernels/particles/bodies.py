"""Places of the drawn bodies: a hash fills each cell of the water with the same bodies whoever asks.

A body scatters as a sphere of its radius whose surface reflects and transmits after Lambert's law; its cross section
is its projected area. The water is cut into cubes that move with it. Hashing a cell's number gives how many bodies it
holds (Poisson), where they are and how large (a power law): there is no list, so every frame, camera and process sees
the same.
"""

import warp as wp

from varos_warp.kernels.numerics import linear
from varos_warp.kernels.sampling import pcg4d, to_unit
from varos_warp.kernels.world.phase import Phase

wp.set_module_options({"enable_backward": False})

MOST_IN_CELL = wp.constant(64)
"""Bodies of a cell at most: with a mean of 8 there are never as many in float32."""
NEAREST, FADE = wp.constant(0.05), wp.constant(0.05)
"""Bodies nearer than this to the camera's port or to a lamp [m] stay in the water, as there are housings; over the
next stretch they fade in. So the variance of the image is finite."""
FARTHEST_GRAIN = wp.constant(5.2)
"""How far a body reaches at most, over the radius of its cross section."""
FAR_FADE = wp.constant(0.5)
"""Bodies as large in the image as the least that is drawn fade in until they are larger by this share."""
NUMBERS = wp.constant(2)
"""Hashes of a body, of four words each."""


@wp.struct
class Grain:
    """A part of a floc whose cross section is that of a sphere of radius 1."""

    at: wp.vec3
    """Place of the grain, from the floc's middle."""
    radius: float
    share: float
    """Share of the floc's cross section."""


@wp.struct
class Particles:
    """One kind of particles; the host's render/particles makes it."""

    phase: Phase
    """Phase function of a body."""
    sigma_s: wp.vec3
    """Scattering coefficient of all of them, that much of the water's [1/m]."""
    grains: wp.array2d(dtype=Grain)
    """Grains of flocs, [shape, grain]."""
    albedo: wp.vec3
    """Share of the light that falls on a body and is scattered, 1 in the brightest channel."""
    opacity: float
    """Share of the light that a body reflects, not transmits."""
    drawn: wp.array(dtype=float)
    """Share of ``sigma_s`` that is drawn, at even steps of the distance along a camera's ray in the water; without
    what fades close to the camera."""
    covered: wp.array(dtype=float)
    """Its optical depth from the camera on, at the same distances."""
    step: float
    """[m]"""
    least_angle: float
    """Radius over distance of the smallest body that is drawn [rad]."""
    reach: float
    """Distance from the camera beyond which none is drawn [m]."""
    drift: wp.vec3
    """Velocity of the bodies in the water [m/s]."""
    wander: float
    """Amplitude [m] of a body's own motion."""
    wander_rate: float
    """Frequency of this motion [rad/s]."""
    wander_phase: float
    """Phase of this motion at the frame's time [rad]."""
    turn: float
    """Angle by which bodies have turned at the frame's time [rad]."""


@wp.struct
class Cells:
    """The cells of one class of sizes that a frame may show."""

    base: wp.vec3ui
    """Number of the first cell in the water, modulo 2^32."""
    size: wp.vec3i
    """Number of cells along each axis."""
    corner: wp.vec3
    """Lower corner of the first cell in the local world at the frame's time [m]."""
    side: float
    """[m]"""
    mean: float
    """Bodies in a cell."""
    r_low: float
    r_high: float
    """Radii of the class [m]."""
    slope: float
    """Exponent of the number of bodies by radius."""
    key: wp.uint32
    ends: wp.array(dtype=int)
    """End of each cell's bodies among those of all cells that may be seen (`count_bodies`); empty: not yet counted."""


@wp.struct
class Body:
    """A body; ``p`` is where it is at the frame's time, without its own motion."""

    p: wp.vec3
    r: float
    u: wp.vec4
    """Numbers in [0, 1) of its own: phases of its motion and of its shape."""


@wp.func
def cell_of(cells: Cells, i: int):
    """Place among the cells of the i-th."""
    x = i % cells.size[0]
    y = (i / cells.size[0]) % cells.size[1]
    return wp.vec3i(x, y, i / (cells.size[0] * cells.size[1]))


@wp.func
def hashed(cells: Cells, at: wp.vec3i, number: int):
    """Four numbers in [0, 1) of a cell."""
    x, y, z, w = pcg4d(
        cells.base[0] + wp.uint32(at[0]),
        cells.base[1] + wp.uint32(at[1]),
        cells.base[2] + wp.uint32(at[2]),
        cells.key + wp.uint32(number),
    )
    return wp.vec4(to_unit(x), to_unit(y), to_unit(z), to_unit(w))


@wp.func
def bodies_in_cell(cells: Cells, at: wp.vec3i):
    """How many bodies a cell holds: Poisson's distribution, inverted."""
    u = hashed(cells, at, 0)[0]
    p = wp.exp(-cells.mean)
    total = p
    n = int(0)
    while u >= total and n < MOST_IN_CELL:
        n += 1
        p *= cells.mean / float(n)
        total += p
    return n


@wp.func
def radius_at(cells: Cells, u: float):
    """Radius that a share ``u`` of the bodies of a class stays below: the power law, inverted."""
    k = 1.0 - cells.slope
    low = wp.pow(cells.r_low, k)
    return wp.clamp(wp.pow(low + u * (wp.pow(cells.r_high, k) - low), 1.0 / k), cells.r_low, cells.r_high)


@wp.func
def body_of(cells: Cells, at: wp.vec3i, n: int):
    """The n-th body of a cell."""
    u = hashed(cells, at, 1 + NUMBERS * n)
    body = Body()
    body.u = hashed(cells, at, 2 + NUMBERS * n)
    place = wp.vec3(float(at[0]) + u[0], float(at[1]) + u[1], float(at[2]) + u[2])
    body.p = cells.corner + cells.side * place
    body.r = radius_at(cells, u[3])
    return body


@wp.func
def body_at(particles: Particles, body: Body, time: float, way: wp.vec3):
    """Place of a body, which wanders, at a time [s] from the frame's; the water has gone a way [m] since then."""
    angle = particles.wander_phase + particles.wander_rate * time
    own = wp.vec3(
        wp.sin(angle + wp.tau * body.u[0]), wp.sin(angle + wp.tau * body.u[1]), wp.sin(angle + wp.tau * body.u[2])
    )
    return body.p + way + time * particles.drift + particles.wander * own


@wp.func
def ramp(distance: float):
    """Share of a body that is drawn at a distance from what stays clear of bodies."""
    return wp.clamp((distance - NEAREST) / FADE, 0.0, 1.0)


@wp.func
def drawn_of_body(particles: Particles, r: float, t: float):
    """Share of a body that is drawn at a distance ``t`` along a camera's ray; `Particles.drawn` is its mean."""
    small = wp.clamp((r / (particles.least_angle * t) - 1.0) / FAR_FADE, 0.0, 1.0)
    far = wp.clamp((1.0 - t / particles.reach) / 0.25, 0.0, 1.0)
    return ramp(t) * small * far


@wp.func
def drawn_at(particles: Particles, t: float):
    """Share of the scattering by bodies that is drawn at a distance along a camera's ray."""
    at = t / particles.step
    if at >= float(particles.drawn.shape[0] - 1):
        return 0.0
    return ramp(t) * linear(particles.drawn, at)


@wp.func
def covered_before(particles: Particles, t: float):
    """Optical depth of the drawn bodies up to a distance along a camera's ray."""
    return linear(particles.covered, wp.min(t / particles.step, float(particles.covered.shape[0] - 1)))
