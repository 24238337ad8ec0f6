"""Seeded noise for patterns: hashes of cells, fractal sums limited to a footprint, periodic noise for baked tiles."""

import warp as wp

wp.set_module_options({"enable_backward": False})


STRIDE_I, STRIDE_J = wp.constant(wp.uint32(2654435761)), wp.constant(wp.uint32(2246822519))
MIX_1, MIX_2 = wp.constant(wp.uint32(2146121005)), wp.constant(wp.uint32(2221713035))


@wp.func
def cell_hash(seed: wp.uint32, i: int, j: int):
    """32 random bits for a cell (Wellons' lowbias32 of its indices times large odd constants)."""
    h = seed + wp.uint32(i) * STRIDE_I + wp.uint32(j) * STRIDE_J
    h = (h ^ (h >> wp.uint32(16))) * MIX_1
    h = (h ^ (h >> wp.uint32(15))) * MIX_2
    return h ^ (h >> wp.uint32(16))


@wp.func
def low_half(h: wp.uint32):
    """The lower 16 bits as a number in [0, 1)."""
    return float(h & wp.uint32(65535)) / 65536.0


@wp.func
def high_half(h: wp.uint32):
    """The upper 16 bits as a number in [0, 1)."""
    return float(h >> wp.uint32(16)) / 65536.0


@wp.func
def band(cycles: float):
    """Weight of a wave with ``cycles`` per footprint: 1 if it is resolved, 0 from half a cycle on."""
    return wp.clamp(2.0 - 4.0 * cycles, 0.0, 1.0)


@wp.func(inline=False)  # one copy for all callers: a GPU waits for long code
def fbm(seed: wp.uint32, p: wp.vec3, octaves: int, footprint: float):
    """Fractal sum of gradient noise, roughly in [-1, 1]; octaves finer than ``footprint`` fade out."""
    total = float(0.0)
    weight = float(1.0)
    width = footprint
    q = p
    for octave in range(octaves):
        share = band(width)
        if share == 0.0:
            break
        total += share * weight * wp.noise(seed + wp.uint32(octave), q)
        # rotated between octaves, so that their lattices do not line up
        q = 2.03 * wp.vec3(0.8 * q[0] - 0.6 * q[1], 0.6 * q[0] + 0.8 * q[1], q[2]) + wp.vec3(17.1, 9.2, 5.3)
        width *= 2.03
        weight *= 0.5
    return total


# ------------------------------------------------------------------------------------------ periodic, for baked tiles


@wp.func
def periodic_fbm(seed: wp.uint32, uv: wp.vec2, cycles: int, octaves: int):
    """Fractal sum of gradient noise, roughly in [-1, 1], that repeats with period 1 in ``uv``."""
    total = float(0.0)
    weight = float(1.0)
    n = cycles
    for octave in range(octaves):
        total += weight * wp.pnoise(seed + wp.uint32(octave), float(n) * uv, n, n)
        n *= 2
        weight *= 0.5
    return total


@wp.struct
class Cell:
    """The cell of a Voronoi diagram around a point."""

    nearest: float
    """Distance to its centre, in mean cell widths."""
    gap: float
    """How much farther the next centre is: 0 on the border."""
    id: wp.uint32
    """Random bits that the whole cell shares."""


@wp.func
def periodic_cell(seed: wp.uint32, uv: wp.vec2, cells: int):
    """Cell at ``uv`` of jittered points, ``cells`` along a side, that repeat with period 1 (Worley 1996)."""
    x = float(cells) * uv[0]
    y = float(cells) * uv[1]
    i = int(wp.floor(x))
    j = int(wp.floor(y))
    cell = Cell()
    cell.nearest = 9.0
    second = float(9.0)
    for dj in range(-1, 2):
        for di in range(-1, 2):
            h = cell_hash(seed, (i + di + cells) % cells, (j + dj + cells) % cells)
            apart = wp.vec2(float(i + di) + low_half(h) - x, float(j + dj) + high_half(h) - y)
            distance = wp.length(apart)
            if distance < cell.nearest:
                second = cell.nearest
                cell.nearest = distance
                cell.id = h
            else:
                second = wp.min(second, distance)
    cell.gap = second - cell.nearest
    return cell
