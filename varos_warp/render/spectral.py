"""Images in water by wavelength: passes of three bands, weighed into the channels of the camera.

All passes see the same geometry with the same random numbers. They are added before anything is denoised.
"""

from collections.abc import Callable

import numpy as np
import warp as wp

from varos_warp.kernels.film.bands import add_layers, add_weighted, add_weighted_variance
from varos_warp.render.image.films import Films
from varos_warp.render.options import LAYERS
from varos_warp.render.radiance import DEVELOPED, RadianceRenderer, Shot, Taken
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
            self._passes[view.response] = [
                (one, RadianceRenderer(one.scene, self.world.relit(one.scene, one), self.films))
                for one in passes(self._whole, view)
            ]
        return self._passes[view.response]

    def lets_through(self, view: Camera) -> BandWater:
        """The water as a camera sees it, by white light of the first lamp."""
        if view.response not in self._waters:
            self._waters[view.response] = BandWater.of_camera(self._whole, view)
        return self._waters[view.response]

    def take_water(self, shot: Shot) -> Taken | None:
        """Take the samples of A in all bands; None if it is black."""
        return self._summed(shot, RadianceRenderer.take_water, lambda one: one.weights)

    def take_ambient(self, shot: Shot) -> Taken | None:
        """Take the samples of B, in light of the colour of the first lamp; None if all is white."""
        return self._summed(shot, RadianceRenderer.take_ambient, lambda one: one.of_ambient)

    def _summed(
        self,
        shot: Shot,
        take: Callable[[RadianceRenderer, Shot], Taken | None],
        weights_of: Callable[[BandPass], np.ndarray],
    ) -> Taken | None:
        """All passes in the channels of the camera, but for those that are known without samples; None: all are."""
        total, of_passes = None, self.passes(shot.view)
        for one, renderer in of_passes:
            world = renderer.world if shot.world is self.world else renderer.world.placed_as(shot.world)
            taken = take(renderer, shot._replace(view=one.seen_by(shot.view), world=world))
            if taken is not None:
                total = self._added(total or self._black(taken), taken, weights_of(one), 1.0 / len(of_passes))
        if total is None:
            return None
        radiance, layers = total.images["radiance"], {layer: total.images[layer] for layer in LAYERS}
        self.launcher.run(add_layers, radiance.shape, {**layers, "radiance": radiance})
        return total

    @staticmethod
    def _black(like: Taken) -> Taken:
        """The sum of no pass."""
        images, guides = (
            {name: wp.zeros_like(image) for name, image in images.items()} for images in (like.images, like.guides)
        )
        return Taken(images, [], [], [], guides)

    def _added(self, total: Taken, taken: Taken, weights: np.ndarray, share: float) -> Taken:
        """The sum, but for its radiance, with one more pass, whose bands have ``weights`` [3 channels, 3 bands].

        Errors are added as if all bands erred alike, which is the most that they may: passes share their random
        numbers. Guides of the denoiser are means, as they only tell where edges are: a ``share`` of each pass counts.
        """
        light, errors, mean = (wp.mat33d(*np.ravel(w)) for w in (weights, np.abs(weights), share * np.eye(3)))
        of = dict.fromkeys(DEVELOPED, light) | {"stderr": errors, "base_variance": errors}
        for name in DEVELOPED:
            if name != "radiance":
                kernel = add_weighted_variance if name == "base_variance" else add_weighted
                self._add(kernel, taken.images[name], of[name], total.images[name])
        # not every pass need have guides: the field may be known for some only
        guides = {name: guide for name, guide in total.guides.items() if name in taken.guides}
        for name, guide in guides.items():
            self._add(add_weighted, taken.guides[name], mean, guide)
        blocks = [(variances, weights @ own) for variances, own in taken.blocks]
        return Taken(
            total.images,
            total.blocks + blocks,
            total.counted + taken.counted,
            [*total.kinds, *taken.kinds],
            guides,
            min(total.subpaths, taken.subpaths),
        )

    def _add(self, kernel: wp.Kernel, image: wp.array, weights: wp.mat33d, total: wp.array) -> None:
        """Add an image to a sum by a kernel."""
        self.launcher.run(kernel, total.shape, {"image": image, "weights": weights, "total": total})
