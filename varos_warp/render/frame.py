"""One frame from one pose of the vehicle: radiance of A and B, normals of C, depth of D, objects of S."""

import functools
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import warp as wp

from varos_warp.errors import InputError
from varos_warp.kernels.conventions import ALL
from varos_warp.kernels.field.open_water import Tables
from varos_warp.kernels.film.film import Film, develop, sample_variances
from varos_warp.kernels.transport.ambient import make_ambient_kernel
from varos_warp.kernels.transport.first_hits import make_first_hits_kernel, make_guides_kernel
from varos_warp.kernels.transport.path import PathBounds, PathSpec, make_path_kernel
from varos_warp.kernels.transport.reference import make_reference_kernel
from varos_warp.kernels.transport.virtual_lights import VirtualLight, make_virtual_lights_kernel
from varos_warp.render.adapt import FEWEST_FIRST_SHARED, first_samples, more_samples, other_noise, share_out
from varos_warp.render.denoise import METHODS, check_finite, denoise_image
from varos_warp.render.field.open_water import OpenWater, along_camera, unavailable
from varos_warp.render.films import Films, tile_pixels
from varos_warp.render.images import DepthImage, Frame, NormalImage, RadianceImage, SegmentImage
from varos_warp.render.launch import Launcher, Steps, finish
from varos_warp.scene.description import Scene, field_by_old_name
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import DeviceScene, resolve_device
from varos_warp.scene.geometry import Part
from varos_warp.scene.segments import segment_table

LAYERS = ("direct", "single", "multiple")
INTEGRATORS = ("auto", "field", "path", "reference")
CORRECTION_SHARE = 1.0
"""With the field: share of a pixel's samples that take a subpath."""
DENOISED = 8.0
"""With the field, where images are denoised: samples are shared out as if that took away all but one part in so many of
the correction's variance."""
VIRTUAL_LIGHTS = (1 << 14, 1 << 20)
"""Virtual point lights are as many as the pixels, within these bounds: what pixels share of their error then falls as
the rest does."""


class Asked(NamedTuple):
    """What is asked of a radiance image."""

    layers: Sequence[str]
    denoise: str | None
    denoised_only: bool


def resolve_integrator(scene: Scene, view: Camera, name: str, max_scatterings: int | None) -> str:
    """The integrator that ``name`` stands for: ``auto`` is paths with the field where it serves, else without.

    Raises:
        InputError: If the field is asked for and cannot be had.
    """
    name = field_by_old_name(name)
    if name not in ("auto", "field"):
        return name
    why = unavailable(scene, view)
    if max_scatterings is not None:
        why = f"it holds all orders of scattering, and max_scatterings is {max_scatterings}"
    if name == "field":
        if why:
            remedy = "Use integrator path, or auto."
            raise InputError(f"the field cannot be used: {why}", key="render.integrator", value=name, remedy=remedy)
        return name
    return "path" if why else "field"


def _check_request(outputs, layers, integrator, denoise, **numbers):
    """Refuse what cannot be rendered: unknown letters, layers, integrators and denoisers, too low numbers."""
    texts = (("outputs", outputs, "ABCDS"), ("layers", layers, LAYERS), ("integrator", [integrator], INTEGRATORS),
             ("denoise", [method for method in denoise if method is not None] or METHODS, METHODS))
    for key, names, known in texts:
        unknown = [name for name in names if name not in known]
        if unknown or not len(names):
            raise InputError("unknown or none", key=key, value=names, remedy=f"Name some of: {', '.join(known)}.")
    for key, number in numbers.items():
        least = 1 if key.startswith("spp") else 0
        if number is not None and number < least:
            raise InputError(f"must be at least {least}", key=key, value=number)


def stream_key(seed: int, frame: int, camera: str, output: str) -> int:
    """32-bit key of the random numbers of one image; pixel and sample are added in the kernel."""
    words = [seed, frame, *camera.encode(), *output.encode()]
    return int(np.random.SeedSequence(words).generate_state(1)[0])


class FrameRenderer:
    """Renders frames of one scene on one device; uploads and compiles once.

    Several frames may be under way (`steps`), from several threads too, but of these only one at a time may use it.

    Args:
        scene: the scene.
        device: ``auto``, ``cpu`` or ``cuda:N``.
        parts: its geometry, where it is built already.
        threads: CPU threads; absent: all that the process may use. Does not change a byte of the result.
    """

    def __init__(self, scene: Scene, device: str = "auto", parts: list[Part] | None = None, threads: int | None = None):
        self.scene = scene
        self.device = resolve_device(device)
        self.device_name = wp.get_device(self.device).name
        if parts is None:
            from varos_warp.scene.meshes import build_parts

            parts = build_parts(scene)
        self.parts = parts
        self.world = DeviceScene(scene, parts, self.device)
        self.origin = self.world.origin
        self.segments = segment_table(scene, self.world.part_names)
        """What the numbers of S stand for: a row for each."""
        self.launcher = Launcher(self.device, threads)
        self.open_water = OpenWater(scene, self.launcher)
        self.films = Films(self.launcher)
        self._cameras = {camera.id: camera for camera in scene.vehicle.cameras}

    @property
    def compile_seconds(self) -> float:
        """Time spent so far on compiling kernels."""
        return self.launcher.compile_seconds

    def render(
        self,
        T_w_v,
        camera: str | Camera | None = None,
        outputs="ABCD",
        *,
        spp: int | None = None,
        tolerance: float | None = None,
        spp_b: int | None = None,
        max_scatterings: int | None = None,
        max_bounces: int | None = None,
        layers=LAYERS,
        integrator: str | None = None,
        denoise: str | None = None,
        denoise_b: str | None = None,
        denoised_only: bool = False,
        seed: int | None = None,
        frame: int = 0,
    ) -> Frame:
        """Render the ``outputs`` of one camera for the vehicle at ``T_w_v`` [4, 4].

        Args:
            T_w_v: pose of the vehicle in the world.
            camera: id of a camera of the scene, or a camera that is not in it; absent: the first.
            outputs: any of A, B, C, D and S.
            spp: samples per pixel of A; absent: the scene's, or 64.
            tolerance: of A by paths: tiles of 8 x 8 pixels stop once their standard error, relative to the mean of the
                image, is below it, between a quarter of ``spp`` (8 at least) and four times that
                (render/adapt.py); absent: all take ``spp``. With the field samples are always shared out by noise.
            spp_b: samples per pixel of B; absent: the scene's.
            max_scatterings: most scatterings in the water on a path; None: no bound.
            max_bounces: most reflections on surfaces; None: no bound.
            layers: which of direct, single, multiple to render.
            integrator: of A: auto, field, path or reference; absent: the scene's.
            denoise: oidn, nlm or none: fill in ``denoised`` of A, on a GPU without a way over the host; absent: do not.
            denoise_b: the same for B.
            denoised_only: of what is denoised on a GPU copy ``denoised`` alone to the host: all the rest takes longer
                than denoising it.
            seed: of the random numbers; absent: the scene's.
            frame: number of the frame, which keys the random numbers too.
        """
        how = (spp, tolerance, spp_b, max_scatterings, max_bounces, layers, integrator, denoise, denoise_b,
               denoised_only, seed, frame)
        return finish(self.steps(T_w_v, camera, outputs, *how))

    def steps(self, T_w_v, camera=None, outputs="ABCD", spp=None, tolerance=None, spp_b=None, max_scatterings=None,
              max_bounces=None, layers=LAYERS, integrator=None, denoise=None, denoise_b=None, denoised_only=False,
              seed=None, frame=0) -> Steps[Frame]:
        """Render as `render` does, step by step, so that another frame can go on while this one waits for a GPU."""
        bounds = {"max_scatterings": max_scatterings, "max_bounces": max_bounces}
        integrator = field_by_old_name(integrator or self.scene.render.integrator)
        _check_request(outputs, layers, integrator, (denoise, denoise_b), spp=spp, spp_b=spp_b, **bounds)
        view = self._camera(camera)
        seed = self.scene.seed if seed is None else seed
        T_w_v = np.asarray(T_w_v, np.float64)
        guides = functools.cache(lambda: self._trace_guides(view, T_w_v))
        images = {}
        if "A" in outputs:
            spp = spp or self.scene.render.spp or 64
            key = stream_key(seed, frame, view.id, "A")
            integrator = resolve_integrator(self.scene, view, integrator, max_scatterings)
            bounds = (ALL if bound is None else bound for bound in bounds.values())
            asked = Asked(layers, denoise, denoised_only)
            how = (spp, tolerance, *bounds, integrator, asked, guides, key)
            images["A"] = yield from self._render_water(view, T_w_v, *how)
        if "B" in outputs:
            key = stream_key(seed, frame, view.id, "B")
            asked = Asked((), denoise_b, denoised_only)
            spp_b = spp_b or self.scene.render.spp_b
            images["B"] = yield from self._render_ambient(view, T_w_v, spp_b, asked, guides, key)
        if set("CDS") & set(outputs):
            images |= yield from self._render_first_hits(view, T_w_v, outputs)
        return Frame(**images)

    def _camera(self, name: str | Camera | None) -> Camera:
        if isinstance(name, Camera):
            return name
        if name is None:
            return self.scene.vehicle.cameras[0]
        if name not in self._cameras:
            raise InputError(
                "no such camera", key="camera", value=name, remedy=f"There are: {', '.join(self._cameras)}."
            )
        return self._cameras[name]

    # ------------------------------------------------------------------------------------------------- the images

    def _render_water(
        self, view, T_w_v, spp, tolerance, max_scatterings, max_bounces, integrator, asked, guides, key
    ) -> Steps[RadianceImage]:
        medium = bool(self.world.water.sigma_s.any())
        if not (self.world.has_surfaces or medium) or not self.scene.vehicle.lights:
            black = np.zeros((*view.resolution[::-1], 3), np.float32)
            image = RadianceImage(black, black.copy(), {layer: black.copy() for layer in asked.layers})
            return (yield from self._denoised(image, {}, asked.denoise))
        max_scatterings = max_scatterings if medium else 0
        how = (spp, tolerance, max_scatterings, max_bounces, asked, guides, key)
        if integrator == "reference":
            return (yield from self._render_reference(view, T_w_v, *how))
        return (yield from self._render_paths(view, T_w_v, *how, integrator == "field"))

    def _render_reference(self, view, T_w_v, spp, tolerance, max_scatterings, max_bounces, asked, guides, key
                          ) -> Steps[RadianceImage]:
        film = self.films.black(view.resolution)
        kernel = make_reference_kernel(*self._wanted(asked), self.world.has_instances, self.world.has_textures)
        before = [self.world.lit(T_w_v), self.world.camera(view, T_w_v)]
        self.films.take(film, kernel, before, [max_scatterings, max_bounces, wp.uint32(key), film], spp, paths=True)
        return (yield from self._develop(film, asked))

    def _render_paths(self, view, T_w_v, spp, tolerance, max_scatterings, max_bounces, asked, guides, key,
                      with_field: bool) -> Steps[RadianceImage]:
        keys = [int(k) for k in np.random.SeedSequence(key).generate_state(2)]
        scene = self.world.lit(T_w_v)
        filtered = (asked.denoise or self.scene.render.denoise) != "none"
        kernel = make_path_kernel(self._path_spec(view, asked, max_scatterings, with_field))
        field = self.open_water.tables(view) if with_field else Tables()
        bounds = PathBounds()
        bounds.scatterings, bounds.bounces = max_scatterings, max_bounces
        bounds.correction = CORRECTION_SHARE if with_field else 1.0
        shares = (with_field or tolerance is not None) and not _is_one_pixel(view)
        first = min(spp, first_samples(spp, FEWEST_FIRST_SHARED)) if with_field else first_samples(spp)
        film = self.films.black(view.resolution, adapts=shares, metal=with_field and self.world.has_textures)
        before = [scene, self.world.camera(view, T_w_v)]
        after = [field, self._virtual_lights(scene, view, keys[0]), bounds, wp.uint32(keys[1]), film]
        self.films.take(film, kernel, before, after, first if shares else spp, paths=True)
        if shares and (first < spp or not with_field):
            noise = other_noise(*(yield from self.films.tile_statistics(film, DENOISED if filtered else 1.0)))
            more = share_out(noise, first, spp) if with_field else more_samples(noise, first, tolerance, spp)
            self.films.take(film, kernel, before, after, more, paths=True)
        # plain reflectances need no guides (render/denoise.py)
        guided = with_field and self.world.has_textures and asked.denoise != "none"
        return (yield from self._develop(film, asked, guides() if guided else {}, corrected=with_field))

    def _wanted(self, asked: Asked) -> tuple[bool, ...]:
        return tuple(layer in asked.layers for layer in LAYERS)

    def _path_spec(self, view, asked: Asked, max_scatterings: int, with_field: bool) -> PathSpec:
        world = self.world
        return PathSpec(max_scatterings > 0, *self._wanted(asked), world.has_instances, world.has_textures,
                        world.has_surfaces, with_field, with_field and along_camera(self.scene, view))

    def _virtual_lights(self, scene, view, key: int) -> wp.array:
        """Virtual point lights of a frame."""
        if not self.world.has_surfaces:
            return wp.empty(0, dtype=VirtualLight, device=self.device)
        few, many = VIRTUAL_LIGHTS
        count = int(np.clip(1 << int(np.prod(view.resolution)).bit_length(), few, many))
        lights = wp.empty(count, dtype=VirtualLight, device=self.device)
        kernel = make_virtual_lights_kernel(self.world.has_instances, self.world.has_textures)
        self.launcher.rows(kernel, lights.shape, [scene], [wp.uint32(key), lights], tile_rows=1024)
        return lights

    def _render_ambient(self, view, T_w_v, spp, asked, guides, key) -> Steps[RadianceImage]:
        if not self.world.has_surfaces:
            shape = (*view.resolution[::-1], 3)
            image = RadianceImage(np.ones(shape, np.float32), np.zeros(shape, np.float32))
            return (yield from self._denoised(image, {}, asked.denoise))
        film = self.films.black(view.resolution)
        kernel = make_ambient_kernel(self.world.has_instances, self.world.has_textures)
        camera = self.world.camera(view, T_w_v, pinhole=True)
        self.films.take(film, kernel, [self.world.data, camera], [ALL, wp.uint32(key), film], spp)
        guided = (asked.denoise or self.scene.render.denoise_b) == "oidn"
        return (yield from self._develop(film, asked, guides() if guided else {}))

    def _render_first_hits(self, view, T_w_v, outputs) -> Steps[dict[str, NormalImage | DepthImage | SegmentImage]]:
        width, height = view.resolution
        shape = (height, width)
        normal = wp.zeros(shape, dtype=wp.vec3, device=self.device)
        depth, distance = (wp.full(shape, wp.inf, dtype=float, device=self.device) for _ in range(2))
        instance = wp.zeros(shape, dtype=wp.int32, device=self.device)
        if self.world.has_surfaces:
            camera = self.world.camera(view, T_w_v, pinhole=True)
            kernel = make_first_hits_kernel(self.world.has_instances)
            self.launcher.rows(kernel, shape, [self.world.data, camera], [normal, depth, distance, instance])
        arrays = {"C": [normal], "D": [depth, distance], "S": [instance]}
        wanted = [letter for letter in arrays if letter in outputs]
        fetched = iter((yield from self.launcher.fetch(*(array for letter in wanted for array in arrays[letter]))))
        on_host = {letter: [next(fetched) for _ in arrays[letter]] for letter in wanted}
        if "S" in on_host:
            ids, = on_host["S"]
            on_host["S"].append(np.array([0, *(row["material_id"] for row in self.segments)], np.int32)[ids])
        kinds = {"C": NormalImage, "D": DepthImage, "S": SegmentImage}
        return {letter: kinds[letter](*images) for letter, images in on_host.items()}

    def _develop(self, film: Film, asked: Asked, guides=None, corrected: bool = False) -> Steps[RadianceImage]:
        """The `RadianceImage` of a film."""
        shape = film.sums.shape[1:]
        names = (*LAYERS, "correction", "metal_variance", "radiance", "stderr")
        images = {name: wp.empty(shape, dtype=wp.vec3, device=self.device) for name in names}
        variance = self.films.buffer(*shape)
        self.launcher.run(sample_variances, shape, [film], [variance])
        self.launcher.run(develop, shape, [film, variance], list(images.values()))
        # what a denoiser works on, still on the device
        of_field = ("correction", "metal_variance") if corrected else ()
        work = {name: images[name] for name in ("radiance", *of_field)} | (guides or {})
        if asked.denoised_only and self._denoises(asked.denoise):
            wanted = {"denoised": self._device_denoiser.denoise(**work)}
        else:
            wanted = work | {name: images[name] for name in ("stderr", *asked.layers)}
        lost, count, *arrays = yield from self.launcher.fetch(film.lost, film.count, *wanted.values())
        self.films.keep(film)
        on_host = dict(zip(wanted, arrays, strict=True))
        if lost[0]:
            warnings.warn(f"at least {lost[0]} samples of an image were infinite or not a number; they count as black, "
                          "and the image is darker there", stacklevel=7)
        facts = {"lost_samples": int(lost[0]), "spp": _mean_over_pixels(count.mean(0), shape)}
        if "denoised" in on_host:
            return RadianceImage(None, None, **on_host, **facts)
        layers = {layer: on_host.pop(layer) for layer in LAYERS if layer in asked.layers}
        image = RadianceImage(**on_host, layers=layers, **facts)
        return (yield from self._denoised(image, work, asked.denoise))

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
        from varos_warp.render.device_denoise import DeviceDenoiser

        try:
            return DeviceDenoiser(self.device)
        except (ImportError, OSError, RuntimeError) as error:
            warnings.warn(f"images are denoised on the CPU: {error}", stacklevel=2)
            return None

    def _trace_guides(self, view, T_w_v) -> dict[str, wp.array]:
        """Albedo and normals."""
        shape = view.resolution[::-1]
        guides = {name: wp.empty(shape, dtype=wp.vec3, device=self.device) for name in ("albedo", "normal")}
        kernel = make_guides_kernel(self.world.has_instances, self.world.has_textures)
        camera = self.world.camera(view, T_w_v, pinhole=True)
        self.launcher.rows(kernel, shape, [self.world.data, camera], list(guides.values()))
        return guides


def _is_one_pixel(view: Camera) -> bool:
    """Whether there is no other side to decide for a pixel."""
    return tuple(view.resolution) == (1, 1)


def _mean_over_pixels(tiles: np.ndarray, shape: tuple[int, int]) -> float:
    """Mean over the pixels of an image [H, W] of what is known of its tiles."""
    return float((tiles * tile_pixels(*shape)).sum() / np.prod(shape))
