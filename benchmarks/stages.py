"""Measure where the time of a run goes: stages, first image, memory, and the time that `plan` foretells, on a CPU.

    python -m benchmarks.stages [NAMES...] [--frames 2] [-o benchmarks/results/stages_cpu.json]

Each run is a process of its own with warm caches but no plan (and once with one). Times are CPU-seconds of all threads
over the cores, as an idle machine would take them with all cores busy: other work beside does not count. The results
are added to those of other scenes in the file, and put on docs/benchmarks.md.
"""

import json
import resource
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace

from benchmarks.machine import MUNKHOLMEN, RESULTS, ROOT, command, machine, markdown, save
from benchmarks.page import PAGE, fill
from varos_warp.cache import cache_folder
from varos_warp.dataset import timing
from varos_warp.dataset.run import produce
from varos_warp.dataset.run.planning import kept_plan, plan_sequence
from varos_warp.dataset.write.images import Store
from varos_warp.device.devices import usable_cores
from varos_warp.render.planner.cost import sequence_cost
from varos_warp.render.planner.pilot import Frames
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import load_scene
from varos_warp.sim.trajectory import simulate

DATA = ROOT / "varos_warp/data"
SCENES = {
    "starter": (DATA / "starter.yaml", ()),
    "starter at 1280x720": (DATA / "starter.yaml", ("vehicle.cameras.0.resolution=[1280,720]", "render.spp=2")),
    "demo": (DATA / "demo.yaml", ("render.spp=null",)),
    "turbid_water": (DATA / "templates/turbid_water.yaml", ("vehicle.cameras.0.resolution=[320,180]",)),
    "harbour_wall": (DATA / "templates/harbour_wall.yaml", ("vehicle.cameras.0.resolution=[320,180]",)),
    "munkholmen": (MUNKHOLMEN, ("vehicle.cameras.0.resolution=[320,180]",)),
}
"""Scene files, and what is changed in them."""
STAGES = ("start", "simulate", "load", "plan", "render", "finish")
"""Before the scene is simulated; ... ; and after the last image: exposure, checksums."""
FORETOLD = "foretold over real"


def measure_here(path: Path, changes, frames: int, forget: bool = False, foretell: bool = False) -> dict:
    """One run in this process: CPU-seconds over cores of its stages, and at its first image."""
    if forget:
        forget_plans()
    start, first, write = time.process_time(), [], Store.write
    timing.time = SimpleNamespace(perf_counter=time.process_time)  # stages in CPU-seconds

    def timed_write(self, job, letter, image, clock):
        stored = write(self, job, letter, image, clock)
        if letter == "A":
            first.append(time.process_time())
        return stored

    Store.write = timed_write
    scene = load_scene(path, changes)
    with tempfile.TemporaryDirectory() as folder:
        done = produce.produce(scene, Path(folder) / "out", device="cpu", frames=slice(0, frames), quiet=True)
        plan = json.loads((Path(folder) / "out/dataset.json").read_text())["samples"]["plan"]
    cores, took = usable_cores(), done.stages
    parts = {"start": start, **{name: took[name] for name in ("simulate", "load", "plan")}}
    parts |= {"render": took["render"] + took["wait"], "finish": took["expose"] + took["checksums"]}
    row = {
        "stages": {stage: round(seconds / cores, 2) for stage, seconds in parts.items()},
        "first_image": round(min(first) / cores, 2),
        "a_frame": round(parts["render"] / frames / cores, 3),
        "peak_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "spp": plan["spp"],
    }
    return row | ({"foretold": foretold(scene, frames)} if foretell else {})


def foretold(scene, frames: int) -> float:
    """Seconds a frame that `plan` foretells for the same frames."""
    simulation, renderer = simulate(scene), FrameRenderer(scene, "cpu")
    plan = kept_plan(
        scene,
        renderer,
        simulation.frames,
        lambda: plan_sequence(scene, renderer, simulation.frames, simulation.motion, quiet=True),
    )
    costed = Frames(renderer, list(simulation.frames.poses()[:frames]), simulation.frames.time_ns, simulation.motion)
    return sequence_cost(scene, costed, plan)["seconds_per_frame"]


def measure(name: str, frames: int, **options: bool) -> dict:
    """Measure in a process of its own."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return {"scene": name} | pool.submit(measure_here, *SCENES[name], frames, **options).result()


def check(name: str, frames: int) -> dict:
    """One row: without a plan, as a run that is the first of its scene, and then with it."""
    row = measure(name, frames, forget=True)
    again = measure(name, frames, foretell=True)
    row["first_image_planned"] = again["first_image"]
    row["peak_mb"] = max(row["peak_mb"], again["peak_mb"])
    row["foretold"], row["a_frame"] = again["foretold"], again["a_frame"]
    row[FORETOLD] = round(again["foretold"] / again["a_frame"], 2)
    return row


def forget_plans() -> None:
    """Delete the plans in the user's cache; all else stays."""
    for path in cache_folder().glob("plan-*.npz"):
        path.unlink()


def table(result: dict) -> str:
    """Rows for docs/benchmarks.md."""
    facts = ("first image [s]", "planned before [s]", "a frame [s]", FORETOLD, "memory [MB]", "spp")
    keys = ("first_image", "first_image_planned", "a_frame", FORETOLD, "peak_mb", "spp")
    values = {row["scene"]: (*row["stages"].values(), *map(row.get, keys)) for row in result["rows"]}
    rows = [[name, *(f"{x:.3g}" if x < 100 else f"{x:.0f}" for x in row)] for name, row in values.items()]
    made = result["machine"]
    return (
        f"{made['cores']} cores of {made['cpu']}{result['note']}; {made['commit']}, {made['date']}; "
        f"{result['frames']} frames.\n\n{markdown(['scene', *(f'{stage} [s]' for stage in STAGES), *facts], rows)}"
    )


def main():
    parser = command(__doc__, device=None)
    parser.add_argument("names", nargs="*", choices=[*SCENES, []])
    parser.add_argument("--frames", type=int, default=2)
    parser.add_argument("--note", default="", help="On the machine, such as: ', busy'.")
    parser.add_argument("-o", "--out", type=Path, default=RESULTS / "stages_cpu.json")
    asked = parser.parse_args()
    rows = {row["scene"]: row for row in json.loads(asked.out.read_text())["rows"]} if asked.out.exists() else {}
    result = {"machine": machine("cpu"), "note": asked.note, "frames": asked.frames}
    for name in asked.names or SCENES:
        measure(name, 1)  # compiles, and fills the caches
        rows[name] = check(name, asked.frames)
        print(rows[name], flush=True)
        save(asked.out, result | {"rows": [rows[name] for name in SCENES if name in rows]})
    PAGE.write_text(fill(PAGE.read_text(), "cpu: stages", table(json.loads(asked.out.read_text()))))


if __name__ == "__main__":
    main()
