"""C, D and S of one frame against each other: slopes, borders, holes.

Sums over pixels are kept for each frame, so that a camera's frames can be added up before anything is checked.
"""

import numpy as np
from scipy import ndimage

from varos_warp.dataset.validate.alignment import lucas_kanade
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.products.images.depth import DEPTH_LEVELS
from varos_warp.scene.description.image_types import NORMALS, SEGMENTS

OFFSETS = (0, -2, -1, 1, 2)
"""Pixels by which borders of C or S are moved against jumps of D."""
FEWEST_JUMPS = 30
"""Fewest jumps that must meet a border to say something."""
DEVIATIONS = 3.0
"""Standard deviations by which more borders of C aside than in place are no chance."""
FEWEST_SLOPES = 200
"""Pixels with a slope, fewer of which say nothing."""
MOST_PIXELS = 150_000
"""Pixels of a larger image whose slopes are looked at, in bands of `BAND` rows."""
BAND = 24
BLOCKS = 4, 6
"""Rows and columns of blocks of an image, by whose scatter the shift of C is judged."""
SCATTER = 1.5
"""How many times that scatter a shift may seem to be. What D lacks cancels over a whole triangle, but blocks cut
triangles, so their scatter is an upper bound: of sound hills in triangles of many sizes, none was over 1.1 times it."""


def check_sums(result: Validation, camera: str, sums: dict[str, np.ndarray]) -> None:
    """Note what the sums over a camera's frames say: ``slopes``, and borders of ``C`` and ``S``."""
    if "slopes" in sums:
        check_slopes(result, camera, sums["slopes"])
    for letter in sorted(sums.keys() & {NORMALS, SEGMENTS}):
        check_borders(result, camera, letter, sums[letter])


# --------------------------------------------------------------------------------------------------------------- holes


def holes(depth: np.ndarray, surface: np.ndarray, labels: np.ndarray) -> int:
    """Pixels of holes: D [H, W] has nothing in range, C or S has the ``surface`` that lies around them, which is near.

    Far ground seen through a gap has another depth than its surroundings, too; but the gap is in something, and S knows
    what. Without S, C has to be alike within and around: 10 degrees or so. ``labels`` [H, W, k] are what is alike in a
    surface: numbers of S, or 8-bit normals of C.
    """
    gone, found = (depth == DEPTH_LEVELS) & surface, 0
    if not gone.any():
        return found
    parts, count = ndimage.label(gone)
    for number, box in enumerate(ndimage.find_objects(parts) if count else (), 1):
        box = tuple(slice(max(s.start - 1, 0), s.stop + 1) for s in box)
        inside = parts[box] == number
        ring = ndimage.binary_dilation(inside, np.ones((3, 3))) & ~inside
        if not ring.any() or (depth[box][ring] > 0.8 * DEPTH_LEVELS).any():
            continue
        within, about = (np.median(labels[box][where].astype(float), axis=0) for where in (inside, ring))
        alike = 20.0 if labels.shape[-1] == 3 else 0.0
        found += int(inside.sum()) if np.abs(within - about).max() <= alike else 0
    return found


# -------------------------------------------------------------------------------------------------------------- slopes


def bands(height: int, width: int) -> list[slice]:
    """Rows of an image whose slopes are looked at: all, or bands evenly apart if there are more than `MOST_PIXELS`."""
    if height * width <= MOST_PIXELS or height <= BAND:
        return [slice(0, height)]
    count = max(1, round(MOST_PIXELS / (BAND * width)))
    return [slice(start, start + BAND) for start in np.linspace(0, height - BAND, count + 2).astype(int)[1:-1].tolist()]


def normals_of(points: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Unit normals [H, W, 3] towards the camera from central differences of points; NaN at borders and at edges."""
    normal = np.full(points.shape, np.nan, points.dtype)
    with np.errstate(invalid="ignore", divide="ignore"):
        across, down = points[1:-1, 2:] - points[1:-1, :-2], points[2:, 1:-1] - points[:-2, 1:-1]
        n = np.cross(across, down)
        n /= np.sqrt(np.einsum("...i,...i", n, n))[..., None]
        n *= -np.sign(np.einsum("...i,...i", n, rays[1:-1, 1:-1]))[..., None]
        smooth = _is_smooth(points[1:-1, :-2], points[1:-1, 1:-1], points[1:-1, 2:])
        smooth &= _is_smooth(points[:-2, 1:-1], points[1:-1, 1:-1], points[2:, 1:-1])
    normal[1:-1, 1:-1] = np.where(smooth[..., None], n, np.nan)
    return normal


def _is_smooth(before: np.ndarray, here: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return whether three neighbours in a line are of a slope: a step in depth between two of them is an edge."""
    second, first = before + after - 2 * here, after - before
    return np.einsum("...i,...i", second, second) < 0.04 * np.einsum("...i,...i", first, first)


def slope_sums(normal: np.ndarray, slope: np.ndarray, noise: float, top: int, height: int) -> np.ndarray:
    """What `check_slopes` needs of a band of rows of one frame, from its row ``top`` of ``height`` on: [27, 6].

    A row of sums for each axis of the world (C C, D D, C D, noise^2, pixels, `fineness`), then for each of `BLOCKS`
    those of a Lucas-Kanade step (xx, xy, yy, x, y, 0). ``normal`` [h, W, 3] is C, zero where there is none, ``slope``
    normals of D, NaN where there are none, ``noise`` what a step of D makes of a normal.
    """
    both = np.isfinite(slope).all(-1) & normal.any(-1)
    c, d = normal[both], slope[both]
    count = np.full(3, float(len(c)))
    rows = np.stack(
        [(c * c).sum(0), (d * d).sum(0), (c * d).sum(0), noise**2 * count, count, fineness(normal, both)], -1
    )
    solid = ndimage.binary_erosion(both, np.ones((3, 3)))[1:-1, 1:-1]
    across, down = normal[1:-1, 2:] - normal[1:-1, :-2], normal[2:, 1:-1] - normal[:-2, 1:-1]
    gx, gy, e = (x[solid] for x in (across / 2, down / 2, slope[1:-1, 1:-1] - normal[1:-1, 1:-1]))
    # an edge of C is not a bend, and where C is finer than a pixel it says nothing of D
    w = (
        (np.abs(gx).max(-1, initial=0) < 0.2)
        & (np.abs(gy).max(-1, initial=0) < 0.2)
        & (np.abs(e).max(-1, initial=0) < 0.3)
    )[:, None]
    row, col = np.nonzero(solid)
    block = (row + 1 + top) * BLOCKS[0] // height * BLOCKS[1] + (col + 1) * BLOCKS[1] // normal.shape[1]
    steps = [
        np.bincount(block, (w * a * b).sum(-1), BLOCKS[0] * BLOCKS[1])
        for a, b in ((gx, gx), (gx, gy), (gy, gy), (gx, e), (gy, e))
    ]
    return np.vstack([rows, np.pad(np.stack(steps, -1), ((0, 0), (0, 1)))])


def fineness(normal: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Sum [3] over the pixels that are used of the variance of C within the size of a pixel, for each axis.

    It is half the mean square of the differences between neighbours (the semivariance at the distance of a pixel).
    """
    squares, pairs = np.zeros(3), 0
    for c, there in ((normal, used), (normal.swapaxes(0, 1), used.T)):
        both = there[1:] & there[:-1]
        squares += ((c[1:] - c[:-1])[both].astype(float) ** 2).sum(0)
        pairs += int(both.sum())
    return 0.5 * squares / max(pairs, 1) * used.sum()


def check_slopes(result: Validation, camera: str, sums: np.ndarray) -> None:
    """Each axis of C goes with that of D's slopes, where slopes are more than noise; and neither image is shifted.

    Sound axes are correlated by 0.9 and more, flipped ones by as much below 0. C is of a point and a slope of D of two
    pixels, so what changes within a pixel is in C alone: its share of C is what they may agree less. D bends at the
    edges of triangles only, C within them: where triangles are large, each seems to be shifted, at random.
    """
    for axis, (cc, dd, cd, noise, count, fine) in zip("xyz", sums[:3], strict=True):
        if count >= FEWEST_SLOPES and cc > 0.02**2 * count and dd > max(8.0 * noise, 0.02**2 * count):
            result.measure(
                f"{camera}: C against the slopes of D, {axis}, 1 - correlation",
                1.0 - cd / np.sqrt(cc * dd),
                0.5 + fine / cc,
                "",
            )
    total = sums[3:, :5].sum(0)
    xx, xy, yy = total[:3]
    # per pixel, curvature must be more than the rounding of C to 8 bits
    if min(xx, yy) > FEWEST_SLOPES * 0.004**2 and xx * yy - xy * xy > 0.01 * xx * yy:
        shift, error = _shift(total, sums[3:, :5])
        if np.isfinite(error):
            result.measure(f"{camera}: C against the slopes of D, shift", np.hypot(*shift), 0.5 + SCATTER * error, "px")


def _shift(total: np.ndarray, blocks: np.ndarray) -> tuple[np.ndarray, float]:
    """A Lucas-Kanade step [2] [px] from sums of all and of each block [n, 5], and its scatter by the jackknife.

    The scatter is not finite where all that can tell lies in one block.
    """
    shift = np.stack(lucas_kanade(*total))
    with np.errstate(divide="ignore", invalid="ignore"):
        without = np.stack(lucas_kanade(*(total - blocks).T), -1)
    return shift, float(np.sqrt((1.0 - 1.0 / len(blocks)) * ((without - shift) ** 2).sum()))


def slope_noise(depth: np.ndarray, K: np.ndarray, step_m: float) -> float:
    """Standard deviation that rounding D to steps gives a normal's component: two roundings over two footprints."""
    near = depth[np.isfinite(depth)]
    return float(step_m / np.sqrt(6.0) / (2.0 * np.median(near) / K[0, 0])) if near.size else 0.0


# ------------------------------------------------------------------------------------------------------------- borders


def jumps(depth: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rows and columns of the pixels of D [H, W] whose neighbour to the right lies across a jump; and those of D.T."""
    found, near = [], depth.astype(np.float32)
    for d in (near, near.T):
        size = np.abs(np.diff(d, axis=1))
        jump = size[:, 3:-3] > 0.1 * np.minimum(d[:, 3:-4], d[:, 4:-3])
        row, col = np.nonzero(jump)
        # a slope that is seen at a grazing angle changes as much on either side
        steep = np.maximum(size[row, col + 2], size[row, col + 4]) < 0.3 * size[row, col + 3]
        found.append((row[steep], col[steep] + 3))
    return found


def border_counts(places: list[tuple[np.ndarray, np.ndarray]], image: np.ndarray, least: float) -> np.ndarray:
    """How many `jumps` of D meet a border of C or S [H, W, channels] that is moved by `OFFSETS` pixels.

    Int [2, 5], across and down; a change of a channel by more than ``least`` is a border.
    """
    counts = np.zeros((2, len(OFFSETS)), np.int64)
    for axis, ((row, col), i) in enumerate(zip(places, (image, image.swapaxes(0, 1)), strict=True)):
        for k, s in enumerate(OFFSETS):
            change = i[row, col + s + 1].astype(np.int32) - i[row, col + s]
            counts[axis, k] = (np.abs(change) > least).any(-1).sum()
    return counts


def check_borders(result: Validation, camera: str, letter: str, counts: np.ndarray) -> None:
    """Jumps of D meet more borders where they are than a pixel or two aside, since one ray per pixel makes both.

    Where relief is finer than a pixel there are borders of C everywhere, so that both are as many, but for chance; S
    has borders of objects only.
    """
    for direction, (here, *aside) in zip(("across", "down"), counts, strict=True):
        if max(here, *aside) >= FEWEST_JUMPS:
            # of a difference of two counts
            chance = DEVIATIONS * np.sqrt(here + max(aside)) if letter == NORMALS else 0.0
            result.measure(
                f"{camera}: borders of {letter} at jumps of D, {direction}: those a pixel aside over those in place",
                max(aside) / max(here, 1),
                1.0 + chance / max(here, 1),
                "",
            )
