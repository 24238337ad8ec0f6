"""Denoising of linear radiance: Open Image Denoise, or non-local means (paper 3.2.1), by the same kernels everywhere.

An image of paths has a correction, what subpaths carry, which holds nearly all its noise, and a base: direct light,
single scattering and the field, noisy mainly at edges, in textures and where a lens blurs. They are denoised apart.
The base is then mixed with itself before denoising, by its variance: so it keeps its detail, and what is certain for
some pixels around stays as it is. Values of the correction may be negative, and clipping them would brighten the
image: what is positive and what is negative are denoised as two images, each of which a denoiser takes.

With the field the base is nearly free of noise, so it guides the correction, with albedo and normals of surfaces as far
as light comes from them. B has no water: it is divided by the albedo, the mean over its samples, which is nearly free
of noise and has edges as smooth as the image; what is left, the light on surfaces, is denoised without guides, and
multiplied again. Where an exposure blurs B, that mean is noisy, and albedo and normals guide instead.
"""

import functools
from typing import Any

import numpy as np
import warp as wp

from varos_warp.device.devices import upload
from varos_warp.device.launcher import Launcher
from varos_warp.errors import warn
from varos_warp.kernels.film.denoise import (
    add_enlarged,
    add_mixed,
    add_scaled,
    clip_negative,
    demodulate,
    halve,
    mix_guide,
    modulate,
    positive_part,
    scale_to_unit,
    subtract,
)
from varos_warp.products.images.registry import DENOISE_KEYS
from varos_warp.render.image.nlm import NonLocalMeans
from varos_warp.render.image.oidn import OpenImageDenoise, open_image_denoise

METHODS = ("oidn", "nlm", "none")
QUALITY, PART_QUALITY = "high", "balanced"
"""Quality settings of Open Image Denoise: for a whole image, and for a base or correction.

Both leave the same error in corrections within 1 %, the second in half the time; the fast one leaves 7 % more
(Munkholmen, 1280 x 720, 12 samples). Without the negative part the image would be too bright by 0.2 % in blue (4
samples)."""
HALF_BELOW = 0.5
"""Subpaths per pixel below which Open Image Denoise sees a correction at half its size: most pixels then have none.

Denoised images err 0.90 to 1.06 times as much at 0.3 to 0.5 subpaths a pixel (five scenes, 192 x 112 or 320 x 180). In
small ones (192 x 112) it is 0.96 to 1.13 times at 0.7 to 0.8, and up to 1.6 times at 5; Munkholmen at 320 x 180 still
gains at 1."""
NEAR, FAR = 3, 11
"""Sides [pixels] of what a base is mixed by (kernels/film/denoise.py). Where rare bright samples were missed, the mean
is too low and the variance too: with the variance of the nearest pixels alone, such places would count as certain, and
come out too dark."""


def denoisers_of(render: Any) -> dict[str, str]:
    """What denoises the image types that have a denoiser of their own, by their letters, as far as it is available.

    ``render`` is a scene's block of this name.
    """
    return {letter: available_method(getattr(render, key)) for letter, key in DENOISE_KEYS.items()}


def denoise_image(image, method: str) -> np.ndarray:
    """Linear radiance float32 [H, W, 3] of an image on the host, with less noise.

    Of an image with a ``correction`` that and the rest, the base, are denoised apart, and what is negative of the sum
    is cut. ``albedo`` and ``normal`` guide the correction, or the whole, if the image has them; a whole with ``albedo``
    alone is divided by it. There is nothing to denoise where ``stderr`` is zero throughout.

    Args:
        image: `frame.RadianceImage`.
        method: ``oidn``, ``nlm`` or ``none`` (which returns the radiance itself).

    Raises:
        ValueError: If a value is not finite, or the method is unknown.
    """
    if image.snow is not None:
        return np.maximum(image.snow.over(denoise_image(image.without_snow(), method)), 0.0)
    method, whole = available_method(method), image.correction is None
    if method == "none" or (whole and not (np.any(image.stderr) and np.any(image.radiance))):
        return np.ascontiguousarray(image.radiance, np.float32)
    names = ["radiance"] if whole else ["radiance", "correction"]
    for name in names:
        check_finite(getattr(image, name))
    if not whole and np.any(image.base_variance):
        names.append("base_variance")
    if method == "nlm":
        names.append("stderr")
    elif image.albedo is not None:
        names += ["albedo"] if image.normal is None else ["albedo", "normal"]
    arrays = {name: upload(np.asarray(getattr(image, name), np.float32), wp.vec3, "cpu") for name in names}
    return _on_cpu(method).denoise(**arrays, subpaths=np.inf if whole else image.subpaths).numpy()


def check_finite(image: np.ndarray) -> None:
    """Refuse infinite values and what is not a number.

    Raises:
        ValueError: If there are any.
    """
    if not np.isfinite(image).all():
        raise ValueError(f"cannot denoise: {np.count_nonzero(~np.isfinite(image))} values are not finite")


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
        warn(
            f"Open Image Denoise is not available ({error}); non-local means takes its place, for which B needs more "
            "samples: render.spp_b: 20"
        )
        return "nlm"
    return "oidn"


@functools.cache
def _on_cpu(method: str) -> "Denoiser":
    return Denoiser(Launcher("cpu"), method)


class Denoiser:
    """Denoises arrays of one device where they lie: on a GPU without waiting for it, on a CPU in any number of threads.

    Args:
        launcher: Of the device.
        method: ``oidn``, or on a CPU ``nlm``.

    Raises:
        ImportError, OSError, RuntimeError: As `OpenImageDenoise`.
    """

    def __init__(self, launcher: Launcher, method: str = "oidn"):
        self.launcher, self.device = launcher, launcher.device
        self.filters = OpenImageDenoise(launcher.device) if method == "oidn" else NonLocalMeans()

    def denoise(
        self, radiance, correction=None, base_variance=None, stderr=None, subpaths: float = np.inf, **guides
    ) -> wp.array:
        """Linear radiance with less noise, not negative; all arrays are of vec3 [H, W] on this device.

        Args:
            radiance: The image.
            correction: What is denoised apart from the rest, the base; may be negative.
            base_variance: Of all but the correction: what is mixed by. Absent: it is certain.
            stderr: Of the image, for ``nlm``.
            subpaths: How many per pixel the correction is the mean of.
            guides: Of the correction, or the whole: ``albedo`` in [0, 1] and ``normal``, or neither. A whole is divided
                by an ``albedo`` that comes alone.

        Raises:
            RuntimeError: If Open Image Denoise reports a failure.
        """
        result = wp.zeros_like(radiance)
        if correction is None:
            self._add_whole(result, radiance, guides, stderr)
        else:
            self._add_base(result, radiance, correction, base_variance, stderr is not None)
            guides = self._correction_guides(result, **guides) if guides else guides
            if subpaths < HALF_BELOW and stderr is None:
                self._add_at_half_size(result, correction, guides)
            else:
                self._add_correction(result, correction, guides, stderr)
        self.launcher.run(clip_negative, result.shape, {"image": result})
        return result

    def _add_whole(self, result, radiance, guides: dict[str, wp.array], stderr):
        """Add an image, denoised; what guides alone is divided by meanwhile."""
        if guides.keys() != {"albedo"}:
            self.add_denoised(result, radiance, 1.0, QUALITY, guides, stderr)
            return
        light = wp.empty_like(radiance)
        self.launcher.run(demodulate, result.shape, {"image": radiance, "light": light} | guides)
        self.add_denoised(result, light, 1.0, QUALITY, {}, stderr)
        self.launcher.run(modulate, result.shape, {"image": result} | guides)

    def _add_base(self, result, radiance, correction, variance, by_error: bool):
        """Add all but the correction, denoised where it has a variance, and mixed with itself by that."""
        base, clean = wp.empty_like(radiance), wp.zeros_like(radiance)
        self.launcher.run(
            subtract,
            radiance.shape,
            {"image": radiance, "part": correction, "rest": result if variance is None else base},
        )
        if variance is not None:
            error = upload(np.sqrt(variance.numpy()), wp.vec3, self.device) if by_error else None
            self.add_denoised(clean, base, 1.0, PART_QUALITY, {}, error)
            self.launcher.rows(
                add_mixed,
                radiance.shape,
                {"smooth": clean, "noisy": base, "variance": variance, "near": NEAR, "far": FAR, "image": result},
            )

    def _add_correction(self, result, correction, guides: dict[str, wp.array], stderr=None):
        """Add a correction, denoised."""
        for sign in (1.0, -1.0):
            self.add_denoised(result, correction, sign, PART_QUALITY, guides, stderr)

    def _add_at_half_size(self, result, correction, guides: dict[str, wp.array]):
        """Add a correction that is denoised at half its size and interpolated."""
        shape = [-(-side // 2) for side in result.shape]
        small = {name: wp.empty(shape, dtype=wp.vec3, device=self.device) for name in ("correction", *guides)}
        for name, image in ({"correction": correction} | guides).items():
            self.launcher.run(halve, shape, {"image": image, "small": small[name]})
        clean = wp.zeros(shape, dtype=wp.vec3, device=self.device)
        self._add_correction(clean, small.pop("correction"), small)
        self.launcher.run(add_enlarged, result.shape, {"small": clean, "image": result})

    def _correction_guides(self, base, albedo, normal) -> dict[str, wp.array]:
        """What guides the denoiser of a correction: as ``albedo`` its mean with the base over itself plus its mean.

        The correction is light of surfaces and water, as the base is, and has the same edges, shadows and textures, as
        strong as they are seen through the water. Surfaces' albedo alone would draw them at full strength, whatever
        water is before them.

        Args:
            base: All but the correction, denoised.
            albedo: Of surfaces and water, weighted by the light of each, in [0, 1] (`RadianceImage.albedo`).
            normal: The same of normals.
        """
        albedo, light = wp.clone(albedo), wp.empty_like(base)
        self.launcher.run(positive_part, base.shape, {"image": base, "sign": 1.0, "part": light})
        self.launcher.run(mix_guide, base.shape, {"base": base, "total": self._sum(light), "albedo": albedo})
        return {"albedo": albedo, "normal": normal}

    def add_denoised(self, result, noisy, sign: float, quality: str, guides: dict[str, wp.array], stderr=None):
        """Add ``sign`` times what is positive of ``sign`` times ``noisy``, denoised, to ``result``.

        Open Image Denoise adds 1e-4 of its own to very dark images, so they are brought to a mean near 1 first.
        """
        with self.filters.filter(noisy.shape, quality, guides) as filter_:
            color = filter_.images["color"]
            self.launcher.run(positive_part, noisy.shape, {"image": noisy, "sign": sign, "part": color})
            total = self._sum(color)
            if self.device == "cpu" and not total.numpy().any():
                return
            for name, values in (guides | {"stderr": stderr}).items():
                if name in filter_.images:
                    wp.copy(filter_.images[name], values)
            for name in {"color", "stderr"} & {*filter_.images}:
                self.launcher.run(scale_to_unit, noisy.shape, {"total": total, "image": filter_.images[name]})
            filter_.run()
            self.launcher.run(
                add_scaled,
                noisy.shape,
                {"part": filter_.images["output"], "total": total, "sign": sign, "image": result},
            )

    def _sum(self, image: wp.array) -> wp.array:
        """Sum of the pixels, [1]."""
        total = wp.empty(1, dtype=wp.vec3, device=image.device)
        if self.device == "cpu":  # where Warp would add up floats one by one
            total.assign(image.numpy().sum((0, 1), np.float64))
        else:
            with wp.ScopedDevice(image.device):  # of several GPUs it adds up on the current one
                wp.utils.array_sum(image, out=total)
        return total
