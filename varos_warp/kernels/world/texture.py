"""Reflectance of a surface at a point: constants, tiled sand and rock, texture maps, rust, dirt, metal.

Everything is averaged over a ``footprint``, the width [m] of a ray's cone on the surface. This keeps distant textures
from aliasing and makes them cheap, as patterns finer than the footprint are not computed.
"""

import warp as wp

from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.world.pattern_noise import band, fbm
from varos_warp.kernels.world.tiling import Image, level_of, repeated, sample, tiled, unit_clamp

wp.set_module_options({"enable_backward": False})

DIFFUSE = wp.constant(0)
GROUND = wp.constant(1)
MAPPED = wp.constant(2)
COLOURED = wp.constant(3)
METAL = wp.constant(4)
RUST = wp.constant(5)
DIRT = wp.constant(6)

GRAIN_CYCLES, GRAIN_OCTAVES = wp.constant(150.0), wp.constant(3)
"""Patches of the coarsest octave of grain per metre, and octaves: 7 to 1.6 mm; coarser ones look like a mottle."""
GRAIN_CONTRAST, MOST_GRAIN = wp.constant(2.5), wp.constant(0.8)
"""Tone over noise of the most grain, and how far from 1 a tone may be."""

NOISE_DEVIATION = wp.constant(0.215)
"""Standard deviation of the noise that is thresholded for rust and dirt: fbm of four octaves."""

SUBPATH_ANGLE = wp.constant(0.2)
"""Angle of the cone that a segment of a subpath stands for [rad]; such rays carry no sharp image."""


REPEAT = wp.constant(0)
CLAMP = wp.constant(1)
MIRROR = wp.constant(2)


@wp.struct
class Layer:
    """A tile on a surface, or a page of a mesh file's textures."""

    image: Image
    offset: wp.vec3
    """The material's offset, minus whole multiples of ``tiling.PERIOD`` tiles."""
    size: float
    """Width of the tile [m]."""
    ripple: float
    """Wavelength of ripples [m]; 0: none."""
    factor: wp.vec3
    """Reflectance that multiplies the image of a page."""
    wrap_u: int
    """Wrapping of a page outside of 0..1: REPEAT, CLAMP or MIRROR."""
    wrap_v: int
    alpha: wp.array2d(dtype=wp.uint8)
    """Alpha of a page that masks, rows from the top; else empty."""
    cutoff: float
    """Cutoff of a page that masks: there are holes where the alpha, 0..1, is below."""


@wp.struct
class Material:
    """Input of `make_material_at`; scene/materials/records.py makes it."""

    kind: int
    offset: wp.vec3
    """Origin of the noise: added to local world coordinates, so that patterns move only with their object."""
    seed: wp.uint32
    base: wp.vec3
    """Reflectance of a diffuse surface or of what is under rust or dirt, or F0 of a metal."""
    metallic: int
    """True if what is under rust is bare metal with a lobe."""
    roughness: float
    """Roughness of the metal's lobe."""
    diffuse_roughness: float
    """Roughness of the diffuse part, 0 to 1; 0: Lambertian."""
    layer_dark: wp.vec3
    """Reflectance of rust or dirt at the edges, and where it is thick."""
    layer_pale: wp.vec3
    threshold: float
    """Noise above this is rust or dirt."""
    cycles: float
    """Patches of rust or dirt per metre."""
    grain: float
    """How much the tone varies from grain to grain, 0 to 1; 0: it does not."""
    layers: wp.array(dtype=Layer)
    """The layer of flat parts, then that of steep ones; or one layer for all, or the pages of a mesh file."""
    has_holes: int
    """True if some of the pages mask."""


@wp.struct
class Bsdf:
    """Scattering function of a point on a surface: a diffuse part and a metal's lobe."""

    reflectance: wp.vec3
    """Reflectance of the diffuse part."""
    specular: wp.vec3
    """F0 of the lobe, times ``metal``."""
    metal: float
    """Fraction of bare metal; 0: no lobe."""
    roughness: float
    diffuse_roughness: float
    """Roughness of the diffuse part, 0 to 1; 0: Lambertian."""


@wp.func
def footprint_width(angle: float, t: float, d: wp.vec3, n: wp.vec3):
    """Width [m] on the surface of a cone of ``angle`` [rad] around a ray along ``d``, at distance ``t`` [m].

    The side of the square with the area of the cone's intersection with the surface.
    """
    return angle * t / wp.sqrt(wp.max(wp.abs(wp.dot(d, n)), 0.02))


# -------------------------------------------------------------------------------------------------------------- ground


@wp.func
def ripples(seed: wp.uint32, x: wp.vec3, broad: float, footprint: float):
    """Shade of ripples around 1: pale crests and dark troughs that bend, fork and fade; lengths in wavelengths."""
    share = band(footprint)
    if share == 0.0:
        return 1.0
    bend = 2.6 * fbm(seed, 0.11 * x, 3, 0.0)
    phase = 2.0 * wp.pi * (0.92 * x[0] + 0.39 * x[1] + bend)
    # sharper crests than troughs, as waves leave them
    profile = wp.sin(phase) + 0.22 * wp.cos(2.0 * phase)
    return 1.0 + share * wp.clamp(0.09 + 0.12 * broad, 0.0, 0.16) * profile


@wp.func
def slope_mask(m: Material, q: wp.vec3, n: wp.vec3, footprint: float):
    """1 where the surface faces up, 0 where it is steep, with a ragged edge (paper 3.1.1)."""
    up = wp.abs(n[2])
    if up > 0.55 and up < 0.99:
        up += 0.18 * fbm(m.seed + wp.uint32(3), 2.5 * q, 5, 2.5 * footprint)
    return wp.smoothstep(0.79, 0.85, up)


@wp.func
def ground(m: Material, p: wp.vec3, n: wp.vec3, footprint: float):
    """Tiles: one, or sand where the surface faces up and rock elsewhere."""
    q = p + m.offset
    flat = float(1.0)
    if m.layers.shape[0] > 1:
        flat = slope_mask(m, q, n, footprint)
    # the shade of a sea floor varies over metres
    broad = 1.5 * fbm(m.seed + wp.uint32(101), 0.35 * q, 2, 0.35 * footprint)
    c = wp.vec3(0.0)
    for k in range(m.layers.shape[0]):
        share = wp.where(k == 0, flat, 1.0 - flat)
        if share > 0.0:
            size = m.layers[k].size
            x = (p + m.layers[k].offset) / size
            if m.layers[k].ripple > 0.0:
                length = m.layers[k].ripple
                share *= ripples(m.seed + wp.uint32(103), q / length, broad, footprint / length)
            c += share * tiled(m.layers[k].image, m.seed + wp.uint32(7 * k), x, n, footprint / size)
    return (1.0 + 0.13 * broad) * c


# ------------------------------------------------------------------------------------------------------------- objects


@wp.func
def covered(m: Material, noise: float, bias: float, footprint: float):
    """Fraction covered by a layer: 1 where ``noise + bias`` is above the threshold; far away, the mean."""
    # the mean takes over while the broadest octave is still resolved
    share = band(2.0 * m.cycles * footprint)
    # the noise is roughly normal; with 1.702 a logistic function approximates its distribution
    mean = 1.0 / (1.0 + wp.exp(-1.702 * (bias - m.threshold) / NOISE_DEVIATION))
    return wp.lerp(mean, wp.smoothstep(-0.06, 0.06, noise + bias - m.threshold), share)


@wp.func
def layered(m: Material, q: wp.vec3, n: wp.vec3, footprint: float):
    """Metal, paint or another surface under patches of rust, or of silt, which is mostly where the surface faces up."""
    noise = fbm(m.seed, m.cycles * q, 4, m.cycles * footprint)
    bias = wp.where(m.kind == DIRT, 0.5 * n[2], 0.0)
    s = covered(m, noise, bias, footprint)
    bsdf = Bsdf()
    if m.metallic == 1:
        bsdf.metal = 1.0 - s
        bsdf.specular = bsdf.metal * m.base
        bsdf.roughness = m.roughness
    else:
        bsdf.reflectance = (1.0 - s) * m.base
    if s > 0.0:
        grain = 1.0 + 0.6 * fbm(m.seed + wp.uint32(9), 12.0 * m.cycles * q, 2, 12.0 * m.cycles * footprint)
        shade = wp.clamp(0.5 + 0.8 * noise, 0.0, 1.0)
        bsdf.reflectance += s * grain * wp.lerp(m.layer_dark, m.layer_pale, shade)
    bsdf.reflectance = unit_clamp(bsdf.reflectance)
    return bsdf


@wp.func(inline=False)  # long code, and run near surfaces only
def grain_tone(seed: wp.uint32, grain: float, q: wp.vec3, footprint: float):
    """Factor of a reflectance from grain to grain, of mean 1; 1 where no grain is resolved.

    Octaves are alike, as of grains of all sizes, so that at any distance the finest that are resolved are seen.
    """
    total = float(0.0)
    cycles = float(GRAIN_CYCLES)
    for octave in range(GRAIN_OCTAVES):
        share = band(cycles * footprint)
        if share == 0.0:
            break
        total += share * wp.noise(seed + wp.uint32(octave), cycles * q)
        cycles *= 2.03
    return 1.0 + wp.clamp(GRAIN_CONTRAST * grain * total, -MOST_GRAIN, MOST_GRAIN)


@wp.func
def wrapped(u: float, how: int, count: int):
    """Coordinate within 0..1 of one outside, and half a texel of ``count`` from its ends, if none repeats."""
    if how == REPEAT:
        return u
    inside = u
    if how == MIRROR:
        inside = wp.abs(u - 2.0 * wp.round(0.5 * u))
    margin = 0.5 / float(count)
    return wp.clamp(inside, margin, 1.0 - margin)


@wp.func(inline=False)  # code that all textures would carry is not free
def mapped(layers: wp.array(dtype=Layer), page: int, at: wp.vec3, footprint: float):
    """Page of a mesh file at coordinates u, v (v up), with at[2] of their units per metre."""
    layer = layers[page]
    width = float(layer.image.width)
    height = float(layer.image.height)
    level = level_of(layer.image, footprint * at[2] * wp.sqrt(width * height))
    coarse = int(wp.ceil(level))  # the coarser of the two levels
    x = width * wrapped(at[0], layer.wrap_u, layer.image.width >> coarse)
    y = height * (1.0 - wrapped(at[1], layer.wrap_v, layer.image.height >> coarse))
    return wp.cw_mul(layer.factor, sample(layer.image, x, y, level))


@wp.func
def page_alpha(layer: Layer, u: float, v: float):
    """Alpha 0..1 of a page that masks at coordinates u, v (v up), blended between the four nearest texels."""
    height = layer.alpha.shape[0]
    width = layer.alpha.shape[1]
    x = float(width) * wrapped(u, layer.wrap_u, width) - 0.5
    y = float(height) * (1.0 - wrapped(v, layer.wrap_v, height)) - 0.5
    left = wp.floor(x)
    top = wp.floor(y)
    alpha = float(0.0)
    for k in range(4):
        i = k // 2
        j = k % 2
        row = repeated(int(top) + i, height)
        col = repeated(int(left) + j, width)
        share = wp.where(i == 1, y - top, 1.0 - (y - top)) * wp.where(j == 1, x - left, 1.0 - (x - left))
        alpha += share * float(layer.alpha[row, col])
    return alpha / 255.0


# ---------------------------------------------------------------------------------------------------------------- all


@specialised("patterns", "metals", "grain")
def make_material_at(spec: SceneSpec) -> wp.Function:
    """The function ``material_at``, for scenes with or without images, patterns and metals.

    Where there is no metal its lobe is zero in all that is compiled, so nothing of it is left in the kernels.
    """

    @wp.func
    def material_at(m: Material, p: wp.vec3, n: wp.vec3, at: wp.vec3, page: int, footprint: float):
        """Scattering function of a material at ``p`` (local world) with normal ``n``, averaged over ``footprint`` [m].

        ``at`` holds the mesh file's data for the point: u, v and their units per metre on the ``page`` of its textures,
        or where that is -1 the colour; other kinds do not use it.
        """
        bsdf = Bsdf()
        if m.kind == DIFFUSE:
            bsdf.reflectance = m.base
        elif m.kind == COLOURED or (m.kind == MAPPED and page < 0):
            bsdf.reflectance = at
        if wp.static(spec.grain):
            if m.grain > 0.0:
                tone = grain_tone(m.seed + wp.uint32(31), m.grain, p + m.offset, footprint)
                bsdf.reflectance = unit_clamp(tone * bsdf.reflectance)
        if wp.static(spec.patterns):
            if m.kind == GROUND:
                bsdf.reflectance = unit_clamp(ground(m, p, n, footprint))
            elif m.kind == MAPPED and page >= 0:
                bsdf.reflectance = mapped(m.layers, page, at, footprint)
            elif m.kind == RUST or m.kind == DIRT:
                bsdf = layered(m, p + m.offset, n, footprint)
        if wp.static(spec.metals):
            if m.kind == METAL:
                bsdf.metal = 1.0
                bsdf.specular = m.base
                bsdf.roughness = m.roughness
        if wp.static(not spec.metals):
            bsdf.metal = 0.0
            bsdf.specular = wp.vec3(0.0)
        return bsdf

    return material_at
