"""Reflectance of a surface point: constant, or procedural sand, rock and rust of any resolution."""

import warp as wp

wp.set_module_options({"enable_backward": False})

DIFFUSE = wp.constant(0)
SLOPE_BLEND = wp.constant(1)
RUST = wp.constant(2)
SAND = wp.constant(0)
ROCK = wp.constant(1)

WALK_ANGLE = wp.constant(0.2)
"""Width of the cone that a ray of a walk stands for [rad]: such rays carry no sharp image."""


@wp.struct
class Material:
    """What ``reflectance`` needs; the host's materials.py fills it."""

    kind: int
    offset: wp.vec3
    """Where the pattern is laid from: added to local world coordinates, so that it moves with its object alone."""
    base: wp.vec3
    """Reflectance of a diffuse surface or of the bare metal."""
    amount: float
    """Share of rust."""
    seed: wp.uint32
    flat: int
    """Texture where the surface looks up."""
    steep: int
    flat_size: float
    """Size of one tile [m]."""
    steep_size: float


@wp.func
def footprint_width(angle: float, t: float, d: wp.vec3, n: wp.vec3):
    """Width on the surface [m] of what a ray along ``d`` stands for: a cone of ``angle`` [rad], ``t`` [m] away.

    The side of the square that has the area of the cone's section with the surface: between its two widths.
    """
    return angle * t / wp.sqrt(wp.max(wp.abs(wp.dot(d, n)), 0.02))


@wp.func
def fbm(seed: wp.uint32, p: wp.vec3, octaves: int):
    """Fractal sum of gradient noise, about in [-1, 1]."""
    total = float(0.0)
    weight = float(0.5)
    q = p
    for octave in range(octaves):
        total += weight * wp.noise(seed + wp.uint32(octave), q)
        # turn between octaves, so that their lattices do not line up
        q = 2.03 * wp.vec3(0.8 * q[0] - 0.6 * q[1], 0.6 * q[0] + 0.8 * q[1], q[2]) + wp.vec3(17.1, 9.2, 5.3)
        weight *= 0.5
    return 2.0 * total


@wp.func
def sand(seed: wp.uint32, p: wp.vec3):
    """Pale grains in ripples; ``p`` in tiles."""
    ripple = wp.sin(38.0 * (p[0] + 0.35 * fbm(seed, 3.0 * p, 2)) + 9.0 * p[1])
    shade = 1.0 + 0.07 * ripple + 0.22 * fbm(seed + wp.uint32(11), 5.0 * p, 4) + 0.25 * wp.noise(seed, 190.0 * p)
    return wp.max(shade, 0.2) * wp.vec3(0.46, 0.40, 0.30)


@wp.func
def rock(seed: wp.uint32, p: wp.vec3):
    """Grey-brown stone with veins and dark cracks; ``p`` in tiles."""
    body = fbm(seed, 4.0 * p, 6)
    crack = 1.0 - wp.exp(-14.0 * wp.abs(fbm(seed + wp.uint32(7), 3.0 * p, 5)))
    tint = 0.5 + 0.5 * wp.clamp(1.8 * fbm(seed + wp.uint32(5), 1.3 * p, 3), -1.0, 1.0)
    colour = wp.lerp(wp.vec3(0.27, 0.25, 0.22), wp.vec3(0.33, 0.26, 0.19), tint)
    return wp.max((0.35 + 0.65 * crack) * (1.0 + 0.9 * body), 0.08) * colour


@wp.func
def ground(kind: int, seed: wp.uint32, p: wp.vec3):
    """One of the two ground textures."""
    if kind == SAND:
        return sand(seed, p)
    return rock(seed, p)


@wp.func
def slope_blend(m: Material, p: wp.vec3, n: wp.vec3):
    """Sand where the surface faces up, rock elsewhere, with a ragged edge (paper 3.1.1)."""
    edge = wp.abs(n[2]) + 0.12 * fbm(m.seed + wp.uint32(3), 3.0 * p, 4)
    s = wp.smoothstep(0.78, 0.88, edge)
    if s <= 0.0:
        return ground(m.steep, m.seed, p / m.steep_size)
    if s >= 1.0:
        return ground(m.flat, m.seed, p / m.flat_size)
    return wp.lerp(ground(m.steep, m.seed, p / m.steep_size), ground(m.flat, m.seed, p / m.flat_size), s)


@wp.func
def rust(m: Material, p: wp.vec3):
    """Bare metal with patches of rust that ``amount`` controls; the seed is the object's position."""
    patch = 0.5 + 0.75 * fbm(m.seed, 6.0 * p, 5)
    s = wp.smoothstep(0.0, 0.15, patch - (1.0 - m.amount))
    grain = 1.0 + 0.5 * fbm(m.seed + wp.uint32(9), 60.0 * p, 3)
    rusty = grain * wp.lerp(wp.vec3(0.20, 0.075, 0.03), wp.vec3(0.33, 0.15, 0.06), wp.clamp(patch, 0.0, 1.0))
    return wp.lerp((0.9 + 0.1 * grain) * m.base, rusty, s)


@wp.func
def reflectance(m: Material, p: wp.vec3, n: wp.vec3, footprint: float):
    """Reflectance per channel at ``p`` (local world) with normal ``n``, averaged over ``footprint`` [m]; at most 1."""
    if m.kind == SLOPE_BLEND:
        c = slope_blend(m, p + m.offset, n)
    elif m.kind == RUST:
        c = rust(m, p + m.offset)
    else:
        return m.base
    return wp.vec3(wp.clamp(c[0], 0.0, 1.0), wp.clamp(c[1], 0.0, 1.0), wp.clamp(c[2], 0.0, 1.0))
