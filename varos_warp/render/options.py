"""What can be asked of the images of a frame, and the integrator that serves."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from varos_warp.errors import InputError
from varos_warp.products.images.registry import DENOISE_KEYS
from varos_warp.render.image.denoise import METHODS
from varos_warp.scene.description import Scene
from varos_warp.scene.description.render import LEAST_SPP, MOST_SPP, field_by_old_name

LAYERS = ("direct", "single", "multiple")
INTEGRATORS = ("auto", "field", "path", "reference")


@dataclass(frozen=True)
class RenderOptions:
    """How the images of a frame are made: the further keywords of `FrameRenderer.render`.

    Raises:
        InputError: If a name is unknown or a number too low.
    """

    spp: float | None = None
    """Samples per pixel of A; absent: the scene's, or 64. With the field this is the mean over the image, and fractions
    count, below one too; else they are rounded up."""
    spp_b: int | None = None
    """Samples per pixel of B; absent: the scene's."""
    max_scatterings: int | None = None
    """Most scatterings in the water on a path; absent: the scene's, which may be without a bound."""
    max_bounces: int | None = None
    """Most reflections on surfaces; absent: the scene's, which may be without a bound."""
    layers: Sequence[str] | None = None
    """Which of direct, single, multiple to render; absent: the scene's."""
    integrator: str | None = None
    """Integrator of A: auto, field, path or reference; absent: the scene's."""
    denoise: str | None = None
    """oidn, nlm or none: fill in ``denoised`` of A, on a GPU without a way over the host; absent: do not."""
    denoise_b: str | None = None
    """oidn, nlm or none: fill in ``denoised`` of B, on a GPU without a way over the host; absent: do not."""
    snow: bool = True
    """True if A and P show the bodies in the water that a scene has."""
    copied: Sequence[str] | None = None
    """What of A and B to keep on the host: radiance, denoised or both. An image that the host has to denoise keeps what
    that takes instead. Absent: all. On a GPU, copying all takes longer than denoising; on a CPU it fills memory."""

    def __post_init__(self):
        for key, known in (
            ("layers", LAYERS),
            ("integrator", INTEGRATORS),
            ("denoise", METHODS),
            ("denoise_b", METHODS),
            ("copied", ("radiance", "denoised")),
        ):
            names = getattr(self, key)
            if names is not None:
                check_names(key, names if key in ("layers", "copied") else [field_by_old_name(names)], known)
        for key, least, most in (
            ("spp", LEAST_SPP, MOST_SPP),
            ("spp_b", 1, MOST_SPP),
            ("max_scatterings", 0, math.inf),
            ("max_bounces", 0, math.inf),
        ):
            number = getattr(self, key)
            if number is not None and number < least:
                raise InputError(f"must be at least {least}", key=key, value=number)
            if number is not None and number > most:
                raise InputError(f"must be at most {most}", key=key, value=number)


OF_SCENE = ("spp", "spp_b", "max_scatterings", "max_bounces", "layers", "integrator")
"""Options that a scene's ``render`` block has, too."""


def of_scene(scene: Scene) -> dict[str, Any]:
    """What a scene says of them."""
    return {key: getattr(scene.render, key) for key in OF_SCENE}


def of_run(device: str, denoisers: Mapping[str, str | None], linear_exr: bool) -> dict[str, Any]:
    """Options for a run's images: a GPU denoises what it rendered, and what is not written stays there.

    Args:
        device: ``cpu`` or ``cuda:N``; a CPU denoises beside the next frame.
        denoisers: Of A and B.
        linear_exr: Whether A is written before denoising, too.
    """
    there = {key: "oidn" for letter, key in DENOISE_KEYS.items() if device != "cpu" and denoisers[letter] == "oidn"}
    return there | {"copied": None if linear_exr else ["denoised"]}


def options_of(scene: Scene, given: dict[str, Any]) -> RenderOptions:
    """The options that were given, and the scene's where they are absent.

    Raises:
        TypeError: If there is no such option.
    """
    known = [option.name for option in fields(RenderOptions)]
    unknown = ", ".join(name for name in given if name not in known)
    if unknown:
        raise TypeError(f"unknown options of a frame: {unknown}; there are: {', '.join(known)}")
    options = RenderOptions(**given)
    absent = {key: value for key, value in of_scene(scene).items() if getattr(options, key) is None}
    options = replace(options, **absent)
    return options if options.spp else replace(options, spp=64)


def check_names(key: str, names, known) -> None:
    """Refuse unknown names, and none at all."""
    if not len(names) or any(name not in known for name in names):
        raise InputError("unknown or none", key=key, value=names, remedy=f"Name some of: {', '.join(known)}.")


def resolve_integrator(name: str, max_scatterings: int | None, no_field: Callable[[], str | None]) -> str:
    """The integrator that ``name`` stands for: ``auto`` is paths with the field where it serves, else without.

    Args:
        name: As in a scene file.
        max_scatterings: Bound, if any.
        no_field: Tells why a scene has no field, or None; asked only where that matters.

    Raises:
        InputError: If the field is asked for and cannot be had.
    """
    name = field_by_old_name(name)
    if name not in ("auto", "field"):
        return name
    why = no_field()
    if max_scatterings is not None:
        why = f"it holds all orders of scattering, and max_scatterings is {max_scatterings}"
    if name == "field" and why:
        raise InputError(
            f"the field cannot be used: {why}",
            key="render.integrator",
            value=name,
            remedy="Use integrator path, or auto.",
        )
    return "path" if why else "field"
