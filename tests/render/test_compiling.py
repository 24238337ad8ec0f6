"""Kernels that are compiled while something else goes on: those that images need, each of them once."""

import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_frame import LAMPS, POSE, camera, ground_and_ball, make_scene

from varos_warp.render.kinds import kernels_needed
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene import launch
from varos_warp.scene.device import Contents, DeviceScene
from varos_warp.scene.file.load import DATA, load_scene
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.launch import compiling, load_kernel

EXAMPLES = Path(__file__).parents[2] / "examples"


def still():
    return FrameRenderer(make_scene(), "cpu", parts=ground_and_ball()), {}


def moving():
    """A shutter, and a lamp that is a disk."""
    scene = make_scene([camera(shutter={"exposure_s": 0.4})], [LAMPS[0] | {"radius_m": 0.05}])
    return FrameRenderer(scene, "cpu", parts=ground_and_ball()), {"motion": at_rest}


def at_rest(offset_ns):
    """Of a vehicle that does not move, and blurs nothing."""
    return np.broadcast_to(POSE, (len(offset_ns), 4, 4))


@pytest.mark.parametrize(("made", "integrator"), [(still, "path"), (still, "field"), (moving, "path")])
def test_what_is_compiled_meanwhile_is_what_images_need(any_field, made, integrator):
    renderer, how = made()
    announced = needed(renderer, "ABCDS", integrator)
    renderer.render(POSE, outputs="ABCDS", spp=2, spp_b=2, integrator=integrator, denoise_b="oidn", **how)
    assert announced == {kernel.module for kernel in renderer.launcher._loaded}


def needed(renderer, letters, integrator=None):
    kernels = kernels_needed(renderer.scene, renderer.world.contents, letters, integrator)
    modules = [kernel.module for kernel in kernels]
    assert len(modules) == len({*modules})
    return {*modules}


def test_a_plan_that_compares_integrators_needs_the_kernels_of_both():
    renderer, _ = still()
    both = needed(renderer, "A", "auto")
    assert all(both > needed(renderer, "A", integrator) for integrator in ("field", "path"))


def test_each_kernel_is_compiled_once_begun_or_not(monkeypatch):
    compiled, go = [], threading.Event()

    def load(kernel, device):
        go.wait()
        compiled.append(kernel.name)

    monkeypatch.setattr(launch, "_load", load)
    first, second, third, fourth = (SimpleNamespace(name=name, module=name) for name in ("a", "b", "c", "d"))
    with compiling([first, second, third], "cpu"), compiling([third, first], "cpu"):
        go.set()
        for kernel in (first, third):
            load_kernel(kernel, "cpu")
    assert {*"ac"} <= {*compiled} <= {*"abc"}
    assert len(compiled) == len({*compiled})
    assert not launch._begun
    load_kernel(fourth, "cpu")
    assert compiled[-1] == "d"


def test_a_kernel_that_is_needed_does_not_wait_for_those_before_it(monkeypatch):
    """With fewer threads than kernels, the one that is needed may not have begun."""
    compiled, go = [], threading.Event()

    def load(kernel, device):
        if kernel.name != "c":
            go.wait()
        compiled.append(kernel.name)

    monkeypatch.setattr(launch, "usable_cores", lambda: 2)
    monkeypatch.setattr(launch, "_load", load)
    kernels = [SimpleNamespace(name=name, module=name) for name in "abc"]
    with compiling(kernels, "cpu"):
        load_kernel(kernels[-1], "cpu")
        assert compiled == ["c"]
        go.set()
    assert sorted(compiled) == ["a", "b", "c"]


def test_what_a_thread_failed_to_compile_is_tried_again_where_it_is_needed(monkeypatch):
    tried = []

    def load(kernel, device):
        tried.append(kernel.name)
        raise RuntimeError("no compiler")

    monkeypatch.setattr(launch, "_load", load)
    kernel = SimpleNamespace(name="a", module="a")
    with compiling([kernel], "cpu"):
        while not tried:
            time.sleep(0.001)
        with pytest.raises(RuntimeError, match="no compiler"):
            load_kernel(kernel, "cpu")
    assert tried == ["a", "a"]


@pytest.mark.parametrize("file", [DATA / "starter.yaml", DATA / "templates" / "stereo_survey.yaml",
                                  EXAMPLES / "every_block" / "scene.yaml"], ids=lambda file: file.stem)
def test_what_a_scene_holds_is_foretold_by_its_file(file):
    """Else kernels are compiled that nothing needs, and those that are needed only after the scene is loaded."""
    scene = load_scene(file)
    world = DeviceScene(scene, build_parts(scene), "cpu")
    assert Contents.foretold(scene, "cpu") == world.contents
