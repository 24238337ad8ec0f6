"""Error against time for every method, on named scenes.

    python -m benchmarks.bench [SCENE-NAMES...] [--methods ...] [--outputs A,sensors] [--device cuda:0] [--quick]
                               [-o OUT]

Writes bench.json, and a CSV file and charts for each output; docs/benchmarks.md says what is measured. Every row is
written as soon as it is known.
"""

import argparse
import json
import sys
from pathlib import Path

from benchmarks import chart, methods, radiance, scenes, sensors
from benchmarks.machine import machine
from benchmarks.store import Store, reopen
from varos_warp.device.devices import resolve_device
from varos_warp.errors import InputError

OUTPUTS = ("A", "sensors")
SECONDS, QUICK_SECONDS = 150.0, 25.0
"""Of a scene and an output, where nobody says otherwise; preparation comes on top."""


def run(
    names=(),
    method_names=(),
    outputs=OUTPUTS,
    device: str = "auto",
    quick: bool = False,
    seconds: float | None = None,
    out: Path = Path("bench"),
    quiet: bool = False,
) -> dict:
    """Measure, write and draw; returns what bench.json holds.

    Args:
        names: of scenes; none: all, or two if ``quick``.
        method_names: of methods of A; none: all, or a few if ``quick``.
        outputs: any of `OUTPUTS`.
        device: auto, cpu or cuda:N.
        quick: to see it work, in two minutes on two cores.
        seconds: for each scene and output; compilation, tables and references that must be made first come on top.
        out: folder for the results; of those of an earlier run there by the same code on the same machine, the scenes
            that are measured anew are replaced, of others all.
        quiet: no lines of progress.

    Raises:
        InputError: There is no such scene, method, output or device.
    """
    for output in outputs:
        if output not in OUTPUTS:
            raise InputError(
                "there is no such chart", key="--outputs", value=output, remedy=f"There are: {', '.join(OUTPUTS)}."
            )
    seconds = seconds or (QUICK_SECONDS if quick else SECONDS)
    if seconds <= 0.0:
        raise InputError("must be above 0", key="--seconds", value=seconds)
    chosen = scenes.find(names or (scenes.QUICK if quick else ()))
    ways, device = methods.find(method_names, quick), resolve_device(device)
    store = reopen(Path(out), machine(device))

    def tell(text: str) -> None:
        if not quiet:
            print(text, file=sys.stderr, flush=True)

    store.forget([bench.name for bench in chosen], outputs)
    if "sensors" in outputs:
        _sensors(store, tell)
    for bench in chosen if "A" in outputs else ():
        if radiance.compare(bench, ways, device, seconds, store, tell):
            chart.radiance(store.content(), bench.name, store.folder / f"A_{bench.name}.png")
    draw(store.content(), store.folder)
    return store.content()


def _sensors(store: Store, tell) -> None:
    tell("flying the course with steps of several lengths")
    for row in (*sensors.step_rows(), *sensors.rate_rows()):
        store.add("sensors", row)


def draw(result: dict, folder: Path, prefix: str = "") -> None:
    """The charts that span scenes, of the outputs that were measured."""
    if result.get("A"):
        chart.scenes(result, folder / f"{prefix}scenes.png")
    if result.get("sensors"):
        chart.steps_and_rates(result, folder / f"{prefix}sensors.png")


def _names(text: str) -> list[str]:
    """Names between commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns its exit status."""
    parser = argparse.ArgumentParser(prog="benchmarks.bench", description="Chart errors of methods against time.")
    parser.add_argument("names", nargs="*", metavar="SCENE", help="ref1, open_water, jerlov_1b ... (none: all)")
    parser.add_argument(
        "--methods",
        type=_names,
        default=[],
        metavar="NAME,...",
        help="methods of A: direct, single, path, field, field+oidn ...",
    )
    parser.add_argument("--outputs", type=_names, default=list(OUTPUTS), metavar="A,sensors", help="charts to make")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    parser.add_argument("--quick", action="store_true", help="two scenes, few methods: two minutes")
    parser.add_argument("--seconds", type=float, help="budget of each scene and chart")
    parser.add_argument("-o", "--out", type=Path, default=Path("bench"), help="folder for tables and charts")
    parser.add_argument("--json", action="store_true", help="print what bench.json holds")
    parser.add_argument("-q", "--quiet", action="store_true", help="no lines of progress")
    given = parser.parse_args(arguments)
    try:
        result = run(
            given.names, given.methods, given.outputs, given.device, given.quick, given.seconds, given.out, given.quiet
        )
    except InputError as error:
        print(f"{parser.prog}: {error.message}", file=sys.stderr)
        return 2
    names = ", ".join(sorted(path.name for path in given.out.glob("*.*")))
    print(json.dumps(result, indent=2) if given.json else f"{given.out}: {names}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
