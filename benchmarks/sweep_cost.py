"""What a further water of a sweep costs, over what its A alone does.

    python -m benchmarks.sweep_cost [--device cuda:0] [--template stereo_survey] [--resolution 640x360] [--frames 50]
        [--spp 8] [--integrator auto] [--outputs ACDS] [--waters IB,II,1C,3C] [--repeats 3]
        [-o benchmarks/results/sweep_cost.json]

One course with all sensors is made, each time into a new folder: as sweeps of the first water, of the first two and of
all, and as a run without A. Into the folder of such a run A alone is made then, written, exposed and listed, with
geometry and course at hand. ``further_s`` is what N waters take more than one, ``a_alone_s`` what A of these further
waters takes alone, ``over_a`` their ratio. ``a_of_run_s`` is what a run of the first water takes more than one without
A, which is to be ``a_alone_first_s``. Seconds are pairs: on the clock, and of all cores.

A throwaway sweep compiles. What the user's cache keeps is made anew each time, such as the field of every water.
"""

import argparse
import json
import os
import tempfile
import warnings
from pathlib import Path
from unittest.mock import patch

import numpy as np

from benchmarks.machine import Stopwatch, machine
from varos_warp.dataset.run.produce import produce_sharing
from varos_warp.dataset.run.shared import Shared
from varos_warp.dataset.sweep.run import prepare
from varos_warp.device.devices import resolve_device
from varos_warp.scene.description.image_types import WATER
from varos_warp.scene.file.load import load_scene
from varos_warp.scene.file.templates import template_text

SENSORS = ("dvl", "magnetometer")
"""Sensors that a template may lack."""


class Course:
    """A template, its sweeps and its runs, each in a new folder and with an empty cache."""

    def __init__(self, folder: Path, options):
        self.folder, self.count = folder, 0
        self.how = {"device": options.device, "frames": slice(options.frames)}
        self.path = folder / "scene.yaml"
        self.path.write_text(template_text(options.template))
        vehicle = load_scene(self.path).vehicle
        self.sets = [f"render.{key}={getattr(options, key)}" for key in ("spp", "integrator")]
        self.sets.append(f"render.outputs=[{','.join(options.outputs)}]")
        self.sets += [f"vehicle.cameras.{i}.resolution={options.resolution}" for i in range(len(vehicle.cameras))]
        self.sets += [f"vehicle.{name}={{}}" for name in SENSORS if getattr(vehicle, name) is None]

    def new(self) -> Path:
        """A folder for the next dataset, and an empty cache."""
        self.count += 1
        os.environ["VAROS_WARP_CACHE"] = str(self.folder / f"cache{self.count}")
        return self.folder / f"out{self.count}"

    def sweep(self, waters: list[str]) -> np.ndarray:
        """Seconds of a sweep."""
        over, out, watch = f"water.jerlov.type={','.join(waters)}", self.new(), Stopwatch()
        prepare(self.path, [over], out, self.sets, **self.how).run(quiet=True)
        return read(watch)

    def apart(self, waters: list[str]) -> tuple[np.ndarray, np.ndarray]:
        """Seconds of a run without A of the first water, and of A of each water, [N, 2]."""
        kept, taken = Shared(), []
        for water in waters:
            out = self.new()
            scene = kept.suited(load_scene(self.path, [*self.sets, f"water={{jerlov: {{type: {water}}}}}"]))
            rest = [letter for letter in scene.render.outputs if letter != WATER]
            for letters in (rest, scene.render.outputs):
                part, watch = scene.render.model_copy(update={"outputs": letters}), Stopwatch()
                produce_sharing(scene.model_copy(update={"render": part}), out, kept, quiet=True, **self.how)
                taken.append(read(watch))
        return taken[0], np.array(taken[1::2])


def read(watch: Stopwatch) -> np.ndarray:
    """Seconds on the clock, and of all cores."""
    return np.array([watch.seconds, watch.cpu_seconds])


def repeat(course: Course, waters: list[str]) -> dict:
    """Everything once."""
    rest, alone = course.apart(waters)
    one = course.sweep(waters[:1])
    row = {"run_s": one, "a_of_run_s": one - rest, "a_alone_first_s": alone[0]}
    for count in sorted({2, len(waters)}):
        further, of_a = course.sweep(waters[:count]) - one, alone[1:count].sum(axis=0)
        row[f"{count}_waters"] = {"further_s": further, "a_alone_s": of_a, "over_a": further / of_a}
    return row


def main(arguments=None) -> None:
    """Print a line a repeat, and write what was asked for, with the medians of the ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", type=resolve_device, default="cpu")
    parser.add_argument("--template", default="stereo_survey")
    parser.add_argument("--resolution", type=lambda text: [int(n) for n in text.split("x")], default=[640, 360])
    parser.add_argument("--frames", type=int, default=50)
    parser.add_argument("--spp", type=float, default=8)
    parser.add_argument("--integrator", default="auto")
    parser.add_argument("--outputs", default="ACDS")
    parser.add_argument("--waters", type=lambda text: text.split(","), default=["IB", "II", "1C", "3C"])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("-o", "--out", type=Path)
    options = parser.parse_args(arguments)
    rows = []
    with (
        tempfile.TemporaryDirectory() as folder,
        patch.dict(os.environ),
        warnings.catch_warnings(action="ignore"),
    ):
        course = Course(Path(folder), options)
        course.sweep(options.waters[:1])
        for _ in range(options.repeats):
            text = json.dumps(repeat(course, options.waters), default=lambda value: value.round(3).tolist())
            rows.append(json.loads(text))
            print(text, flush=True)
    asked = {key: value for key, value in vars(options).items() if key not in ("device", "out")}
    medians = {
        f"over_a_{key}": np.median([row[key]["over_a"] for row in rows], axis=0).round(3).tolist()
        for key in rows[0]
        if key.endswith("_waters")
    }
    print(json.dumps(medians))
    if options.out:
        result = {"machine": machine(options.device), **asked, **medians, "repeats": rows}
        options.out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
