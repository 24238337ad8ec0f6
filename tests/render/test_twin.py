"""P, the twin of A: what a camera would see of the same pose without its port and the distortion of its lens."""

import numpy as np
import pytest

from varos_warp.errors import InputError
from varos_warp.render.decisions import Plan
from varos_warp.render.image.frame import Frame, without_noise
from varos_warp.render.planner.cost import sequence_cost
from varos_warp.render.planner.pilot import Frames
from varos_warp.render.planner.plan import plan_render
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict

PLAIN = {"id": "M0", "resolution": [24, 16], "rotation_euler_deg": [-30, 0, 0], "f_stop": 1.4, "focus_m": 2.0}
BENT = {
    "flat, colours apart": {
        "n_water": {"temperature_C": 10, "salinity": 35},
        "port": {"kind": "flat", "distance_m": 0.02, "normal": [0.1, 0.0, 1.0]},
    },
    "dome and barrel": {
        "port": {"kind": "dome", "radius_m": 0.05},
        "distortion": {"model": "brown_conrady", "k": [-0.2, 0.05, 0.001, -0.002, 0.0]},
    },
}


def scene_of(*cameras, outputs="A", **render):
    return scene_from_dict(
        {
            "terrain": {"kind": "procedural", "size_m": 20, "resolution": 9, "relief_m": 0.3, "position": [0, 0, -2]},
            "water": {"coefficients": {"sigma_s": [0.2, 0.2, 0.2], "sigma_a": [0.2, 0.1, 0.1]}},
            "vehicle": {"cameras": list(cameras), "lights": [{"position": [0.15, -0.1, 0], "direction": [0, 1, -0.5]}]},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            "render": {"outputs": list(outputs)} | render,
        }
    )


@pytest.mark.parametrize(
    ("bent", "layers"), [("flat, colours apart", ("direct", "single")), ("dome and barrel", ("direct",))]
)
def test_the_twin_is_a_of_the_camera_without_port_and_distortion(bent, layers):
    """Every byte, with the same samples and random numbers, whatever else is rendered; and A does not change."""
    how = {"spp": 2, "integrator": "path", "denoise": "oidn", "frame": 3, "layers": layers}
    plain = FrameRenderer(scene_of(PLAIN), "cpu").render(np.eye(4), outputs="A", **how).A
    renderer = FrameRenderer(scene_of(PLAIN | BENT[bent]), "cpu")
    both, alone = (renderer.render(np.eye(4), outputs=outputs, **how) for outputs in ("AP", "A"))
    for name in ("radiance", "stderr", "denoised"):
        assert np.array_equal(getattr(both.P, name), getattr(plain, name)), name
        assert np.array_equal(getattr(both.A, name), getattr(alone.A, name)), name
    assert not np.array_equal(both.P.radiance, both.A.radiance)
    assert alone.P is None


def test_a_camera_without_port_and_distortion_is_rendered_once():
    """Beside one that has a port, its P is its A."""
    cameras = PLAIN, PLAIN | BENT["dome and barrel"] | {"id": "M1"}
    frame = FrameRenderer(scene_of(*cameras, outputs="AP"), "cpu").render(
        np.eye(4), "M0", "AP", spp=1, integrator="path", layers=("direct",)
    )
    assert frame.P is frame.A


@pytest.mark.parametrize("outputs", ["P", "ABCDP"])
def test_a_scene_in_which_no_camera_has_a_twin_is_refused(outputs):
    with pytest.raises(InputError, match="P is A without port, distortion, vignetting and shutter") as error:
        scene_of(PLAIN, outputs=outputs)
    assert error.value.key == "render.outputs"


@pytest.mark.parametrize(("outputs", "rendered"), [("AP", {"M1"}), ("P", {"M0", "M1"})])
def test_what_it_costs_is_measured_of_cameras_whose_twin_is_not_their_a(outputs, rendered):
    class Renderer:
        device, device_name, compile_seconds = "cpu", "none", 0.0

        def render(self, _T_w_v, camera, letters, **_how):
            made.append((camera.id, letters))
            return Frame(**dict.fromkeys(letters, without_noise(np.zeros((2, 2, 3), np.float32))))

    made = []
    scene = scene_of(PLAIN, PLAIN | BENT["dome and barrel"] | {"id": "M1"}, outputs=outputs)
    cost = sequence_cost(scene, Frames.of(scene, Renderer(), [np.eye(4)]), Plan(4, None))
    assert set(cost["seconds_by_output"]) == set(outputs)
    assert {camera for camera, letters in made if letters == "P"} == rendered


def test_the_plan_of_a_serves_the_twin_alone():
    scene = scene_of(PLAIN | BENT["dome and barrel"], outputs="P", spp=7, integrator="path")
    plan = plan_render(scene, FrameRenderer(scene, "cpu"), [np.eye(4)])
    assert plan.spp == 7
    assert [decision.what for decision in plan.decisions] == ["integrator", "spp", "port of M0"]
    assert "7 samples per pixel" in plan.models["P"]
