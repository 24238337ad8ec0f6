"""Error against time for every method, on named scenes.

    python -m benchmarks.bench [ref1 open_water jerlov_1b ... closed_room demo] [--methods path,field+oidn,...]
                               [--device cuda:0] [--seconds 150] [--quick] [-o OUT]

Writes bench.json and charts; docs/benchmarks.md says what is measured. Every row is written as soon as it
is known. ``--seconds`` is of a scene; compilation, tables and references that must be made first come on top.
``--quick``: two scenes, few methods, two minutes on two cores.
"""

import sys
from pathlib import Path

from benchmarks import chart, methods, radiance, scenes
from benchmarks.machine import command, machine, words
from benchmarks.store import reopen
from varos_warp.device.devices import resolve_device
from varos_warp.errors import InputError

SECONDS, QUICK_SECONDS = 150.0, 25.0
"""Seconds for a scene, unless the caller says otherwise."""


def tell(text: str) -> None:
    """Print a line of progress."""
    print(text, file=sys.stderr, flush=True)


def run(names=(), method_names=(), device="auto", quick=False, seconds=None, out=Path("bench")) -> None:
    """Measure scenes by methods (none named: all, a few if ``quick``), write and draw.

    ``seconds`` are for each scene. Of the results of an earlier run in ``out`` by the same code on the same machine,
    the scenes that are measured anew are replaced, of others all. An InputError tells that there is no such scene,
    method or device.
    """
    seconds = seconds or (QUICK_SECONDS if quick else SECONDS)
    if seconds <= 0.0:
        raise InputError("must be above 0", key="--seconds", value=seconds)
    chosen = scenes.find(names or (scenes.QUICK if quick else ()))
    ways, device = methods.find(method_names, quick), resolve_device(device)
    store = reopen(Path(out), machine(device))
    store.forget([bench.name for bench in chosen])
    for bench in chosen:
        if radiance.compare(bench, ways, device, seconds, store, tell):
            chart.radiance(store.content(), bench.name, store.folder / f"A_{bench.name}.png")
    if store.rows:
        chart.scenes(store.content(), store.folder / "scenes.png")


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns its exit status."""
    parser = command(__doc__, device=None)
    parser.add_argument("names", nargs="*", metavar="SCENE", help="none: all")
    parser.add_argument("--methods", type=words, default=[], help="direct, single, path, field, field+oidn ...")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--seconds", type=float)
    parser.add_argument("-o", "--out", type=Path, default=Path("bench"), help="folder for tables and charts")
    given = parser.parse_args(arguments)
    try:
        run(given.names, given.methods, given.device, given.quick, given.seconds, given.out)
    except InputError as error:
        print(f"benchmarks.bench: {error.message}", file=sys.stderr)
        return 2
    print(f"{given.out}: {', '.join(sorted(path.name for path in given.out.glob('*.*')))}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
