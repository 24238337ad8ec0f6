"""Images in water by wavelength: passes of three bands, weighed into the channels of the camera.

All passes see the same geometry with the same random numbers. They are added before anything is denoised.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from varos_warp.products.images.radiance import RadianceImage
from varos_warp.render.image.films import Films
from varos_warp.render.image.frame import without_noise
from varos_warp.render.radiance import RadianceRenderer, Shot
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import DeviceScene
from varos_warp.scene.passes import BandPass, BandWater, passes


class SpectralRenderer(RadianceRenderer):
    """Renders A and B of one scene by wavelength on one device.

    What is the same in all passes is asked of the scene that ``world`` is of, three of its bands.

    Args:
        scene: The scene.
        world: The scene on the device.
        films: Films of the device.
    """

    def __init__(self, scene: Scene, world: DeviceScene, films: Films):
        super().__init__(world.scene, world, films)
        self._whole = scene
        self._waters: dict[str | None, BandWater] = {}
        self._passes: dict[str | None, list[tuple[BandPass, RadianceRenderer]]] = {}

    def passes(self, view: Camera) -> list[tuple[BandPass, RadianceRenderer]]:
        """The passes of a camera, each with its renderer; the same for all of one response."""
        if view.response not in self._passes:
            self._passes[view.response] = [(one, RadianceRenderer(one.scene, self._lit(self.world, one), self.films))
                                  for one in passes(self._whole, view)]
        return self._passes[view.response]

    def lets_through(self, view: Camera) -> BandWater:
        """The water as a camera sees it, by white light of the first lamp."""
        if view.response not in self._waters:
            self._waters[view.response] = BandWater.of_camera(self._whole, view)
        return self._waters[view.response]

    def water(self, shot: Shot) -> RadianceImage:
        """Render A."""
        image = self._summed(shot, lambda renderer, one: renderer.water(one), lambda one: one.weights,
                             {"denoise": None, "copied": None})
        return self._denoised(image, {}, shot.options.denoise)

    def ambient(self, shot: Shot) -> RadianceImage:
        """Render B, in light of the colour of the first lamp."""
        method = shot.options.denoise_b
        if not self.world.spec.surfaces:
            return self._denoised(without_noise(np.ones((*shot.view.resolution[::-1], 3), np.float32)), {}, method)
        image = self._summed(shot, lambda renderer, one: renderer.ambient(one), lambda one: one.of_ambient,
                             {"denoise_b": None, "copied": None})
        return self._denoised(image, {}, method)

    def _summed(self, shot: Shot, render: Callable[[RadianceRenderer, Shot], RadianceImage],
                weights_of: Callable[[BandPass], np.ndarray], changed: dict) -> RadianceImage:
        """The image of all passes, not denoised."""
        options, images, weights = replace(shot.options, **changed), [], []
        for one, renderer in self.passes(shot.view):
            world = renderer.world if shot.world is self.world else self._lit(shot.world, one)
            images.append(render(renderer, shot._replace(view=one.seen_by(shot.view), options=options, world=world)))
            weights.append(weights_of(one))
        return weighed(images, weights)

    @staticmethod
    def _lit(world: DeviceScene, one: BandPass) -> DeviceScene:
        return world.relit(one.scene, one)


def weighed(images: Sequence[RadianceImage], weights: Sequence[np.ndarray]) -> RadianceImage:
    """The sum of images in three bands each, with weights [3 channels, 3 bands] of each.

    Errors are added as if all bands erred alike, which is the most that they may: passes share their random numbers.
    Guides of the denoiser are means, as they only tell where edges are.
    """
    def every(name):
        values = [getattr(image, name) for image in images]
        return None if any(value is None for value in values) else values

    def light(values):
        return None if values is None else _in_channels(values, weights)

    def error(values):
        return None if values is None else _in_channels(values, [np.abs(w) for w in weights])

    def mean(values):
        return None if values is None else np.mean(values, axis=0, dtype=np.float32)

    variances = every("base_variance")
    deviation = error(None if variances is None else [np.sqrt(v) for v in variances])
    return RadianceImage(
        radiance=light(every("radiance")), correction=light(every("correction")),
        layers={name: light([image.layers[name] for image in images]) for name in images[0].layers},
        stderr=error(every("stderr")), block_error=error(every("block_error")),
        base_variance=None if deviation is None else deviation**2,
        albedo=mean(every("albedo")), normal=mean(every("normal")),
        spp=float(np.mean([image.spp or 0.0 for image in images])),
        lost_samples=sum(image.lost_samples for image in images))


def _in_channels(values: Sequence[np.ndarray], weights: Sequence[np.ndarray]) -> np.ndarray:
    """Values [H, W, 3 bands] of all passes in the camera's channels, float32 [H, W, 3].

    A band without weight adds nothing, though it is infinite.
    """
    out = np.zeros(values[0].shape)
    for value, w in zip(values, weights, strict=True):
        for channel, band in zip(*np.nonzero(w), strict=True):
            out[..., channel] += w[channel, band] * value[..., band].astype(np.float64)
    return out.astype(np.float32)
