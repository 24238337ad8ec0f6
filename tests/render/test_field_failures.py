"""Water in which the field cannot be solved for: ``auto`` takes paths and says why, and ``field`` is refused."""

import warnings

import numpy as np
import pytest
from physics.rig import VAROS_LAMPS, one_ray_scene

from varos_warp.device.launcher import Launcher
from varos_warp.errors import InputError
from varos_warp.render.field import solver
from varos_warp.render.field.open_water import OpenWater, unavailable
from varos_warp.render.planner.plan import plan_render
from varos_warp.render.renderer import FrameRenderer

SMOOTH = {"sigma_s": [0.1] * 3, "sigma_a": [0.1] * 3, "phase": {"g": 0.8}}


def with_step(folder, at_deg, height):
    """Water whose measured phase function is that of Henyey and Greenstein, but for a step at an angle."""
    angle = np.unique([0.0, *np.geomspace(1e-3, 180.0, 200), at_deg * (1.0 - 1e-3), at_deg])
    p = np.where(angle < at_deg, height, 1.0) / (1.81 - 1.8 * np.cos(np.radians(angle))) ** 1.5
    rows = "\n".join(f"{a!r},{x!r}" for a, x in zip(angle.tolist(), p.tolist(), strict=True))
    (folder / "phase.csv").write_text(f"angle_deg,p\n{rows}\n")
    return SMOOTH | {"phase": {"kind": "tabulated", "file": str(folder / "phase.csv")}}


def scene_of(coefficients):
    scene = one_ray_scene(VAROS_LAMPS, coefficients, pixels=4)
    assert unavailable(scene) is None
    return scene


def image(scene, **how):
    return FrameRenderer(scene, "cpu", parts=[]).render(np.eye(4), outputs="A", spp=4, seed=3, **how).A.radiance


@pytest.mark.parametrize(("at_deg", "height"), [(3.0, 0.1), (40.0, 1e-6), (0.3, 1000.0), (1.0, 30.0)])
def test_auto_is_path_in_water_with_a_step_and_tells_why_once(tmp_path, at_deg, height):
    """Whether scattering becomes no numbers, or its matrix makes light."""
    scene = scene_of(with_step(tmp_path, at_deg, height))
    renderer = FrameRenderer(scene, "cpu", parts=[])
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        images = [renderer.render(np.eye(4), outputs="A", spp=4, seed=3).A.radiance for _ in range(2)]
    assert [str(warning.message).split(": ")[1] for warning in told] == ["A is rendered by paths alone"]
    assert "too sharp for the field" in str(told[0].message)
    for one in images:
        assert np.array_equal(one, image(scene, integrator="path"))


def test_field_asked_for_by_name_is_refused_with_key_and_remedy(tmp_path):
    with pytest.raises(InputError, match="too sharp for the field") as refused:
        image(scene_of(with_step(tmp_path, 3.0, 0.1)), integrator="field")
    assert (refused.value.key, refused.value.value) == ("render.integrator", "field")
    assert refused.value.remedy == "Use integrator path, or auto."


@pytest.mark.parametrize("how", [{"max_scatterings": 2}, {"layers": ("direct", "single")}, {"integrator": "path"}])
def test_what_needs_no_field_does_not_solve_for_it(tmp_path, monkeypatch, how):
    monkeypatch.setattr(solver.LightFieldSolver, "solve", lambda self: pytest.fail("solved"))
    image(scene_of(with_step(tmp_path, 3.0, 0.1)), **how)


def test_a_sum_that_does_not_converge_is_a_failure(monkeypatch, tmp_path):
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path))
    monkeypatch.setattr(solver, "RESTARTS", 0)
    assert "does not converge" in OpenWater(scene_of(SMOOTH), Launcher("cpu")).failure


def test_light_that_is_not_a_number_is_a_failure_found_at_once(monkeypatch, tmp_path):
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path))
    solved, whole = [], solver.LightFieldSolver._converged

    def spoilt(self, operator, b):
        solved.append(whole(self, operator, np.full_like(b, np.nan)))

    monkeypatch.setattr(solver.LightFieldSolver, "_converged", spoilt)
    assert "does not converge" in OpenWater(scene_of(SMOOTH), Launcher("cpu")).failure
    monkeypatch.setattr(solver.LightFieldSolver, "_converged", lambda self, operator, b: np.full_like(b, np.inf))
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path / "other"))
    assert "not a number" in OpenWater(scene_of(SMOOTH), Launcher("cpu")).failure
    assert not solved


def test_a_failure_is_kept_and_not_found_out_again(monkeypatch, tmp_path):
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path / "cache"))
    scene = scene_of(with_step(tmp_path, 3.0, 0.1))
    found = OpenWater(scene, Launcher("cpu")).failure
    monkeypatch.setattr(solver.LightFieldSolver, "solve", lambda self: pytest.fail("solved again"))
    assert OpenWater(scene, Launcher("cpu")).failure == found


def planned(scene):
    renderer = FrameRenderer(scene, "cpu", parts=[])
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the plan tells
        return plan_render(scene, renderer, [np.eye(4)])


def in_render(scene, **keys):
    return scene.model_copy(update={"render": scene.render.model_copy(update=keys)})


@pytest.mark.parametrize("spp", [None, 4])
def test_a_plan_takes_paths_and_says_why(tmp_path, spp):
    scene = in_render(scene_of(with_step(tmp_path, 3.0, 0.1)), spp=spp, tolerance=0.5)
    plan = planned(scene)
    assert plan.integrator == "path"
    assert plan.decisions[0].what == "integrator"
    assert "too sharp for the field" in plan.decisions[0].reason
    assert plan.models["A"].startswith("path tracer, ")


def test_a_plan_with_the_field_asked_for_by_name_is_refused(tmp_path):
    scene = in_render(scene_of(with_step(tmp_path, 3.0, 0.1)), spp=4, integrator="field")
    with pytest.raises(InputError, match=r"render\.integrator = 'field': the field cannot be used: the phase function"):
        planned(scene)
