"""What stands in for the simulation, the planner and the renderer is called as they are."""

import inspect
from importlib import import_module

import pytest
import standins
from standins import FlatFloorRenderer

CALLED = [
    (getattr(import_module(f"varos_warp.{name}"), member), getattr(standins, stand_in))
    for name, members in standins.PLACES.items()
    for member, stand_in in members.items()
]
CALLED += [
    (getattr(CALLED[-1][0], name), getattr(FlatFloorRenderer, name)) for name in ("render", "relit", "compiling")
]


@pytest.mark.parametrize(("real", "stand_in"), CALLED, ids=lambda function: function.__qualname__)
def test_a_stand_in_takes_what_the_real_one_takes(real, stand_in):
    """Every name that it knows is one of the real one's, in its place, and it knows every name that must be given."""
    known, own = (inspect.signature(function).parameters for function in (real, stand_in))
    rest = {parameter.kind for parameter in own.values()} & {inspect.Parameter.VAR_KEYWORD}
    named = [name for name, parameter in own.items() if parameter.kind is not inspect.Parameter.VAR_KEYWORD]
    options = standins.OPTIONS if "options" in known else set()
    assert set(named) <= known.keys() | options
    must = {name for name, parameter in known.items() if parameter.default is parameter.empty and name != "options"}
    assert must <= set(named) or rest
    placed = [name for name in named if own[name].kind is inspect.Parameter.POSITIONAL_OR_KEYWORD]
    assert placed == [*known][: len(placed)]
