"""Plans are kept: the same scene is planned once, and another one anew."""

from types import SimpleNamespace

import numpy as np
import pytest
import standins
from standins import FlatFloorRenderer, make_scene

from varos_warp.dataset.run.planning import kept_plan, plan_sequence, told_of, what_is_planned
from varos_warp.render.decisions import Plan

POSES, TIMES = [np.eye(4)] * 3, [0, 100, 200]


@pytest.fixture
def plans(monkeypatch, tmp_path):
    """What was planned: the samples of each plan; the cache is empty at first."""
    made = []

    def plan_render(scene, renderer, poses, **options):
        made.append(scene.render.spp)
        return standins.plan_render(scene, renderer, poses)

    standins.install(monkeypatch)
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path))
    monkeypatch.setattr("varos_warp.render.planner.plan.plan_render", plan_render)
    return made


def frames_of(poses=POSES, times=TIMES):
    return SimpleNamespace(poses=lambda: np.array(poses), time_ns=np.array(times[: len(poses)]))


def kept(poses=POSES, times=TIMES, **render):
    scene = make_scene(render)
    renderer, frames = FlatFloorRenderer(scene), frames_of(poses, times)
    return kept_plan(scene, renderer, frames, lambda: plan_sequence(scene, renderer, frames, None, quiet=True))


def test_the_same_scene_is_planned_once(plans):
    assert kept(spp=4) == kept(spp=4)
    assert kept(spp=4).spp == 4
    assert "4 samples per pixel" in told_of(kept(spp=4), "A")[0]
    assert plans == [4]


@pytest.mark.parametrize(
    "changed",
    [{"spp": 5}, {"denoise": "none"}, {"outputs": ["B", "D"]}, {"poses": [np.eye(4)] * 2}, {"times": [0, 100, 300]}],
)
def test_what_a_plan_follows_from_is_planned_anew(plans, changed):
    kept(spp=4)
    kept(**({"spp": 4} | changed))
    assert len(plans) == 2


@pytest.mark.parametrize("changed", [{"linear_exr": True}, {"spp_b": 3}, {"outputs": ["D", "A"]}])
def test_what_a_plan_does_not_follow_from_keeps_it(plans, changed):
    kept(spp=4)
    kept(spp=4, **changed)
    assert len(plans) == 1


def test_a_plan_that_was_made_anyway_is_kept_without_its_cost_and_the_outputs(plans):
    scene = make_scene({"spp": 4})
    kept_plan(
        scene,
        FlatFloorRenderer(scene),
        frames_of(),
        lambda: Plan(9, None, cost={"seconds_per_frame": 1.0}, models={"A": "paths"}),
    )
    assert kept(spp=4) == Plan(9, None)
    assert plans == []


@pytest.mark.parametrize(
    ("render", "words"),
    [
        ({"spp": None}, "how many samples keep an error of 0.02, once for this scene (--spp N takes N unasked)"),
        ({"spp": 4}, "which integrator is faster, once for this scene (--integrator field or path takes it unasked)"),
        ({"spp": 4, "integrator": "field"}, None),
        ({"spp": 4, "max_scatterings": 1}, None),
        ({"outputs": ["B", "D"]}, None),
    ],
)
def test_what_is_planned_is_said_with_the_option_that_does_without(plans, render, words):
    assert what_is_planned(make_scene(render)) == words
    if render.get("outputs"):
        assert told_of(kept(**render), render["outputs"]) == []  # nothing of samples of A
