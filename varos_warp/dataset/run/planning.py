"""The plan of a sequence, kept in the user's cache: the same scene is planned once for each kind of device."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

import varos_warp
from varos_warp.cache import cached, code_hash, digest
from varos_warp.dataset.progress import NamedSteps
from varos_warp.dataset.write.checksums import sha256
from varos_warp.dataset.write.texts import sources
from varos_warp.device.devices import kind_of
from varos_warp.render.decisions import Plan, open_questions, plan_as_given, planner_is_here, require_planner
from varos_warp.render.image.denoise import available_method
from varos_warp.scene.description.looks import GAINS, without
from varos_warp.scene.description.render import sees_water
from varos_warp.scene.file.load import scene_to_dict
from varos_warp.scene.geometry.files.named import mesh_textures

CODE = (
    "varos_warp.kernels",
    "varos_warp.device",
    "varos_warp.render",
    "varos_warp.products.images",
    "varos_warp.scene",
    "varos_warp.sim",
)
"""What a plan follows from, besides the scene,"""
ROOTS = ("varos_warp.render.renderer", "varos_warp.render.planner.plan", "varos_warp.sim.trajectory")
"""beginning with these."""
BESIDE = ("exposure", "linear_exr", "depth_exr", "depth_kind", "depth_range_m", "spp_b", "denoise_b", "outputs")
"""Keys of the block ``render`` that no plan follows from; of the outputs only whether they see water."""


def plan_sequence(scene, renderer, frames, motion, quiet: bool = False, **options):
    """`plan_render` with a progress bar, of ``frames``, rows of a `Trajectory`; what a run needs is compiled meanwhile.

    But not where the time is to be measured, nor where there is nothing to find out; refused where there is, and no
    planner.
    """
    if not sees_water(scene.render.outputs):  # nothing that is made takes an integrator: none is refused
        scene = scene.model_copy(update={"render": scene.render.model_copy(update={"integrator": "auto"})})
    if not planner_is_here():
        require_planner(scene)
        return plan_as_given(scene)
    from varos_warp.render.planner.plan import STEPS, plan_render

    ahead = scene.render.outputs if open_questions(scene) and not options.get("measure_cost") else ()
    with renderer.compiling(ahead), NamedSteps("planning", STEPS, quiet) as steps:
        return plan_render(
            scene,
            renderer,
            list(frames.poses()),
            time_ns=frames.time_ns.tolist(),
            motion=motion,
            progress=steps.reach,
            **options,
        )


def what_is_planned(scene) -> str | None:
    """What the planner finds out by test images, and what to do without, in words; None: nothing."""
    asked, tolerance = open_questions(scene), scene.render.tolerance
    if "samples" in asked:
        return f"how many samples keep an error of {tolerance:g}, once for this scene (--spp N takes N unasked)"
    if "integrator" in asked:
        return "which integrator is faster, once for this scene (--integrator field or path takes it unasked)"
    return None


def kept_plan(scene, renderer, frames, make: Callable[[], Plan]) -> Plan:
    """The plan of a sequence from disk, or made and kept there, for this or another run.

    Without its cost, which is of one machine, and without models, which say of what outputs it was asked for. Of
    ``frames``, rows of a `Trajectory`; ``make`` is such as `plan_sequence`.
    """

    def build() -> dict[str, np.ndarray]:
        return {"plan": np.array(json.dumps({"plan": replace(make(), cost=None, models={}).to_dict()}))}

    arrays = cached("plan", depends_on(scene, renderer, frames), build)
    return Plan.from_dict(json.loads(str(arrays["plan"]))["plan"])


def told_of(plan: Plan, outputs) -> list[str]:
    """What a user is told of a plan for some outputs."""
    error = "" if plan.error is None else f", predicted error {plan.error.max():.1%}"
    samples = [f"{plan.spp_in_words} of A{error}"] * sees_water(outputs)
    return [*samples, *filter(None, [plan.shortfall]), *plan.ports]


def depends_on(scene, renderer, frames) -> dict[str, Any]:
    """Everything that a plan follows from, as JSON."""
    described = without(scene_to_dict(scene), GAINS)
    for key in BESIDE:
        described["render"].pop(key, None)
    textures = {str(path.name): sha256(path) for path in mesh_textures(scene)}
    return {
        "scene": described,
        "water": sees_water(scene.render.outputs),
        "files": sources(scene) | textures,
        "frames": digest(frames.time_ns, frames.poses()),
        "device": kind_of(renderer.device),
        "renderer": type(renderer).__qualname__,
        "denoiser": available_method(scene.render.denoise),
        "version": varos_warp.__version__,
        "code": [code_hash(root, CODE) for root in ROOTS],
    }
