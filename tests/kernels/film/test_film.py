"""Film: sums in parts, and the mean and standard error that they develop to, against numpy."""

import numpy as np
import pytest
import warp as wp
from chance import run

from varos_warp.kernels.conventions import LONG_KERNEL
from varos_warp.kernels.film import develop as developing
from varos_warp.kernels.film import film as kernel
from varos_warp.kernels.film.adapt import pixel_statistics
from varos_warp.render.image.films import tile_pixels


@wp.kernel(**LONG_KERNEL)
def expose(samples: wp.array4d(dtype=wp.vec3), film: kernel.Film):
    """Sums as the path tracers keep them, compiled as they are; samples [layer, sample, height, width]."""
    part = film.batches[wp.tid()]
    row, col = part.row, part.col
    sums = kernel.Sums()
    for taken in range(part.begin, part.end):
        i = kernel.sample_of(film, part, taken)
        direct, single, multiple = samples[0, i, row, col], samples[1, i, row, col], samples[2, i, row, col]
        if film.sums.shape[0] == kernel.SUMS:
            sums = kernel.add_sample(sums, i, direct, single, multiple, samples[3, i, row, col])
        else:
            sums = kernel.add_correction(sums, i, multiple)
    kernel.store(film, wp.tid(), sums)


IN_BLOCK = int(kernel.IN_BLOCK)


def sides_of(shape):
    """The side of each pixel [H, W], if there are two."""
    row, col = np.indices(shape)
    return (row // 2 + col // 2) % 2


def exposed(samples, most, takes, sides=1, lot=1000, sums=kernel.SUMS, key=0):
    """Film of samples [layer, sample, H, W, 3], of which each side's tiles take so many more a pixel, take by take.

    In parts of ``most`` samples, so many parts at a time.
    """
    shape, tiles = samples.shape[2:4], tuple(-(-side // int(kernel.TILE)) for side in samples.shape[2:4])
    film = kernel.Film()
    film.key = wp.uint32(key)
    film.sums = wp.zeros((sums, *shape), dtype=wp.vec3d, device="cpu")
    film.count, film.wanted = (wp.zeros((sides, *tiles), dtype=int, device="cpu") for _ in "cw")
    film.lost = wp.zeros(1, dtype=int, device="cpu")
    device_samples = wp.array(samples.astype(np.float32), dtype=wp.vec3, device="cpu")
    counts = wp.zeros(int(kernel.TILE) ** 2 * tiles[0] * tiles[1], dtype=int, device="cpu")
    for take in takes:
        film.wanted.assign(np.broadcast_to(np.int32(IN_BLOCK * np.asarray(take)), film.count.shape))
        wp.launch(kernel.count_batches, dim=counts.shape, inputs=[film, most], outputs=[counts], device="cpu")
        ends = wp.array(np.cumsum(counts.numpy()), dtype=int, device="cpu")
        total = int(ends.numpy()[-1])
        for begin in range(0, total, lot):
            parts = min(lot, total - begin)
            film.batches = wp.zeros(parts, dtype=kernel.Batch, device="cpu")
            film.batch_sums = wp.zeros((sums, parts), dtype=wp.vec3d, device="cpu")
            wp.launch(kernel.list_batches, dim=ends.shape, inputs=[ends, 0, begin], outputs=[film], device="cpu")
            assert (film.batches.numpy()["end"] - film.batches.numpy()["begin"]).max() <= most
            wp.launch(expose, dim=parts, inputs=[device_samples, film], device="cpu")
            dim = (sums, *ends.shape)
            wp.launch(kernel.add_batches, dim=dim, inputs=[ends, 0, begin], outputs=[film], device="cpu")
        wp.launch(kernel.note_samples, dim=film.count.shape, outputs=[film], device="cpu")
    return film


NAMES = ("direct", "single", "multiple", "correction", "base_variance", "radiance", "stderr")


def developed(film):
    """The ``NAMES`` [H, W, 3]."""
    shape = film.sums.shape[1:]
    variance, squares = side_variances(film)
    out = [wp.zeros(shape, dtype=wp.vec3, device="cpu") for _ in NAMES]
    wp.launch(developing.develop, dim=shape, inputs=[film, variance, squares], outputs=out, device="cpu")
    return dict(zip(NAMES, (image.numpy() for image in out), strict=True))


def side_variances(film):
    """Of one sample, and squares of the light, [side, tile row, tile column]."""
    out = [wp.zeros(film.count.shape, dtype=wp.vec3d, device="cpu") for _ in "vs"]
    wp.launch(developing.side_variances, dim=out[0].shape, inputs=[film], outputs=out, device="cpu")
    return out


def tile_variances(film):
    """Of the mean of a tile, [tile row, tile column, 3]."""
    out = wp.zeros(film.count.shape[1:], dtype=wp.vec3d, device="cpu")
    wp.launch(developing.tile_variances, dim=out.shape, inputs=[film], outputs=[out], device="cpu")
    return out.numpy()


def statistics(film, denoised=1.0):
    """Mean and variance of a sample of each pixel, [H, W, 3] each."""
    out = [wp.empty(film.sums.shape[1:], dtype=wp.vec3d, device="cpu") for _ in "mv"]
    wp.launch(pixel_statistics, dim=out[0].shape, inputs=[film, denoised], outputs=out, device="cpu")
    return [image.numpy() for image in out]


def develop(samples, most):
    """Of samples [layer, sample, H, W, 3], all taken at once."""
    return developed(exposed(samples, most, [samples.shape[1]]))


def samples_of(kind, spp, seed=1):
    rng = np.random.default_rng(seed)
    shape = (4, spp, 3, 4, 3)
    if kind == "heavy tail":
        return rng.pareto(1.5, shape)
    if kind == "small spread on a large mean":
        return 1e4 + rng.normal(size=shape)
    if kind == "faint":
        return 1e-12 * rng.random(shape)
    return rng.random(shape)


def one_variance(light):
    """Estimate of the variance of one sample of light [sample, ...] from its halves."""
    even, odd = light[::2], light[1::2]
    return (even.mean(0) - odd.mean(0)) ** 2 * len(even) * len(odd) / len(light)


@pytest.mark.parametrize("kind", ["uniform", "heavy tail", "small spread on a large mean", "faint"])
@pytest.mark.parametrize(("spp", "most"), [(1000, 1000), (1000, 150), (1000, 1), (37, 8), (13, 2), (2, 1), (2, 2)])
def test_means_and_standard_errors_are_those_of_all_samples(kind, spp, most):
    """In parts of uneven size, too: against numpy in float64. The image is smaller than the square of an error.

    A total of 3e4 is rounded to 2e-3 of its spread.
    """
    samples = np.float32(samples_of(kind, spp)).astype(float)
    images = develop(samples, most)
    for name, truth in zip(NAMES[:4], samples.mean(axis=1), strict=True):
        np.testing.assert_allclose(images[name], truth, rtol=1e-7, atol=1e-7 * images["multiple"].max())
    total = samples[:3].sum(axis=0)
    np.testing.assert_allclose(images["radiance"], total.mean(axis=0), rtol=3e-7)
    expected = np.sqrt(one_variance(total).mean((0, 1)) / spp)
    np.testing.assert_allclose(images["stderr"], np.broadcast_to(expected, images["stderr"].shape), rtol=1e-6)
    base = one_variance(total - samples[3]) / spp
    np.testing.assert_allclose(images["base_variance"], base, rtol=1e-5, atol=1e-12 * (total**2).max())


@pytest.mark.parametrize("spp", [2, 3, 4, 5, 8, 13])
def test_the_squared_error_is_unbiased(spp):
    """Of 36 000 pixels of variance 1 + 4, even and odd counts: 4 standard errors of a chi-square of one degree each."""
    samples = np.zeros((4, spp, 100, 120, 3))
    samples[:2] = (
        np.random.default_rng(spp).normal(size=(2, *samples.shape[1:]))
        * np.array([1.0, 2.0])[:, None, None, None, None]
    )
    film = exposed(samples, 3, [spp], lot=100_000)
    variance, size = side_variances(film)[0].numpy()[0], np.prod(samples.shape[2:])
    pixels = tile_pixels(*samples.shape[2:4])[..., None]
    assert abs((variance * pixels).sum() / size - 5.0) < 4.0 * 5.0 * np.sqrt(2.0 / size)


@pytest.mark.parametrize("denoised", [1.0, 4.0])
def test_the_variance_that_samples_are_shared_out_by_is_of_base_and_correction_together(denoised):
    """Half of each sample is correction, so both are off alike: their deviations add up, not their squares."""
    samples = samples_of("uniform", 8)
    samples[3] = 0.5 * samples[:3].sum(axis=0)
    film = exposed(samples, 8, [8])
    mean, variance = statistics(film, denoised)
    total = np.float32(samples[:3]).astype(float).sum(axis=0)
    np.testing.assert_allclose(mean, total.mean(axis=0), rtol=1e-6)
    expected = one_variance(total) * (0.5 + 0.5 / np.sqrt(denoised)) ** 2
    np.testing.assert_allclose(variance, expected, rtol=1e-4, atol=1e-6 * expected.max())


@pytest.mark.parametrize(("spp", "most"), [(1, 1), (8, 3), (13, 5)])
def test_every_second_sample_is_of_the_other_half(spp, most):
    """By its number, however samples come in parts; the correction alike."""
    samples = np.float32(samples_of("uniform", spp)).astype(float)
    sums = exposed(samples, most, [spp]).sums.numpy()
    np.testing.assert_allclose(sums[1], samples[:3, 1::2].sum((0, 1)), rtol=1e-12)
    np.testing.assert_allclose(sums[5], samples[3, 1::2].sum(0), rtol=1e-12)


def test_two_sums_say_the_same_of_light_that_is_all_correction():
    """What is not a number counts as lost in both."""
    samples = samples_of("uniform", 9)
    samples[:2], samples[3], samples[2:, 2, 1, 1] = 0.0, samples[2], np.inf
    many, few = (exposed(samples, 2, [9], sums=sums) for sums in (kernel.SUMS, kernel.CORRECTION_SUMS))
    assert many.lost.numpy() == few.lost.numpy() == 1
    for name, image in developed(few).items():
        assert np.array_equal(image, developed(many)[name]), name


def test_a_standard_error_is_that_of_the_pixels_of_a_tile():
    """A pixel among equals that met one rare bright sample, and those of its tile, claim the same.

    A tenth of what a tile claims is the mean over it and the tiles around: nine, and six or four at the corner.
    """
    samples = np.zeros((4, 8, 36, 36, 3))
    samples[0, 3, 10, 10] = 8.0
    variance = 2.0 * 4.0 / 64 / 8
    squares = develop(samples, 8)["stderr"] ** 2
    np.testing.assert_allclose(squares[8:16, 8:16], variance * (0.9 + 0.1 / 9), rtol=1e-6)
    np.testing.assert_allclose(squares[16:24, 8:24], variance * 0.1 / 9, rtol=1e-6)
    np.testing.assert_allclose(squares[:8, 8:16], variance * 0.1 / 6, rtol=1e-6)
    np.testing.assert_allclose(squares[:8, :8], variance * 0.1 / 4, rtol=1e-6)
    assert not squares[24:].any()
    assert not squares[:, 24:].any()


def test_a_tile_that_the_edge_cuts_takes_pixels_before_it():
    """Of a single pixel the half difference would tell next to nothing. Blocks of two it takes as a whole."""
    samples = np.random.default_rng(3).normal(size=(4, 8, 9, 9, 3))
    whole, alone = (side_variances(exposed(part, 8, [8]))[0].numpy()[0] for part in (samples, samples[:, :, 2:, 2:]))
    np.testing.assert_allclose(whole[1, 1], alone[0, 0], rtol=1e-12)


def test_of_a_tile_with_two_sides_each_claims_by_its_own_samples():
    """How many these are follows from the other side's noise, which must not tell what is claimed."""
    samples = np.random.default_rng(2).normal(size=(4, 32, 8, 8, 3))
    film = exposed(samples, 8, [np.array([[[8]], [[32]]])], sides=2)
    stderr, total, side = developed(film)["stderr"], np.float32(samples[:3]).astype(float).sum(axis=0), sides_of((8, 8))
    for one, n in enumerate((8, 32)):
        expected = np.sqrt(one_variance(total[:n])[side == one].mean(0) / n)
        np.testing.assert_allclose(stderr[side == one], np.broadcast_to(expected, (32, 3)), rtol=1e-6)


def test_the_mean_does_not_stall_however_many_samples_there_are():
    """A million samples of which few are bright: in float32 the many dark ones would no longer move a running mean."""
    rng = np.random.default_rng(2)
    samples = np.zeros((4, 1_000_000, 1, 1, 3), np.float32)
    samples[0] = 1e-3 * rng.pareto(1.8, samples.shape[1:])
    radiance, stderr = map(develop(samples, 1_000_000).get, ("radiance", "stderr"))
    total = samples[0].astype(float)
    np.testing.assert_allclose(radiance[0, 0], total.mean(axis=(0, 1, 2)), rtol=1e-6)
    np.testing.assert_allclose(stderr[0, 0], np.sqrt(one_variance(total)[0, 0] / 1e6), rtol=1e-6)


@wp.kernel(enable_backward=False)
def start(part: wp.array(dtype=int), parts: int, spp: int, first: wp.array(dtype=int)):
    i = wp.tid()
    first[i] = kernel.first_sample(part[i], parts, spp)


@pytest.mark.parametrize(("parts", "spp"), [(7, 1000), (1000, 1000), (524_288, 2_000_000), (3, 2**31 - 2)])
def test_parts_share_the_samples_evenly_and_without_gaps(parts, spp):
    first = run(start, [np.arange(parts + 1, dtype=np.int32), parts, spp], [int])
    assert np.array_equal(first, np.arange(parts + 1, dtype=np.int64) * spp // parts)


def test_layers_sum_to_the_radiance():
    direct, single, multiple, *_, radiance, _ = develop(samples_of("heavy tail", 50), 3).values()
    assert np.array_equal(direct + single + multiple, radiance)


def test_equal_samples_have_no_error():
    radiance, stderr = map(develop(np.full((4, 64, 2, 2, 3), 0.25), 5).get, ("radiance", "stderr"))
    assert np.all(radiance == 0.75)
    assert np.all(stderr == 0.0)


def test_one_sample_has_an_unknown_error_not_a_small_one():
    radiance, stderr = map(develop(samples_of("uniform", 1), 1).get, ("radiance", "stderr"))
    assert np.isfinite(radiance).all()
    assert np.all(np.isinf(stderr))


def test_the_two_sides_of_tiles_may_take_unlike_numbers_of_samples():
    """3 x 4 pixels are one tile, 9 x 17 six; three takes in a row, different in every tile and side."""
    rng = np.random.default_rng(3)
    samples = rng.pareto(1.5, (4, 60, 9, 17, 3))
    takes = [np.full((2, 2, 3), 8), rng.integers(0, 20, (2, 2, 3)), rng.integers(0, 20, (2, 2, 3))]
    radiance = developed(exposed(samples, 6, takes, sides=2, lot=50))["radiance"]
    counts = np.sum(takes, axis=0)
    light = np.float32(samples[:3]).astype(float).sum(axis=0)
    for row, col in ((0, 0), (7, 8), (8, 7), (8, 16), (0, 1)):
        side = (row // 2 + col // 2) % 2
        taken = light[np.arange(counts[side, row // 8, col // 8]) ^ side, row, col]
        np.testing.assert_allclose(radiance[row, col], taken.mean(0), rtol=1e-6)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_samples_that_are_not_numbers_are_counted_and_black(bad):
    samples = samples_of("uniform", 10)
    samples[1, 3, 0, 2, 1] = bad
    samples[2, 7, 2, 0, 0] = bad
    film = exposed(samples, 2, [10])
    samples[:, 3, 0, 2] = samples[:, 7, 2, 0] = 0.0
    radiance = developed(film)["radiance"]
    assert film.lost.numpy()[0] == 2
    np.testing.assert_allclose(radiance, samples[:3].sum(axis=0).mean(axis=0), rtol=1e-6)


# -------------------------------------------------------------------------------------------- one subpath in a pixel


def subpaths(samples, counts, key=0):
    """Film of a correction alone, samples [sample, H, W, 3], whose sides take ``counts``: two, or two of each tile."""
    full = np.zeros((4, *samples.shape))
    full[2] = samples
    take = np.reshape(counts, (2, 1, 1) if np.ndim(counts) == 1 else np.shape(counts))
    return exposed(full, 4, [take], sides=2, sums=kernel.CORRECTION_SUMS, key=key)


def test_pixels_of_the_second_side_begin_with_the_other_half():
    samples = np.arange(1.0, 4.0)[:, None, None, None] * np.ones((3, 8, 8, 3))
    side = sides_of((8, 8))
    for count, first, second in ((1, 1.0, 2.0), (3, 2.0, 7.0 / 3.0)):  # of samples 0; 1; 0, 1, 2; 1, 0 and one beyond
        given = np.concatenate([samples, 4.0 * np.ones((1, 8, 8, 3))])
        sums = subpaths(given, [count, count]).sums.numpy()
        means = np.where(side, second, first)
        np.testing.assert_allclose(sums[0], count * means[..., None] * np.ones(3), rtol=1e-12)
    np.testing.assert_allclose(subpaths(samples, [1, 1]).sums.numpy()[1][..., 0], 2.0 * side)


@pytest.mark.parametrize("shape", [(96, 120), (97, 121)])
def test_of_one_subpath_the_squared_error_is_unbiased(shape):
    """By neighbours, which are of one side; also at an edge with half a pair. Pairs are chi-square of one degree."""
    samples = 2.0 * np.random.default_rng(4).normal(size=(2, *shape, 3))
    film = subpaths(samples, [1, 1])
    pixels = tile_pixels(*shape)[..., None]
    variance = (side_variances(film)[0].numpy().mean(0) * pixels).sum((0, 1)) / np.prod(shape)
    assert np.abs(variance - 4.0).max() < 4.0 * 4.0 * np.sqrt(4.0 / np.prod(shape))
    images = developed(film)
    assert not images["base_variance"].any()  # all is correction
    assert np.isfinite(images["stderr"]).all()


@pytest.mark.parametrize("many", [2, 3, 64])
def test_of_one_subpath_at_a_lone_edge_next_to_tiles_with_more_the_squared_error_is_unbiased(many):
    """The last row pairs with pixels of other tiles, which have ``many``; the light is the same everywhere."""
    shape = (9, 400)
    samples = 5.0 + 2.0 * np.random.default_rng(9).normal(size=(many + 1, *shape, 3))
    take = np.full((2, 2, 50), many)
    take[:, 1] = 1
    last = statistics(subpaths(samples, take))[1][8]
    assert np.abs(last.mean(0) - 4.0).max() < 4.0 * 4.0 * np.sqrt(2.0 / len(last))


def test_of_one_subpath_slopes_of_the_light_count_as_noise_but_not_in_blocks():
    """A step of 0.1 to each next column: of blocks of four samples twice that, so 8 times its square."""
    samples = 0.1 * np.arange(24.0)[None, None, :, None] * np.ones((2, 16, 1, 3))
    film = subpaths(samples, [1, 1])
    variance, blocks = side_variances(film)[0].numpy(), tile_variances(film)
    np.testing.assert_allclose(variance, 8.0 * 0.1**2, rtol=1e-5)
    np.testing.assert_allclose(blocks, 0.0, atol=1e-12)


def test_what_one_side_is_told_of_noise_is_of_the_other_side_alone():
    """Noise in one side: the variance of the other's only samples is none."""
    side = sides_of((16, 16))
    samples = np.random.default_rng(6).normal(size=(2, 16, 16, 3)) * side[..., None]
    film = subpaths(samples, [1, 1])
    _, variance = statistics(film)
    assert not variance[side == 0].any()
    assert variance[side == 1].min() > 0.0


@pytest.mark.parametrize("shape", [(9, 9), (10, 10), (10, 17)])
@pytest.mark.parametrize("count", [0.25, 1])
def test_light_without_noise_has_no_error_in_corners_whose_pixels_are_all_of_one_side(shape, count):
    """Such a tile borrows pixels before it; its own few would tell half of the light."""
    blocks = tile_variances(subpaths(np.full((2, *shape, 3), 3.0), [count] * 2))
    np.testing.assert_allclose(blocks, 0.0, atol=1e-12)


@pytest.mark.parametrize("shared", [0.0, 1.0])
@pytest.mark.parametrize(("counts", "least", "most"), [((1, 1), 1.0, 1.0), ((1, 3), 1.0, 1.5), ((2, 1), 1.0, 1.5)])
def test_block_variances_of_one_subpath_are_those_of_block_means(counts, least, most, shared):
    """As below; where one side has more samples, what these are off by counts twice, so too much is claimed."""
    rng, films = np.random.default_rng(8), 400
    estimates, means = [], []
    for _ in range(films):
        samples = 5.0 + rng.normal(size=(4, 8, 8, 3))
        for half in (0, 1):
            samples[half::2] += shared * rng.normal()
        film = subpaths(samples, counts)
        estimates.append(tile_variances(film)[0, 0])
        means.append(developed(film)["radiance"].mean((0, 1)))
    ratio = np.mean(estimates, axis=0) / np.var(means, axis=0, ddof=1)
    unsure = np.exp(4.0 * np.sqrt(4.0 / films))
    assert least / unsure < ratio.min()
    assert ratio.max() < most * unsure


# ----------------------------------------------------------------------------------------- fewer samples than pixels


@pytest.mark.parametrize("of_block", [1, 2, 3])
def test_of_a_block_with_fewer_samples_than_pixels_each_pixel_is_as_likely_and_right_in_the_mean(of_block):
    """Over keys: the number of hits of a pixel is binomial. Pixels of a block that the edge cuts always have one."""
    keys = 400
    light = 1.0 + np.arange(17 * 24).reshape(17, 24, 1) * np.ones(3)
    films = [subpaths(np.stack([light] * 2), [0.25 * of_block] * 2, key) for key in range(keys)]
    images = np.array([developed(film)["radiance"] for film in films])
    seen = images[:, :16, :, 0] > 0
    assert np.all(seen.reshape(keys, 8, 2, 12, 2).sum((2, 4)) == of_block)
    chance = of_block / 4
    off = (seen.mean(0) - chance) / np.sqrt(chance * (1 - chance) / keys)
    assert np.abs(off).max() < 5.0
    assert 0.8 < np.mean(off**2) < 1.2
    np.testing.assert_allclose(images[:, :16], np.where(seen[..., None], light[:16] / chance, 0.0), rtol=1e-6)
    np.testing.assert_allclose(images[:, 16], np.broadcast_to(light[16], images[:, 16].shape), rtol=1e-6)


def test_two_samples_of_a_block_are_across_the_corner():
    """For a denoiser: two in a row or column would leave more of a hole."""
    images = developed(subpaths(np.ones((2, 16, 16, 3)), [0.5, 0.5]))["radiance"][..., 0]
    blocks = images.reshape(8, 2, 8, 2).swapaxes(1, 2)
    assert np.array_equal(blocks[..., 0, 0], blocks[..., 1, 1])
    assert np.array_equal(blocks[..., 0, 1], blocks[..., 1, 0])
    assert np.all(blocks[..., 0, 0] != blocks[..., 0, 1])
    assert 0.2 < np.mean(blocks[..., 0, 0] > 0) < 0.8


@pytest.mark.parametrize("counts", [(0.25, 0.25), (0.5, 0.5), (0.75, 0.75), (0.25, 1), (0.5, 3)])
def test_of_fewer_samples_than_pixels_errors_are_what_images_with_other_random_numbers_differ_by(counts):
    """Light 3 with a deviation of 2: squared errors of pixels, of tiles' means, and what a sample is told to vary.

    Errors of tiles have one degree of freedom each; where a side has more samples, what these are off by counts twice.
    """
    rng, films, shape = np.random.default_rng(11), 100, (40, 48)
    images, claimed, blocks, variances = [], [], [], []
    for key in range(films):
        film = subpaths(3.0 + 2.0 * rng.normal(size=(4, *shape, 3)), counts, key)
        image = developed(film)
        images.append(image["radiance"])
        claimed.append(image["stderr"])
        blocks.append(tile_variances(film))
        variances.append(statistics(film)[1])
    images, claimed = np.array(images, float), np.square(claimed, dtype=float)
    spread, side = images.var(axis=0, ddof=1), sides_of(shape)
    for one in (0, 1):
        n = counts[one]
        truth = 4.0 / n + 9.0 * max(1.0 / n - 1.0, 0.0)
        error = np.sqrt(2.0 / films / (side == one).sum()) * 4.0 * (1.0 + 9.0 / 4.0)  # tails of what is seen or not
        assert spread[side == one].mean() / truth == pytest.approx(1.0, abs=4.0 * error)
        assert claimed[:, side == one].mean() / truth == pytest.approx(1.0, abs=4.0 * error)
        assert np.mean(variances, axis=0)[side == one].mean() == pytest.approx(4.0, rel=4.0 * error)
    tiles = images.reshape(films, 5, 8, 6, 8, 3).mean((2, 4))
    ratio = np.mean(blocks) / tiles.var(axis=0, ddof=1).mean()
    unsure = np.exp(4.0 * np.sqrt(4.0 / films / 30))
    assert 1.0 / unsure < ratio < unsure * (1.5 if max(counts) > 1 else 1.0)


def test_where_all_of_the_light_is_noise_fewer_samples_than_pixels_claim_so():
    """One path in a hundred carries light: the mean is dark, and the chance to have a sample adds next to nothing."""
    rng, films, shape = np.random.default_rng(12), 100, (40, 48)
    images = [
        developed(subpaths(100.0 * (rng.random((2, *shape, 3)) < 0.01), [0.25, 0.25], key)) for key in range(films)
    ]
    spread = np.array([image["radiance"] for image in images], float).var(axis=0, ddof=1).mean()
    claimed = np.square([image["stderr"] for image in images], dtype=float).mean()
    assert claimed / spread == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / (films * 40 * 48 / 4 * 0.01)))


# ------------------------------------------------------------------------------------------------------------- blocks


@pytest.mark.parametrize("shared", [0.0, 1.0])
def test_block_variances_are_those_of_block_means_shared_errors_included(shared):
    """Over many films: noise of each pixel, and the same in all pixels of a half. The last block is 3 x 4 pixels."""
    rng, spp, films = np.random.default_rng(5), 5, 400
    estimates, means = [], []
    for _ in range(films):
        samples = np.zeros((4, spp, 11, 12, 3))
        samples[0] = 5.0 + rng.normal(size=samples.shape[1:])
        for half in (0, 1):
            samples[0, half::2] += shared * rng.normal()
        film = exposed(samples, 3, [spp])
        image = developed(film)["radiance"]
        estimates.append(tile_variances(film)[[0, 1], [0, 1]])
        means.append([image[:8, :8].mean((0, 1)), image[8:, 8:].mean((0, 1))])
    # estimates are chi-square with one degree of freedom; channels have what is shared in common
    ratio = np.mean(estimates, axis=0) / np.var(means, axis=0, ddof=1)
    assert np.abs(np.log(ratio)).max() < 4.0 * np.sqrt(2.0 / films + 2.0 / films)


def test_block_variances_are_unknown_after_one_sample():
    assert np.isinf(tile_variances(exposed(samples_of("even", 1), 4, [1]))).all()
