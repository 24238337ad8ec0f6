"""The images of light: A with the water and B without, from their samples to what a denoiser leaves."""

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import warp as wp

from varos_warp.errors import warn
from varos_warp.kernels.conventions import ALL
from varos_warp.kernels.field.open_water import Field
from varos_warp.kernels.film.film import Film, develop, tile_variances
from varos_warp.kernels.transport.ambient import make_ambient_kernel
from varos_warp.kernels.transport.first_hits import make_guides_kernel
from varos_warp.kernels.transport.path import PathBounds, PathSpec, make_path_kernel
from varos_warp.kernels.transport.reference import make_reference_kernel
from varos_warp.kernels.transport.virtual_lights import VirtualLight, make_virtual_lights_kernel
from varos_warp.render.field.open_water import OpenWater, along_camera
from varos_warp.render.image.adapt import first_samples, other_noise, share_out
from varos_warp.render.image.denoise import check_finite, denoise_image
from varos_warp.render.image.films import Films, tile_pixels
from varos_warp.render.image.frame import RadianceImage, block_error, without_noise
from varos_warp.render.launch import Steps
from varos_warp.render.options import LAYERS, RenderOptions, resolve_integrator
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import DeviceScene

DENOISED = 8.0
"""With the field, where images are denoised: samples are shared out as if that took away all but one part in so many of
the correction's variance."""
VIRTUAL_LIGHTS = (1 << 14, 1 << 20)
"""Virtual point lights are as many as the pixels, within these bounds: what pixels share of their error then falls as
the rest does."""


class Shot(NamedTuple):
    """One image to make."""

    view: Camera
    T_w_v: np.ndarray
    options: RenderOptions
    """With everything that the scene has to say."""
    key: int
    """Of its random numbers."""
    guides: Callable[[], dict[str, wp.array]]
    """Albedo and normals, traced once for all images of a frame."""


class RadianceRenderer:
    """Renders A and B of one scene on one device."""

    def __init__(self, scene: Scene, world: DeviceScene, films: Films):
        self.scene, self.world, self.films = scene, world, films
        self.launcher, self.device = films.launcher, films.device
        self.open_water = OpenWater(scene, self.launcher)
        self.apart = self.device != "cpu"
        """Whether, with the field, the camera's own segments have a kernel of their own, see `PathSpec.apart`."""

    def water(self, shot: Shot) -> Steps[RadianceImage]:
        """Render A."""
        view, options = shot.view, shot.options
        integrator = resolve_integrator(self.scene, view, options.integrator, options.max_scatterings)
        medium = bool(self.world.water.sigma_s.any())
        if not (self.world.has_surfaces or medium) or not self.scene.vehicle.lights:
            black = np.zeros((*view.resolution[::-1], 3), np.float32)
            image = without_noise(black, layers={layer: black.copy() for layer in options.layers})
            return (yield from self._denoised(image, {}, options.denoise))
        bounds, most = PathBounds(), (options.max_scatterings if medium else 0, options.max_bounces)
        bounds.scatterings, bounds.bounces = (ALL if bound is None else bound for bound in most)
        if integrator == "reference":
            return (yield from self._by_reference(shot, bounds))
        return (yield from self._by_paths(shot, bounds, integrator == "field"))

    def _by_reference(self, shot: Shot, bounds: PathBounds) -> Steps[RadianceImage]:
        options, world = shot.options, self.world
        film = self.films.black(shot.view.resolution)
        layers = (layer in options.layers for layer in LAYERS)
        kernel = make_reference_kernel(*layers, world.has_instances, world.has_textures)
        before = [world.lit(shot.T_w_v), world.camera(shot.view, shot.T_w_v)]
        after = [bounds.scatterings, bounds.bounces, wp.uint32(shot.key), film]
        self.films.take(film, [kernel], before, after, options.spp)
        return (yield from self._develop(film, shot, options.layers, options.denoise))

    def _by_paths(self, shot: Shot, bounds: PathBounds, with_field: bool) -> Steps[RadianceImage]:
        view, options, world = shot.view, shot.options, self.world
        keys = [int(k) for k in np.random.SeedSequence(shot.key).generate_state(2)]
        scene = world.lit(shot.T_w_v)
        kernels = self._path_kernels(shot, bounds, with_field)
        # single scattering in open water is a quadrature
        field = self.open_water.field(view) if with_field and "multiple" in options.layers else Field()
        # a single pixel has no other side to decide for it
        shares = with_field and tuple(view.resolution) != (1, 1)
        first = first_samples(options.spp) if shares else options.spp
        film = self.films.black(view.resolution, adapts=shares)
        before = [scene, world.camera(view, shot.T_w_v)]
        after = [field, self._virtual_lights(scene, view, keys[0]), bounds, wp.uint32(keys[1]), film]
        self.films.take(film, kernels, before, after, first, queued=True)
        if first < options.spp:
            # by the noise of the first, of which a denoiser takes most
            denoised = (options.denoise or self.scene.render.denoise) != "none"
            noise = other_noise(*(yield from self.films.tile_statistics(film, DENOISED if denoised else 1.0)))
            self.films.take(film, kernels, before, after, share_out(noise, first, options.spp), queued=True)
        # plain reflectances need no guides (render/image/denoise.py)
        guided = world.has_textures and options.denoise != "none"
        guides = shot.guides() if guided else {}
        return (yield from self._develop(film, shot, options.layers, options.denoise, guides, by_paths=True))

    def _path_kernels(self, shot: Shot, bounds: PathBounds, with_field: bool) -> list[wp.Kernel]:
        world, layers = self.world, (layer in shot.options.layers for layer in LAYERS)
        spec = PathSpec(bounds.scatterings > 0, *layers, world.has_instances, world.has_textures,
                        world.has_surfaces, with_field, with_field and along_camera(self.scene, shot.view))
        apart = self.apart and with_field and world.has_surfaces  # without surfaces there are no subpaths
        return [make_path_kernel(part) for part in (spec.apart() if apart else [spec])]

    def _virtual_lights(self, scene, view, key: int) -> wp.array:
        """Virtual point lights of a frame."""
        if not self.world.has_surfaces:
            return wp.empty(0, dtype=VirtualLight, device=self.device)
        count = int(np.clip(1 << int(np.prod(view.resolution)).bit_length(), *VIRTUAL_LIGHTS))
        lights = wp.empty(count, dtype=VirtualLight, device=self.device)
        kernel = make_virtual_lights_kernel(self.world.has_instances, self.world.has_textures)
        self.launcher.rows(kernel, lights.shape, [scene], [wp.uint32(key), lights], tile_rows=1024)
        return lights

    def ambient(self, shot: Shot) -> Steps[RadianceImage]:
        """Render B."""
        resolution, method, world = shot.view.resolution, shot.options.denoise_b, self.world
        if not world.has_surfaces:
            image = without_noise(np.ones((*resolution[::-1], 3), np.float32))
            return (yield from self._denoised(image, {}, method))
        film = self.films.black(resolution)
        kernel = make_ambient_kernel(world.has_instances, world.has_textures)
        before = [world.data, world.camera(shot.view, shot.T_w_v, pinhole=True)]
        self.films.take(film, [kernel], before, [ALL, wp.uint32(shot.key), film], shot.options.spp_b)
        guided = (method or self.scene.render.denoise_b) == "oidn"
        return (yield from self._develop(film, shot, (), method, shot.guides() if guided else {}))

    def trace_guides(self, view, T_w_v) -> dict[str, wp.array]:
        """Albedo and normals at the centres of the pixels."""
        shape = view.resolution[::-1]
        guides = {name: wp.empty(shape, dtype=wp.vec3, device=self.device) for name in ("albedo", "normal")}
        kernel = make_guides_kernel(self.world.has_instances, self.world.has_textures)
        camera = self.world.camera(view, T_w_v, pinhole=True)
        self.launcher.rows(kernel, shape, [self.world.data, camera], list(guides.values()))
        return guides

    def _develop(self, film: Film, shot: Shot, wanted_layers, method: str | None, guides=None, by_paths: bool = False
                 ) -> Steps[RadianceImage]:
        """The `RadianceImage` of a film."""
        shape = film.sums.shape[1:]
        names = (*LAYERS, "correction", "base_variance", "radiance", "stderr")
        images = {name: wp.empty(shape, dtype=wp.vec3, device=self.device) for name in names}
        variance, blocks = (self.films.buffer(*film.count.shape[1:]) for _ in "vb")
        self.launcher.run(tile_variances, blocks.shape, [film], [variance, blocks])
        self.launcher.run(develop, shape, [film, variance], list(images.values()))
        # what a denoiser works on, still on the device
        apart = ("correction", "base_variance") if by_paths else ()
        work = {name: images[name] for name in ("radiance", *apart)} | (guides or {})
        if shot.options.denoised_only and self._denoises(method):
            wanted = {"denoised": self._device_denoiser.denoise(**work)}
        else:
            wanted = work | {"block_error": blocks} | {name: images[name] for name in ("stderr", *wanted_layers)}
        lost, count, *arrays = yield from self.launcher.fetch(film.lost, film.count, *wanted.values())
        self.films.keep(film)
        on_host = dict(zip(wanted, arrays, strict=True))
        if lost[0]:
            warn(f"at least {lost[0]} samples of an image were infinite or not a number; they count as black, "
                 "and the image is darker there")
        spp = float((count.mean(0) * tile_pixels(*shape)).sum() / np.prod(shape))
        facts = {"lost_samples": int(lost[0]), "spp": spp}
        if "block_error" in on_host:
            on_host["block_error"] = block_error(on_host["block_error"], tile_pixels(*shape))
        if "denoised" in on_host:
            return RadianceImage(None, None, **on_host, **facts)
        layers = {layer: on_host.pop(layer) for layer in LAYERS if layer in wanted_layers}
        return (yield from self._denoised(RadianceImage(**on_host, layers=layers, **facts), work, method))

    def _denoised(self, image: RadianceImage, on_device: dict[str, wp.array], method: str | None
                  ) -> Steps[RadianceImage]:
        """The image with ``denoised`` filled in, from the arrays that lie on a GPU where there is one."""
        if method is None:
            return image
        if not on_device or not self._denoises(method):
            return replace(image, denoised=denoise_image(image, method))
        check_finite(image.radiance)
        denoised, = yield from self.launcher.fetch(self._device_denoiser.denoise(**on_device))
        return replace(image, denoised=denoised)

    def _denoises(self, method: str | None) -> bool:
        """Whether the device does that."""
        return method == "oidn" and self._device_denoiser is not None

    @functools.cached_property
    def _device_denoiser(self):
        """Open Image Denoise on the GPU; None where the host has to do."""
        if self.device == "cpu":
            return None
        from varos_warp.render.image.device_denoise import DeviceDenoiser

        try:
            return DeviceDenoiser(self.device)
        except (ImportError, OSError, RuntimeError) as error:
            warn(f"images are denoised on the CPU: {error}")
            return None
