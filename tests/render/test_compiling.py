"""Kernels that are compiled while something else goes on: those that images need, each of them once."""

import threading

import numpy as np
import pytest
from test_frame import LAMPS, POSE, camera, ground_and_ball, make_scene

from varos_warp.render import launch
from varos_warp.render.launch import Launcher
from varos_warp.render.renderer import FrameRenderer


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
    with renderer.compiling("ABCDS", integrator):
        announced = {*renderer.launcher._compiling}
    renderer.render(POSE, outputs="ABCDS", spp=2, spp_b=2, integrator=integrator, denoise_b="oidn", **how)
    assert announced == {kernel for kernel in renderer.launcher._loaded if "<locals>" in kernel.func.__qualname__}


def test_a_plan_that_compares_integrators_needs_the_kernels_of_both():
    renderer, _ = still()
    with renderer.compiling("A", "auto"):
        both = {*renderer.launcher._compiling}
    for integrator in ("field", "path"):
        with renderer.compiling("A", integrator):
            assert both > {*renderer.launcher._compiling}


def test_each_kernel_is_compiled_once_begun_or_not(monkeypatch):
    compiled, go = [], threading.Event()

    def load_kernel(kernel, device):
        go.wait()
        compiled.append(kernel)

    monkeypatch.setattr(launch, "load_kernel", load_kernel)
    launcher = Launcher("cpu", threads=1)
    with launcher.compiling(["first", "second", "third"]):
        go.set()
        launcher.load("first")
    for kernel in ("first", "second", "third", "fourth"):
        launcher.load(kernel)
    assert sorted(compiled) == ["first", "fourth", "second", "third"]
