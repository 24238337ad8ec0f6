"""A plan of a sequence: choices with their reasons and errors, and what follows from them for a frame.

The planner (`varos_warp.render.planner`) makes it by test images. It may be left out of an installation: a scene that
says its integrator and its samples is planned without.
"""

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Any

import numpy as np

from varos_warp.errors import InputError, counted
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.render.field.open_water import unavailable
from varos_warp.render.options import resolve_integrator
from varos_warp.scene.description import Scene
from varos_warp.scene.description.image_types import AMBIENT, WATER
from varos_warp.scene.description.render import sees_water

INTEGRATORS = {
    "reference": "reference path tracer",
    "path": "path tracer",
    "field": "path tracer with the field of open water",
}
"""Integrators in words."""
PLANNED = ("spp", "max_scatterings", "max_bounces", "integrator")
"""Options of `FrameRenderer.render` that a plan says, and its first fields."""
FIELD_ERROR = 0.002
"""Relative RMSE of the field without noise: measured, docs/results.md."""


def open_questions(scene: Scene) -> tuple[str, ...]:
    """What test images have to tell of a scene: which ``integrator`` is faster, how many ``samples`` it takes."""
    render = scene.render
    if not sees_water(render.outputs):
        return ()
    compared = (
        render.integrator == "auto"
        and resolve_integrator("auto", render.max_scatterings, lambda: unavailable(scene)) == "field"
    )
    return ("integrator",) * compared + ("samples",) * (render.spp is None)


def planner_is_here() -> bool:
    """Return whether this installation has the planner."""
    try:
        import varos_warp.render.planner  # noqa: F401
    except ModuleNotFoundError:
        return False
    return True


def require_planner(scene: Scene) -> None:
    """Refuse a scene that leaves a choice to the planner where there is none.

    Raises:
        InputError: If that is so.
    """
    asked = () if planner_is_here() else open_questions(scene)
    if asked:
        key, value = ("tolerance", scene.render.tolerance) if "samples" in asked else ("integrator", "auto")
        raise InputError(
            "needs the planner (varos_warp.render.planner), which this installation leaves out",
            key=f"render.{key}",
            value=value,
            remedy="Set render.spp, the samples per pixel, and render.integrator, path or field.",
        )


@dataclass(frozen=True)
class Decision:
    """One choice of the planner."""

    what: str
    choice: str
    reason: str
    error: Sequence[float] | None = None
    """Predicted relative RMSE of the choice, per channel; None where it is not known."""

    def to_dict(self) -> dict[str, Any]:
        """Plain types."""
        return {"what": self.what, "choice": self.choice, "reason": self.reason, "error": _rounded(self.error)}


def _rounded(error: Iterable[float] | None) -> list[float] | None:
    """An error in three digits."""
    return None if error is None else [float(f"{e:.3g}") for e in error]


@dataclass(frozen=True)
class Plan:
    """What to render with, and why."""

    spp: float
    """Samples per pixel of A, of the frames that need most."""
    max_scatterings: int | None = None
    """Most scatterings in the water on a path; None: no bound."""
    max_bounces: int | None = None
    """Most reflections on surfaces; None: no bound."""
    integrator: str = "auto"
    spp_by_frame: dict[str, list[list[float]]] | None = None
    """Pairs of a frame and its samples per pixel, by camera, interpolated between two of them; None: all frames take
    ``spp``."""
    decisions: list[Decision] = field(default_factory=list)
    models: dict[str, str] = field(default_factory=dict)
    """How each output is made, by its letter."""
    cost: dict[str, Any] | None = None
    """Seconds on this device; only where they were asked for."""
    stated_error: Sequence[float] | None = None
    """What a plan that was read says of its ``error``; absent: it follows from the decisions."""

    @property
    def reasons(self) -> list[str]:
        """One sentence for each decision."""
        return [f"{d.what} {d.choice}: {d.reason}" for d in self.decisions]

    @property
    def shortfall(self) -> str | None:
        """One sentence where the tolerance is not kept."""
        return next((f"{d.what} {d.choice}: {d.reason}" for d in self.decisions if d.what == "tolerance"), None)

    @property
    def ports(self) -> list[str]:
        """What each port is worth, one sentence for each."""
        return [f"{d.what} {d.choice}: {d.reason}" for d in self.decisions if d.what.startswith("port of")]

    @property
    def error(self) -> np.ndarray | None:
        """Predicted relative RMSE [3] of an image: noise, and the error of the field; None: not predicted."""
        if self.stated_error is not None:
            return np.array(self.stated_error)
        samples = [d.error for d in self.decisions if d.what == "spp"]
        if samples in ([], [None]):
            return None
        models = [d.error for d in self.decisions if d.what != "spp" and d.error is not None]
        return np.hypot(samples[0], np.sum([np.zeros(3), *models], axis=0))

    @property
    def options(self) -> dict[str, Any]:
        """Options of `FrameRenderer.render` for A as planned, of the frames that need most."""
        return {key: getattr(self, key) for key in PLANNED}

    def options_of(self, camera: str, frame: int) -> dict[str, Any]:
        """Options of `FrameRenderer.render` for A of one frame."""
        return self.options | {"spp": self.spp_of(camera, frame)}

    def spp_of(self, camera: str, frame: int) -> float:
        """Samples per pixel of A of one frame."""
        pairs = (self.spp_by_frame or {}).get(camera)
        return spp_between(pairs, frame) if pairs else self.spp

    def mean_spp(self, camera: str, count: int) -> float:
        """Samples per pixel of A, on average over the frames of a sequence."""
        return float(np.mean([self.spp_of(camera, frame) for frame in range(count)]))

    @property
    def spp_in_words(self) -> str:
        """How many samples per pixel of A the frames have."""
        least, most = extent(self.spp_by_frame) if self.spp_by_frame else (self.spp, self.spp)
        return f"{f'{least} to ' * (least < most)}{counted(most, 'sample')} per pixel"

    def says_how(self, letters: Iterable[str]) -> bool:
        """Return whether it says how images are rendered; of A it does not if it was made for others."""
        return not sees_water(letters) or all(decision.what != WATER for decision in self.decisions)

    def to_dict(self) -> dict[str, Any]:
        """Plain types; the same on every machine as long as there is no ``cost``."""
        cost = {} if self.cost is None else {"cost": self.cost}
        return self.options | {
            "spp_by_frame": self.spp_by_frame,
            "error": _rounded(self.error),
            **cost,
            "decisions": [decision.to_dict() for decision in self.decisions],
            "reasons": self.reasons,
            "models": self.models,
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> "Plan":
        """The plan that `to_dict` has made plain, here or in an earlier version, which may have said less."""
        known = {key: content[key] for key in (*PLANNED, "spp_by_frame", "cost") if key in content}
        decisions = [
            Decision(one["what"], one["choice"], one["reason"], one.get("error"))
            for one in content.get("decisions") or ()
        ]
        return cls(**known, decisions=decisions, models=content.get("models") or {}, stated_error=content.get("error"))


def given_integrator(scene: Scene) -> Decision:
    """The integrator that a scene names, or that is left for it where it has no field.

    Raises:
        InputError: If the field is named and there is none.
    """
    render, why = scene.render, "given"
    found = resolve_integrator(render.integrator, render.max_scatterings, lambda: unavailable(scene))
    if found != render.integrator and render.max_scatterings is not None:
        why = "the field holds all orders of scattering, and a bound is given"
    elif found != render.integrator:
        why = unavailable(scene)
    return Decision("integrator", found, why, (FIELD_ERROR if found == "field" else 0.0,) * 3)


def plan_as_given(scene: Scene) -> Plan:
    """The plan of a scene that leaves nothing to a planner (`open_questions`); its images are as the planner's.

    Raises:
        InputError: If the field is named and there is none.
    """
    render = scene.render
    if not sees_water(render.outputs):  # nothing else pays for water
        decisions = [Decision(WATER, "none", "it is not among the outputs")]
        spp = render.spp or 1
    else:
        integrator = given_integrator(scene)
        # without the field, samples are whole
        spp = render.spp if integrator.choice == "field" else ceil(render.spp)
        why = "given" if spp == render.spp else f"{render.spp} given, and without the field they are whole numbers"
        decisions = [integrator, Decision("spp", str(spp), why)]
    return Plan(spp, render.max_scatterings, render.max_bounces, render.integrator, decisions=decisions)


def models_in_words(
    scene: Scene, plan: Plan, outputs: Iterable[str], denoisers: dict[str, str | None]
) -> dict[str, str]:
    """What makes each of the outputs by a plan, in words; ``denoisers`` are of A and B."""
    render, scatterings, bounces = scene.render, plan.max_scatterings, plan.max_bounces
    bounds = ((scatterings, "scattering", "in the water"), (bounces, "reflection", "on surfaces"))
    limits = "".join(f", at most {counted(bound, noun)} {where}" for bound, noun, where in bounds if bound is not None)
    integrator = INTEGRATORS[resolve_integrator(plan.integrator, scatterings, lambda: unavailable(scene))]
    water = f"{integrator}{limits}, {plan.spp_in_words}, denoise {denoisers[WATER]}"
    ambient = (
        f"no water, uniform ambient light, {counted(render.spp_b, 'sample')} per pixel, denoise {denoisers[AMBIENT]}"
    )
    return {
        letter: OUTPUTS[letter].method.format(water=water, ambient=ambient) for letter in OUTPUTS if letter in outputs
    }


def extent(given: dict[str, list[list[float]]]) -> tuple[float, float]:
    """The fewest and the most samples of all cameras' frames (`knots`)."""
    counts = [spp for pairs in given.values() for _, spp in pairs]
    return min(counts), max(counts)


def spp_between(pairs: list[list[float]], frame: int) -> float:
    """Samples per pixel of a camera's frame by its `knots`."""
    after = bisect_right(pairs, frame, key=lambda pair: pair[0])
    (start, spp), (end, next_spp) = pairs[after - 1], pairs[min(after, len(pairs) - 1)]
    return spp + (next_spp - spp) * (frame - start) / max(end - start, 1)
