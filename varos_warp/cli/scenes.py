"""Verbs around scene files, the meshes that they name, and the cache of what was precomputed for them."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from varos_warp.cli.app import verb
from varos_warp.cli.facts import print_info
from varos_warp.cli.options import (
    Device,
    Json,
    PreviewOptions,
    Quiet,
    Repair,
    SceneFile,
    Set,
    Vehicle,
    check_meshes,
    observer,
    with_options,
)
from varos_warp.cli.tables import print_cache, print_json, print_preprocessed, print_table
from varos_warp.errors import InputError


def _complete_template(typed: str) -> list[str]:
    from varos_warp.scene.file.templates import TEMPLATES

    return [name for name in TEMPLATES if name.startswith(typed)]


@verb
def init(
    file: Annotated[Path, typer.Argument(metavar="FILE")] = Path("scene.yaml"),
    template: Annotated[
        str,
        typer.Option(metavar="NAME", help="Scene to begin with; --list names them.", autocompletion=_complete_template),
    ] = "starter",
    list_: Annotated[bool, typer.Option("--list", help="List the templates, and write nothing.")] = False,
):
    """Write a commented scene file to begin with, and beside it the JSON Schema by which editors complete its keys."""
    from varos_warp.dataset import files
    from varos_warp.scene.file.schema import json_schema
    from varos_warp.scene.file.templates import SCHEMA_FILE, TEMPLATES, template_text

    if list_:
        print_table(["template", "scene"], [[name, words] for name, words in TEMPLATES.items()])
        return
    text = template_text(template)
    if file.exists():
        raise InputError("is there already", file=file, remedy="Name another file; nothing is overwritten.")
    files.write_bytes(file, text.encode())
    files.write_json(file.with_name(SCHEMA_FILE), json_schema())
    print(
        f"{file} is written, and for editors {file.with_name(SCHEMA_FILE)}; "
        f"next: varos-warp info {file}, then varos-warp run {file} -o OUT"
    )


@verb
def info(
    scene: SceneFile,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Also draw the water's spectra into a PNG, SVG or PDF file."),
    ] = None,
    set_: Set = None,
    json_: Json = False,
    quiet: Quiet = False,
):
    """Tell what a run of a scene would make and how long it takes, and warn of what looks wrong."""
    from varos_warp.scene.file.load import load_scene
    from varos_warp.scene.file.named_files import require_files
    from varos_warp.scene.file.source import located
    from varos_warp.scene.spectra.plot import draw_water

    loaded = load_scene(scene, set_ or ())
    seen = [loaded.observed_by(vehicle.id) for vehicle in loaded.vehicles or ()] or [loaded]
    with located(loaded):
        require_files(loaded)
        if plot is not None:
            draw_water(loaded, plot)
    facts = [_facts(alone, quiet) for alone in seen]
    if json_:
        print_json(dict(zip([alone.vehicle.id for alone in seen], facts, strict=True)) if loaded.vehicles else facts[0])
        return
    for alone, each in zip(seen, facts, strict=True):
        if loaded.vehicles:
            print(f"--- vehicle {alone.vehicle.id}")
        print_info(each)
        for warning in each["warnings"]:
            print(f"warning: {warning}")


def _facts(scene, quiet: bool) -> dict:
    """What `info` tells of a scene as its vehicle sees it."""
    from varos_warp.dataset.run.expect import dataset_facts, exposure_facts
    from varos_warp.dataset.run.steps import simulated
    from varos_warp.scene.checks import check_scene
    from varos_warp.scene.file.source import located
    from varos_warp.scene.geometry.build import build_parts
    from varos_warp.scene.info import scene_info
    from varos_warp.sim.trajectory import course_facts, path_samples

    with located(scene):
        parts = build_parts(scene)
        simulation = simulated(scene, quiet, parts)
        facts, found = scene_info(scene, parts), check_scene(scene, parts, path_samples(simulation))
    facts["trajectory"] |= course_facts(simulation, scene)
    return {
        **facts,
        "dataset": dataset_facts(scene, len(simulation.frames)),
        "exposures": exposure_facts(scene, parts, simulation),
        "warnings": found + simulation.messages,
    }


@verb
def preview(
    scene: SceneFile,
    options: PreviewOptions,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FOLDER", help="Keep preview.png there up to date, without the viewer."),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="End after the last refinement.")] = False,
    device: Device = "auto",
    vehicle: Vehicle = None,
    set_: Set = None,
    quiet: Quiet = False,
):
    """Show a small image A of a scene, and again whenever the scene file is saved; Ctrl-C ends it."""
    from varos_warp.dataset.preview import Viewpoint
    from varos_warp.dataset.preview import preview as show
    from varos_warp.dataset.screens import FolderScreen, RerunScreen

    viewpoint = Viewpoint(**options.parsed())
    screen = RerunScreen() if out is None else FolderScreen(out)
    show(
        scene,
        screen,
        viewpoint,
        spp=options.spp,
        device=device,
        overrides=[*(set_ or ()), *observer(vehicle)],
        once=once,
        quiet=quiet,
    )


def _complete_key(typed: str) -> list[str]:
    from varos_warp.scene.file.schema import keys_like

    return keys_like(typed)


@verb
def schema(
    key: Annotated[
        str | None,
        typer.Argument(
            metavar="KEY", help="Explain this key instead, such as vehicle.cameras.port.", autocompletion=_complete_key
        ),
    ] = None,
    json_: Json = False,
):
    """Print the JSON Schema of scene files, or explain one key in plain words: meaning, unit, range, default, example.

    Items of lists need no number, and materials no name. A part may name a kind of block: objects.pipe.radius.
    """
    from varos_warp.scene.file.schema import explain, find_key, json_schema

    if key is None:
        print_json(json_schema())
    elif json_:
        print_json([asdict(entry) for entry in find_key(key)])
    else:
        print(explain(key))


@verb
def preprocess(
    meshes: Annotated[list[Path], typer.Argument(metavar="MESH...", help="Mesh or survey files, which are joined.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="PLY file; the report goes to a JSON file beside it.")],
    repair: Repair,
    device: Device = "auto",
    json_: Json = False,
    quiet: Quiet = False,
):
    """Join, merge, repair, shrinkwrap and decimate meshes and surveys, and tell how far the result is from them.

    16.6 million vertices, wrapped and decimated to 250 000, take 10 CPU-minutes and 9.3 GB of memory. Memory grows in
    proportion to the vertices of the model or of its wrap, whichever has more.
    """
    from varos_warp.dataset.files import write_json
    from varos_warp.dataset.progress import NamedSteps
    from varos_warp.device.devices import resolve_device
    from varos_warp.scene.geometry.terrain import STEPS, preprocess_meshes, write_ply

    options, device = repair.parsed(), resolve_device(device)
    check_meshes(meshes, out)
    try:
        with NamedSteps("preprocess", STEPS, quiet) as steps:
            (points, faces), facts = preprocess_meshes(meshes, **options, device=device, progress=steps.reach)
    except InputError as error:
        raise with_options(error) from None
    write_ply(out, points, faces)
    write_json(out.with_suffix(".json"), {"out": out.name, **facts})
    if json_:
        print_json({"out": str(out), **facts})
    elif not quiet:
        print_preprocessed(out, facts)
    for warning in facts["warnings"]:
        print(f"warning: {warning}", file=sys.stderr)


@verb
def cache(clear: Annotated[bool, typer.Option("--clear", help="Delete every entry.")] = False, json_: Json = False):
    """List what was precomputed and is kept for later runs, or delete it: it is then made again when needed."""
    from varos_warp import cache as kept

    if clear:
        kept.clear()
    contents = kept.contents()
    if json_:
        print_json(
            {
                "folder": str(contents.folder),
                "limit_bytes": contents.limit,
                "bytes": contents.bytes,
                "entries": [{"name": name, "bytes": size} for name, size in contents.entries],
            }
        )
    else:
        print_cache(contents)
