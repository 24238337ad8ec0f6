"""What makes a function a verb: a dataclass's fields as options, and one message where the input is bad."""

import dataclasses
import functools
import inspect
import logging
import sys
import threading
import warnings
from collections.abc import Callable, Iterable

import typer
from typer.core import TyperCommand, TyperGroup
from typer.models import ArgumentInfo

from varos_warp.errors import InputError, RunFailed


class _PlainFlags:
    """Help in which flags have no type: one takes no value."""

    def get_params(self, ctx):
        params = super().get_params(ctx)
        for param in params:
            if getattr(param, "is_flag", False) and param.metavar is None:
                param.metavar = ""
        return params


class _Group(_PlainFlags, TyperGroup):
    pass


class _Command(_PlainFlags, TyperCommand):
    pass


app = typer.Typer(
    cls=_Group,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Realistic synthetic underwater video with exact ground truth.\n\nTo begin with: "
    "varos-warp init my.yaml, varos-warp info my.yaml, varos-warp run my.yaml -o OUT.",
)
SECOND_WING = (
    "varos_warp.render.planner",
    "varos_warp.dataset.validate",
    "varos_warp.dataset.report",
    "varos_warp.dataset.export",
    "varos_warp.dataset.readiness",
    "varos_warp.dataset.sweep",
    "varos_warp.dataset.view",
    "varos_warp.dataset.preview",
    "varos_warp.dataset.screens",
)
"""Rooms and files that an installation may leave out: they choose what a scene leaves open, or look at what is made."""
interrupted = threading.Event()
"""Set once a signal has interrupted: a library may have made another error of it, as NumPy does where it compares
types."""
PANELS = {"scenes": "Scene files", "jobs": "Make a dataset", "datasets": "Use a dataset"}
"""Headings of the verbs in the help, by the module that has them."""


def verb(function: Callable, goes_on: bool = False) -> Callable:
    """Register a command; bad input becomes one message and status 2, an interruption status 130.

    Of a parameter that is a dataclass the command line has the fields; a verb that ``goes_on`` says so when
    interrupted.
    """
    parameters = inspect.signature(function).parameters.values()
    groups = {p.name: p.annotation for p in parameters if dataclasses.is_dataclass(p.annotation)}
    options = [
        option
        for p in parameters
        for option in (inspect.signature(p.annotation).parameters.values() if p.name in groups else [p])
    ]
    named = {p.name for p in options if not any(isinstance(about, ArgumentInfo) for about in p.annotation.__metadata__)}

    @functools.wraps(function)
    def guarded(**given):
        for name, group in groups.items():
            given[name] = group(**{field.name: given.pop(field.name) for field in dataclasses.fields(group)})
        logging.getLogger("varos_warp").setLevel(logging.WARNING if given.get("quiet") else logging.INFO)
        if given.get("quiet"):
            warnings.showwarning = lambda *_: None  # each call shows them again: cli._global
        try:
            return function(**given)
        except InputError as error:
            print(f"varos-warp: {_with_option(error, named).message}", file=sys.stderr)
            raise typer.Exit(2) from None
        except ModuleNotFoundError as error:
            if not (error.name or "").startswith(SECOND_WING):
                raise
            print(f"varos-warp: this installation leaves out {error.name}, which this needs", file=sys.stderr)
            raise typer.Exit(2) from None
        except RunFailed as error:
            print(f"varos-warp: {error}", file=sys.stderr)
            raise typer.Exit(1) from None
        except (KeyboardInterrupt, Exception) as error:
            if not (isinstance(error, KeyboardInterrupt) or interrupted.is_set()):
                raise
            rest = "; what is complete stays, the same command goes on from there" if goes_on else ""
            print(f"varos-warp: interrupted{rest}", file=sys.stderr)
            raise typer.Exit(130) from None

    guarded.__signature__ = inspect.Signature([p.replace(kind=p.KEYWORD_ONLY) for p in options])
    guarded.__annotations__ = {p.name: p.annotation for p in options}
    panel = PANELS[function.__module__.rpartition(".")[2]]
    return app.command(cls=_Command, no_args_is_help=False, rich_help_panel=panel)(guarded)


def _with_option(error: InputError, named: Iterable[str]) -> InputError:
    """The error of an option under the name that it has on the command line; ``named``: names of parameters."""
    return error.at(f"--{error.key.replace('_', '-')}") if error.file is None and error.key in named else error


resumable = functools.partial(verb, goes_on=True)
