"""Denoising of linear radiance: Open Image Denoise, or non-local means (paper 3.2.1).

An image of paths has a correction, what subpaths carry, which holds nearly all its noise, and a base: direct light,
single scattering and the field, noisy mainly at edges, in textures and where a lens blurs. They are denoised apart.
The base is then mixed with itself before denoising, by its variance: so it keeps its detail, and what is certain for
some pixels around stays as it is. Values of the correction may be negative, and clipping them would brighten the
image: what is positive and what is negative are denoised as two images, each of which a denoiser takes.

With the field the base is nearly free of noise, so it guides the correction, with albedo and normals of surfaces as far
as light comes from them (`correction_guides`). B has no water: albedo and normals keep its textures and edges; its
albedo is the mean over its samples, which has edges as smooth as the image, unless an exposure blurs it.
"""

import atexit
import functools
import sys
import threading
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.ndimage import correlate1d, gaussian_filter, uniform_filter

from varos_warp.errors import warn
from varos_warp.products.images.registry import DENOISE_KEYS

METHODS = ("oidn", "nlm", "none")


def denoise(radiance: np.ndarray, stderr: np.ndarray, method: str, albedo=None, normal=None) -> np.ndarray:
    """Linear radiance float32 [H, W, 3] with less noise.

    Args:
        radiance: Linear radiance [H, W, 3].
        stderr: Its standard error [H, W, 3]; where it is zero throughout, there is nothing to denoise.
        method: ``oidn``, ``nlm`` or ``none`` (which returns the radiance itself).
        albedo: Guide [H, W, 3] of ``oidn``, in [0, 1]; absent with ``normal``: none.
        normal: Guide [H, W, 3], in [-1, 1].

    Raises:
        ValueError: If a value is not finite, or the method is unknown.
    """
    method = available_method(method)
    radiance = np.ascontiguousarray(radiance, np.float32)
    if method == "none" or not np.any(stderr) or not np.any(radiance):
        return radiance
    check_finite(radiance)
    return _oidn(radiance, albedo=albedo, normal=normal) if method == "oidn" else _nlm(radiance, stderr)


def denoisers_of(render: Any) -> dict[str, str]:
    """What denoises the image types that have a denoiser of their own, by their letters, as far as it is available.

    ``render`` is a scene's block of this name.
    """
    return {letter: available_method(getattr(render, key)) for letter, key in DENOISE_KEYS.items()}


def denoise_image(image, method: str) -> np.ndarray:
    """Linear radiance float32 [H, W, 3] of an image, with less noise.

    Of an image with a ``correction`` that and the rest, the base, are denoised apart, and what is negative of the sum
    is cut. ``albedo`` and ``normal`` guide the correction, or the whole, if the image has them.

    Args:
        image: `frame.RadianceImage`.
        method: ``oidn``, ``nlm`` or ``none`` (which returns the radiance itself).

    Raises:
        ValueError: If a value is not finite, or the method is unknown.
    """
    if image.correction is None or method == "none":
        return denoise(image.radiance, image.stderr, method, image.albedo, image.normal)
    check_finite(image.radiance)
    check_finite(image.correction)
    result = image.radiance - image.correction
    if image.base_variance.any():
        clean = part_denoised(result, np.sqrt(image.base_variance), method)
        result = mix(clean, result, image.base_variance)
    guides = {} if image.albedo is None else correction_guides(image.albedo, image.normal, result)
    for sign in (np.float32(1.0), np.float32(-1.0)):
        result += sign * part_denoised(sign * image.correction, image.stderr, method, **guides)
    return np.maximum(result, np.float32(0.0))


def part_denoised(part: np.ndarray, stderr: np.ndarray, method: str, **guides) -> np.ndarray:
    """What is positive of a part of an image, denoised."""
    part = np.maximum(part, np.float32(0.0))
    if not part.any():
        return part
    if available_method(method) == "nlm":
        return _nlm(part, stderr)
    return _oidn(part, PART_QUALITY, **guides)


def correction_guides(albedo: np.ndarray, normal: np.ndarray, base: np.ndarray) -> dict[str, np.ndarray]:
    """What guides the denoiser of a correction: as ``albedo`` its mean with the base over itself plus its mean.

    The correction is light of surfaces and water, as the base is, and has the same edges, shadows and textures, as
    strong as they are seen through the water. Surfaces' albedo alone would draw them at full strength, whatever water
    is before them. `benchmarks.guides` compares such guides.

    Args:
        albedo: Of surfaces and water, weighted by the light of each, in [0, 1] (`RadianceImage.albedo`).
        normal: The same of normals.
        base: All but the correction, denoised.
    """
    light = np.maximum(base, np.float32(0.0))
    mean = light.mean(0, dtype=np.float64).mean(0).astype(np.float32)
    shown = np.divide(light, light + mean, out=np.zeros_like(light), where=light > 0.0)
    return {"albedo": np.float32(0.5) * (albedo + shown), "normal": normal}


NEAR, FAR = 3, 11
"""Sides [pixels] of what `mix` looks at. Where rare bright samples were missed, the mean is too low and the variance
too: with the variance of the nearest pixels alone, such places would count as certain, and come out too dark."""


def mix(smooth: np.ndarray, noisy: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """A denoised image and the noisy one, mixed for the least error where the variance of the noise is known.

    The mean square of what is between the two is noise, which is known, and what the denoiser has taken away: B in all
    that noise does not explain. The share of the noisy image is B / (B + variance). So what a denoiser takes for noise
    and is not comes back, the more the better it is known (a shrinkage estimate, as of James and Stein 1961).

    Args:
        smooth: Radiance [H, W, 3].
        noisy: The same before denoising.
        variance: Of ``noisy`` about its mean; may be infinite.
    """
    difference = noisy - smooth
    apart = _around(difference.astype(np.float64) ** 2, NEAR)
    noise = np.maximum(*(_around(variance.astype(np.float64), side) for side in (NEAR, FAR)))
    share = np.divide(apart - noise, apart, out=np.zeros_like(apart), where=apart > noise)
    return smooth + share.astype(np.float32) * difference


def _around(image: np.ndarray, side: int) -> np.ndarray:
    """Means [H, W, 3] over squares; no running sums, in which a bright pixel leaves its rounding to all after it."""
    def sums(values):
        return correlate1d(correlate1d(values, np.ones(side), axis=0, mode="constant"), np.ones(side), axis=1,
                           mode="constant")

    return sums(image) / sums(np.ones((*image.shape[:2], 1)))


def check_finite(image: np.ndarray) -> None:
    """Refuse infinite values and what is not a number.

    Raises:
        ValueError: If there are any.
    """
    if not np.isfinite(image).all():
        raise ValueError(f"cannot denoise: {np.count_nonzero(~np.isfinite(image))} values are not finite")


QUALITY, PART_QUALITY = "high", "balanced"
"""Of Open Image Denoise: of a whole image, and of a base or correction.

Of corrections both leave the same error within 1 %, the second in half the time; the fast one leaves 7 % more
(Munkholmen, 1280 x 720, 12 samples). Without the negative part the image would be too bright by 0.2 % in blue (4
samples)."""


def open_image_denoise():
    """The module ``pyoidn``, imported without torch.

    Where torch is installed, ``pyoidn`` imports it, which takes seconds, but needs it only for tensors.

    Raises:
        ImportError, OSError: If it cannot be loaded.
    """
    if not {"pyoidn", "torch"} & {*sys.modules}:
        sys.modules["torch"] = None
        try:
            import pyoidn
        finally:
            del sys.modules["torch"]
        for name, module in [*sys.modules.items()]:  # others may give it tensors
            if name.startswith("pyoidn.") and hasattr(module, "TORCH_AVAILABLE"):
                module.TORCH_AVAILABLE = find_spec("torch") is not None
    import pyoidn

    return pyoidn


@functools.cache
def available_method(method: str) -> str:
    """``method``, or ``nlm`` where Open Image Denoise cannot be loaded; says so once."""
    if method not in METHODS:
        raise ValueError(f"denoise must be oidn, nlm or none, got {method!r}")
    if method != "oidn":
        return method
    try:
        open_image_denoise()
    except (ImportError, OSError) as error:
        warn(f"Open Image Denoise is not available ({error}); non-local means takes its place, for which B needs more "
             "samples: render.spp_b: 20")
        return "nlm"
    return "oidn"


MOST_MB = 300
"""Memory that Open Image Denoise may take on a CPU [MB], about: it works in tiles then, with the same bytes. Without a
bound an image of 1280 x 720 takes 550, and four fifths of the time."""
_one_at_a_time = threading.Lock()


def _oidn(radiance: np.ndarray, quality: str = QUALITY, albedo=None, normal=None) -> np.ndarray:
    """Open Image Denoise on the CPU, all cores; its bytes do not depend on the number of threads.

    It adds 1e-4 of its own to very dark images, so the image is brought to a mean near 1 first.
    """
    mean = float(radiance.mean(dtype=np.float64))
    scale = np.float32(2.0 ** -np.round(np.log2(mean)))  # a power of two: exact
    images = {"color": radiance * scale, "output": np.empty_like(radiance)}
    if albedo is not None and normal is not None:
        images |= {name: np.ascontiguousarray(guide, np.float32) for name, guide in (("albedo", albedo),
                                                                                     ("normal", normal))}
    with _one_at_a_time:
        _filter(images, quality)
    images["output"] /= scale
    return images["output"]


def _filter(images: dict[str, np.ndarray], quality: str) -> None:
    """Denoise ``color`` into ``output``, all of them contiguous float32.

    With a filter of its own, for one that is kept keeps its memory, too.
    """
    pyoidn, device = open_image_denoise(), _cpu_device()
    filter_ = pyoidn.Filter(device, pyoidn.OIDN_FILTER_TYPE_RT)
    try:
        for name, image in images.items():
            filter_.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
        filter_.set_bool("hdr", True)
        filter_.set_bool("cleanAux", "albedo" in images)
        filter_.set_quality({"high": pyoidn.OIDN_QUALITY_HIGH, "balanced": pyoidn.OIDN_QUALITY_BALANCED}[quality])
        filter_.set_int("maxMemoryMB", MOST_MB)
        filter_.commit()
        filter_.execute()
        if (error := device.get_error()) is not None:
            raise RuntimeError(f"Open Image Denoise: {error}")
    finally:
        filter_.release()


@functools.cache
def _cpu_device():
    """Open Image Denoise's CPU device; released at exit, before its library."""
    pyoidn = open_image_denoise()
    device = pyoidn.Device(pyoidn.OIDN_DEVICE_TYPE_CPU)
    device.commit()
    atexit.register(device.release)
    return device


def _nlm(radiance: np.ndarray, stderr: np.ndarray) -> np.ndarray:
    """Non-local means in the square-root domain, where the noise of a path tracer is more nearly uniform.

    What is left of its variation (shadows are noisier than open places) is met by a few strengths, between which each
    pixel takes its own. The mean of square roots is too dark, so the local mean of the linear image is restored.
    """
    from skimage.restoration import denoise_nl_means

    radiance = np.maximum(radiance, 0.0)
    sigma = _sigma_of_root(radiance, stderr)
    low, high = np.percentile(sigma[sigma > 0.0], [10.0, 98.0]) if np.any(sigma > 0.0) else (0.0, 0.0)
    if not high > 0.0:
        return radiance
    steps = int(np.ceil(np.log(high / low) / np.log(_STRENGTH_RATIO)))
    levels = np.geomspace(low, high, min(steps, _STRENGTHS - 1) + 1)
    root = np.sqrt(radiance)
    smooth = [denoise_nl_means(root, patch_size=5, patch_distance=3, h=0.8 * level, sigma=level, fast_mode=True,
                               channel_axis=-1).astype(np.float32) ** 2 for level in levels]
    smooth = _between(smooth, levels, np.clip(sigma, low, high))
    blur = functools.partial(gaussian_filter, sigma=(_BLUR_PX, _BLUR_PX, 0.0))
    tiny = np.float32(1e-12) * max(float(smooth.max()), 1e-20)
    return smooth * (blur(radiance) + tiny) / (blur(smooth) + tiny)


_BLUR_PX = 4.0
_STRENGTHS, _STRENGTH_RATIO = 3, 1.5
"""At most so many strengths, a factor of so much apart."""


def _between(images: list[np.ndarray], levels: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Image [H, W, 3] that takes from the images at ``levels`` what suits each pixel's ``sigma`` [H, W]."""
    place = np.interp(np.log(sigma), np.log(levels), np.arange(len(levels)))[..., None]
    return sum(np.maximum(1.0 - np.abs(place - i), 0.0) * image for i, image in enumerate(images)).astype(np.float32)


def _sigma_of_root(radiance: np.ndarray, stderr: np.ndarray) -> np.ndarray:
    """Standard error [H, W] of the square root of the radiance, from neighbourhoods; 0 where there is no light.

    One sample per pixel has no known error (inf); its noise is taken to be as large as its radiance.
    """
    stderr = np.where(np.isfinite(stderr), stderr, radiance)
    mean = uniform_filter(radiance.astype(np.float64), size=(7, 7, 1)).mean(-1)
    variance = uniform_filter(np.square(stderr, dtype=np.float64), size=(7, 7, 1)).mean(-1)
    lit = mean > 1e-6 * mean.max()
    return np.sqrt(np.divide(variance, 4.0 * mean, out=np.zeros_like(mean), where=lit).clip(min=0.0))
