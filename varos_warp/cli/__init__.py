"""The command line: arguments become calls, nothing else.

Exit status: 0 done; 2 bad input or an invalid dataset; 1 a failure of our own; 130 interrupted.
"""

import functools
import signal
import sys
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

import varos_warp
from varos_warp.cli.arguments import (
    Denoise,
    Device,
    Folder,
    Frames,
    Integrator,
    Json,
    Layers,
    LinearExr,
    MaxBounces,
    MaxScatterings,
    Out,
    Outputs,
    Quiet,
    SceneFile,
    Seed,
    Set,
    Shard,
    Spp,
    Tolerance,
    Workers,
    check_choice,
    overrides,
    parse_frames,
    parse_region,
    parse_shard,
    parse_shrinkwrap,
    split_names,
)
from varos_warp.cli.tables import print_info, print_json, print_meshes, print_plan, print_preprocessed, print_table
from varos_warp.errors import InputError, RunFailed

app = typer.Typer(add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False,
                  help="Realistic synthetic underwater video with exact ground truth.")


def verb(function, goes_on: bool = False):
    """Register a command; bad input becomes one message and status 2, an interruption status 130.

    Args:
        function: What it does.
        goes_on: Whether, given again, it goes on where it was interrupted.
    """
    @functools.wraps(function)
    def guarded(*args, **kwargs):
        try:
            return function(*args, **kwargs)
        except InputError as error:
            print(f"varos-warp: {error.message}", file=sys.stderr)
            raise typer.Exit(2) from None
        except RunFailed as error:
            print(f"varos-warp: {error}", file=sys.stderr)
            raise typer.Exit(1) from None
        except KeyboardInterrupt:
            rest = "; what is complete stays, the same command goes on from there" if goes_on else ""
            print(f"varos-warp: interrupted{rest}", file=sys.stderr)
            raise typer.Exit(130) from None

    return app.command(no_args_is_help=False)(guarded)


resumable = functools.partial(verb, goes_on=True)


# -------------------------------------------------------------------------------------------------------- the main job


def _job(name: str, text: str, **kind):
    """`run` and `render` differ in what they write, not in what they take."""
    def command(scene: SceneFile, out: Out, device: Device = "auto", frames: Frames = None, outputs: Outputs = None,
                tolerance: Tolerance = None, spp: Spp = None, max_scatterings: MaxScatterings = None,
                max_bounces: MaxBounces = None, layers: Layers = None, integrator: Integrator = None,
                seed: Seed = None, denoise: Denoise = None, linear_exr: LinearExr = False, set_: Set = None,
                shard: Shard = None, workers: Workers = None, json_: Json = False,
                quiet: Quiet = False):
        changed = overrides(set_, outputs, tolerance, spp, max_scatterings, max_bounces, layers, integrator, seed,
                            denoise, linear_exr)
        make(scene, out, changed, json_, quiet, device=device, frames=parse_frames(frames), shard=parse_shard(shard),
             workers=workers, **kind)

    command.__name__, command.__doc__ = name, text
    return resumable(command)


run = _job("run", "Simulate, render and write the dataset; goes on where an earlier run stopped.")
render = _job("render", "Render the frames only, without IMU, depth gauge and vehicle poses.", sensors=False)


@verb
def simulate(scene: SceneFile, out: Out, seed: Seed = None, set_: Set = None, json_: Json = False,
             quiet: Quiet = False):
    """Write trajectory, IMU and depth gauge only."""
    make(scene, out, overrides(set_, seed=seed), json_, quiet, images=False)


@resumable
def demo(out: Out = Path("varos_demo"), device: Device = "auto", frames: Frames = None, outputs: Outputs = None,
         tolerance: Tolerance = None, spp: Spp = None, max_scatterings: MaxScatterings = None,
         max_bounces: MaxBounces = None, layers: Layers = None, integrator: Integrator = None, seed: Seed = None,
         denoise: Denoise = None, linear_exr: LinearExr = False, set_: Set = None, shard: Shard = None,
         json_: Json = False, quiet: Quiet = False):
    """Make a small bundled scene, start to end, with a report: minutes on two CPU cores."""
    from varos_warp.dataset.reader.dataset import Dataset
    from varos_warp.dataset.report import write_report
    from varos_warp.scene.load import demo_scene_path

    changed = overrides(set_, outputs, tolerance, spp, max_scatterings, max_bounces, layers, integrator, seed, denoise,
                        linear_exr)
    whole = make(demo_scene_path(), out, changed, json_, quiet, device=device, frames=parse_frames(frames),
                 shard=parse_shard(shard))
    if not whole:
        return
    page = write_report(Dataset(out), out / "report.html", quiet)
    if not json_:
        print(f"look at {out / 'contact_sheet.png'} and {page}")


def make(path: Path, out: Path, changed: list[str], json_: bool, quiet: bool, **options) -> bool:
    """Produce a dataset and print what was done; returns whether all that was asked for is there."""
    from varos_warp.dataset.run.produce import produce
    from varos_warp.scene.load import load_scene

    summary = produce(load_scene(path, changed), out, quiet=quiet, **options)
    if json_:
        print_json(asdict(summary))
        return summary.complete
    images = f"{summary.rendered} images rendered, {summary.kept} kept" if options.get("images", True) else "no images"
    where = f" on {summary.device}" if summary.device else ""
    state = "" if summary.complete else "; not complete yet"
    print(f"{summary.out}: {summary.frames} frames, {images}, {summary.seconds:.1f} s{where}{state}")
    return summary.complete


@verb
def plan(scene: SceneFile, device: Device = "auto", frames: Frames = None, outputs: Outputs = None,
         tolerance: Tolerance = None, spp: Spp = None, max_scatterings: MaxScatterings = None,
         max_bounces: MaxBounces = None, layers: Layers = None, integrator: Integrator = None, seed: Seed = None,
         denoise: Denoise = None, set_: Set = None, json_: Json = False, quiet: Quiet = False):
    """Say which models and meshes each output needs, why, and what it will cost."""
    from varos_warp.dataset.run.produce import select, simulated
    from varos_warp.render.planner.detail import choose_detail
    from varos_warp.render.planner.plan import plan_render
    from varos_warp.render.renderer import FrameRenderer
    from varos_warp.scene.device import resolve_device
    from varos_warp.scene.geometry.build import build_parts
    from varos_warp.scene.load import load_scene

    device = resolve_device(device)
    changed = overrides(set_, outputs, tolerance, spp, max_scatterings, max_bounces, layers, integrator, seed, denoise)
    loaded, chosen = load_scene(scene, changed), parse_frames(frames)
    simulation = simulated(loaded, quiet)
    ticks = simulation.frame_ticks
    poses = [simulation.trajectory.T_w_v(tick) for tick in ticks]
    wanted = [poses[frame] for frame in select(chosen, len(ticks))]
    detail = choose_detail(loaded, build_parts(loaded), poses, device, propose=True, measure_cost=True)
    planned = plan_render(loaded, FrameRenderer(loaded, device, detail.parts), wanted, measure_cost=True,
                          meshes=detail.meshes)
    result = planned.to_dict()
    if json_:
        print_json(result)
        return
    print_plan(result, planned)
    if "meshes" in result:
        print_meshes(result["meshes"])


# ---------------------------------------------------------------------------------------------------------- a dataset


@verb
def validate(dataset: Folder, json_: Json = False, quiet: Quiet = False):
    """Read everything back and check it against itself; status 2 if something does not agree."""
    from varos_warp.dataset.validate import validate as check

    result = check(dataset, quiet)
    result.keep(dataset)
    if json_:
        print_json({"dataset": str(dataset), **result.plain()})
    else:
        print_table(["measure", "value", "limit", "unit"],
                     [[m["name"], f"{m['value']:.3g}", f"{m['limit']:.3g}", m["unit"]] for m in result.measures])
        for problem in result.problems:
            print(f"problem: {problem}")
        sums = f"{result.files_hashed} checksums" if result.files_hashed else "no checksums"
        count = len(result.problems)
        print(f"{dataset}: {result.files_read} images read, {sums}, {count or 'no'} problem{'' if count == 1 else 's'}")
    if result.problems:
        raise typer.Exit(2)


@verb
def report(dataset: Folder, out: Annotated[Path | None, typer.Option(
        "-o", "--out", help="HTML file; report.html in the dataset by default.")] = None,
        json_: Json = False, quiet: Quiet = False):
    """Write one self-contained HTML page: frames, sensors, trajectory, plan, timings."""
    from varos_warp.dataset.reader.dataset import Dataset
    from varos_warp.dataset.report import write_report

    page = write_report(Dataset(dataset), out or dataset / "report.html", quiet)
    if json_:
        print_json({"report": str(page)})
    elif not quiet:
        print(page)


@verb
def view(dataset: Folder, save: Annotated[Path | None, typer.Option(
        metavar="FILE.rrd", help="Write the recording to a file instead of opening the viewer.")] = None,
        frames: Frames = None, quiet: Quiet = False):
    """Open the dataset in the viewer Rerun: images, depth cloud, frustum, course, sensors on one time line."""
    from varos_warp.dataset.view import view as show

    recording = show(dataset, save, parse_frames(frames), quiet)
    if recording and not quiet:
        print(f"{recording}: open it with `rerun {recording}`")


@verb
def export(dataset: Folder,
           to: Annotated[str, typer.Option("--to", metavar="euroc|tum|kitti|colmap|nerfstudio|mcap",
                                           help="Format.")],
           out: Annotated[Path, typer.Option("-o", "--out", help="Folder to make; it must not be there yet.")],
           images: Annotated[str, typer.Option(metavar="A|B", help="Which images are the colour images.")] = "A",
           camera: Annotated[list[str] | None, typer.Option(help="Only this camera; repeatable.")] = None,
           raw: Annotated[bool, typer.Option("--raw", help="mcap: uncompressed images as well.")] = False,
           start_ns: Annotated[int, typer.Option(help="Time of the beginning, added to all stamps: ROS takes 0 for "
                                                      "none.")] = 0,
           json_: Json = False, quiet: Quiet = False):
    """Write the dataset in the format of other programs; images are linked, not copied, where that is possible.

    Where readings have noise, they are exported with it.
    """
    from varos_warp.dataset.export import export as write
    from varos_warp.dataset.export.job import NO_NOISE

    job = write(dataset, to, out, images, camera, quiet, raw, start_ns)
    if json_:
        print_json({"out": str(out), "to": to, "frames": len(job.data), "cameras": job.cameras, "noise": job.noises})
        return
    noises = "".join(f"; {', '.join(names)} {words}" for words, names in job.by_noise().items() if words != NO_NOISE)
    print(f"{out}: {len(job.data)} frames of {', '.join(job.cameras)} as {to}{noises}")


@verb
def noise(dataset: Folder,
          profile: Annotated[list[str], typer.Option("--profile", metavar="NAME|FILE",
                                                     help="What errs and how; repeatable for several sensors.")],
          out: Annotated[Path, typer.Option("-o", "--out", help="Folder to make; it must not be there yet.")],
          seed: Annotated[int, typer.Option(help="Of the noise.")] = 0, json_: Json = False, quiet: Quiet = False):
    """Add noise of IMU, depth gauge and cameras to a copy of a dataset, whose truth stays beside it."""
    from varos_warp.dataset.noise_pass import add_noise
    from varos_warp.scene.noise_profile import load_profile, merge_profiles

    chosen = [load_profile(name) for name in profile]
    made = add_noise(dataset, chosen[0] if len(chosen) == 1 else merge_profiles(chosen), out, seed, quiet)
    if json_:
        print_json({"out": str(out), "frames": len(made), **made.meta["noise"]})
        return
    print(f"{out}: {len(made)} frames with noise of {made.meta['noise']['profile']['name']}, seed {seed}")


# ------------------------------------------------------------------------------------------------------------- scenes


@verb
def info(scene: SceneFile, set_: Set = None, json_: Json = False, quiet: Quiet = False):
    """Show what is in a scene, and warn of what looks wrong."""
    from varos_warp.dataset.run.produce import simulated
    from varos_warp.scene.checks import check_scene, scene_info
    from varos_warp.scene.geometry.build import build_parts
    from varos_warp.scene.load import load_scene
    from varos_warp.sim.trajectory import path_samples

    loaded = load_scene(scene, set_ or ())
    parts = build_parts(loaded)
    facts, found = scene_info(loaded, parts), check_scene(loaded, parts, path_samples(simulated(loaded, quiet)))
    if json_:
        print_json({**facts, "warnings": found})
        return
    print_info(facts)
    for warning in found:
        print(f"warning: {warning}")


@verb
def schema():
    """Print the JSON Schema of scene files."""
    from varos_warp.scene.load import json_schema

    print_json(json_schema())


@verb
def init(file: Annotated[Path, typer.Argument(metavar="FILE")] = Path("scene.yaml")):
    """Write a commented scene file to begin with."""
    from varos_warp.dataset import files
    from varos_warp.scene.load import starter_scene

    if file.exists():
        raise InputError("is there already", file=file, remedy="Name another file; nothing is overwritten.")
    files.write_bytes(file, starter_scene().encode())
    print(f"{file} is written; next: varos-warp info {file}, then varos-warp run {file} -o OUT")


@verb
def preprocess(
        meshes: Annotated[list[Path], typer.Argument(metavar="MESH...", help="Files, which are joined.")],
        out: Annotated[Path, typer.Option("-o", "--out", help="PLY file; the report goes to a JSON file beside it.")],
        vertices: Annotated[int | None, typer.Option(min=4, help="Decimate to this many.")] = None,
        merge_tolerance: Annotated[float, typer.Option(min=0.0, help="Merge vertices nearer than so many m.")] = 0.001,
        fill_holes: Annotated[float | None, typer.Option(
            min=0.0, help="Fill holes up to so many metres wide, by default ten median edges.")] = None,
        shrinkwrap: Annotated[str, typer.Option(
            metavar="N|auto|none", help="Vertices along the longer side of the new surface that is wrapped around the "
            "model; auto: twice as fine as the model, within 16.6 million vertices.")] = "auto",
        close: Annotated[str, typer.Option(metavar="skirt|solid|none", help="Close the outline of a wrapped sheet by "
                                           "a skirt, or by skirt and bottom.")] = "skirt",
        region: Annotated[str | None, typer.Option(metavar="XMIN,YMIN,XMAX,YMAX", help="Keep this part only.")] = None,
        scale: Annotated[float, typer.Option(help="Multiply coordinates; 0.001 if they are millimetres.")] = 1.0,
        up_axis: Annotated[str | None, typer.Option(metavar="x|y|z", help="Which axis of the files points up.")] = None,
        device: Device = "auto", json_: Json = False, quiet: Quiet = False):
    """Join, merge, repair, shrinkwrap and decimate meshes, and print the error that it made.

    16.6 million vertices, wrapped and decimated to 250 000, need 10 CPU-minutes and 9.3 GB of memory; it grows in
    proportion to the vertices of the model or of its wrap, whichever are more.
    """
    from varos_warp.dataset.files import write_json
    from varos_warp.dataset.progress import NamedSteps
    from varos_warp.scene.device import resolve_device
    from varos_warp.scene.geometry.terrain import STEPS, preprocess_meshes, write_ply

    check_choice("--up-axis", up_axis, (None, "x", "y", "z"))
    check_choice("--close", close, ("skirt", "solid", "none"))
    with NamedSteps("preprocess", STEPS, quiet) as steps:
        (points, faces), facts = preprocess_meshes(
            meshes, vertices, merge_tolerance_m=merge_tolerance, fill_holes_m=fill_holes, close=close, scale=scale,
            shrinkwrap_resolution=parse_shrinkwrap(shrinkwrap), region=parse_region(region), up_axis=up_axis,
            device=resolve_device(device), progress=steps.reach)
    write_ply(out, points, faces)
    write_json(out.with_suffix(".json"), {"out": out.name, **facts})
    if json_:
        print_json({"out": str(out), **facts})
    elif not quiet:
        print_preprocessed(out, facts)
    for warning in facts["warnings"]:
        print(f"warning: {warning}", file=sys.stderr)


@verb
def bench(names: Annotated[list[str] | None, typer.Argument(
              metavar="[SCENE-NAMES...]", help="ref1, open_water, jerlov_1b, ... (where none is named: all).")] = None,
          methods: Annotated[str | None, typer.Option(
              metavar="NAME,...", help="Methods of A: direct, single, path, field, field+oidn ...")] = None,
          outputs: Annotated[str, typer.Option(metavar="A,D,sensors", help="Charts to make.")] = "A,D,sensors",
          device: Device = "auto",
          quick: Annotated[bool, typer.Option("--quick", help="Two scenes, few methods: two minutes.")] = False,
          out: Annotated[Path, typer.Option("-o", "--out", help="Folder for tables and charts.")] = Path("bench"),
          seconds: Annotated[float | None, typer.Option(help="Budget of each scene and chart.")] = None,
          json_: Json = False, quiet: Quiet = False):
    """Chart the error of every method against its time (in a checkout of the source)."""
    root = Path(varos_warp.__file__).parents[1]
    if (root / "benchmarks" / "bench.py").exists():
        sys.path.insert(0, str(root))  # a script does not look there
    try:
        from benchmarks import bench as benchmark
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "benchmarks":
            raise
        raise InputError("the benchmarks are not installed with the package", key="bench",
                         remedy="Run `python -m varos_warp bench` in the root of a checkout of the source.") from error

    result = benchmark.run(names or (), split_names(methods), split_names(outputs), device, quick, seconds, out, quiet)
    if json_:
        print_json(result)
    else:
        print(f"{out}: {', '.join(sorted(path.name for path in out.glob('*.*')))}")


# ---------------------------------------------------------------------------------------------------------------- main


def _version(value: bool) -> None:
    if value:
        print(f"varos-warp {varos_warp.__version__}")
        raise typer.Exit


@app.callback()
def _global(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True,
                                                  help="Print the version.")] = False):
    warnings.showwarning = lambda message, *_: print(f"note: {message}", file=sys.stderr)


def _interrupt(_signal, _frame):
    raise KeyboardInterrupt


def main() -> None:
    """Entry point of ``varos-warp``; SIGTERM (a cluster's end of time) counts as an interruption."""
    signal.signal(signal.SIGTERM, _interrupt)
    app(prog_name="varos-warp")
