"""Images on surfaces, filtered to the footprint of a ray, and endless tiling without visible repetition.

Hexagonal patches are cut from random places of a tile (Heitz and Neyret 2018, "High-performance by-example noise using
a histogram-preserving blending operator"; Deliot and Heitz 2019). Texels hold Gaussian values: a blend of independent
ones, divided by the root of the sum of its squared weights, has the same distribution, and a table maps it to colours
with the histogram of the tile. Most points lie in a single patch: patches blend only over a narrow edge, which keeps
features sharp and is cheap (cf. Mikkelsen 2022, "Practical real-time hex-tiling").
"""

import warp as wp

from varos_warp.kernels.world.pattern_noise import band, cell_hash, high_half, low_half

wp.set_module_options({"enable_backward": False})

VALUES = wp.constant(512)
"""Length of the table of colours."""
REACH = wp.constant(3.5)
"""Gaussian values are clipped to plus or minus this many standard deviations."""
PATCHES = wp.constant(2.0)
"""Patches along a side of a tile."""
EDGE = wp.constant(0.25)
"""Width of the blend between patches, in barycentric coordinates of the grid of their centres."""
TILT = wp.constant(0.15)
"""Projections along two axes blend where the normal's components along them differ by less than this."""
PERIOD = wp.constant(1024)
"""Tiles after which the choice of patches repeats, so that coordinates stay small."""


@wp.struct
class Image:
    """An image and its coarser levels, each with half the sides of the one before, rounded down.

    A texel is the mean of the area of the finest level that it covers.
    """

    texels: wp.array(dtype=wp.uint32)
    """All levels, the finest first, rows from the top; channels of 11, 11 and 10 bits, 0..1."""
    starts: wp.array(dtype=int)
    """Index of the first texel of each level in ``texels``."""
    width: int
    """Width of the finest level."""
    height: int
    levels: int
    colours: wp.array2d(dtype=wp.vec3)
    """Colours that the Gaussian values of tiles map to, shape [levels, VALUES]; empty for other images."""
    basis: wp.mat33
    """Matrix from the values of ``colours`` to reflectances, used for tiles only."""


@wp.func
def unit_clamp(c: wp.vec3):
    """Clamp each channel to 0..1."""
    return wp.min(wp.max(c, wp.vec3(0.0)), wp.vec3(1.0))


@wp.func
def texel(image: Image, index: int):
    """The three channels of a texel, 0..1."""
    code = image.texels[index]
    return wp.vec3(
        float(code & wp.uint32(2047)) / 2047.0,
        float((code >> wp.uint32(11)) & wp.uint32(2047)) / 2047.0,
        float(code >> wp.uint32(22)) / 1023.0,
    )


@wp.func
def repeated(i: int, count: int):
    """Index 0..count - 1 of texel ``i`` of a row that repeats."""
    inside = i - int(wp.floor(float(i) / float(count))) * count
    return wp.clamp(inside, 0, count - 1)  # far away the quotient is rounded


@wp.func
def sample_level(image: Image, level: int, x: float, y: float):
    """Bilinear sample of one level at (x, y), in texels of the finest from its top left corner; repeats."""
    width = image.width >> level
    height = image.height >> level
    u = float(width) / float(image.width) * x - 0.5
    v = float(height) / float(image.height) * y - 0.5
    i = int(wp.floor(u))
    j = int(wp.floor(v))
    fu = u - float(i)
    fv = v - float(j)
    left = repeated(i, width)
    right = wp.where(left + 1 == width, 0, left + 1)
    row = repeated(j, height)
    start = image.starts[level]
    top = start + row * width
    bottom = start + wp.where(row + 1 == height, 0, row + 1) * width
    above = wp.lerp(texel(image, top + left), texel(image, top + right), fu)
    below = wp.lerp(texel(image, bottom + left), texel(image, bottom + right), fu)
    return wp.lerp(above, below, fv)


@wp.func
def level_of(image: Image, footprint: float):
    """Fractional level, 0..levels - 1, whose texels are as wide as ``footprint``, in texels of the finest.

    Half of all footprints get a whole level, so that one level is read instead of two.
    """
    level = wp.clamp(wp.log2(wp.max(footprint, 1.0)), 0.0, float(image.levels - 1))
    whole = wp.floor(level)
    return whole + wp.clamp(2.0 * (level - whole) - 0.5, 0.0, 1.0)


@wp.func
def sample(image: Image, x: float, y: float, level: float):
    """Sample between levels; (x, y) in texels of the finest from the top left corner of the image."""
    fine = int(level)
    share = level - float(fine)
    c = wp.vec3(0.0)
    levels = wp.where(share > 0.0, 2, 1)
    for k in range(levels):
        c += wp.where(k == 0, 1.0 - share, share) * sample_level(image, fine + k, x, y)
    return c


# --------------------------------------------------------------------------------------------------------------- tiles


@wp.struct
class Blend:
    """Weighted sum of independent Gaussian values, and of the squares of the weights."""

    total: wp.vec3
    squares: float


@wp.func
def add_patches(blend: Blend, image: Image, seed: wp.uint32, x: float, y: float, level: float, weight: float):
    """Add the patches around (x, y), in tiles, to a blend."""
    s = PATCHES * (x - 0.5 * y)
    t = PATCHES * y
    i = int(wp.floor(s))
    j = int(wp.floor(t))
    fs = s - float(i)
    ft = t - float(j)
    # the triangle of patch centres around the point, and its barycentric coordinates there
    upper = int(fs + ft >= 1.0)
    w = wp.vec3(1.0 - fs - ft, fs, ft)
    if upper == 1:
        w = wp.vec3(fs + ft - 1.0, 1.0 - ft, 1.0 - fs)
    least = wp.max(w) - EDGE
    added = blend
    corners = int(3)  # a variable, so that the loop is not unrolled: small code is faster on a GPU
    for k in range(corners):
        share = weight * (w[k] - least)
        if share > 0.0:
            di = wp.where(k == 0, upper, int(k == 1))
            dj = wp.where(k == 0, upper, int(k == 2))
            h = cell_hash(seed, (i + di) & (PERIOD - 1), (j + dj) & (PERIOD - 1))
            # cut the patch at a random place, in units of the tile's sides
            u = (x + low_half(h)) * float(image.width)
            v = (y + high_half(h)) * float(image.width)
            g = sample(image, u, v, level)
            added.total += share * (2.0 * REACH * g - wp.vec3(REACH))
            added.squares += share * share
    return added


@wp.func
def colour_row(image: Image, g: wp.vec3, row: int):
    """Colour that Gaussian values ``g`` map to on one level."""
    c = wp.vec3(0.0)
    for k in range(3):
        value = int((g[k] + REACH) * (float(VALUES) / (2.0 * REACH)))
        c[k] = image.colours[row, wp.clamp(value, 0, VALUES - 1)][k]
    return c


@wp.func
def colour_of(image: Image, g: wp.vec3, level: float):
    """Reflectance that Gaussian values ``g``, averaged over a footprint, map to."""
    fine = int(level)
    c = colour_row(image, g, fine)
    share = level - float(fine)
    if share > 0.0:
        c = wp.lerp(c, colour_row(image, g, fine + 1), share)
    return unit_clamp(image.basis * c)


@wp.func
def grit(seed: wp.uint32, q: wp.vec3, footprint: float):
    """Detail finer than the texels, for close views: up to three octaves of noise; ``q``, ``footprint`` in texels."""
    total = float(0.0)
    cycles = float(0.6)
    for octave in range(3):
        share = band(cycles * footprint)
        if share == 0.0:
            break
        total += share * wp.noise(seed + wp.uint32(octave), cycles * q)
        cycles *= 2.0
    return total


@wp.func
def tiled(image: Image, seed: wp.uint32, p: wp.vec3, n: wp.vec3, footprint: float):
    """Reflectance of an endless surface of tiles at ``p`` with normal ``n``; ``p`` and ``footprint`` in tiles.

    The tile is projected along the axes (triplanar mapping); between two projections values blend as between patches.
    """
    texels = footprint * float(image.width)
    level = level_of(image, texels)
    least = wp.max(wp.abs(n)) - TILT
    blend = Blend()
    axes = int(3)
    for axis in range(axes):
        w = wp.abs(n[axis]) - least
        if w > 0.0:
            x = wp.where(axis == 0, p[1], p[0])
            y = wp.where(axis == 2, p[1], p[2])
            blend = add_patches(blend, image, seed + wp.uint32(axis), x, -y, level, w)
    g = blend.total / wp.sqrt(wp.max(blend.squares, 1.0e-12))
    if texels < 0.8:
        g[0] += 0.5 * grit(seed, float(image.width) * p, texels)
    return colour_of(image, g, level)
