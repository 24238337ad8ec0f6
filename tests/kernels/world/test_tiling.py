"""Images on surfaces: the right level, the right histogram, no repetition, no aliasing."""

import numpy as np
import pytest
import trimesh
import warp as wp
from chance import run
from PIL import Image as PillowImage
from scipy.ndimage import gaussian_filter
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from varos_warp.kernels.world import tiling
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.images import linear
from varos_warp.scene.materials import textures
from varos_warp.scene.materials.textures import bake_ground, map_pyramid, tile_pyramid

DOWN = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Attitude of a vehicle that looks down."""


@wp.kernel(enable_backward=False)
def sample_map(image: tiling.Image, x: wp.array(dtype=wp.vec2), footprint: float, out: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    out[i] = tiling.sample(image, x[i][0], x[i][1], tiling.level_of(image, footprint))


@wp.kernel(enable_backward=False)
def sample_tiles(
    image: tiling.Image, p: wp.array(dtype=wp.vec3), n: wp.vec3, footprint: float, out: wp.array(dtype=wp.vec3)
):
    i = wp.tid()
    out[i] = tiling.tiled(image, wp.uint32(5), p[i], n, footprint)


@wp.kernel(enable_backward=False)
def levels_of(image: tiling.Image, footprint: wp.array(dtype=float), out: wp.array(dtype=float)):
    i = wp.tid()
    out[i] = tiling.level_of(image, footprint[i])


def mapped(pyramid, x, footprint):
    return run(sample_map, [pyramid.upload("cpu"), np.asarray(x, np.float32), footprint], [wp.vec2, wp.vec3][1:])


def tiles(pyramid, p, n=(0.0, 0.0, 1.0), footprint=0.0):
    return run(sample_tiles, [pyramid.upload("cpu"), np.asarray(p, np.float32), wp.vec3(*n), footprint], [wp.vec3])


def reflectance_pyramid(reflectance):
    """Pyramid of linear reflectances [H, W, 3], which pictures hold with 8 bits only."""
    levels = textures._levels(np.asarray(reflectance, np.float32))
    return textures._pyramid([textures._packed(level) for level in levels])


def gray(values):
    return np.repeat(np.asarray(values, np.float32)[..., None], 3, axis=2)


def blobs(n=128, seed=1, width=3.0):
    """A skewed texture with features some texels wide: dark, with bright spots."""
    noise = gaussian_filter(np.random.default_rng(seed).standard_normal((n, n)), width, mode="wrap")
    return gray(0.1 + 0.7 / (1.0 + np.exp(-3.0 * (noise / noise.std() - 1.0))))


# -------------------------------------------------------------------------------------------------------------- levels


def test_a_level_averages_stripes_as_a_box_of_its_texels_does():
    """Stripes of P texels through a box of w: their amplitude falls by sin(pi w / P) / (w sin(pi / P))."""
    n, period = 256, 16
    x = np.arange(n)
    pyramid = reflectance_pyramid(gray(np.broadcast_to(0.5 + 0.4 * np.cos(2 * np.pi * (x + 0.5) / period), (n, n))))
    for level in range(7):
        width = 2**level
        centres = (np.arange(n // width) + 0.5) * width
        seen = mapped(pyramid, np.column_stack([centres, np.full_like(centres, 17.3)]), float(width))
        kept = np.sin(np.pi * width / period) / (width * np.sin(np.pi / period))
        expected = 0.5 + 0.4 * kept * np.cos(2 * np.pi * centres / period)
        np.testing.assert_allclose(seen[:, 0], expected, atol=1.0 / 2047)


def test_the_level_follows_the_footprint_and_stays_whole_half_of_the_time():
    pyramid = reflectance_pyramid(gray(np.full((256, 256), 0.5)))
    octaves = np.linspace(-3, 12, 1501)
    level = run(levels_of, [pyramid.upload("cpu"), (2.0**octaves).astype(np.float32)], [float])
    assert np.all(np.diff(level) >= -1e-6)
    inside = (octaves > 0.5) & (octaves < 7.5)
    assert np.abs(level - octaves)[inside].max() <= 0.25 + 1e-3
    assert np.mean(level[inside] == np.rint(level[inside])) == pytest.approx(0.5, abs=0.02)
    assert np.all(level[octaves <= 0] == 0.0)
    assert np.all(level[octaves >= 8.3] == 8.0)


def test_wide_and_tall_images_end_in_their_mean():
    for shape in ((64, 8), (8, 64)):
        values = np.random.default_rng(1).random((*shape, 3)).astype(np.float32)
        pyramid = reflectance_pyramid(values)
        assert len(pyramid.starts) == 4
        strip = values.reshape(shape[0] // 8, 8, shape[1] // 8, 8, 3).mean(axis=(1, 3)).reshape(8, 3)
        centres = (np.arange(8) + 0.5) * 8
        x = [(4.0, c) if shape[0] == 64 else (c, 4.0) for c in centres]
        np.testing.assert_allclose(mapped(pyramid, x, 8.0), strip, atol=1.0 / 1023)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 3), (5, 1), (6, 10), (7, 20), (65, 64), (100, 1), (3, 1000)])
def test_pictures_of_any_size_show_their_own_texels(height, width):
    """At the centre of each texel its own colour, on either side of the edge too; to the 10 bits that are kept."""
    texels = np.random.default_rng(1).integers(0, 256, (height, width, 3)).astype(np.uint8)
    row, col = (index.ravel() for index in np.indices((height, width)))
    for tiles_off in (0, -3, 1000):
        x = np.column_stack([col + 0.5 + tiles_off * width, row + 0.5 - tiles_off * height])
        rounding = 0.51 / 1023 + abs(tiles_off) * max(height, width) * 2**-24
        np.testing.assert_allclose(mapped(map_pyramid(texels), x, 1.0), linear(texels[row, col]), atol=rounding)


@pytest.mark.parametrize(("height", "width"), [(3, 3), (6, 10), (7, 20), (65, 64), (33, 1000)])
def test_levels_of_any_size_keep_the_mean(height, width):
    """Every level has the mean of the picture, to the rounding of its texels; the last has a side of one."""
    texels = np.random.default_rng(1).integers(0, 256, (height, width, 3)).astype(np.uint8)
    pyramid = map_pyramid(texels)
    ends = [*pyramid.starts[1:], len(pyramid.texels)]
    mean = linear(texels).mean(axis=(0, 1))
    for k, (start, end) in enumerate(zip(pyramid.starts, ends, strict=True)):
        assert end - start == (height >> k) * (width >> k)
        red, blue = pyramid.texels[start:end] & 2047, pyramid.texels[start:end] >> 22
        assert red.mean() / 2047 == pytest.approx(mean[0], abs=0.5 / 2047)
        assert blue.mean() / 1023 == pytest.approx(mean[2], abs=0.5 / 1023)
    assert min(height >> k, width >> k) == 1


def test_a_coarse_texel_of_odd_sides_is_the_mean_of_its_area():
    """Of seven columns, three: each covers 7 / 3 of them."""
    row = np.random.default_rng(1).random(7)
    cut = np.repeat(row, 3).reshape(3, 7).mean(axis=1)  # thirds of columns, seven to each new one
    level = reflectance_pyramid(gray(np.broadcast_to(row, (4, 7))))
    red = level.texels[level.starts[1] : level.starts[1] + 3] & 2047
    np.testing.assert_allclose(red / 2047, cut, atol=0.51 / 2047)


# ----------------------------------------------------------------------------------------------------------- histogram


PERCENTILES = [1, 5, 25, 50, 75, 95, 99]


def sampled_both_ways(source):
    """60000 samples of a tile, laid without end and plainly; both between texels, which smooths them alike."""
    rng = np.random.default_rng(2)
    p = np.column_stack([rng.uniform(-100, 100, (60000, 2)), np.zeros(60000)])
    plain = mapped(reflectance_pyramid(source), rng.uniform(0, len(source), (60000, 2)), 1.0)
    return tiles(tile_pyramid(source), p, footprint=1.0 / len(source)), plain


@pytest.mark.parametrize(("name", "bound"), [("rock", 0.01), ("blobs", 0.02), ("sand", 0.08)])
def test_tiles_have_the_histogram_of_their_source(name, bound):
    """Mean within 1 %; deviation and percentiles within ``bound`` of the range from the 1st to the 99th.

    1 % for rock, 2 % for a tile with few features. 8 % for sand, at its white grains: they are two texels wide, and
    between texels Gaussian values are mixed instead of colours.
    """
    tiled, plain = sampled_both_ways(blobs() if name == "blobs" else bake_ground(name, 1024))
    np.testing.assert_allclose(tiled.mean(axis=0), plain.mean(axis=0), rtol=0.01)
    is_, should = (np.percentile(values, PERCENTILES, axis=0) for values in (tiled, plain))
    span = should[-1] - should[0]
    assert np.all(np.abs(tiled.std(axis=0) - plain.std(axis=0)) < bound * span)
    assert np.all(np.abs(is_ - should) < bound * span)


def test_tiles_of_two_colours_show_these_two_and_as_much_of_each():
    """Within 5 %, for along their borders the colour of the larger area spreads by part of a texel."""
    source = gray(blobs(width=8.0)[..., 0] > 0.2) * 0.6 + 0.1
    tiled, plain = sampled_both_ways(source)
    np.testing.assert_allclose(tiled.mean(axis=0), plain.mean(axis=0), rtol=0.05)
    assert np.mean(np.minimum(np.abs(tiled - 0.1), np.abs(tiled - 0.7)) < 0.01) > 0.95


@pytest.mark.parametrize("n", [(0.7, 0.0, 0.714), (0.577, 0.577, 0.577)])
def test_slopes_keep_the_histogram_where_projections_blend(n):
    source = blobs()
    n = np.array(n) / np.linalg.norm(n)
    p = np.random.default_rng(2).uniform(-100, 100, (60000, 3))
    p -= (p @ n)[:, None] * n
    level, slope = tiles(tile_pyramid(source), p, footprint=1 / 128), tiles(tile_pyramid(source), p, n, 1 / 128)
    np.testing.assert_allclose(slope.mean(axis=0), level.mean(axis=0), rtol=0.03)
    np.testing.assert_allclose(slope.std(axis=0), level.std(axis=0), rtol=0.04)


@pytest.mark.parametrize("name", ["sand", "rock"])
def test_the_mean_is_the_same_at_every_footprint(name):
    """Within 1.5 %: coarse levels hold means of Gaussian values, and tables what these stand for."""
    source = bake_ground(name, 256)
    pyramid = tile_pyramid(source)
    p = np.column_stack([np.random.default_rng(2).uniform(-100, 100, (60000, 2)), np.zeros(60000)])
    spread = []
    for footprint in 2.0 ** np.arange(-8, 3):
        c = tiles(pyramid, p, footprint=footprint)
        np.testing.assert_allclose(c.mean(axis=0), source.mean(axis=(0, 1)), rtol=0.015)
        spread.append(c.std(axis=0).mean())
    assert np.all(np.diff(spread) <= 1e-4)
    assert spread[-1] < 2e-3


def test_close_views_show_detail_finer_than_the_texels():
    """Along a line, in steps of a tenth of a texel: more than the bilinear image holds, with the same mean."""
    pyramid, n = tile_pyramid(blobs()), 128
    x = np.arange(200000) / (10 * n)
    p = np.column_stack([x, np.full_like(x, 0.37), np.zeros_like(x)])
    smooth, fine = tiles(pyramid, p, footprint=1.0 / n)[:, 0], tiles(pyramid, p, footprint=0.05 / n)[:, 0]
    bend = [np.std(np.diff(c, 2)) for c in (smooth, fine)]
    assert bend[1] > 3 * bend[0]
    assert fine.mean() == pytest.approx(smooth.mean(), rel=0.03)


# ---------------------------------------------------------------------------------------------------------- rendered B


def save_blobs(path):
    linear = blobs(64, width=2.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    PillowImage.fromarray(np.rint(255 * encoded).astype(np.uint8)).save(path)


def floor(tmp, tile_m, repeat, side=16.0, file="blobs.png", pixels=256):
    """A level square of ``side``: with the image laid as tiles or, to ``repeat``, as a map that repeats itself."""
    square = 0.5 * side * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    material = PBRMaterial(baseColorTexture=PillowImage.open(tmp / file))
    visual = TextureVisuals(uv=square[:, :2] / tile_m, material=material)
    mesh = trimesh.Trimesh(square, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)
    mesh.export(tmp / "floor.glb")
    block = {"texture": file, "size_m": tile_m}
    terrain = {"file": "floor.glb", "up_axis": "z"} | ({} if repeat else {"material": "tiles"})
    camera = {"resolution": [pixels, pixels], "sensor_mm": [2.0, 2.0], "focal_mm": 2.0}
    scene = scene_from_dict(
        {
            "terrain": terrain,
            "materials": {"tiles": {"kind": "slope_blend", "flat": block, "steep": block}},
            "vehicle": {"cameras": [camera]},
            "trajectory": {"poses": [{"position": [0, 0, 0.4 * side]}]},
        },
        tmp,
    )
    return FrameRenderer(scene, device="cpu")


def from_above(renderer, height, **how):
    pose = DOWN.copy()
    pose[2, 3] = height
    return renderer.render(pose, outputs="B", **how).B.radiance


def correlation_peak(image, lag):
    """Autocorrelation of a picture [H, W] at ``lag`` [pixels] along x and along y, and its scatter at lags around."""
    image = image - image.mean()
    power = np.abs(np.fft.fft2(image, s=[2 * n for n in image.shape])) ** 2
    overlap = np.fft.ifft2(np.abs(np.fft.fft2(np.ones(image.shape), s=[2 * n for n in image.shape])) ** 2).real
    correlation = np.fft.ifft2(power).real / np.maximum(overlap, 1.0) / image.var()
    around = np.arange(int(0.6 * lag), int(1.4 * lag))
    around = around[np.abs(around - lag) > 0.15 * lag]
    ring = np.concatenate([correlation[around, 0], correlation[0, around]])
    near = np.arange(int(lag) - 2, int(lag) + 4)
    peak = max(correlation[near, 0].max(), correlation[0, near].max())
    return peak, abs(ring.mean()) + 4.0 * ring.std()


@pytest.mark.parametrize("repeat", [False, True])
def test_a_rendered_floor_shows_no_period_of_its_tile_but_repeated_images_do(tmp_path, repeat):
    save_blobs(tmp_path / "blobs.png")
    tile_m, height, pixels = 0.8, 4.0, 256
    seen = from_above(floor(tmp_path, tile_m, repeat), height, spp_b=4)[..., 0]
    lag = tile_m / height * pixels  # focal length and sensor are equal
    peak, chance = correlation_peak(seen, lag)
    if repeat:
        assert peak > 0.5
        assert peak > chance
    else:
        assert peak < chance
        assert peak < 0.1


@pytest.mark.parametrize("repeat", [False, True])
def test_fine_textures_far_away_are_their_mean_without_noise(tmp_path, repeat):
    """A pixel of 9 texels of random black and white: 1 sample is like 256, where unfiltered ones scatter by 100 %.

    Within 5 %, where the texture that is left in a mean over 9 x 9 texels has a deviation of 11 %: samples differ by
    where in their pixel they lie.
    """
    checks = np.random.default_rng(3).integers(0, 2, (128, 128)) * 255
    PillowImage.fromarray(gray(checks).astype(np.uint8)).save(tmp_path / "checks.png")
    mean = np.mean(checks / 255.0)
    renderer = floor(tmp_path, 0.9, repeat, side=20.0, file="checks.png", pixels=64)
    rough, exact = (from_above(renderer, 4.0, spp_b=spp)[..., 0] for spp in (1, 256))
    assert exact.mean() == pytest.approx(mean, rel=0.03)
    assert np.sqrt(np.mean((rough - exact) ** 2)) < 0.05 * mean
    assert rough.std() < 0.11 * mean


def test_grazing_views_do_not_alias(tmp_path):
    """A floor seen at 3 to 30 degrees: with one sample per pixel its rows scatter little more than with 256."""
    checks = np.random.default_rng(3).integers(0, 2, (128, 128)) * 255
    PillowImage.fromarray(gray(checks).astype(np.uint8)).save(tmp_path / "checks.png")
    renderer = floor(tmp_path, 0.2, True, side=60.0, file="checks.png", pixels=96)
    pose = np.eye(4)
    pose[2, 3] = 0.5
    rough, exact = (renderer.render(pose, outputs="B", spp_b=spp).B.radiance[52:90, :, 0] for spp in (1, 256))
    assert exact.mean() == pytest.approx(np.mean(checks / 255.0), rel=0.03)
    assert np.sqrt(np.mean((rough - exact) ** 2)) < 0.03
