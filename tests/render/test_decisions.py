"""A plan is the same after it was written and read; so is what earlier versions wrote."""

import json

import pytest

from varos_warp.render.decisions import Decision, Plan, plan_as_given
from varos_warp.scene.file.load import scene_from_dict

PLAN = Plan(
    12.5,
    None,
    3,
    "field",
    {"M0": [[0, 4], [9, 12.5]]},
    [
        Decision("integrator", "field", "it is faster", (0.010049, 0.010049, 0.010049)),
        Decision("spp", "12.5", "as many as that", (0.020049, 0.017449, 0.034649)),
        Decision("port of M0", "needed", "so"),
    ],
    {"A": "paths"},
)


def read_again(plan):
    return Plan.from_dict(json.loads(json.dumps(plan.to_dict())))


def test_what_was_written_and_read_says_the_same():
    again = read_again(PLAN)
    assert again.to_dict() == PLAN.to_dict()
    assert read_again(again) == again
    assert (again.options, again.spp_of("M0", 3), again.models) == (PLAN.options, PLAN.spp_of("M0", 3), PLAN.models)


def test_the_error_in_all_is_rounded_once():
    """The root of the sum of squares of 0.010049 and 0.034649 is 0.0361; of 0.01 and 0.0346 it is 0.0360."""
    assert read_again(PLAN).error.tolist() == [0.0224, 0.0201, 0.0361]


def test_a_plan_of_before_samples_differed_by_frame_is_read():
    old = {"spp": 8, "max_scatterings": 4, "error": None, "decisions": [{"what": "A", "choice": "none", "reason": "."}]}
    plan = Plan.from_dict(old)
    assert plan.options == {"spp": 8, "max_scatterings": 4, "max_bounces": None, "integrator": "auto"}
    assert (plan.spp_of("M0", 7), plan.error, plan.says_how("CD"), plan.says_how("A")) == (8, None, True, False)


@pytest.mark.parametrize(("integrator", "spp"), [("path", 1), ("field", 0.25)])
def test_samples_are_those_that_are_taken(integrator, spp):
    """Paths alone take whole samples; a plan that said 0.25 of them would be wrong."""
    scene = scene_from_dict(
        {
            "water": {"jerlov": {"type": "IB"}},
            "vehicle": {
                "lights": [{"kind": "point", "position": [0.5, 0, 0], "intensity": [1, 1, 1]}],
                "cameras": [{"id": "M0", "resolution": [16, 9]}],
            },
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            "render": {"outputs": ["A"], "spp": 0.25, "integrator": integrator},
        }
    )
    plan = plan_as_given(scene)
    assert plan.spp == spp
    assert plan.decisions[1].choice == str(spp)
