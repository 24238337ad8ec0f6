"""Image A of one scene by many methods: error against time, within a budget of seconds."""

import os
import tempfile
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

from benchmarks.errors import Reference, measure
from benchmarks.machine import Budget
from benchmarks.methods import REPEATS, Method, Render, Workshop
from benchmarks.scenes import BenchScene, references
from benchmarks.store import Store
from varos_warp.device.devices import usable_cores
from varos_warp.errors import InputError

Tell = Callable[[str], None]


@dataclass
class Series:
    """A method that is under way."""

    method: Method
    left: list[int]
    """Samples per pixel to come, ascending."""
    render: Render | None = None
    """Absent until it is prepared."""
    setup_seconds: float = 0.0
    expected: float = 0.0
    """Seconds that the next point will take, errors and repetitions included; 0 before the first is known."""


@contextmanager
def tables_of_its_own():
    """A fresh folder for tables, so that the time to make them is that of a user's first frame."""
    with tempfile.TemporaryDirectory() as folder, patch.dict(os.environ, VAROS_WARP_CACHE=folder):
        yield Path(folder)


def compare(bench: BenchScene, methods: list[Method], device: str, seconds: float, store: Store, tell: Tell) -> int:
    """Render a scene by every method with more and more samples, the cheapest point first, and store a row for each.

    ``seconds`` (of a `Budget`) hold the rendering and the comparing. What comes before is counted apart: compilation,
    the field, references that must be made first. Returns the number of points.
    """
    known, workshop, clock = references(bench, device, tell), Workshop(bench, device), Budget(device)
    about = {"title": bench.title, "triangles": sum(len(part.faces) for part in bench.parts)}
    about |= {"resolution": list(bench.camera.resolution), "left_out": {}}
    facts = store.scenes.setdefault(bench.name, about)
    running, points = [Series(method, list(method.spp)) for method in methods], 0
    with tables_of_its_own():
        while running:
            series = min(running, key=lambda one: one.expected)
            if clock.seconds - workshop.cost + series.expected > seconds:
                break
            try:
                _point(workshop, series, known, clock, store, tell)
                points += 1
            except (InputError, RuntimeError) as error:  # what does not serve this scene, or another program's failure
                facts["left_out"][series.method.name] = str(error)
                tell(f"{bench.name}: {series.method.name} is left out: {error}")
                series.left.clear()
            if not series.left:
                running.remove(series)
    facts["left_out"] |= {series.method.name: "no time was left" for series in running if series.render is None}
    facts |= {"compile_seconds": workshop.compile_seconds, "seconds": clock.seconds - workshop.cost}
    store.save()
    return points


def _point(
    workshop: Workshop, series: Series, known: dict[str, Reference], clock: Budget, store: Store, tell: Tell
) -> None:
    """The next number of samples of a series: rows in the store, and how long the one after that will take."""
    bench, method = workshop.bench, series.method
    if series.render is None:
        series.render, series.setup_seconds = workshop.prepare(method)
    spp, before = series.left.pop(0), clock.seconds
    made = series.render(spp)
    for truth in (truth for truth in method.truth if truth in known):
        row = {
            "scene": bench.name,
            "method": method.name,
            "spp": spp,
            "truth": truth,
            "repeats": len(made.images),
            **{name: getattr(method, name) for name in ("label", "family", "denoise", "peer")},
            **{name: getattr(made, name) for name in ("seconds", "cpu_seconds")},
            "setup_seconds": series.setup_seconds + made.setup_seconds,
            **measure(made.images, known[truth]),
        }
        store.add(row)
        tell(
            f"{bench.name}: {method.name} {spp} spp, {made.seconds:.3g} s ({made.cpu_seconds:.3g} CPU-s), rmse "
            f"{row['rmse']:.3g}, median {row['median']:.3g}, 1 - SSIM {row['ssim']:.3g}"
            + ("" if truth == "full" else f" against {truth}")
        )
    # the part that grows with the samples, once; the rest as now
    ratio = series.left[0] / spp if series.left else 1.0
    one = made.cpu_seconds / usable_cores() if workshop.device == "cpu" else made.seconds
    series.expected = clock.seconds - before + one * max(ratio - min(len(made.images), REPEATS), 0.0)
