"""The command line: arguments become calls, nothing else.

Exit status: 0 done; 2 bad input or an invalid dataset; 1 a failure of our own; 130 interrupted.
"""

import gc
import logging
import os
import signal
import sys
import threading
import warnings
from typing import Annotated

import typer

import varos_warp
from varos_warp.cli.app import app, interrupted

from varos_warp.cli import scenes, jobs, datasets  # isort: skip  # in the order of the help

__all__ = ["app", "datasets", "jobs", "main", "scenes"]

SEARCHED = (10_000, 10, 10)
"""Thresholds of the search for garbage in circles: Python's own, of 700 objects, take a tenth of the time of a short
run, as all modules are searched again and again. Images are in no circles (benchmarks/soak.py keeps its memory even
without any search)."""


def _version(value: bool) -> None:
    if value:
        print(f"varos-warp {varos_warp.__version__}")
        raise typer.Exit


class _ToStderr(logging.Handler):
    """Shows what the package logs, such as that it makes what it keeps for later runs."""

    def emit(self, record):
        print(record.getMessage(), file=sys.stderr, flush=True)  # looked up now: a progress bar may stand in for it


@app.callback()
def _global(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
):
    logging.getLogger("varos_warp").handlers = [_ToStderr()]
    warnings.showwarning = lambda message, *_: print(f"note: {message}", file=sys.stderr)


def _interrupt(_signal, _frame):
    interrupted.set()
    raise KeyboardInterrupt


def main() -> None:
    """Entry point of ``varos-warp``; SIGTERM (a cluster's end of time) counts as an interruption."""
    gc.set_threshold(*SEARCHED)
    signal.signal(signal.SIGTERM, _interrupt)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else who calls has it ignored
        signal.signal(signal.SIGINT, _interrupt)
    try:
        app(prog_name="varos-warp")
    except SystemExit as end:
        _leave_threads(end.code)
        raise


def _leave_threads(status: str | int | None) -> None:
    """End without waiting for threads that compile or load (device/compile.py), if any do: nobody needs it any more.

    Python would wait for them. What they write gets its name when it is whole.
    """
    if any(thread.name.startswith("unawaited_") for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status if isinstance(status, int) else int(status is not None))
