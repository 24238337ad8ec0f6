"""Images for the device: pyramids of texture maps, and of tiles whose values blend without losing their histogram."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp
from scipy.special import ndtr, ndtri

from varos_warp.cache import cached, code_hash, digest
from varos_warp.device.launch import in_threads, launch_rows
from varos_warp.files import require_file
from varos_warp.kernels.mesh import bake
from varos_warp.kernels.world.texture import Layer
from varos_warp.kernels.world.tiling import REACH, VALUES, Image
from varos_warp.scene.description import Scene
from varos_warp.scene.geometry.parts import Page, Skin
from varos_warp.scene.images import linear, read_picture
from varos_warp.scene.optics.camera import camera_model

GROUND = {"sand": int(bake.SAND), "rock": int(bake.ROCK)}
"""The tiles that ship, computed when first asked for."""

CODE = (__name__, "varos_warp.kernels")
"""Modules that decide what tiles hold."""

_BINS = 4096
_NORMAL_QUANTILES = np.clip(ndtri((np.arange(65536) + 0.5) / 65536), -REACH, REACH).astype(np.float32)
_QUADRATURE = ndtri((np.arange(128) + 0.5) / 128)


class Textures:
    """The images of a scene on a device, each once; owns the memory that records of materials point to."""

    def __init__(self, scene: Scene, device: str):
        self.scene, self.device = scene, device
        self.texel_m = min(camera_model(camera).pixel_angle for camera in scene.vehicle.cameras)
        """What the finest pixel covers at a distance of 1 m [m]: how fine procedural tiles are made."""
        self.images: dict = {}
        self.by_id: dict = {}
        self.arrays: list[wp.array] = []

    def tile(self, texture: str, key: str, tile_m: float) -> Image:
        """Tile ``texture``: one of GROUND, or an image file that ``key`` of the scene file names."""
        if texture in GROUND:
            resolution = ground_resolution(tile_m, self.texel_m)
            return self._image((texture, resolution), lambda: ground_tile(texture, resolution, self.device))
        path = self.scene.resolve(texture)
        return self._image(path, lambda: image_tile(path, key))

    def map(self, page: Page) -> Image:
        """The picture of a page of a mesh file; where masks cut, of what they leave."""
        key = id(page.texels), id(page.alpha), page.cutoff if page.masks else 0.0
        return self._image(key, lambda: map_pyramid(page.texels, page.shown()), page)

    def alpha(self, values: np.ndarray) -> wp.array:
        """Alpha of a mask, uint8 [h, w], on the device."""
        return self._kept(id(values), lambda: wp.array(values, dtype=wp.uint8, device=self.device), values)

    def pages(self, skin: Skin, make: Callable[[], list[Layer]]) -> wp.array:
        """Records of the pages of a mesh file, once for all its copies."""
        return self._kept(id(skin), lambda: wp.array(make(), dtype=Layer, device=self.device), skin)

    def layers(self, records: list[Layer]) -> wp.array:
        """Records of a material on the device."""
        self.arrays.append(wp.array(records, dtype=Layer, device=self.device))
        return self.arrays[-1]

    def _kept(self, key: int, make: Callable[[], wp.array], alive: object) -> wp.array:
        if key not in self.by_id:
            self.by_id[key] = make(), alive
        return self.by_id[key][0]

    def _image(self, key, make, alive=None) -> Image:
        if key not in self.images:
            self.images[key] = make().upload(self.device), alive  # what an id belongs to must stay
        return self.images[key][0]


@dataclass(frozen=True)
class Pyramid:
    """An image with its coarser levels as kernels read it (see ``kernels.tiling.Image``)."""

    texels: np.ndarray
    """uint32 [T], all levels, the finest first."""
    starts: np.ndarray
    """int32 [L], where each begins."""
    width: int
    height: int
    colours: np.ndarray | None = None
    """Colours that the values of a tile map to, float32 [levels, VALUES, 3]; None for a texture map."""
    basis: np.ndarray | None = None
    """Matrix [3, 3] from the values of ``colours`` to reflectances; None for a texture map."""

    def upload(self, device: str) -> Image:
        """The record of the image; it keeps its arrays alive."""
        image = Image()
        image.texels = wp.array(self.texels, dtype=wp.uint32, device=device)
        image.starts = wp.array(self.starts, dtype=int, device=device)
        image.width, image.height, image.levels = self.width, self.height, len(self.starts)
        if self.colours is not None:
            image.colours = wp.array(self.colours, dtype=wp.vec3, device=device)
            image.basis = wp.mat33(*self.basis.ravel())
        return image


def map_pyramid(texels: np.ndarray, shown: np.ndarray | None = None) -> Pyramid:
    """Pyramid of a texture map; its texels are linear reflectances.

    Args:
        texels: uint8 [H, W, 3], the map in sRGB.
        shown: bool [H, W], which texels a mask leaves: coarse levels are means of these. None: all.
    """
    levels = _levels_all(texels) if shown is None else _levels_shown(texels, shown)
    finest = functools.reduce(np.bitwise_or, (_CODES[k][texels[..., k]] for k in range(3)))
    return _pyramid([finest, *map(_packed, levels)])


def _pyramid(levels, **of_tile) -> Pyramid:
    """A pyramid of packed levels [h, w]."""
    starts = np.cumsum([0, *(level.size for level in levels[:-1])])
    height, width = levels[0].shape
    return Pyramid(
        np.concatenate([level.ravel() for level in levels]), starts.astype(np.int32), width, height, **of_tile
    )


def tile_pyramid(reflectance: np.ndarray, seed: int = 1) -> Pyramid:
    """Pyramid of a tile, float [H, W, 3] linear, that can be blended with itself.

    Along the principal axes of its colours, each value becomes the normal quantile of its rank (Heitz and Neyret 2018,
    section 3); equal values are spread at random over theirs. A texel of a coarse level is a mean of quantiles, which
    stands for the mean of the colours it may be made of (ibid., section 4.2): at the top, for that of the whole tile.
    """
    pixels = np.asarray(reflectance, np.float32).reshape(-1, 3)
    some = pixels[::7] if len(pixels) > 64 else pixels
    _, basis = np.linalg.eigh(np.cov(some.T) if len(some) > 1 else np.eye(3))
    basis = basis[:, ::-1]  # the axis of largest variance first
    rng = np.random.default_rng(seed)
    along = np.ascontiguousarray((pixels @ basis.astype(np.float32)).T)
    spread = [rng.random(len(pixels), dtype=np.float32) for _ in along]
    found = in_threads(lambda pair: _gaussianise(*pair), list(zip(along, spread, strict=True)))
    gaussian, quantiles = zip(*found, strict=True)
    levels = _levels(np.stack(gaussian, axis=1).reshape(reflectance.shape))
    variances = in_threads(_variance, levels)
    colours = np.stack([_colours(quantiles, np.maximum(variances[0] - variance, 0.0)) for variance in variances])
    packed = [_packed((level + REACH) / (2 * REACH)) for level in levels]
    return _pyramid(packed, colours=colours.astype(np.float32), basis=basis)


def _kept_tile(what: dict, reflectance: Callable[[], np.ndarray]) -> Pyramid:
    """A tile's pyramid from the cache, or made of its reflectances."""
    depends_on = what | {"code": code_hash(__name__, CODE)}
    kept = cached(
        "tile",
        depends_on,
        lambda: vars(tile_pyramid(reflectance())),
        what=f"the texture {what.get('tile', 'of an image file')}",
    )
    sizes = {name: int(kept[name]) for name in ("width", "height")}
    return Pyramid(**(kept | sizes))


def _variance(image):
    """Variance [3] over the pixels of an image, row by row: numpy's over both axes at once takes three times longer."""
    image = image.astype(np.float64)
    mean = image.mean(0).mean(0)
    return (image**2).mean(0).mean(0) - mean**2


def _gaussianise(values, spread):
    """Normal quantile [N] of the rank of each value [N], and the function back from probabilities to values.

    ``spread`` [N], random in [0, 1): where a value lies among equal ones.
    """
    low, high = float(values.min()), float(values.max())
    span = max(high - low, 1e-6)
    place = np.minimum(((values - low) * (_BINS / span)).astype(np.int32), _BINS - 1)
    counts = np.bincount(place, minlength=_BINS)
    cumulative = np.concatenate([[0.0], np.cumsum(counts)]) / len(values)
    start, share = cumulative[:-1].astype(np.float32), (counts / len(values)).astype(np.float32)
    rank = start[place] + share[place] * spread
    g = _NORMAL_QUANTILES[np.minimum((65536 * rank).astype(np.int32), 65535)]
    sums = np.bincount(place, values, minlength=_BINS)
    held = counts > 0
    means = sums[held] / counts[held]
    middles = (start + 0.5 * share)[held]
    if counts[held].min() > 0.01 * len(values):  # a few distinct values: nothing lies between them
        edges = cumulative[1:][held]
        return g, lambda p: means[np.minimum(np.searchsorted(edges, p), len(means) - 1)]
    return g, lambda p: np.interp(p, middles, means)


def _colours(quantiles, lost):
    """Colours [VALUES, 3] that mean quantiles stand for on a level that has ``lost`` so much of their variance [3]."""
    g = (np.arange(VALUES) + 0.5) / VALUES * 2 * REACH - REACH
    return np.stack(
        [q(ndtr(g[:, None] + s * _QUADRATURE)).mean(axis=1) for q, s in zip(quantiles, np.sqrt(lost), strict=True)],
        axis=1,
    )


def _levels(image):
    """The image and its coarser levels, down to a single row or column."""
    levels = [image]
    while min(levels[-1].shape[:2]) > 1:
        levels.append(_halved(levels[-1]))
    return levels


def _halved(image):
    """Means over the area of 2 x 2 texels, or of somewhat more where a side is odd."""
    if image.shape[0] % 2 or image.shape[1] % 2:
        return _halved_rows(_halved_rows(image).swapaxes(0, 1)).swapaxes(0, 1)
    return 0.25 * (image[::2, ::2] + image[1::2, ::2] + image[::2, 1::2] + image[1::2, 1::2])


def _halved_rows(image):
    """Half as many rows; of 2 m + 1, each new one covers 2 + 1 / m of the old ones (Guthe and Heckbert 2005)."""
    many = len(image) // 2
    if len(image) % 2 == 0:
        return 0.5 * (image[::2] + image[1::2])
    i = np.arange(many, dtype=np.float32).reshape(-1, *[1] * (image.ndim - 1))
    return ((many - i) * image[:-1:2] + many * image[1::2] + (i + 1) * image[2::2]) / len(image)


def _levels_all(texels):
    """The coarser levels of a map in sRGB, linear; channel by channel, as the finest level may fill the memory."""
    if min(texels.shape[:2]) == 1:
        return []
    return _levels(np.stack([_halved(linear(texels[..., k])) for k in range(3)], axis=-1))


def _levels_shown(texels, shown):
    """The levels of `_levels_all` as means over the texels that are shown; where none is, over all that are there."""
    if min(texels.shape[:2]) == 1:
        return []
    share = shown.astype(np.float32)
    weights = _levels(_halved(share))
    totals = _levels(np.stack([_halved(linear(texels[..., k]) * share) for k in range(3)], axis=-1))
    return [
        np.where(w[..., None] > 0.0, total / np.maximum(w[..., None], 1e-9), plain)
        for w, total, plain in zip(weights, totals, _levels_all(texels), strict=True)
    ]


_BITS = ((2047, 0), (2047, 11), (1023, 22))
"""The largest code of each channel of a packed texel, and where it begins."""
_CODES = [np.rint(linear(np.arange(256)) * np.float32(top)).astype(np.uint32) << shift for top, shift in _BITS]
"""The bits that each sRGB value of 8 bits becomes, of each channel."""


def _packed(level):
    """A level of values 0..1 [h, w, 3] as uint32 [h, w]."""
    r, g, b = (np.rint(level[..., k] * top).astype(np.uint32) << shift for k, (top, shift) in enumerate(_BITS))
    return r | g | b


# ---------------------------------------------------------------------------------------------------------- procedural


def ground_resolution(tile_m: float, texel_m: float) -> int:
    """Side of a procedural tile [texels]: 1024 or 2048, its texels about ``texel_m`` wide."""
    return int(2 ** np.clip(np.round(np.log2(tile_m / texel_m)), 10, 11))


@functools.lru_cache(maxsize=8)
def ground_tile(kind: str, resolution: int, device: str = "cpu") -> Pyramid:
    """Pyramid of the ``sand`` or the ``rock`` that ships, computed on ``device`` when it is first asked for."""
    what = {"tile": kind, "resolution": resolution, "device": device.partition(":")[0]}  # the kinds round differently
    return _kept_tile(what, lambda: bake_ground(kind, resolution, device))


def bake_ground(kind: str, resolution: int, device: str = "cpu") -> np.ndarray:
    """Reflectances of a periodic tile of ``sand`` or ``rock``, float32 [resolution, resolution, 3] linear."""
    tile = wp.zeros((resolution, resolution), dtype=wp.vec3, device=device)
    launch_rows(bake.bake_ground, tile.shape, {"kind": GROUND[kind], "seed": wp.uint32(1), "tile": tile}, device)
    return tile.numpy()


# --------------------------------------------------------------------------------------------------------------- files


def image_tile(path: Path, key: str) -> Pyramid:
    """Pyramid of an image file as a tile; the errors are those of `read_image`."""
    reflectance = read_image(path, key)
    return _kept_tile({"image": digest(reflectance)}, lambda: reflectance)


def read_image(path: str | Path, key: str = "texture") -> np.ndarray:
    """Reflectances of an image file, float32 [H, W, 3] linear.

    Raises:
        InputError: The file is missing or is no image.
    """
    path = Path(path)
    known = " or ".join(GROUND)
    require_file(path, "image file", f"Give {known}, or the path relative to the scene file.", key)
    return linear(read_picture(path, key).texels)
