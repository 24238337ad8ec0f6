"""The images of light: A with the water and B without, from their samples to what a denoiser leaves."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import ceil
from typing import NamedTuple

import numpy as np
import warp as wp

from varos_warp.errors import warn
from varos_warp.kernels.conventions import ALL
from varos_warp.kernels.field.open_water import Field
from varos_warp.kernels.film.develop import develop, side_variances, tile_variances, weigh_guides
from varos_warp.kernels.film.film import IN_BLOCK, Film
from varos_warp.kernels.transport.moments import Moments
from varos_warp.kernels.transport.segment import PathBounds
from varos_warp.kernels.transport.virtual_lights import VirtualLight
from varos_warp.kernels.world.camera import Camera as CameraData
from varos_warp.products.images.protocol import LetsThrough
from varos_warp.products.images.radiance import RadianceImage
from varos_warp.render.field.open_water import OpenWater, unavailable
from varos_warp.render.image.adapt import LEAST_FIRST, LEAST_SUBPATHS, first_samples, other_noise, share_out
from varos_warp.render.image.denoise import Denoiser, check_finite, denoise_image
from varos_warp.render.image.films import Films, tile_pixels
from varos_warp.render.image.frame import block_error, without_noise
from varos_warp.render.kinds import ALL_ALIKE, LightKernels, SampleKind, ambient_kernels, sample_step, water_kernels
from varos_warp.render.moments import Motion, moments_of
from varos_warp.render.options import LAYERS, RenderOptions, resolve_integrator
from varos_warp.render.particles.snow import Drawn, with_snow
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import DeviceScene
from varos_warp.scene.lights.records import lights_vary
from varos_warp.scene.optics.camera import camera_model, pixel_centres
from varos_warp.scene.optics.shutter import lit_of_rows

DEVELOPED = (*LAYERS, "correction", "base_variance", "radiance", "stderr")
"""Images that films develop to (kernels/film/film.py)."""
DENOISED, DENOISED_PIXELS = 8.0, 96 * 56
"""Effect of a denoiser that is assumed with the field: samples are shared out as if it left only one part in DENOISED
of the correction's variance, in an image of DENOISED_PIXELS pixels or fewer. In larger ones it takes away more, for
more pixels show the same light: it leaves one part in about 100 at 1280 x 720 (measured on Munkholmen). The factor
grows with the square root of the number of pixels."""
VIRTUAL_LIGHTS, OF_SAMPLES = (1 << 14, 1 << 20), 0.25
"""Virtual point lights are as many as this share of the samples, within these bounds: what pixels share of their error
then falls as the rest does. With four times as many, denoised images err as much, within 1 % or two standard errors, in
eight unlike scenes, still and moving (H200, 640 x 360, 1 and 4 samples)."""

VIRTUAL_GROUPS = 32
"""Groups of instants with virtual point lights of their own: of how the vehicle moves within one, only the error of
light of two and more reflections tells, and that falls with its square."""


class Shot(NamedTuple):
    """One image to make."""

    view: Camera
    T_w_v: np.ndarray
    options: RenderOptions
    """Options with everything that the scene has to say."""
    key: int
    """Key of its random numbers."""
    guides: Callable[[wp.Kernel], dict[str, wp.array]]
    """Albedo and normals, traced by a kernel once for all images of a frame."""
    world: DeviceScene
    """The scene, with what moves where it is at the frame's time."""
    motion: Motion | None = None
    """Motion of the vehicle while the shutter is open; None: it stands still, and so does all else."""
    snow: Callable[[], Drawn] | None = None
    """Draws the bodies in the water that this image shows; None: it shows none."""

    @property
    def moves(self) -> bool:
        """Whether the camera moves while its shutter is open."""
        return self.motion is not None and not self.view.exposure.is_instant


class Seen(NamedTuple):
    """What kernels get of a shot, and whether they are compiled for moments."""

    camera: CameraData
    moments: Moments
    varies: bool


class Taken(NamedTuple):
    """An image whose samples are taken, on the device."""

    images: dict[str, wp.array]
    """The ``LAYERS``, correction, base_variance, radiance and stderr, [H, W] of vec3."""
    blocks: list[tuple[wp.array, np.ndarray]]
    """Variances of the means of tiles [tile row, tile column], of images whose weighted sum it is; and how much the
    channels of each err in its own, float64 [3, 3]."""
    counted: list[wp.array]
    """Lost samples of each film, and its numbers of samples."""
    kinds: Sequence[SampleKind]
    """Kinds of samples, one of each film; none, if not of paths."""
    guides: dict[str, wp.array]
    """Albedo and normals for the denoiser."""
    subpaths: float = np.inf
    """Subpaths per pixel, as in `RadianceImage`."""


class RadianceRenderer:
    """Renders A and B of one scene on one device."""

    def __init__(self, scene: Scene, world: DeviceScene, films: Films):
        self.scene, self.world, self.films = scene, world, films
        self.launcher, self.device = films.launcher, films.device
        self._shares: dict[Camera, wp.array | None] = {}
        self._told = False
        self.open_water = OpenWater(scene, self.launcher, world.lights)

    def lets_through(self, view: Camera) -> LetsThrough:
        """The water as a camera sees it."""
        return self.world.water

    def water(self, shot: Shot) -> RadianceImage:
        """Render A, with the bodies in the water in front: a GPU draws them while the host waits."""
        if shot.snow is None:
            return self._water(shot, None)
        with self.launcher.meanwhile(shot.snow) as drawn:
            return self._water(shot, drawn)

    def _water(self, shot: Shot, bodies: Callable[[], Drawn] | None) -> RadianceImage:
        view, options = shot.view, shot.options
        if (taken := self.take_water(shot)) is None:
            black = np.zeros((*view.resolution[::-1], 3), np.float32)
            image = without_noise(black, layers={layer: black.copy() for layer in options.layers})
            image = self._denoised(image, {}, options.denoise)
        elif self._is_brief(options.copied, options.denoise):
            return self._fetched_brief(taken, options.copied, options.denoise, bodies)
        else:
            image = self._fetched(taken, shot, options.layers, options.denoise)
        return image if bodies is None else with_snow(image, bodies().on_host, options.copied is None)

    def take_water(self, shot: Shot) -> Taken | None:
        """Take the samples of A without bodies; None if it is black."""
        view, options = shot.view, shot.options
        integrator = self._integrator(options)
        if step := sample_step(view, integrator == "field"):
            options = replace(options, spp=step * ceil(options.spp / step))
            shot = shot._replace(options=options)
        kernels = water_kernels(self.scene, self.world.spec, view, options, integrator, shot.moves)
        if kernels is None:
            return None
        bounds, most = PathBounds(), (options.max_scatterings if self.world.spec.medium else 0, options.max_bounces)
        bounds.scatterings, bounds.bounces = (ALL if bound is None else bound for bound in most)
        if kernels.samples:
            return self._by_reference(shot, bounds, kernels.samples)
        return self._by_paths(shot, bounds, integrator == "field", kernels)

    def _integrator(self, options: RenderOptions) -> str:
        """The integrator of A; that ``auto`` does without a field that cannot be solved for is told, once.

        Raises:
            InputError: If ``field`` is asked for by name and cannot be had.
        """
        name = resolve_integrator(options.integrator, options.max_scatterings, lambda: self._no_field)
        if name != "field" or "multiple" not in options.layers or (why := self.open_water.failure) is None:
            return name
        name = resolve_integrator(options.integrator, None, lambda: why)
        if not self._told:
            self._told = True
            warn(f"{why}: A is rendered by paths alone")
        return name

    @functools.cached_property
    def _no_field(self) -> str | None:
        """What `unavailable` tells: once, for it reads files."""
        return unavailable(self.scene)

    def share(self, view: Camera) -> wp.array | None:
        """What counts of the samples of each pixel, float64 [height, width]; None: all.

        It is what vignetting leaves at its centre, times the share of a row's exposure in which some strobe is on.
        """
        if view not in self._shares:
            rows, left = lit_of_rows(view, self.scene.lights), None
            if view.vignetting is not None:
                left = camera_model(view).vignette(pixel_centres(*view.resolution))
            if rows is not None:
                left = rows[:, None] * (np.ones(view.resolution[::-1]) if left is None else left)
            self._shares[view] = None if left is None else wp.array(left, dtype=wp.float64, device=self.device)
        return self._shares[view]

    def _by_reference(self, shot: Shot, bounds: PathBounds, kernel: wp.Kernel) -> Taken:
        film, spp = self.films.black(shot.view.resolution), shot.options.spp
        seen = self._seen(shot.world, shot.view, shot.T_w_v, shot.motion)
        self.films.take(
            film,
            kernel,
            {
                "scene": shot.world.lit(shot.T_w_v),
                "camera": seen.camera,
                "moments": seen.moments,
                "max_scatterings": bounds.scatterings,
                "max_bounces": bounds.bounces,
                "key": wp.uint32(shot.key),
            },
            IN_BLOCK * spp,
            share=self.share(shot.view),
        )
        return self._developed([film])

    def _by_paths(self, shot: Shot, bounds: PathBounds, with_field: bool, kernels: LightKernels) -> Taken:
        films, subpaths = self._path_films(shot, bounds, with_field, kernels)
        taken = self._developed(films, kernels.kinds)._replace(subpaths=subpaths)
        if not kernels.guides:
            return taken
        return taken._replace(guides=self._weighed(shot.guides(kernels.guides), taken.images))

    def _path_films(
        self, shot: Shot, bounds: PathBounds, with_field: bool, kernels: LightKernels
    ) -> tuple[list[Film], float]:
        """Films with the samples of A, and subpaths per pixel.

        What else it takes is let go with this function, before a denoiser works.
        """
        view, options, kinds = shot.view, shot.options, kernels.kinds
        seen = self._seen(shot.world, view, shot.T_w_v, shot.motion)
        keys = [int(k) for k in np.random.SeedSequence(shot.key).generate_state(3)]
        scene = shot.world.lit(shot.T_w_v)
        field = Field()
        if with_field:
            field = (self.open_water.field if "multiple" in options.layers else self.open_water.only_single)(view)
        known = {"scene": scene, "camera": seen.camera, "moments": seen.moments, "field": field, "bounds": bounds}
        of_segments, of_subpaths = ({**known, "key": wp.uint32(key)} for key in keys[:2])
        if any(kind.subpaths for kind in kinds):
            of_subpaths["virtual_lights"] = self._virtual_lights(scene, shot, seen, keys[2], kernels.virtual_lights)
        shares = sample_step(view, with_field) == 0
        spp = [kind.to_a_sample * options.spp for kind in kinds]
        films = [self.films.black(view.resolution, shares, kind.sums, keys[kind.subpaths]) for kind in kinds]
        first = [IN_BLOCK * count for count in spp]
        if shares:
            least = [LEAST_SUBPATHS if kind.subpaths else LEAST_FIRST for kind in kinds]
            first = [*map(first_samples, spp, least)]
        share = self.share(view)

        def take(samples, before):
            for kind, film, count, had in zip(kinds, films, samples, before, strict=True):
                arguments = of_subpaths if kind.subpaths else of_segments
                self.films.take(film, kind.kernel, arguments, count, queued=kind.subpaths, share=share, before=had)

        take(first, [0] * len(first))
        taken = first
        if shares:
            # by the noise of the first, of which a denoiser takes most
            denoised = (options.denoise or self.scene.render.denoise) != "none"
            taken_away = DENOISED * max(1.0, np.sqrt(np.prod(view.resolution) / DENOISED_PIXELS))
            statistics = self.films.tile_statistics(films, taken_away if denoised else 1.0)
            noise = other_noise(self.launcher, *statistics)
            (samples,) = self.launcher.fetch(share_out(self.launcher, noise, first, spp, [kind.cost for kind in kinds]))
            take(samples, first)
            taken = [before + samples[i].mean() for i, before in enumerate(first)]
        rates = [of_block / IN_BLOCK for kind, of_block in zip(kinds, taken, strict=True) if kind.subpaths]
        return films, float(min(rates, default=np.inf))

    def _virtual_lights(self, scene, shot: Shot, seen: Seen, key: int, kernel: wp.Kernel | None) -> wp.array:
        """Virtual point lights of a frame [2 * group of instants + half of the samples, point]."""
        groups = 1
        if seen.varies:  # parts of the instants that samples are of
            lit = seen.moments.lit_end - seen.moments.lit_begin
            groups = min(lit or seen.moments.cameras.shape[0], VIRTUAL_GROUPS)
        if kernel is None:
            return wp.empty((2 * groups, 0), dtype=VirtualLight, device=self.device)
        samples = OF_SAMPLES * shot.options.spp * np.prod(shot.view.resolution)
        count = int(np.clip(1 << int(samples).bit_length(), *VIRTUAL_LIGHTS))
        lights = wp.empty((2 * groups, count // (2 * groups)), dtype=VirtualLight, device=self.device)
        self.launcher.rows(
            kernel,
            (lights.size,),
            {"scene": scene, "moments": seen.moments, "key": wp.uint32(key), "points": lights},
            tile_rows=1024,
        )
        return lights

    def _seen(
        self,
        world: DeviceScene,
        view: Camera,
        T_w_v: np.ndarray,
        motion: Motion | None,
        *,
        pinhole: bool = False,
        lit: bool = True,
    ) -> Seen:
        """Camera and moments of an image; with ``pinhole``, without depth of field, and of the camera only.

        Unless ``lit``, the time in which no light is on counts too.
        """
        camera = world.camera(view, T_w_v, pinhole=pinhole)
        moves = motion is not None and not view.exposure.is_instant
        if not moves and (pinhole or not lights_vary(self.scene.lights)):
            return Seen(camera, Moments(), False)
        return Seen(camera, moments_of(world, view, T_w_v, motion if moves else None, pinhole, lit), True)

    def ambient(self, shot: Shot) -> RadianceImage:
        """Render B."""
        method = shot.options.denoise_b
        if (taken := self.take_ambient(shot)) is None:
            return self._denoised(without_noise(np.ones((*shot.view.resolution[::-1], 3), np.float32)), {}, method)
        if not taken.guides and (method or self.scene.render.denoise_b) == "oidn":  # what it is divided by
            taken = taken._replace(guides={"albedo": taken.images["direct"]})
        if self._is_brief(shot.options.copied, method):
            return self._fetched_brief(taken, shot.options.copied, method)
        return self._fetched(taken, shot, (), method)

    def take_ambient(self, shot: Shot) -> Taken | None:
        """Take the samples of B; None if all is white."""
        method, world = shot.options.denoise_b, shot.world
        kernels = ambient_kernels(world.spec, shot.view, method or self.scene.render.denoise_b, shot.moves)
        if kernels is None:
            return None
        film = self.films.black(shot.view.resolution)
        seen = self._seen(world, shot.view, shot.T_w_v, shot.motion, pinhole=True, lit=False)
        self.films.take(
            film,
            kernels.samples,
            {"scene": world.data, "camera": seen.camera, "moments": seen.moments, "key": wp.uint32(shot.key)},
            IN_BLOCK * shot.options.spp_b,
        )
        taken = self._developed([film])
        return taken._replace(guides=shot.guides(kernels.guides)) if kernels.guides else taken

    def trace_guides(
        self, world: DeviceScene, view: Camera, T_w_v: np.ndarray, motion: Motion | None, lit: bool, kernel: wp.Kernel
    ) -> dict[str, wp.array]:
        """Albedo and normals at the centres of the pixels; means over an exposure, or what is ``lit`` of it."""
        seen = self._seen(world, view, T_w_v, motion, pinhole=True, lit=lit)
        shape = view.resolution[::-1]
        guides = {name: wp.empty(shape, dtype=wp.vec3, device=self.device) for name in ("albedo", "normal")}
        self.launcher.rows(
            kernel, shape, {"scene": world.data, "camera": seen.camera, "moments": seen.moments, **guides}
        )
        return guides

    def _weighed(self, guides: dict[str, wp.array], images: dict[str, wp.array]) -> dict[str, wp.array]:
        """Guides of surfaces and water, from those of surfaces and the images that were developed."""
        weighed = {name: wp.empty_like(guide) for name, guide in guides.items()}
        light = {name: images[name] for name in ("direct", "radiance", "correction")}
        of_surfaces = {f"surface_{name}": guide for name, guide in guides.items()}
        self.launcher.run(weigh_guides, images["radiance"].shape, {**light, **of_surfaces, **weighed})
        return weighed

    def _developed(self, films: list[Film], kinds: Sequence[SampleKind] = ()) -> Taken:
        """The image that is the sum of films, which are taken back."""
        shape = films[0].sums.shape[1:]
        images = {name: wp.zeros(shape, dtype=wp.vec3, device=self.device) for name in DEVELOPED}
        blocks = wp.zeros(tile_pixels(*shape).shape, dtype=wp.vec3d, device=self.device)
        for film in films:
            sides = {name: self.films.buffer(*film.count.shape) for name in ("variance", "squares")}
            self.launcher.run(side_variances, film.count.shape, {"film": film, **sides})
            self.launcher.run(tile_variances, blocks.shape, {"film": film, "blocks": blocks})
            self.launcher.run(develop, shape, {"film": film, **sides, **images})
            self.films.keep(film)
        counted = [array for film in films for array in (film.lost, film.count)]
        return Taken(images, [(blocks, np.eye(3))], counted, kinds, {})

    def _is_brief(self, copied: Sequence[str] | None, method: str | None) -> bool:
        """Return whether nothing but images that are done is copied to the host."""
        return copied is not None and (method == "none" or self._denoises(method))

    def _fetched_brief(
        self, taken: Taken, copied: Sequence[str], method: str | None, bodies: Callable[[], Drawn] | None = None
    ) -> RadianceImage:
        """The `RadianceImage` of what was taken, with what is to be ``copied``, and ``bodies`` in front, alone."""
        images = {"radiance": taken.images["radiance"]}
        images["denoised"] = (
            images["radiance"]
            if method == "none"
            else self._device_denoiser.denoise(**_work(taken), subpaths=taken.subpaths)
        )
        wanted = [images[name] if bodies is None else bodies().over(images[name]) for name in copied]
        fetched = self.launcher.fetch(*taken.counted, *wanted)
        known = dict(zip(copied, fetched[len(taken.counted) :], strict=True))
        return RadianceImage(**{"radiance": None, "stderr": None} | known | _facts_of_samples(taken, fetched))

    def _fetched(self, taken: Taken, shot: Shot, wanted_layers, method: str | None) -> RadianceImage:
        """The `RadianceImage` of what was taken."""
        images, copied, work = taken.images, shot.options.copied, _work(taken)
        wanted = work | {name: images[name] for name in ("stderr", *(() if copied else wanted_layers))}
        blocks = [] if copied else [array for array, _ in taken.blocks]
        counted = self.launcher.fetch(*taken.counted, *blocks, *wanted.values())
        fetched = iter(counted[len(taken.counted) :])
        variances = [next(fetched) for _ in blocks]
        on_host = dict(zip(wanted, fetched, strict=True))
        if blocks:
            pixels = tile_pixels(*images["radiance"].shape)
            parts = zip(variances, (weights for _, weights in taken.blocks), strict=True)
            on_host["block_error"] = sum(
                (added_errors(block_error(values, pixels), weights) for values, weights in parts), np.float32(0.0)
            )
        layers = {layer: on_host.pop(layer) for layer in LAYERS if layer in on_host}
        image = RadianceImage(**on_host, layers=layers, **_facts_of_samples(taken, counted))
        return self._denoised(image, work, method)

    def _denoised(self, image: RadianceImage, on_device: dict[str, wp.array], method: str | None) -> RadianceImage:
        """The image with ``denoised`` filled in, from the arrays that lie on a GPU where there is one."""
        if method is None:
            return image
        if not on_device or not self._denoises(method):
            return replace(image, denoised=denoise_image(image, method))
        check_finite(image.radiance)
        (denoised,) = self.launcher.fetch(self._device_denoiser.denoise(**on_device, subpaths=image.subpaths))
        return replace(image, denoised=denoised)

    def _denoises(self, method: str | None) -> bool:
        """Return whether the device does that."""
        return method == "oidn" and self._device_denoiser is not None

    @functools.cached_property
    def _device_denoiser(self):
        """Open Image Denoise on the GPU; None where the host has to do."""
        if self.device == "cpu":
            return None
        try:
            return Denoiser(self.launcher)
        except (ImportError, OSError, RuntimeError) as error:
            warn(f"images are denoised on the CPU: {error}")
            return None


def _work(taken: Taken) -> dict[str, wp.array]:
    """What a denoiser works on, still on the device."""
    apart = ("correction", "base_variance") if taken.kinds else ()
    return {name: taken.images[name] for name in ("radiance", *apart)} | taken.guides


def _facts_of_samples(taken: Taken, on_host: Sequence[np.ndarray]) -> dict[str, float]:
    """How many samples were lost, which is told, and samples per pixel: as many as cost as much.

    That is a mean over the image, and over the images whose sum it is. ``on_host`` begins with what was counted.
    """
    counted, shape = on_host[: len(taken.counted)], taken.images["radiance"].shape
    kinds = taken.kinds or [ALL_ALIKE] * (len(counted) // 2)
    lost, counts = sum(int(number[0]) for number in counted[::2]), counted[1::2]
    if lost:
        warn(
            f"at least {lost} samples of an image were infinite or not a number; they count as black, "
            "and the image is darker there"
        )
    area = tile_pixels(*shape) / np.prod(shape)
    spent = sum(
        kind.cost * float((count.mean(0) * area).sum()) / IN_BLOCK for count, kind in zip(counts, kinds, strict=True)
    )
    return {
        "lost_samples": lost,
        "subpaths": taken.subpaths,
        "spp": round(spent / sum(kind.cost * kind.to_a_sample for kind in kinds), 6),
    }


def added_errors(errors: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """What errors [..., 3] in the channels of an image make in those of a weighted sum [3, 3], float32 [..., 3].

    As if all erred alike. A channel without weight adds nothing, though it is infinite.
    """
    out = np.zeros(errors.shape)
    for channel, own in zip(*np.nonzero(weights), strict=True):
        out[..., channel] += np.abs(weights[channel, own]) * errors[..., own].astype(np.float64)
    return out.astype(np.float32)
