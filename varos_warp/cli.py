"""The command line: arguments become calls, nothing else.

Exit status: 0 done; 2 bad input or an invalid dataset; 1 a failure of our own; 130 interrupted.
"""

import functools
import json
import signal
import sys
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

import varos_warp
from varos_warp.errors import InputError

app = typer.Typer(add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False,
                  help="Realistic synthetic underwater video with exact ground truth.")

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (YAML).")]
Folder = Annotated[Path, typer.Argument(metavar="DATASET", help="Folder that `varos-warp run` wrote to.")]
Out = Annotated[Path, typer.Option("-o", "--out", help="Folder of the dataset; completes what is there.")]
Device = Annotated[str, typer.Option(help="auto, cpu or cuda:N.")]
Frames = Annotated[str | None, typer.Option(metavar="A:B", help="Frames A to B - 1 of the sequence only.")]
Outputs = Annotated[str | None, typer.Option(metavar="A,B,C,D", help="Image types to make.")]
Tolerance = Annotated[float | None, typer.Option(help="Relative error asked of A; the planner chooses the samples.")]
Spp = Annotated[int | None, typer.Option(help="Samples per pixel of A, instead of a tolerance.")]
MaxScatterings = Annotated[int | None, typer.Option(help="Most scatterings in the water on a path of light.")]
MaxBounces = Annotated[int | None, typer.Option(help="Most reflections on surfaces on a path of light.")]
Layers = Annotated[str | None, typer.Option(metavar="direct,single,multiple", help="Parts of A to render.")]
Integrator = Annotated[str | None, typer.Option(metavar="auto|tables|path|reference", help="How A is computed.")]
Seed = Annotated[int | None, typer.Option(help="Of every random choice.")]
Denoise = Annotated[str | None, typer.Option(metavar="oidn|nlm|none", help="Denoiser of A.")]
LinearExr = Annotated[bool, typer.Option("--linear-exr", help="Also write A as rendered, with its standard error.")]
Set = Annotated[list[str] | None, typer.Option("--set", metavar="KEY.PATH=VALUE", help="Change the scene; repeatable.")]
Shard = Annotated[str | None, typer.Option(metavar="I/N", help="Render every N-th frame from the I-th, I from 0.")]
Workers = Annotated[int | None, typer.Option(metavar="N", help="Render in N processes of this host, one for each GPU.")]
Scheduler = Annotated[str | None, typer.Option(metavar="dask://HOST:PORT",
                                               help="Render on the workers of a Dask scheduler.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no notes.")]


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
                shard: Shard = None, workers: Workers = None, scheduler: Scheduler = None, json_: Json = False,
                quiet: Quiet = False):
        changed = overrides(set_, outputs, tolerance, spp, max_scatterings, max_bounces, layers, integrator, seed,
                            denoise, linear_exr)
        make(scene, out, changed, json_, quiet, device=device, frames=parse_frames(frames), shard=parse_shard(shard),
             workers=workers, scheduler=scheduler, **kind)

    command.__name__, command.__doc__ = name, text
    return resumable(command)


run = _job("run", "Simulate, render and write the dataset; goes on where an earlier run stopped.")
render = _job("render", "Render the frames only, without IMU, depth gauge and vehicle poses.", sensors=False)


@resumable
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
    from varos_warp.dataset.layout import Dataset
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
    from varos_warp.dataset.produce import produce
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
    from varos_warp.dataset.produce import select, simulated
    from varos_warp.render.detail import choose_detail
    from varos_warp.render.frame import FrameRenderer
    from varos_warp.render.plan import plan_render
    from varos_warp.scene.device import resolve_device
    from varos_warp.scene.load import load_scene
    from varos_warp.scene.meshes import build_parts

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
    _print_plan(result, planned)
    if "meshes" in result:
        _print_meshes(result["meshes"])


def _print_plan(result: dict, plan) -> None:
    """What was decided, why, the error that it makes and what it saves; then what makes each output, and the time."""
    rows = [[d.what, d.choice, *_percent(d.error), "" if d.cost is None else f"x {d.cost:.2f}", d.reason]
            for d in plan.decisions]
    if plan.error is not None:
        rows.append(["in all", "", *_percent(plan.error), "",
                     "noise squared plus the sum of the others squared, its root"])
    _print_table(["decision", "choice", "red [%]", "green [%]", "blue [%]", "time", "reason"], rows)
    print("errors: predicted relative RMSE of an image; time: against an image with everything")
    print("models:", *(f"  {name}: {part}" for name, part in result.get("models", {}).items()), sep="\n")
    cost = result.get("cost")
    if cost:
        parts = ", ".join(f"{name} {seconds:g} s" for name, seconds in cost["seconds_by_output"].items())
        print(f"cost on {cost['device']}: {cost['seconds_per_frame']:g} s a frame ({parts}), "
              f"{cost['seconds_in_all']:g} s for {cost['frames']} frames")


def _percent(error) -> list[str]:
    return ["", "", ""] if error is None else [f"{100 * e:.2f}" for e in error]


def _print_meshes(meshes: dict) -> None:
    """The plan's section ``meshes``: what is kept of each, by distance, and what that costs in C and D."""
    detail, memory = meshes["level_of_detail"], meshes["memory_mb"]
    if detail is None:
        moved = f", and D moves by {meshes['depth_error']['rms_mm']:.2g} mm (rms)" if "depth_error" in meshes else ""
        print(f"meshes: all {meshes['triangles']} triangles are kept; with render.level_of_detail={{}} it would be "
              f"{meshes['kept']}{moved} (--json tells of each mesh)")
        return
    print(f"meshes: level_of_detail {detail}")
    _print_table(["mesh", "triangles", "kept", "nearest [m]", "allowed from [mm]", "error [mm]", "why"],
                 [row for part in meshes["parts"] for row in _mesh_rows(part)])
    print(f"  in all {meshes['kept']} of {meshes['triangles']} triangles, {memory['kept']:g} of {memory['given']:g} MB")
    if "depth_error" not in meshes:
        return
    columns = {"pixels": "pixels", "rms_mm": "rms [mm]", "rms_steps": "rms [steps]", "p95_steps": "95 % [steps]",
               "max_steps": "largest [steps]"}
    _print_table(["error of D at [m]", *columns.values()],
                 [["{:g} to {:g}".format(*row["nearest_m"]), *(f"{row[key]:.4g}" for key in columns)]
                  for row in meshes["depth_error"]["by_distance"]])
    turned, seconds = meshes.get("normal_error_deg"), meshes["seconds_per_million_rays"]
    if turned:
        print(f"  normals turn by {turned['rms']:.2g} degrees (rms), 95 % of them by less than {turned['p95']:.2g}")
    print(f"  a million first hits take {seconds['kept']:.3g} s instead of {seconds['given']:.3g} s")


def _mesh_rows(part: dict) -> list[list[str]]:
    """A row for the mesh, and one for each range of distances."""
    from varos_warp.scene.lod import NEVER_SEEN

    rows = [[part["name"], str(part["triangles"]), str(part["kept"]), f"{part['nearest_m']:.3g}", "",
             f"{part['error_mm']:.3g}", part["reason"]]]
    for region in part["regions"]:
        low, high = region["nearest_m"]
        rows.append(["", str(region["triangles"]), str(region["kept"]), f"{low:g} to {high:g}",
                     f"{region['allowed_mm']:.3g}", f"{region['error_mm']:.3g}",
                     "" if region["in_view"] else NEVER_SEEN])
    return rows


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
        _print_table(["measure", "value", "limit", "unit"],
                     [[m["name"], f"{m['value']:.3g}", f"{m['limit']:.3g}", m["unit"]] for m in result.measures])
        for problem in result.problems:
            print(f"problem: {problem}")
        sums = f"{result.files_hashed} checksums" if result.files_hashed else "no checksums"
        print(f"{dataset}: {result.files_read} images read, {sums}, {len(result.problems) or 'no'} problems")
    if result.problems:
        raise typer.Exit(2)


@verb
def report(dataset: Folder, out: Annotated[Path | None, typer.Option(
        "-o", "--out", help="HTML file; report.html in the dataset by default.")] = None,
        json_: Json = False, quiet: Quiet = False):
    """Write one self-contained HTML page: frames, sensors, trajectory, plan, timings."""
    from varos_warp.dataset.layout import Dataset
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
           to: Annotated[str, typer.Option("--to", metavar="euroc|tum|kitti|colmap|nerfstudio|mcap|stream",
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
    from varos_warp.dataset.exports import export as write
    from varos_warp.dataset.exports.job import NO_NOISE

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
    from varos_warp.dataset.noise import add_noise
    from varos_warp.scene.noise import load_profile, merge_profiles

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
    from varos_warp.dataset.produce import simulated
    from varos_warp.scene.checks import check_scene, scene_info
    from varos_warp.scene.load import load_scene
    from varos_warp.scene.meshes import build_parts
    from varos_warp.sim.trajectory import path_samples

    loaded = load_scene(scene, set_ or ())
    parts = build_parts(loaded)
    facts, found = scene_info(loaded, parts), check_scene(loaded, parts, path_samples(simulated(loaded, quiet)))
    if json_:
        print_json({**facts, "warnings": found})
        return
    _print_info(facts)
    for warning in found:
        print(f"warning: {warning}")


def _print_info(facts: dict) -> None:
    """The facts of `scene_info` as tables."""
    water, trajectory = facts["water"], facts["trajectory"]
    print(f"{facts['name']}: {trajectory['count']} {trajectory['kind']}, vehicle of {facts['vehicle']['mass_kg']:g} kg")
    rows = {"absorption a [1/m]": "a", "scattering b [1/m]": "b", "extinction c [1/m]": "c", "albedo b / c": "albedo",
            "mean free path [m]": "mean_free_path_m", "10 % of the light left at [m]": "range_10_percent_m"}
    _print_table([f"water (g = {water['g']:g})", "red", "green", "blue"],
                 [[name, *(_number(x) for x in water[key])] for name, key in rows.items()])
    _print_table(["camera", "resolution", "fx, fy [px]", "cx, cy (COLMAP)", "cx, cy (OpenCV)", "field of view [deg]"],
                 [[c["id"], " x ".join(map(str, c["resolution"])), f"{c['fx']:.3f}, {c['fy']:.3f}",
                   f"{c['cx_colmap']:g}, {c['cy_colmap']:g}", f"{c['cx_opencv']:g}, {c['cy_opencv']:g}",
                   f"{c['horizontal_fov_deg']:.1f} x {c['vertical_fov_deg']:.1f}"] for c in facts["cameras"]])
    _print_table(["light", "kind", "position [m]", "cone [deg]", "intensity [W/sr]"],
                 [[str(i), light["kind"], str(light["position"]), _number(light.get("cone_deg")),
                   str(light["intensity"])] for i, light in enumerate(facts["lights"])])
    _print_table(["mesh", "vertices", "triangles", "size [m]"],
                 [[m["name"], str(m["vertices"]), str(m["triangles"]),
                   " x ".join(f"{high - low:.3g}" for low, high in zip(*m["bounds_m"], strict=True))]
                  for m in facts["meshes"]])


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
    from varos_warp.dataset.progress import Steps
    from varos_warp.scene.device import resolve_device
    from varos_warp.scene.terrain import STEPS, preprocess_meshes, write_ply

    _check_choice("--up-axis", up_axis, (None, "x", "y", "z"))
    _check_choice("--close", close, ("skirt", "solid", "none"))
    with Steps("preprocess", STEPS, quiet) as steps:
        (points, faces), facts = preprocess_meshes(
            meshes, vertices, merge_tolerance_m=merge_tolerance, fill_holes_m=fill_holes, close=close, scale=scale,
            shrinkwrap_resolution=parse_shrinkwrap(shrinkwrap), region=parse_region(region), up_axis=up_axis,
            device=resolve_device(device), progress=steps.reach)
    write_ply(out, points, faces)
    write_json(out.with_suffix(".json"), {"out": out.name, **facts})
    if json_:
        print_json({"out": str(out), **facts})
    elif not quiet:
        _print_preprocessed(out, facts)
    for warning in facts["warnings"]:
        print(f"warning: {warning}", file=sys.stderr)


def _print_preprocessed(out: Path, facts: dict) -> None:
    """The report of `preprocess_meshes` as tables."""
    _print_table(["", "before", "after"], [[key.replace("_", " "), _short(facts["before"][key]), _short(value)]
                                           for key, value in facts["after"].items()])
    ways = (("from the original to the result", "distance_to_result_m"),
            ("from the result to the original", "distance_to_original_m"))
    _print_table(["distance [m], normals [deg]", "rms", "95 %", "largest", "normals: mean", "95 %", "largest"],
                 [[name, *(f"{facts[key][x]:.3g}" for x in ("rms", "p95", "max")),
                   *(f"{facts[key]['normal_deg'][x]:.3g}" for x in ("mean", "p95", "max"))] for name, key in ways])
    symmetric = facts["symmetric_m"]
    print(f"both ways: rms {symmetric['rms']:.3g} m, Hausdorff {symmetric['hausdorff']:.3g} m (sampled)")
    print(*(f"{key.replace('_', ' ')}: {value}" for key, value in facts["counts"].items() if value), sep=", ")
    print(*(f"{key} {value:.1f} s" for key, value in facts["seconds"].items()), sep=", ")
    print(f"{out} is written, and its report {out.with_suffix('.json')}")


@resumable
def bench(names: Annotated[list[str] | None, typer.Argument(
              metavar="[SCENE-NAMES...]", help="ref1, open_water, floor_clear, coastal, harbour, demo.")] = None,
          methods: Annotated[str | None, typer.Option(
              metavar="NAME,...", help="Methods of A: direct, single, path, tables, tables+oidn ...")] = None,
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

    result = benchmark.run(names or (), _split(methods), _split(outputs), device, quick, seconds, out, quiet)
    if json_:
        print_json(result)
    else:
        print(f"{out}: {', '.join(sorted(path.name for path in out.glob('*.*')))}")


# ---------------------------------------------------------------------------------------------------------- arguments


def overrides(set_=None, outputs=None, tolerance=None, spp=None, max_scatterings=None, max_bounces=None, layers=None,
              integrator=None, seed=None, denoise=None, linear_exr=False) -> list[str]:
    """The options that change a scene, as ``key.path=value``; they come after ``--set`` and so have the last word."""
    if tolerance is not None and spp is not None:
        raise InputError("cannot be given together", key="--tolerance and --spp", remedy="Give one of them.")
    changes = {"render.outputs": outputs and ",".join(outputs.replace(",", "")), "render.tolerance": tolerance,
               "render.spp": "null" if tolerance is not None else spp, "render.max_scatterings": max_scatterings,
               "render.max_bounces": max_bounces, "render.layers": layers, "render.integrator": integrator,
               "seed": seed, "render.denoise": denoise, "render.linear_exr": "true" if linear_exr else None}
    lists = ("render.outputs", "render.layers")
    return list(set_ or ()) + [f"{key}=[{value}]" if key in lists else f"{key}={value}"
                               for key, value in changes.items() if value is not None]


def _split(text: str | None) -> list[str]:
    """Names between commas."""
    return [name.strip() for name in (text or "").split(",") if name.strip()]


def parse_frames(text: str | None) -> slice:
    """``A:B``, ``A:``, ``:B`` or ``A`` as a slice of the frames."""
    try:
        ends = [int(end) if end.strip() else None for end in (text or ":").split(":")]
        if len(ends) == 1:
            ends.append(ends[0] + 1)
        first, last = ends
        if any(end is not None and end < 0 for end in ends):
            raise ValueError
    except (ValueError, TypeError):
        raise InputError("is not A:B", key="--frames", value=text, remedy="For example 0:10, 50: or 7.") from None
    return slice(first, last)


def parse_shard(text: str | None) -> tuple[int, int]:
    """``I/N`` with 0 <= I < N."""
    try:
        index, count = (int(part) for part in (text or "0/1").split("/"))
        if not 0 <= index < count:
            raise ValueError
    except ValueError:
        raise InputError("is not I/N with I from 0 to N - 1", key="--shard", value=text,
                         remedy="For example 0/4, 1/4, 2/4 and 3/4 on four machines.") from None
    return index, count


def parse_region(text: str | None) -> tuple[float, float, float, float] | None:
    """Four numbers with commas."""
    try:
        values = tuple(float(part) for part in text.split(",")) if text else None
        if values is not None and len(values) != 4:
            raise ValueError
    except ValueError:
        raise InputError("is not XMIN,YMIN,XMAX,YMAX", key="--region", value=text) from None
    return values


def parse_shrinkwrap(text: str) -> int | str | None:
    """A number of vertices, ``auto`` or ``none``."""
    if text in ("auto", "none"):
        return None if text == "none" else text
    if not (text.isdecimal() and int(text) >= 2):
        raise InputError("is not a number of vertices, at least 2", key="--shrinkwrap", value=text,
                         remedy="For example 1024, auto or none.")
    return int(text)


def _check_choice(key: str, value, known: tuple) -> None:
    if value not in known:
        raise InputError("is unknown", key=key, value=value, remedy=f"Use one of {', '.join(filter(None, known))}.")


# ----------------------------------------------------------------------------------------------------------- printing


def print_json(content) -> None:
    """Print plain types as JSON."""
    print(json.dumps(content, indent=2, ensure_ascii=False))


def _number(x) -> str:
    return "-" if x is None else f"{x:.4g}"


def _short(x) -> str:
    if isinstance(x, list):
        return " to ".join(str([round(v, 2) for v in row]) for row in x)
    return f"{x:.6g}" if isinstance(x, float) else str(x)


def _print_table(header: list[str], rows: list[list[str]]) -> None:
    if not rows:
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(*map(escape, header), header_style="bold", box=None, pad_edge=False)
    for row in rows:
        table.add_row(*map(escape, row))  # [m] is a unit, not a style
    console = Console()
    if not console.is_terminal:
        console.width = 200  # a log is not cut to 80 columns
    console.print(table)


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
