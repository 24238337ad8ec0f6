"""Which kernels make an image, stated once: an image takes them from here, and threads compile them ahead."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import NamedTuple

import warp as wp

from varos_warp.device.compile import compiling
from varos_warp.kernels.field.tabulate import tabulate_single_along_camera
from varos_warp.kernels.film import denoise
from varos_warp.kernels.film.adapt import average_tiles, find_levels, share_samples
from varos_warp.kernels.film.compare import compare_rows
from varos_warp.kernels.film.develop import develop
from varos_warp.kernels.film.film import BLOCK, CORRECTION_SUMS, SUMS, add_batches
from varos_warp.kernels.mesh.bake import bake_ground
from varos_warp.kernels.particles.draw import count_bodies, make_draw_kernel
from varos_warp.kernels.particles.expected import make_expected_kernel, tabulate_expected
from varos_warp.kernels.particles.field_light import make_field_light_kernel
from varos_warp.kernels.particles.gather import gather_splats
from varos_warp.kernels.particles.over import lay_over
from varos_warp.kernels.spec import SceneSpec
from varos_warp.kernels.transport.ambient import make_ambient_kernel
from varos_warp.kernels.transport.camera_segment import make_camera_kernel
from varos_warp.kernels.transport.first_hits import make_first_hits_kernel, make_guides_kernel, make_hidden_kernel
from varos_warp.kernels.transport.path import make_subpath_kernel
from varos_warp.kernels.transport.purity import make_purity_kernel
from varos_warp.kernels.transport.reference import make_reference_kernel
from varos_warp.kernels.transport.virtual_lights import make_virtual_lights_kernel
from varos_warp.products.images.protocol import Source
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.render.field.along_camera import along_camera
from varos_warp.render.field.open_water import unavailable
from varos_warp.render.options import LAYERS, RenderOptions, options_of, resolve_integrator
from varos_warp.render.particles.cells import check_cells
from varos_warp.scene.description import Scene
from varos_warp.scene.description.render import field_by_old_name, sees_water
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.description.world import SlopeBlend
from varos_warp.scene.device import foretold_spec, optics_spec
from varos_warp.scene.geometry.surface import KERNELS
from varos_warp.scene.lights.records import disks, lights_vary
from varos_warp.scene.optics.shutter import is_rolling
from varos_warp.scene.water.particles import particle_laws

SPLITTING = 4
"""Camera segments to a subpath, where nothing else is known."""
SEGMENT_COST = 0.13
"""Time of a camera's segment over that of a subpath, constant, so that machines choose alike: about 0.11 on an H200 and
on a CPU where two lamps are asked, 0.14 on an H200 on a scene of fewer triangles (Munkholmen)."""
FEW_LIGHTS = 4
"""Lights of which each is asked for its direct light by every segment of the camera. One that is chosen of two leaves
1.1 to 1.2 times the error of a denoised image of Munkholmen in 0.92 of the time (1280 x 720, H200). With four, in
coastal water and a closed room, errors are the same and times within 4 %: there D is what is noisy (640 x 360)."""
COLOUR_CYCLE = 6
"""Samples are a multiple of this where each channel has its own rays, and all channels have equally many."""


class SampleKind(NamedTuple):
    """One kind of samples whose sum is an image."""

    kernel: wp.Kernel
    to_a_sample: int
    """Number of these samples to a sample per pixel, where nothing else is known."""
    cost: float
    """Relative cost of one sample."""
    subpaths: bool
    """True if they are subpaths, False if they are segments of the camera."""
    sums: int = SUMS
    """Number of sums of each pixel of the film."""


ALL_ALIKE = SampleKind(None, 1, 1.0, False)
"""Samples of images that have one kind only."""


def sample_step(view: Camera, with_field: bool) -> int:
    """What samples per pixel of A are a multiple of; 0 if tiles take unlike numbers, whose mean may be any fraction."""
    if optics_spec(view).dispersion:
        return COLOUR_CYCLE
    # a row of blocks has no neighbours across corners, by which the other side decides
    return 0 if with_field and min(view.resolution) > BLOCK else 1


class LightKernels(NamedTuple):
    """Kernels of A, P or B; None, or no kinds, of what it does without."""

    kinds: tuple[SampleKind, ...] = ()
    """What paths take samples with."""
    samples: wp.Kernel | None = None
    """Takes those of the reference, or of B."""
    virtual_lights: wp.Kernel | None = None
    guides: wp.Kernel | None = None


def water_kernels(
    scene: Scene, spec: SceneSpec, view: Camera, options: RenderOptions, integrator: str, moves: bool
) -> LightKernels | None:
    """Kernels of A, or of P for its camera; None if it is black: nothing could send light there, or there is none.

    Args:
        scene: The scene.
        spec: What is present in it.
        view: The camera.
        options: With everything that the scene has to say.
        integrator: field, path or reference.
        moves: Whether the camera moves while its shutter is open.
    """
    if not (spec.surfaces or spec.medium) or not scene.lights:
        return None
    layers = {layer: layer in options.layers for layer in LAYERS}
    spec = replace(
        spec,
        optics=optics_spec(view),
        varies=moves or lights_vary(scene.lights),
        disks=disks(scene.lights),
        few_lights=len(scene.lights) <= FEW_LIGHTS,
        **layers,
    )
    if integrator == "reference":
        return LightKernels(samples=make_reference_kernel(spec))
    with_field, kinds = integrator == "field", []
    of_paths = replace(
        spec,
        medium=spec.medium and options.max_scatterings != 0,
        field=with_field,
        camera_field=with_field and along_camera(scene, view),
    )
    if camera := of_paths.camera():
        kinds.append(SampleKind(make_camera_kernel(camera), SPLITTING, SEGMENT_COST, False))
    if subpaths := of_paths.subpaths():
        kinds.append(SampleKind(make_subpath_kernel(subpaths), 1, 1.0, True, CORRECTION_SUMS))
    # without the field the base is too noisy to guide
    guided = with_field and spec.surfaces and options.denoise in (None, "oidn")
    return LightKernels(
        tuple(kinds),
        guides=make_guides_kernel(replace(spec, varies=moves)) if guided else None,
        virtual_lights=make_virtual_lights_kernel(spec) if subpaths and spec.surfaces else None,
    )


def ambient_kernels(spec: SceneSpec, view: Camera, denoiser: str, moves: bool) -> LightKernels | None:
    """Kernels of B, which ``denoiser`` takes; None without surfaces: it is known. The rest as in `water_kernels`."""
    spec = replace(spec, optics=optics_spec(view), varies=moves)
    # at rest the mean albedo of the samples is nearly free of noise, and serves
    guides = make_guides_kernel(spec) if denoiser == "oidn" and moves else None
    return LightKernels(samples=make_ambient_kernel(spec), guides=guides) if spec.surfaces else None


class HitKernels(NamedTuple):
    """Kernel of C, D and S, and what F needs besides."""

    first_hits: wp.Kernel
    hidden: wp.Kernel


def hit_kernels(spec: SceneSpec, view: Camera, rolls: bool) -> HitKernels | None:
    """Kernels of C, D, S and F; None without surfaces. ``rolls``: rows are of different instants."""
    spec = replace(spec, optics=optics_spec(view), rolling=rolls)
    return HitKernels(make_first_hits_kernel(spec), make_hidden_kernel(spec)) if spec.surfaces else None


def purity_kernel(spec: SceneSpec, view: Camera, moves: bool, rolls: bool) -> wp.Kernel | None:
    """Kernel of U; None without surfaces. ``moves``: the camera does so while its shutter is open."""
    spec = replace(spec, optics=optics_spec(view), varies=moves, rolling=rolls)
    return make_purity_kernel(spec) if spec.surfaces else None


class ParticleKernels(NamedTuple):
    """What lists the images of bodies, what tells their mean, and what tabulates that of the field, if it is known."""

    draw: wp.Kernel
    expected: wp.Kernel
    field_light: wp.Kernel | None


def lamps_tabled(scene: Scene, view: Camera) -> bool:
    """Return whether what bodies scatter of the lamps in the mean can be tabulated along a camera's rays.

    It cannot where lamps change, or rays and lamps do not move together.
    """
    return along_camera(scene, view) and not lights_vary(scene.lights)


def particle_kernels(
    scene: Scene, spec: SceneSpec, view: Camera, moves: bool, field: bool, tabled: bool
) -> ParticleKernels:
    """Kernels of bodies in the water.

    Args:
        scene: The scene.
        spec: Of the scene.
        view: The camera.
        moves: Whether the vehicle moves while the shutter is open.
        field: Whether the field lights them.
        tabled: Whether there are tables of what they scatter of the lamps' light.
    """
    moves = moves and not view.exposure.is_instant
    spec = replace(
        spec,
        optics=optics_spec(view),
        varies=moves or lights_vary(scene.lights),
        rolling=is_rolling(view) and (moves or lights_vary(scene.lights)),
        disks=disks(scene.lights),
        field=field,
        lamps_tabled=tabled,
    )
    return ParticleKernels(
        make_draw_kernel(spec), make_expected_kernel(spec), make_field_light_kernel(spec) if spec.field else None
    )


def lit_by_field(scene: Scene) -> bool:
    """Return whether scattered light shines on bodies too: where the field of open water may serve A.

    It does not depend on what a plan chooses, so that bodies look alike in all runs.
    """
    return field_by_old_name(scene.render.integrator) in ("auto", "field") and unavailable(scene) is None


def kernels_needed(
    scene: Scene, spec: SceneSpec, letters: Iterable[str], integrator: str | None = None
) -> list[wp.Kernel]:
    """What images of the scene's cameras will need, of a vehicle under way: one kernel of each module, longest first.

    Args:
        scene: The scene.
        spec: What is present in it.
        letters: Which images.
        integrator: Of A and P; absent: the scene's, and where that is open, all that a plan may compare.
    """
    asked = {*letters}
    wanted = [image for letter, image in OUTPUTS.items() if letter in asked]
    sources = {image.source for image in wanted}
    options, names, images, hits = options_of(scene, {"integrator": integrator}), [], [], []
    if Source.WATER in sources:
        names = [resolve_integrator(options.integrator, options.max_scatterings, lambda: unavailable(scene))]
    if (options.integrator, names) == ("auto", ["field"]) and spec.surfaces:
        names.append("path")  # a plan compares them
    for view in scene.vehicle.cameras:
        for image in wanted:
            seen, moves = image.seen_by(scene, view), image.blurs and not view.exposure.is_instant
            if image.source is Source.WATER:
                images += [water_kernels(scene, spec, seen, options, name, moves) for name in names]
            if image.source is Source.AMBIENT:
                images.append(ambient_kernels(spec, seen, getattr(scene.render, image.denoise_key), moves))
        if scene.particles and sources & {Source.WATER, Source.PARTICLES}:
            tabled = lamps_tabled(scene, view)
            bodies = particle_kernels(scene, spec, view, not view.exposure.is_instant, lit_by_field(scene), tabled)
            hits += [
                gather_splats,
                lay_over,
                count_bodies,
                *([tabulate_expected] if tabled else []),
                *(kernel for kernel in bodies if kernel),
            ]
        if sources & {Source.FIRST_HITS, Source.NEXT_FRAME}:
            hits += (hit_kernels(spec, view, is_rolling(view)) or ())[: 1 + (Source.NEXT_FRAME in sources)]
        if any(image.rays for image in wanted) and spec.surfaces:
            hits.append(purity_kernel(spec, view, not view.exposure.is_instant, is_rolling(view)))
    made = [image for image in images if image]
    kernels = [kind.kernel for image in made for kind in reversed(image.kinds)]
    if "field" in names:
        kernels += [tabulate_single_along_camera, average_tiles, find_levels, share_samples]
    kernels += [*(kernel for image in made for kernel in image[1:] if kernel), *hits]
    if any(image.is_color for image in wanted):
        kernels += [develop, add_batches]
    if any(image.is_color and getattr(scene.render, image.denoise_key) != "none" for image in wanted):
        kernels.append(denoise.clip_negative)
    return list(dict.fromkeys(kernels))


@contextmanager
def compiling_foretold(
    scene: Scene, device: str, letters: Iterable[str], integrator: str | None = None
) -> Iterator[None]:
    """A ``with`` statement during which threads compile what loading a scene and its images will need.

    As far as the scene file tells; arguments as for `kernels_needed`.

    Raises:
        InputError: If the water cannot have the particles that the scene says, or there would be too many.
    """
    check_cells(particle_laws(scene), scene.vehicle.cameras)
    kernels = kernels_needed(scene, foretold_spec(scene, device), letters, integrator)
    if any(isinstance(material, SlopeBlend) for material in scene.materials.values()):
        kernels.insert(0, bake_ground)
    on_host = list(KERNELS) if getattr(scene.terrain, "preprocess", None) else []
    if integrator is None and scene.render.spp is None and sees_water(letters):
        on_host.append(compare_rows)  # for a plan
    with compiling(on_host, "cpu"), compiling(kernels, device):
        yield
