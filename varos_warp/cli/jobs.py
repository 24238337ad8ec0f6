"""Verbs that take a scene and make a dataset of it, or say what that would take."""

from dataclasses import asdict
from pathlib import Path

from varos_warp.cli.app import resumable, verb
from varos_warp.cli.options import (
    Choices,
    DryRun,
    Json,
    Out,
    Over,
    Quiet,
    SceneFile,
    Seed,
    Set,
    Shard,
    SweepOut,
    Vehicle,
    Workers,
    parse_frames,
    parse_shard,
)
from varos_warp.cli.tables import print_json, print_plan, print_sweep
from varos_warp.errors import counted


@verb
def plan(scene: SceneFile, choices: Choices, json_: Json = False, quiet: Quiet = False):
    """Choose the integrator and the samples, and say why and how long a run will take."""
    import varos_warp.render.planner  # noqa: F401  where it is left out, that is said before anything is loaded
    from varos_warp.dataset.progress import Console
    from varos_warp.dataset.run.planning import kept_plan, plan_sequence
    from varos_warp.dataset.run.steps import simulated
    from varos_warp.device.devices import resolve_device
    from varos_warp.render.renderer import FrameRenderer
    from varos_warp.scene.checks import check_scene
    from varos_warp.scene.file.load import load_scene
    from varos_warp.scene.file.named_files import require_files
    from varos_warp.scene.file.source import located
    from varos_warp.scene.geometry.build import build_parts
    from varos_warp.sim.clock import select
    from varos_warp.sim.trajectory import path_samples

    device = resolve_device(choices.device)
    loaded, chosen = load_scene(scene, choices.overrides()), parse_frames(choices.frames)
    with located(loaded):
        require_files(loaded)
        simulation, parts = simulated(loaded, quiet, []), build_parts(loaded)  # what a DVL reads is not looked at
        wanted = simulation.frames.rows(select(chosen, len(simulation.frames)))
        for warning in check_scene(loaded, parts, path_samples(simulation)):
            Console(quiet).tell(f"note: {warning}")
        renderer = FrameRenderer(loaded, device, parts)
        planned = plan_sequence(loaded, renderer, wanted, simulation.motion, quiet, measure_cost=True)
    kept_plan(loaded, renderer, wanted, lambda: planned)
    result = planned.to_dict()
    if json_:
        print_json(result)
        return
    print_plan(result, planned)


@resumable
def run(
    scene: SceneFile,
    out: Out,
    choices: Choices,
    shard: Shard = None,
    workers: Workers = None,
    json_: Json = False,
    quiet: Quiet = False,
):
    """Simulate, render and write the dataset; goes on where an earlier run stopped."""
    make(scene, out, choices, json_, quiet, shard=parse_shard(shard), workers=workers)


@resumable
def render(
    scene: SceneFile,
    out: Out,
    choices: Choices,
    shard: Shard = None,
    workers: Workers = None,
    json_: Json = False,
    quiet: Quiet = False,
):
    """Render the images only, without sensors and the vehicle's poses."""
    make(scene, out, choices, json_, quiet, shard=parse_shard(shard), workers=workers, sensors=False)


@verb
def simulate(
    scene: SceneFile,
    out: Out,
    seed: Seed = None,
    vehicle: Vehicle = None,
    set_: Set = None,
    json_: Json = False,
    quiet: Quiet = False,
):
    """Write the course and the readings of the sensors only, in seconds; no images."""
    make(scene, out, Choices(seed=seed, vehicle=vehicle, set_=set_), json_, quiet, images=False)


@resumable
def sweep(
    scene: SceneFile,
    out: SweepOut,
    over: Over,
    choices: Choices,
    shard: Shard = None,
    workers: Workers = None,
    dry_run: DryRun = False,
    json_: Json = False,
    quiet: Quiet = False,
):
    """Make a dataset of each of many versions of a scene, such as waters; what they have in common is made once."""
    from varos_warp.dataset.sweep.costs import costs
    from varos_warp.dataset.sweep.run import prepare

    job = prepare(
        scene,
        over,
        out,
        choices.overrides(),
        device=choices.device,
        frames=parse_frames(choices.frames),
        only=choices.vehicle,
    )
    if dry_run:
        told = costs(job, quiet)
        print_json({"out": str(out), "datasets": told}) if json_ else print_sweep(told)
        return
    made = job.run(shard=parse_shard(shard), workers=workers, quiet=quiet)
    if json_:
        print_json({"out": str(out), "datasets": {name: summary and asdict(summary) for name, summary in made.items()}})
        return
    for name, summary in made.items():
        if summary is None:
            print(f"{out / name}: complete, left as it is")
        else:
            _print_summary(summary, with_images=True)


@resumable
def demo(
    out: Out = Path("varos_demo"),
    choices: Choices = Choices(),
    shard: Shard = None,
    json_: Json = False,
    quiet: Quiet = False,
):
    """Make the dataset of a small scene that comes with the package, and a report: minutes on two cores."""
    from varos_warp.dataset.reader.dataset import Dataset
    from varos_warp.dataset.report import write_report
    from varos_warp.scene.file.load import demo_scene_path

    if not make(demo_scene_path(), out, choices, json_, quiet, shard=parse_shard(shard)):
        return
    page = write_report(Dataset(out), out / "report.html", quiet)
    if not json_:
        print(f"look at {out / 'contact_sheet.png'} and {page}")


def make(path: Path, out: Path, choices: Choices, json_: bool, quiet: bool, **options) -> bool:
    """Produce the dataset of each vehicle and print what was done; returns whether all that was asked for is there."""
    from varos_warp.dataset.run.fleet import produce_each
    from varos_warp.scene.file.load import load_scene

    loaded = load_scene(path, choices.overrides())
    made = produce_each(
        loaded, out, choices.vehicle, device=choices.device, frames=parse_frames(choices.frames), quiet=quiet, **options
    )
    if json_:
        summaries = {each: asdict(summary) for each, summary in made.items()}
        print_json({"vehicles": summaries} if loaded.vehicles else summaries[loaded.vehicle.id])
    else:
        for summary in made.values():
            _print_summary(summary, options.get("images", True))
    return all(summary.complete for summary in made.values())


def _print_summary(summary, with_images: bool) -> None:
    images = f"{counted(summary.rendered, 'image')} rendered, {summary.kept} kept" if with_images else "no images"
    where = f" on {summary.device}" if summary.device else ""
    state = "" if summary.complete else "; not complete yet"
    print(f"{summary.out}: {counted(summary.frames, 'frame')}, {images}, {summary.seconds:.1f} s{where}{state}")
