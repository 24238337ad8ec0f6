"""What a surface reflects at a point: constants, tiled sand and rock, texture maps, rust, dirt, metal.

Everything is averaged over a ``footprint``: the width [m] on the surface of what a ray stands for. That is what keeps
distant textures from aliasing, and what makes them cheap: patterns finer than it are not computed.
"""

import warp as wp

from varos_warp.kernels.noise import band, fbm
from varos_warp.kernels.tiling import Image, level_of, sample, tiled

wp.set_module_options({"enable_backward": False})

DIFFUSE = wp.constant(0)
SLOPE_BLEND = wp.constant(1)
TILED = wp.constant(2)
MAPPED = wp.constant(3)
COLOURED = wp.constant(4)
RUST = wp.constant(5)
DIRT = wp.constant(6)
METAL = wp.constant(7)

NOISE_DEVIATION = wp.constant(0.215)
"""Standard deviation of the noise that rust and dirt are cut from: fbm of four octaves."""

WALK_ANGLE = wp.constant(0.2)
"""Width of the cone that a ray of a walk stands for [rad]: such rays carry no sharp image."""


@wp.struct
class Material:
    """What ``surface_at`` needs; the host's materials.py fills it."""

    kind: int
    offset: wp.vec3
    """Where noise is laid from: added to local world coordinates, so that patterns move with their object alone."""
    seed: wp.uint32
    base: wp.vec3
    """Reflectance of a diffuse surface, of what is under rust or dirt, or F0 of a metal."""
    metallic: int
    """Whether what is under rust is bare metal with a lobe."""
    roughness: float
    """Of the metal's lobe."""
    silt: wp.vec3
    """Reflectance of dirt."""
    threshold: float
    """Noise above it is rust or dirt."""
    cycles: float
    """Patches of rust or dirt per metre."""
    flat: Image
    """Tile where the surface looks up, tile of everything, or texture map."""
    flat_offset: wp.vec3
    """As ``offset``, less whole multiples of ``tiling.PERIOD`` tiles."""
    flat_size: float
    """Size of a tile [m]."""
    ripple: float
    """Length of ripples on what looks up [m]; 0 is none."""
    steep: Image
    steep_offset: wp.vec3
    steep_size: float


@wp.struct
class Surface:
    """What a point of a surface does with light: a Lambertian part and a metal's lobe."""

    reflectance: wp.vec3
    """Of the diffuse part."""
    specular: wp.vec3
    """F0 of the lobe, times ``metal``."""
    metal: float
    """Share of bare metal; 0: no lobe."""
    roughness: float


@wp.func
def footprint_width(angle: float, t: float, d: wp.vec3, n: wp.vec3):
    """Width on the surface [m] of what a ray along ``d`` stands for: a cone of ``angle`` [rad], ``t`` [m] away.

    The side of the square that has the area of the cone's section with the surface: between its two widths.
    """
    return angle * t / wp.sqrt(wp.max(wp.abs(wp.dot(d, n)), 0.02))


# -------------------------------------------------------------------------------------------------------------- ground


@wp.func
def broad_shade(m: Material, q: wp.vec3, footprint: float):
    """Slow changes over metres, around 0, within about 1: no two places of a sea floor have quite the same shade."""
    return 1.5 * fbm(m.seed + wp.uint32(101), 0.35 * q, 2, 0.35 * footprint)


@wp.func
def ripples(m: Material, q: wp.vec3, broad: float, footprint: float):
    """Shade of ripples around 1: pale crests and dark troughs that bend, fork and die out."""
    share = band(footprint / m.ripple)
    if share == 0.0:
        return 1.0
    x = q / m.ripple
    bend = 2.6 * wp.noise(m.seed + wp.uint32(103), 0.11 * x) + 0.5 * wp.noise(m.seed + wp.uint32(104), 0.43 * x)
    phase = 2.0 * wp.pi * (0.92 * x[0] + 0.39 * x[1] + bend)
    # sharper crests than troughs, as waves leave them
    profile = wp.sin(phase) + 0.22 * wp.cos(2.0 * phase)
    return 1.0 + share * wp.clamp(0.09 + 0.12 * broad, 0.0, 0.16) * profile


@wp.func
def flat_colour(m: Material, p: wp.vec3, n: wp.vec3, footprint: float):
    """The tile of what looks up, with its ripples."""
    c = tiled(m.flat, m.seed, (p + m.flat_offset) / m.flat_size, n, footprint / m.flat_size)
    q = p + m.offset
    broad = broad_shade(m, q, footprint)
    shade = 1.0 + 0.13 * broad
    if m.ripple > 0.0:
        shade *= ripples(m, q, broad, footprint)
    return shade * c


@wp.func
def steep_colour(m: Material, p: wp.vec3, n: wp.vec3, footprint: float):
    """The tile of what is steep."""
    c = tiled(m.steep, m.seed + wp.uint32(7), (p + m.steep_offset) / m.steep_size, n, footprint / m.steep_size)
    return (1.0 + 0.13 * broad_shade(m, p + m.offset, footprint)) * c


@wp.func
def slope_mask(m: Material, q: wp.vec3, n: wp.vec3, footprint: float):
    """1 where the surface looks up, 0 where it is steep, with a ragged edge (paper 3.1.1)."""
    up = wp.abs(n[2])
    if up > 0.55 and up < 0.99:
        up += 0.18 * fbm(m.seed + wp.uint32(3), 2.5 * q, 5, 2.5 * footprint)
    return wp.smoothstep(0.79, 0.85, up)


@wp.func
def slope_blend(m: Material, p: wp.vec3, n: wp.vec3, footprint: float):
    """Sand where the surface faces up, rock elsewhere."""
    s = slope_mask(m, p + m.offset, n, footprint)
    if s <= 0.0:
        return steep_colour(m, p, n, footprint)
    if s >= 1.0:
        return flat_colour(m, p, n, footprint)
    return wp.lerp(steep_colour(m, p, n, footprint), flat_colour(m, p, n, footprint), s)


# ------------------------------------------------------------------------------------------------------------- objects


@wp.func
def covered(m: Material, noise: float, bias: float, footprint: float):
    """Share of a layer: all where ``noise + bias`` is above the threshold; its mean far away."""
    share = band(0.5 * m.cycles * footprint)
    # the noise is about normal; 1.702 makes a logistic function one
    mean = 1.0 / (1.0 + wp.exp(-1.702 * (bias - m.threshold) / NOISE_DEVIATION))
    return wp.lerp(mean, wp.smoothstep(-0.06, 0.06, noise + bias - m.threshold), share)


@wp.func
def grain(m: Material, q: wp.vec3, footprint: float):
    """Fine noise around 1."""
    return 1.0 + 0.6 * fbm(m.seed + wp.uint32(9), 12.0 * m.cycles * q, 2, 12.0 * m.cycles * footprint)


@wp.func
def rust(m: Material, q: wp.vec3, footprint: float):
    """Bare metal or paint with patches of rust."""
    noise = fbm(m.seed, m.cycles * q, 4, m.cycles * footprint)
    s = covered(m, noise, 0.0, footprint)
    surface = Surface()
    surface.roughness = m.roughness
    if m.metallic == 1:
        surface.metal = 1.0 - s
        surface.specular = surface.metal * m.base
    else:
        surface.reflectance = (1.0 - s) * m.base
    if s > 0.0:
        shade = wp.clamp(0.5 + 0.8 * noise, 0.0, 1.0)
        surface.reflectance += (
            s * grain(m, q, footprint) * wp.lerp(wp.vec3(0.20, 0.075, 0.03), wp.vec3(0.33, 0.15, 0.06), shade)
        )
    return surface


@wp.func
def dirt(m: Material, q: wp.vec3, n: wp.vec3, footprint: float):
    """A surface with patches of silt, most of it where it looks up."""
    noise = fbm(m.seed, m.cycles * q, 4, m.cycles * footprint)
    s = covered(m, noise, 0.5 * n[2], footprint)
    c = (1.0 - s) * m.base
    if s > 0.0:
        c += s * grain(m, q, footprint) * m.silt
    return c


@wp.func
def mapped(image: Image, at: wp.vec3, footprint: float):
    """Texture map at coordinates u, v (v up), with at[2] of their units per metre; repeats outside of 0..1."""
    x = at[0] * float(image.width)
    y = (1.0 - at[1]) * float(image.height)
    texels = footprint * at[2] * wp.sqrt(float(image.width) * float(image.height))
    return sample(image, x, y, level_of(image, texels))


# ---------------------------------------------------------------------------------------------------------------- all


@wp.func
def unit_clamp(c: wp.vec3):
    """Each channel within 0..1."""
    return wp.vec3(wp.clamp(c[0], 0.0, 1.0), wp.clamp(c[1], 0.0, 1.0), wp.clamp(c[2], 0.0, 1.0))


@wp.func
def surface_at(m: Material, p: wp.vec3, n: wp.vec3, at: wp.vec3, footprint: float):
    """Surface at ``p`` (local world) with normal ``n``, averaged over ``footprint`` [m].

    ``at`` is what the file of a mesh gives for the point: for texture maps u, v and their units per metre, else its
    vertices' colour; unused by other kinds.
    """
    surface = Surface()
    if m.kind == DIFFUSE:
        surface.reflectance = m.base
    elif m.kind == SLOPE_BLEND:
        surface.reflectance = unit_clamp(slope_blend(m, p, n, footprint))
    elif m.kind == TILED:
        surface.reflectance = unit_clamp(flat_colour(m, p, n, footprint))
    elif m.kind == MAPPED:
        surface.reflectance = mapped(m.flat, at, footprint)
    elif m.kind == COLOURED:
        surface.reflectance = at
    elif m.kind == METAL:
        surface.metal = 1.0
        surface.specular = m.base
        surface.roughness = m.roughness
    elif m.kind == RUST:
        surface = rust(m, p + m.offset, footprint)
        surface.reflectance = unit_clamp(surface.reflectance)
    else:
        surface.reflectance = unit_clamp(dirt(m, p + m.offset, n, footprint))
    return surface
