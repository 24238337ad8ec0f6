"""Standard errors against how images with other random numbers differ; halves that are independent; no noise at all."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from chance import ALPHA, assert_plausible, two_sided
from physics.rig import VAROS_LAMPS, VAROS_WATER, one_ray_scene
from scipy import stats
from spread import absolute, assert_honest, evenly, relative

from varos_warp.kernels.film.film import IN_BLOCK, TILE
from varos_warp.render import radiance
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Part

PAPER_WATER = VAROS_WATER | {"phase": {"g": 0.8}}
SEEDS, SPP, SHAPE = 48, 8, (24, 40)
SLOPES = 0.2
"""Bound on the bias of squared standard errors of few samples: what blocks of 2 x 2 pixels differ by counts as noise,
which is much in so small an image."""
BIAS = 3e-3
"""Stated bound on the field's bias, as a share of the light."""


def boxed(extents, centre, reflectance, name):
    mesh = trimesh.creation.box(extents).apply_translation(centre)
    return Part(
        name, np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32), Diffuse(reflectance=[reflectance] * 3)
    )


FLOOR_AND_BOX = [boxed((20, 20, 1), (0, 6, -1.5), 0.4, "floor"), boxed((0.6, 0.6, 0.6), (0.2, 2.2, -0.8), 0.6, "box")]


def renderer_of(parts, denoise="none") -> FrameRenderer:
    """The paper's water and lamps."""
    view = {"resolution": SHAPE[::-1], "sensor_mm": [6.0, 3.6], "focal_mm": 4.0, "rotation_euler_deg": [-15, 0, 0]}
    scene = Scene(
        water={"coefficients": PAPER_WATER},
        vehicle={"lights": VAROS_LAMPS, "cameras": [view]},
        trajectory={"poses": [{"position": [0, 0, 0]}]},
        render={"denoise": denoise},
    )
    return FrameRenderer(scene, "cpu", parts=parts)


@pytest.fixture(scope="module", params=["path", "field", "field, shared out"])
def renderings(request):
    """Images of a box on a floor: radiance, errors, samples, and means of the two halves [seeds, H, W, 3]."""
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "field":
            patch.setattr(radiance, "share_out", evenly)
        return rendered(request.param.partition(",")[0])


def rendered(integrator):
    """Images of each seed."""
    renderer = renderer_of(FLOOR_AND_BOX)
    films, keep = [], renderer.films.keep

    def kept(film):
        films.append((film.count.numpy().copy(), film.sums.numpy().copy()))
        keep(film)

    renderer.films.keep = kept
    how = {"outputs": "A", "integrator": integrator, "spp": SPP}
    images = [renderer.render(np.eye(4), seed=300 + k, **how).A for k in range(SEEDS)]
    # an image is the sum of two films: the camera's segments, and subpaths
    count = np.array([per_pixel(count) for count, _ in films]).reshape(SEEDS, 2, *SHAPE, 1)
    # multiple, odd, and of segments direct and single (kernels/film/film.py, sums_of)
    total = np.array([sums[0] + sums[2:4].sum(axis=0) for _, sums in films]).reshape(SEEDS, 2, *SHAPE, 3)
    odd = np.array([sums[1] for _, sums in films]).reshape(SEEDS, 2, *SHAPE, 3)
    side = (np.indices(SHAPE) // 2).sum(0)[..., None] % 2
    evens = (count + 1 - side * (count.max() > count.min())) // 2
    halves = (((total - odd) / evens).sum(axis=1), (odd / (count - evens)).sum(axis=1))
    return SimpleNamespace(
        radiance=np.array([image.radiance for image in images], float),
        count=count,
        kinds=total / count,
        halves=halves,
        stderr=np.array([image.stderr for image in images], float),
        block_error=np.array([image.block_error for image in images], float),
        base=np.array([image.radiance - image.correction for image in images], float),
        base_variance=np.array([image.base_variance for image in images], float),
    )


def per_pixel(count):
    """Numbers of the sides of tiles as an image [H, W]."""
    row, col = np.indices(SHAPE)
    return count[(row // 2 + col // 2) % len(count), row // int(TILE), col // int(TILE)] // int(IN_BLOCK)


@pytest.mark.parametrize("ratio", [absolute, relative])
def test_standard_errors_are_what_images_with_other_random_numbers_differ_by(renderings, ratio):
    """Pixel by pixel, as means over tiles, also where samples are shared out."""
    assert_honest(ratio, renderings.kinds, renderings.stderr, renderings.count)


def over_the_image(radiance, claimed, count, where):
    """Mean of what is claimed over the mean spread of the images [3]."""
    return claimed.mean((0, 1, 2)) / radiance.var(axis=0, ddof=1).mean((0, 1))


def test_bases_differ_by_what_their_variance_says(renderings):
    """Each pixel's own, and edges have most of it: so on average over the image."""
    assert_honest(over_the_image, renderings.base, np.sqrt(renderings.base_variance))


def test_image_means_differ_by_what_their_standard_errors_say(renderings):
    """Chi-square bounds: what pixels share (virtual lights) shows here alone. Of 240 images: 1.02 to 1.19, +- 0.09."""
    pixels = np.prod(SHAPE)
    spread = renderings.radiance.mean((1, 2)).var(axis=0, ddof=1)
    chi2 = (SEEDS - 1) * spread / (np.square(renderings.stderr).mean((0, 1, 2)) / pixels)
    low, high = stats.chi2.ppf([ALPHA / 6, 1 - ALPHA / 6], SEEDS - 1)
    assert np.all((low < chi2) & (chi2 < high)), chi2 / (SEEDS - 1)


def test_block_means_differ_by_what_their_errors_say(renderings):
    """As a mean over all blocks; the jackknife over the seeds tells how well that is known."""
    rows, cols = (side // int(TILE) for side in SHAPE)
    means = renderings.radiance.reshape(SEEDS, rows, TILE, cols, TILE, 3).mean((2, 4))
    every = np.arange(SEEDS)

    def log_ratio(kept):
        claimed = np.square(renderings.block_error[kept]).mean((0, 1, 2))
        return np.log(claimed / means[kept].var(axis=0, ddof=1).mean((0, 1)))

    pseudo = SEEDS * log_ratio(every) - (SEEDS - 1) * np.array([log_ratio(every != k) for k in every])
    error = pseudo.std(axis=0, ddof=1) / np.sqrt(SEEDS)
    assert error.max() < 0.25
    assert_plausible(2.0 * stats.t.sf(np.abs(pseudo.mean(axis=0)) / error, SEEDS - 1))


def test_errors_of_one_sample_with_the_field_are_what_images_differ_by():
    """Many pixels have a single subpath then, whose noise neighbours tell. Without the field it is not told."""
    renderer = renderer_of(FLOOR_AND_BOX)
    images = [renderer.render(np.eye(4), outputs="A", integrator="field", spp=1, seed=500 + k).A for k in range(96)]
    radiance, stderr, base_variance = (
        np.array([getattr(image, name) for image in images], float) for name in ("radiance", "stderr", "base_variance")
    )
    assert_honest(over_the_image, radiance, stderr, bias=SLOPES)
    base = radiance - [image.correction for image in images]
    assert_honest(over_the_image, base, np.sqrt(base_variance))
    assert np.isinf(renderer.render(np.eye(4), outputs="A", integrator="path", spp=1).A.stderr).all()


@pytest.fixture(scope="module")
def for_a_denoiser():
    """A renderer of such images, and some of many samples."""
    renderer = renderer_of(FLOOR_AND_BOX, "oidn")
    return renderer, [
        renderer.render(np.eye(4), outputs="A", integrator="field", spp=32, seed=k).A.radiance for k in range(6)
    ]


@pytest.mark.parametrize("spp", [0.25, 0.5, 1, 2])
def test_errors_of_images_for_a_denoiser_are_what_images_differ_by(for_a_denoiser, spp):
    """Of few samples most blocks have less than one subpath a pixel; and their means are right.

    Image means: four standard errors of the difference to images of many samples. Those of tiles' means are estimates
    of one degree of freedom, where sides take unlike numbers too large (kernels/film `tile_variances`).
    """
    (renderer, many), seeds = for_a_denoiser, 96
    images = [
        renderer.render(np.eye(4), outputs="A", integrator="field", spp=spp, seed=700 + k).A for k in range(seeds)
    ]
    radiance, stderr, base_variance, blocks = (
        np.array([getattr(image, name) for image in images], float)
        for name in ("radiance", "stderr", "base_variance", "block_error")
    )
    assert images[0].spp == pytest.approx(max(spp, 0.336), rel=0.06)  # two segments and a quarter of a subpath
    assert_honest(over_the_image, radiance, stderr, bias=SLOPES)
    base = radiance - [image.correction for image in images]
    assert_honest(over_the_image, base, np.sqrt(base_variance))
    rows, cols = (side // int(TILE) for side in SHAPE)
    tiles = radiance.reshape(seeds, rows, TILE, cols, TILE, 3).mean((2, 4))
    ratio = np.square(blocks).mean((0, 1, 2)) / tiles.var(axis=0, ddof=1).mean((0, 1))
    assert np.all((ratio > 0.75) & (ratio < 1.6)), ratio
    means = [np.array(kind, float).mean((1, 2)) for kind in (radiance, many)]
    error = np.sqrt(sum(mean.var(axis=0, ddof=1) / len(mean) for mean in means))
    assert np.all(np.abs(means[0].mean(0) - means[1].mean(0)) < 4.0 * error)


def test_fractions_of_a_sample_count_with_the_field_and_are_rounded_up_without():
    renderer = renderer_of(FLOOR_AND_BOX)
    taken = [renderer.render(np.eye(4), outputs="A", integrator=name, spp=1.25).A.spp for name in ("field", "path")]
    assert taken == [pytest.approx(1.25, abs=0.05), 2.0]


@pytest.mark.parametrize("renderings", ["path", "field"], indirect=True)
def test_the_two_halves_of_samples_are_independent(renderings):
    """Correlation over the seeds, pixel by pixel: its variance is 1/(seeds - 1), whatever the distribution.

    Virtual lights too: each half has its own.
    """
    even, odd = (half - half.mean(axis=0) for half in renderings.halves)
    r = (even * odd).sum(axis=0) / np.sqrt((even**2).sum(axis=0) * (odd**2).sum(axis=0))
    assert_plausible(two_sided(r.mean((0, 1)) * np.sqrt(np.prod(SHAPE) * (SEEDS - 1))))


# ------------------------------------------------------------------------------------------------------- open water


def test_open_water_without_surfaces_has_no_noise_with_the_field():
    """Beyond what rounding of the ray makes of light within a pixel; and nothing is left to correct."""
    ray = FrameRenderer(one_ray_scene(VAROS_LAMPS, PAPER_WATER, pixels=8), "cpu", parts=[])
    image = ray.render(np.eye(4), outputs="A", integrator="field", spp=8, denoise="none").A
    assert np.all(image.stderr <= 2e-6 * image.radiance)
    assert not image.correction.any()
    assert not renderer_of([]).render(np.eye(4), outputs="A", integrator="field", spp=4).A.correction.any()


def test_paths_have_the_mean_of_the_field_in_open_water():
    """Image means: four standard errors of both beside the stated bias."""
    renderer = renderer_of([])
    path, field = (
        renderer.render(np.eye(4), outputs="A", integrator=name, spp=spp, seed=k).A
        for k, (name, spp) in enumerate((("path", 128), ("field", 8)))
    )
    means = [image.radiance.astype(float).mean((0, 1)) for image in (path, field)]
    variance = [np.square(image.stderr, dtype=float).mean((0, 1)) / np.prod(SHAPE) for image in (path, field)]
    error = np.sqrt(sum(variance))
    assert np.all(error < 5e-3 * means[0])
    assert np.all(np.abs(means[0] - means[1]) < 4.0 * error + BIAS * means[0])
