"""The built-in sand and rock: one periodic tile each, baked into an image."""

import warp as wp

from varos_warp.kernels.world.pattern_noise import cell_hash, high_half, low_half, periodic_cell, periodic_fbm

wp.set_module_options({"enable_backward": False})

SAND = wp.constant(0)
ROCK = wp.constant(1)
GRAINS = wp.constant(400)
"""Grains of sand, or of minerals in rock, along a side of the tile."""


@wp.func
def sand(seed: wp.uint32, uv: wp.vec2):
    """Grains of quartz, feldspar and dark minerals, with small pebbles and fragments of shells between them."""
    grain = periodic_cell(seed, uv, GRAINS)
    bits = cell_hash(seed + wp.uint32(1), int(grain.id), 0)
    colour = wp.lerp(wp.vec3(0.52, 0.47, 0.37), wp.vec3(0.47, 0.36, 0.23), low_half(bits))
    which = high_half(bits)
    if which < 0.07:
        colour = wp.vec3(0.16, 0.14, 0.13)
    elif which > 0.975:
        colour = wp.vec3(0.70, 0.66, 0.58)
    shade = (0.75 + 0.5 * low_half(grain.id)) * (0.72 + 0.28 * wp.smoothstep(0.0, 0.3, grain.gap))

    # some coarser pieces, each a patch of its cell
    pebble = periodic_cell(seed + wp.uint32(2), uv, GRAINS / 4)
    size = high_half(cell_hash(seed + wp.uint32(3), int(pebble.id), 0))
    if size > 0.86 and pebble.nearest < 1.6 * (size - 0.72):
        colour = wp.lerp(wp.vec3(0.20, 0.17, 0.14), wp.vec3(0.50, 0.44, 0.36), low_half(pebble.id))
        shade = 1.05 - 0.9 * pebble.nearest
    shell = periodic_cell(seed + wp.uint32(4), uv, GRAINS / 10)
    bits = cell_hash(seed + wp.uint32(5), int(shell.id), 0)
    # a fragment: between the border of its cell and a circle
    if high_half(bits) > 0.93 and shell.gap < 0.28 and shell.nearest < 0.1 + 0.4 * low_half(bits):
        colour = wp.vec3(0.66, 0.61, 0.54)
        shade = 0.8 + 0.3 * low_half(grain.id)

    # where finer or darker sediment has settled
    mottled = 1.0 + 0.16 * periodic_fbm(seed + wp.uint32(6), uv, 4, 6)
    return shade * mottled * colour


@wp.func
def ridges(seed: wp.uint32, uv: wp.vec2, cycles: int, octaves: int):
    """Fractal sum of rounded humps with sharp clefts between (Musgrave's billows), roughly in [-1, 1]; periodic."""
    total = float(0.0)
    weight = float(0.4)
    n = cycles
    for octave in range(octaves):
        total += weight * (4.0 * wp.abs(wp.pnoise(seed + wp.uint32(octave), float(n) * uv, n, n)) - 1.0)
        n *= 2
        weight *= 0.8
    return total


@wp.func
def rock(seed: wp.uint32, uv: wp.vec2):
    """Grey-brown stone: knobs and clefts, broken cracks, mineral grains, a dark film of algae and pale crusts."""
    bent = uv + 0.04 * wp.vec2(
        periodic_fbm(seed + wp.uint32(20), uv, 3, 4), periodic_fbm(seed + wp.uint32(30), uv, 3, 4)
    )
    relief = ridges(seed, bent, 5, 7)
    block = periodic_cell(seed + wp.uint32(40), bent + wp.vec2(0.012 * relief, -0.012 * relief), 5)
    tint = periodic_fbm(seed + wp.uint32(70), uv, 2, 5)
    open = wp.smoothstep(-0.1, 0.4, tint)  # cracks taper off
    crack = 1.0 - open * (1.0 - wp.smoothstep(0.0, 0.03, block.gap))
    grain = periodic_cell(seed + wp.uint32(60), uv, GRAINS)
    bits = cell_hash(seed, int(grain.id), 1)
    colour = wp.lerp(wp.vec3(0.35, 0.34, 0.32), wp.vec3(0.37, 0.29, 0.20), wp.clamp(0.5 + 1.3 * tint, 0.0, 1.0))
    shade = wp.lerp(0.25, 1.7, wp.smoothstep(-1.1, 0.9, relief + 0.3 * low_half(block.id)))
    shade *= (0.35 + 0.65 * crack) * (0.82 + 0.36 * low_half(bits))

    growth = periodic_fbm(seed + wp.uint32(80), bent, 4, 6)
    film = wp.smoothstep(0.0, 0.45, growth + 0.2 * relief)
    colour = wp.lerp(colour, wp.vec3(0.21, 0.18, 0.11), 0.75 * film)
    crust = wp.smoothstep(0.26, 0.34, -growth + 0.1 * relief + 0.06 * high_half(bits))
    colour = wp.lerp(colour, wp.vec3(0.44, 0.39, 0.36), 0.7 * crust)
    return wp.max(shade, 0.06) * colour


@wp.kernel(enable_backward=False)
def bake_ground(kind: int, seed: wp.uint32, first_row: int, tile: wp.array2d(dtype=wp.vec3)):
    """Reflectance of each texel of a periodic tile, shape [N, N], between 0 and 1."""
    row, col = wp.tid()
    row += first_row
    n = tile.shape[0]
    uv = wp.vec2((float(col) + 0.5) / float(n), (float(row) + 0.5) / float(n))
    if kind == SAND:
        c = sand(seed, uv)
    else:
        c = rock(seed, uv)
    tile[row, col] = wp.vec3(wp.clamp(c[0], 0.0, 1.0), wp.clamp(c[1], 0.0, 1.0), wp.clamp(c[2], 0.0, 1.0))
