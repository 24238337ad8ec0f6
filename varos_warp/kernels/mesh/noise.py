"""Noise at many points: sums of octaves that fade where a mesh cannot show them, and cells (Worley 1996).

Places are float64 and are split into a cell and a place in it before anything is single precision: far from the origin
the noise is as smooth as near it. Octaves are rotated against each other, so that their lattices do not line up.
"""

import warp as wp

from varos_warp.kernels.world.pattern_noise import cell_hash, high_half, low_half

wp.set_module_options({"enable_backward": False})

FBM = wp.constant(0)
RIDGED = wp.constant(1)
BILLOW = wp.constant(2)
"""How octaves are formed: as they are; sharp crests that are rough where they are high; round humps between clefts."""

LACUNARITY = wp.constant(2.03)
STRIDE_K = wp.constant(wp.uint32(3266489917))
STRIDE_OCTAVE = wp.constant(wp.uint32(2654435769))
AGAIN = wp.constant(wp.uint32(747796405))
CHAMFER = wp.constant(0.2)
"""Width of the edges between faces, as a difference of distances to their points in cells."""
HALF_DIAGONAL = wp.constant(0.70710678)
MEAN_ABS = wp.constant(0.15569)
"""Mean of the magnitude of gradient noise (measured on 2 10^7 points; standard error 2e-5)."""
MEAN_RIDGE = wp.constant(0.52306)
"""Mean of an octave of ridges, measured in the same way (6e-5)."""

MEAN_ROUGH = wp.constant(0.91399)
"""Mean of what an octave of ridges leaves of the weight of the next, measured in the same way (3e-5)."""


@wp.func
def along_gradient(h: wp.uint32, x: float, y: float, z: float):
    """Dot product with one of the 12 unit vectors to the edges of a cube (Perlin 2002), which random bits choose."""
    which = int(((h >> wp.uint32(16)) * wp.uint32(12)) >> wp.uint32(16))
    u = x
    v = z
    if which < 4:
        u = y
    elif which >= 8:
        v = y
    if which & 1:
        u = -u
    if which & 2:
        v = -v
    return HALF_DIAGONAL * (u + v)


@wp.func
def fade(t: float):
    """Perlin's quintic: its first and second derivatives are 0 at 0 and at 1."""
    return t * t * t * (t * (6.0 * t - 15.0) + 10.0)


@wp.func
def bits_at(seed: wp.uint32, i: int, j: int, k: int):
    """32 random bits for a cell of space."""
    return cell_hash(seed + wp.uint32(k) * STRIDE_K, i, j)


@wp.func
def lattice_cell(q: wp.vec3d):
    """The cell of the lattice that a place is in, and where it is in it, which alone is single precision."""
    i = int(wp.floor(q[0]))
    j = int(wp.floor(q[1]))
    k = int(wp.floor(q[2]))
    return i, j, k, wp.vec3(float(q[0] - wp.float64(i)), float(q[1] - wp.float64(j)), float(q[2] - wp.float64(k)))


@wp.func
def gradient_noise(seed: wp.uint32, q: wp.vec3d):
    """Gradient noise of unit gradients at a place in units of the lattice: in [-1, 1], of mean 0."""
    i, j, k, inside = lattice_cell(q)
    x = inside[0]
    y = inside[1]
    z = inside[2]
    u = fade(x)
    v = fade(y)
    low = wp.lerp(
        wp.lerp(
            along_gradient(bits_at(seed, i, j, k), x, y, z),
            along_gradient(bits_at(seed, i + 1, j, k), x - 1.0, y, z),
            u,
        ),
        wp.lerp(
            along_gradient(bits_at(seed, i, j + 1, k), x, y - 1.0, z),
            along_gradient(bits_at(seed, i + 1, j + 1, k), x - 1.0, y - 1.0, z),
            u,
        ),
        v,
    )
    high = wp.lerp(
        wp.lerp(
            along_gradient(bits_at(seed, i, j, k + 1), x, y, z - 1.0),
            along_gradient(bits_at(seed, i + 1, j, k + 1), x - 1.0, y, z - 1.0),
            u,
        ),
        wp.lerp(
            along_gradient(bits_at(seed, i, j + 1, k + 1), x, y - 1.0, z - 1.0),
            along_gradient(bits_at(seed, i + 1, j + 1, k + 1), x - 1.0, y - 1.0, z - 1.0),
            u,
        ),
        v,
    )
    return wp.lerp(low, high, fade(z))


@wp.func
def next_octave(q: wp.vec3d):
    """A point in the lattice of the next octave: rotated, moved and LACUNARITY times as fine."""
    x = wp.float64(0.8) * q[0] - wp.float64(0.6) * q[1]
    y = wp.float64(0.48) * q[0] + wp.float64(0.64) * q[1] - wp.float64(0.6) * q[2]
    z = wp.float64(0.36) * q[0] + wp.float64(0.48) * q[1] + wp.float64(0.8) * q[2]
    return wp.float64(LACUNARITY) * wp.vec3d(x, y, z) + wp.vec3d(wp.float64(17.1), wp.float64(9.2), wp.float64(5.3))


@wp.func
def octave_value(kind: int, noise: float):
    """What an octave of a kind adds, before its weight."""
    if kind == RIDGED:
        crest = 1.0 - 2.0 * wp.abs(noise)
        return crest * wp.abs(crest)
    if kind == BILLOW:
        return 4.0 * wp.abs(noise) - 1.0
    return 1.6 * noise


@wp.func
def shown(width: float):
    """Weight of an octave where an edge is ``width`` of its cells: 1 up to 0.4, 0 from 0.75 on.

    A wave of gradient noise is one and a half cells or longer, so it has at least two edges where it is shown at all.
    """
    return wp.clamp((0.75 - width) / 0.35, 0.0, 1.0)


@wp.func
def octave_mean(kind: int):
    """What an octave adds where it is too fine to be seen: its mean, so that coarse meshes do not sink."""
    if kind == RIDGED:
        return MEAN_RIDGE
    if kind == BILLOW:
        return 4.0 * MEAN_ABS - 1.0
    return 0.0


@wp.kernel
def sum_octaves(
    first_row: int,
    kind: int,
    seed: wp.uint32,
    cycles: wp.vec3d,
    octaves: int,
    gain: float,
    points: wp.array(dtype=wp.vec3d),
    edge: wp.array(dtype=wp.float32),
    # out
    value: wp.array(dtype=wp.float32),
):
    """Weighted mean of octaves of gradient noise; those too fine for the edges are replaced by their mean.

    Args:
        first_row: Number of the first thread.
        kind: FBM, RIDGED or BILLOW.
        seed: Random bits.
        cycles: Cells of the first octave along each axis [1/m].
        octaves: How many.
        gain: Weight of an octave over that of the octave before.
        points: Places [m], shape [N].
        edge: Length of the edges there [m], shape [N].
        value: The sum over the sum of all weights, shape [N].
    """
    n = first_row + wp.tid()
    q = wp.cw_mul(points[n], cycles)
    width = edge[n] * float(wp.max(wp.max(wp.abs(cycles[0]), wp.abs(cycles[1])), wp.abs(cycles[2])))
    total = float(0.0)
    weight = float(1.0)
    weights = float(0.0)
    rough = float(1.0)
    mean = octave_mean(kind)
    for octave in range(octaves):
        share = shown(width)
        drawn = mean
        next_rough = float(MEAN_ROUGH)
        if share > 0.0:
            whole = octave_value(kind, gradient_noise(seed + wp.uint32(octave) * STRIDE_OCTAVE, q))
            drawn += share * (whole - mean)
            next_rough += share * (wp.clamp(0.6 + 0.8 * whole, 0.15, 1.0) - MEAN_ROUGH)
        total += weight * rough * drawn
        weights += weight
        if kind == RIDGED:  # Musgrave's multifractal: what is low stays smooth
            rough = next_rough
        weight *= gain
        width *= LACUNARITY
        q = next_octave(q)
    value[n] = total / weights


@wp.struct
class Nearest:
    """The two nearest points of a cellular noise so far."""

    first: float
    second: float
    bits: wp.uint32


@wp.func
def point_in(h: wp.uint32, offset: wp.vec3):
    """Way from a place to the jittered point of a cell, whose lower corner lies at ``offset`` from the place."""
    return offset + wp.vec3(low_half(h), high_half(h), low_half(h * AGAIN ^ (h >> wp.uint32(7))))


@wp.func
def nearer(found: Nearest, seed: wp.uint32, i: int, j: int, k: int, offset: wp.vec3, is_flat: int):
    """The nearest points with that of one more cell, whose lower corner lies at ``offset`` from the place."""
    h = bits_at(seed, i, j, k)
    apart = point_in(h, offset)
    if is_flat != 0:
        apart[2] = 0.0
    distance = wp.length(apart)
    out = found
    if distance < found.first:
        out.second = found.first
        out.first = distance
        out.bits = h
    elif distance < found.second:
        out.second = distance
    return out


@wp.func
def search(seed: wp.uint32, i: int, j: int, k: int, inside: wp.vec3, reach: int, is_flat: int):
    """The two nearest of the points in the cells up to ``reach`` away."""
    found = Nearest()
    found.first = 99.0
    found.second = 99.0
    up = reach
    if is_flat != 0:
        up = 0
    for dk in range(-up, up + 1):
        for dj in range(-reach, reach + 1):
            for di in range(-reach, reach + 1):
                corner = wp.vec3(float(di), float(dj), float(dk)) - inside
                found = nearer(found, seed, i + di, j + dj, k + dk, corner, is_flat)
    return found


@wp.func
def random_direction(bits: wp.uint32):
    """A unit vector, uniform over all directions."""
    z = 2.0 * low_half(bits * AGAIN) - 1.0
    around = 2.0 * wp.pi * high_half(bits * STRIDE_OCTAVE)
    r = wp.sqrt(1.0 - z * z)
    return wp.vec3(r * wp.cos(around), r * wp.sin(around), z)


@wp.kernel
def find_cells(
    first_row: int,
    seed: wp.uint32,
    cycles: wp.vec3d,
    is_flat: int,
    points: wp.array(dtype=wp.vec3d),
    # out
    cell: wp.array(dtype=wp.vec3),
):
    """Distances to the nearest two of jittered points, one a cell, and a random number of the nearest one.

    Args:
        first_row: Number of the first thread.
        seed: Random bits.
        cycles: Cells along each axis [1/m].
        is_flat: Whether z does not count: cells are columns then.
        points: Places [m], shape [N].
        cell: Distance to the nearest and the second nearest, in cells, and a number in [0, 1), shape [N].
    """
    n = first_row + wp.tid()
    q = wp.cw_mul(points[n], cycles)
    if is_flat != 0:
        q[2] = wp.float64(0.0)
    i, j, k, inside = lattice_cell(q)
    found = search(seed, i, j, k, inside, 1, is_flat)
    if found.second > 1.0:  # beyond the cells around a point may be nearer
        found = search(seed, i, j, k, inside, 2, is_flat)
    cell[n] = wp.vec3(found.first, found.second, high_half(found.bits * AGAIN))


@wp.kernel
def find_faces(
    first_row: int,
    seed: wp.uint32,
    cycles: wp.vec3d,
    points: wp.array(dtype=wp.vec3d),
    # out
    face: wp.array(dtype=wp.vec2),
):
    """Height of planes that lean at random, each through the jittered point of a cell; a mean where several meet.

    The weight of a point falls from 1, of the nearest, to 0 where it is CHAMFER farther: so there are no steps.

    Args:
        first_row: Number of the first thread.
        seed: Random bits.
        cycles: Cells along each axis [1/m].
        points: Places [m], shape [N].
        face: Height over the point, in cells, and the number in [0, 1) of the nearest one, shape [N].
    """
    n = first_row + wp.tid()
    q = wp.cw_mul(points[n], cycles)
    i, j, k, inside = lattice_cell(q)
    reach = int(1)
    found = search(seed, i, j, k, inside, reach, 0)
    if found.first + CHAMFER > 1.0:  # beyond the cells around a point may be near enough
        reach = 2
        found = search(seed, i, j, k, inside, reach, 0)
    total = float(0.0)
    weights = float(0.0)
    for dk in range(-reach, reach + 1):
        for dj in range(-reach, reach + 1):
            for di in range(-reach, reach + 1):
                h = bits_at(seed, i + di, j + dj, k + dk)
                apart = point_in(h, wp.vec3(float(di), float(dj), float(dk)) - inside)
                w = wp.max(1.0 - (wp.length(apart) - found.first) / CHAMFER, 0.0)
                if w > 0.0:  # few are
                    w = w * w * (3.0 - 2.0 * w)
                    total += w * wp.dot(apart, random_direction(h))
                    weights += w
    face[n] = wp.vec2(total / weights, high_half(found.bits * AGAIN))
