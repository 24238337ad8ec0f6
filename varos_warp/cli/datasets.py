"""Verbs that read a dataset: check it, look at it, write it in other formats."""

from pathlib import Path
from typing import Annotated

import typer

from varos_warp.cli.app import verb
from varos_warp.cli.options import Folder, Frames, Json, NewFolder, Quiet, parse_frames
from varos_warp.cli.tables import print_json, print_table
from varos_warp.errors import InputError, counted


@verb
def validate(dataset: Folder, json_: Json = False, quiet: Quiet = False):
    """Read every file and check that they agree with each other; status 2 if some do not."""
    from varos_warp.dataset.layout import datasets_in
    from varos_warp.dataset.validate import validate as check

    results = [check(folder, quiet) for folder in datasets_in(dataset)]
    for result in results:
        result.keep()
        if not json_:
            _print_outcome(result)
    if json_:
        first, *others = ({"dataset": str(result.root), **result.plain()} for result in results)
        print_json(
            {"valid": not any(result.problems for result in results), "datasets": [first, *others]} if others else first
        )
    if any(result.problems for result in results):
        raise typer.Exit(2)


def _print_outcome(result) -> None:
    print_table(
        ["measure", "value", "limit", "unit"],
        [[m["name"], f"{m['value']:.3g}", f"{m['limit']:.3g}", m["unit"]] for m in result.measures],
    )
    for problem in result.problems:
        print(f"problem: {problem}")
    sums = f"{result.files_hashed} checksums" if result.files_hashed else "no checksums"
    problems = counted(len(result.problems), "problem") if result.problems else "no problems"
    print(f"{result.root}: {counted(result.files_read, 'image file')} read, {sums}, {problems}")


@verb
def report(
    dataset: Folder,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="HTML file; report.html in the dataset by default.")
    ] = None,
    json_: Json = False,
    quiet: Quiet = False,
):
    """Write one self-contained HTML page: frames, sensors, trajectory, plan, timings."""
    from varos_warp.dataset.reader.dataset import Dataset
    from varos_warp.dataset.report import write_report

    if out is not None:
        _check_page(out)
    page = write_report(Dataset(dataset), out or dataset / "report.html", quiet)
    if json_:
        print_json({"report": str(page)})
    elif not quiet:
        print(page)


def _check_page(out: Path) -> None:
    """Refuse what is no name of an HTML file, and one in a folder that is not there, before anything is read."""
    if out.is_dir() or out.suffix.lower() not in (".html", ".htm"):
        page = out / "report.html" if out.is_dir() or not out.suffix else out.with_suffix(".html")
        raise InputError(
            "is a folder" if out.is_dir() else "is no name of an HTML file",
            key="--out",
            value=str(out),
            remedy=f"Such as {page}.",
        )
    if not out.parent.is_dir():
        raise InputError(
            "there is no such folder", key="--out", value=str(out.parent), remedy="Make it, or name another one."
        )


@verb
def readiness(
    datasets: Annotated[
        list[Path],
        typer.Argument(metavar="DATASET...", help="Folders of datasets, or of sweeps, compared by optical depth."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            help="HTML file; of one dataset or one sweep readiness.html in it by default, of several none.",
        ),
    ] = None,
    camera: Annotated[str | None, typer.Option(metavar="ID", help="Which camera; the first by default.")] = None,
    seeds: Annotated[int, typer.Option(help="Runs of the odometry, whose spread is stated.")] = 3,
    json_: Json = False,
    quiet: Quiet = False,
):
    """Tell what a SLAM system will meet: features, contrast, IMU excitation, and a small visual odometry's error."""
    from varos_warp.dataset.readiness import page
    from varos_warp.dataset.readiness.job import readiness as measure_all
    from varos_warp.dataset.readiness.seeds import over_seeds

    if out is not None:
        _check_page(out)
    found = measure_all(datasets, camera, seeds, quiet)
    target = out or (datasets[0] / "readiness.html" if len(datasets) == 1 else None)
    written = page.write(found, target) if target else None
    if json_:
        print_json(
            {
                "report": written and str(written),
                "datasets": [each.plain() for each in found],
                "over_seeds": over_seeds(found),
            }
        )
    else:
        _print_readiness(found)
        if written:
            print(written)


def _print_readiness(found) -> None:
    from varos_warp.dataset.readiness import page

    if len(found) > 1:
        print_table(*page.comparison(found))
    for each in found:
        if len(found) == 1:
            print_table(list(page.MEASURES), page.measures(each))
            print_table(list(page.ODOMETRY), [page.odometry_row(kind, run) for kind, run in each.odometry.items()])
        for words in page.sentences(each):
            print(words if len(found) == 1 else f"{each.root}: {words}")


@verb
def view(
    dataset: Folder,
    save: Annotated[
        Path | None,
        typer.Option(metavar="FILE.rrd", help="Write the recording to a file instead of opening the viewer."),
    ] = None,
    frames: Frames = None,
    quiet: Quiet = False,
):
    """Open the dataset in the viewer Rerun: images, depth cloud, frustum, course, sensors on one time line."""
    from varos_warp.dataset.view import view as show

    recording = show(dataset, save, parse_frames(frames), quiet)
    if recording and not quiet:
        print(f"{recording}: open it with `rerun {recording}`")


@verb
def export(
    dataset: Folder,
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="FORMAT",
            help="euroc, tum, kitti, colmap, nerfstudio, "
            "mcap, stream, vslamlab, coco, yolo, bop or "
            "corners: see docs/exports.md.",
        ),
    ],
    out: NewFolder,
    images: Annotated[str, typer.Option(metavar="A|B", help="Which images are the colour images.")] = "A",
    camera: Annotated[list[str] | None, typer.Option(metavar="ID", help="Only this camera; repeatable.")] = None,
    raw: Annotated[bool, typer.Option("--raw", help="mcap: uncompressed images as well.")] = False,
    start_ns: Annotated[
        int,
        typer.Option(help="Time of the sequence's beginning, added to all stamps; ROS takes a stamp of 0 for none."),
    ] = 0,
    scene_dir: Annotated[
        Path,
        typer.Option(
            metavar="FOLDER",
            help="coco, yolo, bop, corners: where the scene file lies, to which its meshes are relative.",
        ),
    ] = Path("."),
    json_: Json = False,
    quiet: Quiet = False,
):
    """Write the dataset in the format of other programs; images are linked, not copied, where that is possible.

    Readings with noise are exported with it.
    """
    from varos_warp.dataset.export import export as write
    from varos_warp.dataset.export.shared.job import NO_NOISE

    chosen = [part.strip() for each in camera or () for part in each.split(",")]
    job = write(dataset, to, out, images, chosen, quiet, raw, start_ns, scene_dir)
    if json_:
        print_json({"out": str(out), "to": to, "frames": len(job.data), "cameras": job.cameras, "noise": job.noises})
        return
    kinds = [words for words in dict.fromkeys(job.noises.values()) if words != NO_NOISE]
    noises = "".join(
        f"; {', '.join(name for name, kind in job.noises.items() if kind == words)} {words}" for words in kinds
    )
    print(f"{out}: {counted(len(job.data), 'frame')} of {', '.join(job.cameras)} as {to}{noises}")


@verb
def noise(
    dataset: Folder,
    profile: Annotated[
        list[str],
        typer.Option(
            "--profile",
            metavar="NAME|FILE",
            help="What errs and how: a profile, or a file of an IMU's noise by "
            "Kalibr or imu_utils; repeatable for several sensors.",
        ),
    ],
    out: NewFolder,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
    json_: Json = False,
    quiet: Quiet = False,
):
    """Add noise of sensors and cameras to a copy of a dataset; the truth stays beside it."""
    from varos_warp.dataset.noise_pass import add_noise
    from varos_warp.dataset.reader.dataset import Dataset
    from varos_warp.scene.file.noise_profiles import load_profile, merge_profiles

    imu = Dataset(dataset).meta["sensors"].get("imu0")
    chosen = [load_profile(name, imu and imu["rate_hz"]) for name in profile]
    made = add_noise(dataset, chosen[0] if len(chosen) == 1 else merge_profiles(chosen), out, seed, quiet)
    if json_:
        print_json({"out": str(out), "frames": len(made), **made.meta["noise"]})
        return
    print(f"{out}: {counted(len(made), 'frame')} with noise of {made.meta['noise']['profile']['name']}, seed {seed}")
