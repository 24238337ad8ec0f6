"""Sweeps over cameras, films and what becomes of an image: fields of view, samples, memory, half floats, exposure."""

import time
import warnings

import numpy as np
import warp as wp

from benchmarks.stability.entry import Sweeps
from benchmarks.stability.transport import run
from benchmarks.stability.transport_surfaces import scene_of, shot, wall
from varos_warp.kernels.film.develop import half_difference
from varos_warp.kernels.film.film import Sums, add_sample
from varos_warp.products.images.radiance import to_half
from varos_warp.render.image import exposure
from varos_warp.render.renderer import FrameRenderer


def field_error(angle_deg: float) -> float:
    """Largest relative error of depth and range of a wall, over a field of view [degrees]."""
    tangent = np.tan(np.radians(angle_deg) / 2)
    sensor = max(1e-2, 2e-3 * tangent)
    scene = scene_of([], sensor_mm=(sensor, sensor), focal_mm=sensor / 2 / tangent, resolution=(16, 16))
    image = shot(scene, [wall(2.5, 2.5 * tangent * 1.1)]).D
    x, y = np.meshgrid(*2 * [((np.arange(16) + 0.5) / 8 - 1) * tangent])
    truth = 2.5 * np.sqrt(1 + x * x + y * y)
    return float(max(np.abs(image.depth / 2.5 - 1).max(), np.abs(image.range / truth - 1).max()))


def resolution_seconds(side: int) -> tuple[float, float]:
    """CPU time of a pixel of A, direct light, and of D [microseconds]."""
    lamp = {"kind": "point", "position": (0.1, 0.0, 0.0), "intensity": (1.0, 1.0, 1.0)}
    scene = scene_of([lamp], resolution=(side, side), sensor_mm=(6.0, 6.0))
    renderer = FrameRenderer(scene, "cpu", parts=[wall(3.0, 20.0)])
    seconds = []
    for letter in "AD":
        start = time.process_time()
        image = renderer.render(np.eye(4), outputs=letter, spp=1, layers=("direct",), integrator="path")
        seconds.append((time.process_time() - start) / side**2 * 1e6)
        values = image.A.radiance if letter == "A" else image.D.depth
        assert values.shape[:2] == (side, side)
        assert np.isfinite(values).all()
    return tuple(seconds)


@wp.kernel(enable_backward=False)
def _accumulate(samples: wp.array(dtype=float), repeat: int, out: wp.array(dtype=wp.vec3d)):
    """Means by the film, by a float32 sum, and by a float32 running mean; then the film's standard error."""
    sums = Sums()
    black = wp.vec3(0.0)
    total = float(0.0)
    mean = float(0.0)
    n = samples.shape[0]
    count = int(0)
    for _round in range(repeat):
        k = int(0)
        while k < n:
            x = samples[k]
            sums = add_sample(sums, count, wp.vec3(x), black, black, black)
            total += x
            count += 1
            mean += (x - mean) / float(count)
            k += 1
    m = wp.float64(count)
    out[0] = wp.vec3d(sums.direct[0] / m, wp.float64(total) / m, wp.float64(mean))
    out[1] = wp.vec3d(wp.abs(half_difference(sums.direct, sums.odd, count, 0)[0]))


def film_errors(count: int) -> list[float]:
    """Relative errors of means by film, float32 sum, float32 running mean, and of the film's standard error."""
    samples = np.random.default_rng(1).exponential(size=min(count, 10**6)).astype(np.float32)
    repeat = max(1, count // 10**6)
    got = run(_accumulate, [samples, repeat], 2, wp.vec3d)
    apart = samples[::2].mean(dtype=float) - samples[1::2].mean(dtype=float)
    stderr = 0.5 * abs(apart)  # of two halves
    return [*np.abs(got[0] / samples.mean(dtype=float) - 1), abs(got[1][0] / stderr - 1)]


def half_error(radiance: float) -> float:
    """Largest relative error of half floats of radiances within a decade; nan where they are cut, and counted."""
    values = (radiance * np.geomspace(1.0, 9.99, 10_000)).astype(np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns of images as dark as these
        half, cut = to_half(values)
    return np.nan if cut else float(np.abs(half.astype(float) / values - 1).max())


def exposure_error(radiance: float) -> float:
    """How far the exposed value of a constant image is from the key value."""
    image = np.full((4, 4, 3), radiance, np.float32)
    gain = exposure.gains("adaptive", "A", np.zeros(1), [exposure.statistics(image)])[0]
    return float(abs(radiance * gain / exposure.KEY_VALUE - 1))


SWEEPS: Sweeps = {
    "field_of_view": {"depth, range": field_error},
    "resolution": {("A, direct, 1 sample [us]", "D [us]"): resolution_seconds},
    "samples_per_pixel": {
        ("film (float64)", "float32 sum", "float32 running mean", "standard error, film"): film_errors
    },
    "radiance_in_half_floats": {"half float": half_error},
    "exposure_of_a_constant_image": {"key value": exposure_error},
}
