"""Kernels that are compiled while something else goes on: those that images need, each of them once."""

from pathlib import Path

import numpy as np
import pytest
from test_examples import SMALL, name_of, with_little_on_it
from test_frame import LAMPS, POSE, camera, ground_and_ball, make_scene

from varos_warp.kernels.film.denoise import clip_negative
from varos_warp.render.kinds import kernels_needed
from varos_warp.render.moments import NextFrame
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.device import DeviceScene, foretold_spec
from varos_warp.scene.file.load import DATA, demo_scene_path, load_scene
from varos_warp.scene.geometry.build import build_parts

EXAMPLES = Path(__file__).parents[2] / "examples"


def still():
    return FrameRenderer(make_scene(), "cpu", parts=ground_and_ball()), {}


def moving():
    """A shutter, and a lamp that is a disk."""
    scene = make_scene([camera(exposure={"time_s": 0.4})], [LAMPS[0] | {"radius_m": 0.05}])
    return FrameRenderer(scene, "cpu", parts=ground_and_ball()), {"motion": at_rest}


def at_rest(offset_ns):
    """Of a vehicle that does not move, and blurs nothing."""
    return np.broadcast_to(POSE, (len(offset_ns), 4, 4))


def rolling():
    """Rows of different instants."""
    scene = make_scene([camera(exposure={"time_s": 0.1, "readout_s": 0.3})])
    return FrameRenderer(scene, "cpu", parts=ground_and_ball()), {"motion": at_rest}


@pytest.mark.parametrize(
    ("made", "integrator", "letters"),
    [
        (still, "path", "ABCDS"),
        (still, "field", "ABCDSF"),
        (still, "reference", "A"),
        (moving, "path", "ABCDSP"),
        (rolling, "field", "CF"),
    ],
)
def test_what_is_compiled_meanwhile_is_what_images_need(any_field, made, integrator, letters):
    renderer, how = made()
    announced = needed(renderer, letters, integrator)
    if "F" in letters:
        how["following"] = NextFrame(POSE, motion=how.get("motion"))
    renderer.render(POSE, outputs=letters, spp=2, spp_b=2, integrator=integrator, denoise_b="oidn", **how)
    later = {clip_negative.module} if {*letters} & {*"AB"} else set()  # a CPU denoises beside the next frame
    assert announced == {kernel.module for kernel in renderer.launcher._loaded} | later


def needed(renderer, letters, integrator=None):
    kernels = kernels_needed(renderer.scene, renderer.world.spec, letters, integrator)
    modules = [kernel.module for kernel in kernels]
    assert len(modules) == len({*modules})
    return {*modules}


def test_a_plan_that_compares_integrators_needs_the_kernels_of_both():
    renderer, _ = still()
    both = needed(renderer, "A", "auto")
    assert all(both > needed(renderer, "A", integrator) for integrator in ("field", "path"))


@pytest.mark.usefixtures("few_bodies")
@pytest.mark.parametrize(
    ("file", "changes"),
    [
        (DATA / "starter.yaml", []),
        (
            DATA / "starter.yaml",
            ["growth=[]", "objects=[]", "scatter=[]", "materials={}", "terrain={kind: procedural, resolution: 65}"],
        ),
        (DATA / "templates" / "stereo_survey.yaml", []),
        (EXAMPLES / "every_block" / "scene.yaml", []),
    ],
    ids=["starter", "grey", "stereo_survey", "every_block"],
)
def test_what_a_scene_holds_is_foretold_by_its_file(file, changes):
    """Else kernels are compiled that nothing needs, and those that are needed only after the scene is loaded.

    It does not follow from how fine surfaces are, nor from how much grows on them.
    """
    cheap = [] if changes else SMALL[name_of(file)]
    scene = load_scene(file, [*changes, *cheap, *with_little_on_it(load_scene(file, changes))])
    world = DeviceScene(scene, build_parts(scene), "cpu")
    assert foretold_spec(scene, "cpu") == world.spec


def test_letters_may_be_given_one_after_the_other():
    scene = load_scene(demo_scene_path())
    spec = foretold_spec(scene, "cpu")
    assert kernels_needed(scene, spec, iter("CAB"), "path") == kernels_needed(scene, spec, "ABC", "path")
