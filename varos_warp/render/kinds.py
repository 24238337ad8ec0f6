"""Which kernels make an image: the kinds of samples that it is the sum of, and all that is compiled for a scene."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import warp as wp

from varos_warp.device.compile import compiling
from varos_warp.kernels.field.tabulate import tabulate_in_scattering
from varos_warp.kernels.film import denoise, film
from varos_warp.kernels.film.adapt import average_tiles
from varos_warp.kernels.film.compare import compare_rows
from varos_warp.kernels.mesh.bake import bake_ground
from varos_warp.kernels.spec import SceneSpec
from varos_warp.kernels.transport.ambient import make_ambient_kernel
from varos_warp.kernels.transport.camera_segment import make_camera_kernel
from varos_warp.kernels.transport.first_hits import make_first_hits_kernel, make_guides_kernel, make_hidden_kernel
from varos_warp.kernels.transport.path import make_subpath_kernel
from varos_warp.kernels.transport.virtual_lights import make_virtual_lights_kernel
from varos_warp.render.field.open_water import along_camera, unavailable
from varos_warp.render.options import LAYERS, RenderOptions, options_of, resolve_integrator
from varos_warp.scene.description import Scene
from varos_warp.scene.description.optics import twin
from varos_warp.scene.description.render import sees_water
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.description.world import SlopeBlend
from varos_warp.scene.device import foretold_spec, optics_spec
from varos_warp.scene.geometry.surface import KERNELS
from varos_warp.scene.lights.records import lights_vary
from varos_warp.scene.optics.shutter import is_rolling

SPLITTING = 4
"""Camera segments to a subpath, where nothing else is known."""
SEGMENT_COST = 0.17
"""Time of a camera's segment over that of a subpath, constant, so that machines choose alike: 0.2 was measured on an
H100, 0.33 on a CPU (Munkholmen)."""


COLOUR_CYCLE = 6
"""Where each channel has its own rays, samples are a multiple of this, and all channels have equally many."""


class SampleKind(NamedTuple):
    """One kind of samples whose sum is an image."""

    kernel: wp.Kernel
    to_a_sample: int
    """How many there are to a sample per pixel, where nothing else is known."""
    cost: float
    """Of one of them."""
    subpaths: bool
    """Subpaths, or segments of the camera."""
    sums: int = film.SUMS
    """Of each pixel of the film."""


ALL_ALIKE = SampleKind(None, 1, 1.0, False)
"""Samples of images that have one kind only."""


def kinds_of_samples(scene: Scene, spec: SceneSpec, view: Camera, options: RenderOptions, with_field: bool,
                     varies: bool) -> list[SampleKind]:
    """What A is the sum of, by paths with or without the field; ``varies``: compiled for moments."""
    spec = replace(spec, medium=spec.medium and options.max_scatterings != 0, field=with_field, varies=varies,
                   camera_field=with_field and along_camera(scene, view), optics=optics_spec(view), **layers(options))
    kinds = []
    if camera := spec.camera():
        kinds.append(SampleKind(make_camera_kernel(camera), SPLITTING, SEGMENT_COST, False))
    if subpaths := spec.subpaths():
        kinds.append(SampleKind(make_subpath_kernel(subpaths), 1, 1.0, True, film.CORRECTION_SUMS))
    return kinds


def layers(options: RenderOptions) -> dict[str, bool]:
    """Which layers of A are wanted, as fields of a spec."""
    return {layer: layer in options.layers for layer in LAYERS}


def sample_step(view: Camera, with_field: bool) -> int:
    """What samples per pixel of A are a multiple of; 0 if tiles take unlike numbers, whose mean may be any fraction."""
    if optics_spec(view).dispersion:
        return COLOUR_CYCLE
    # a row of pixels has no neighbours across corners, by which the other side decides
    return 0 if with_field and min(view.resolution) > 1 else 1


def is_dark(scene: Scene, spec: SceneSpec) -> bool:
    """Whether A is black: nothing could send light to a camera, or there is none."""
    return not (spec.surfaces or spec.medium) or not scene.lights


def twin_of(scene: Scene, view: Camera) -> Camera:
    """The camera of P; strobes light it as they do A."""
    strobes = any(light.strobe for light in scene.lights)
    return twin(view).model_copy(update={"shutter": view.shutter}) if strobes else twin(view)


def kernels_needed(scene: Scene, spec: SceneSpec, letters: Iterable[str], integrator: str | None = None,
                   device: str = "cpu") -> list[wp.Kernel]:
    """What images of the scene's cameras will need, of a vehicle under way: one kernel of each module, longest first.

    Args:
        scene: The scene.
        spec: What is present in it.
        letters: Which images, of A, B, C, D, S, P, F.
        integrator: Of A and P; absent: the scene's, and where that is open, all that a plan may compare.
        device: On which they are denoised.
    """
    options, letters = options_of(scene, {"integrator": integrator}), {*letters}
    no_field = cache(lambda: unavailable(scene))  # it reads files
    kernels: list[wp.Kernel] = []
    for view in scene.vehicle.cameras:
        for letter, seen in (("A", view), ("P", twin_of(scene, view))):
            if letter in letters and not is_dark(scene, spec):
                kernels += _of_water(scene, spec, seen, options, no_field)
        if "B" in letters and spec.surfaces:
            kernels += _of_ambient(scene, spec, view)
        if letters & {*"CDSF"} and spec.surfaces:
            seen_first = replace(spec, optics=optics_spec(view), rolling=is_rolling(view))
            kernels.append(make_first_hits_kernel(seen_first))
            if "F" in letters:
                kernels.append(make_hidden_kernel(seen_first))
    if letters & {*"APB"}:
        kernels.append(film.develop)
        if device != "cpu":
            kernels.append(denoise.clip_negative)
    return list(dict.fromkeys(kernels))


@contextmanager
def compiling_foretold(scene: Scene, device: str, letters: Iterable[str], integrator: str | None = None
                       ) -> Iterator[None]:
    """A ``with`` statement during which threads compile what loading a scene and its images will need.

    As far as the scene file tells; arguments as for `kernels_needed`.
    """
    kernels = kernels_needed(scene, foretold_spec(scene, device), letters, integrator, device)
    if any(isinstance(material, SlopeBlend) for material in scene.materials.values()):
        kernels.insert(0, bake_ground)
    on_host = list(KERNELS) if getattr(scene.terrain, "preprocess", None) else []
    if integrator is None and scene.render.spp is None and sees_water(letters):
        on_host.append(compare_rows)  # for a plan
    with compiling(on_host, "cpu"), compiling(kernels, device):
        yield


def _of_water(scene: Scene, spec: SceneSpec, view: Camera, options: RenderOptions,
              no_field: Callable[[], str | None]) -> list[wp.Kernel]:
    moves = view.shutter is not None
    name = resolve_integrator(options.integrator, options.max_scatterings, no_field)
    if name == "reference":
        return []
    varies = moves or lights_vary(scene.lights)
    compared = ["path"] if (options.integrator, name) == ("auto", "field") and spec.surfaces else []
    kinds = [kind for which in (name, *compared)
             for kind in reversed(kinds_of_samples(scene, spec, view, options, which == "field", varies))]
    kernels = [kind.kernel for kind in kinds]
    if spec.surfaces and name == "field":
        kernels.append(make_guides_kernel(replace(spec, optics=optics_spec(view), varies=moves)))
    if spec.surfaces:
        kernels.append(make_virtual_lights_kernel(replace(spec, varies=varies)))
    return [*kernels, tabulate_in_scattering, average_tiles] if name == "field" else kernels


def _of_ambient(scene: Scene, spec: SceneSpec, view: Camera) -> list[wp.Kernel]:
    spec = replace(spec, optics=optics_spec(view), varies=view.shutter is not None)
    kernels = [make_ambient_kernel(spec)]
    if scene.render.denoise_b == "oidn":
        kernels.append(make_guides_kernel(spec))
    return kernels
