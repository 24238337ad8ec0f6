"""Bias, noise and error bars of integrators in dissimilar scenes (benchmarks/light/scenes.py).

    python -m benchmarks.light.measure [--scenes coastal,canyon] [--integrators auto,path] [--spp 8,32] [--seeds 20]
        [--device cpu] [--references DIR] [--reference-integrator path] [--json out.json] [--png DIR]
    python -m benchmarks.light.measure --make-references --spp 2048 --seeds 8 [--seconds 60]

A row of the table is one integrator in one scene:
    CPU s, s    time of an image with denoising, median over seeds
    noise       RMS standard deviation of a raw pixel over seeds, R G B, in % of the image's mean
    RMSE        error of denoised images against the reference, worst channel
    worst, 99%  error of blocks of 8 x 8 pixels of a denoised image; halved: share of images with a block off by half
    var z       variance of z = (pixel - mean) / stderr, and of its central 98 %: 1 if stderr holds; >4: share beyond 4
    spread      standard deviation of the images' means over the claimed one, worst channel
    bias z      largest difference of a block from the reference, in standard errors (raw images): beyond 5 is a bias,
                or tails too heavy for so few images
    mean        error of the mean and its standard error, in the most significant channel
    ref         RMS standard error of the reference's blocks: block errors below twice that are the reference's own
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.light import references, scores
from benchmarks.light.pictures import side_by_side
from benchmarks.light.scenes import RESOLUTION, SCENES, Built, build
from benchmarks.light.scores import Estimate
from benchmarks.machine import Stopwatch, machine
from varos_warp.device.devices import resolve_device
from varos_warp.errors import InputError
from varos_warp.render.renderer import FrameRenderer

HIDDEN = 0.3
"""Share of the reference's own noise below which an error of pixels is not told."""
FOLDER = Path(__file__).with_name("references")
HEAD = (
    f"{'scene':<16}{'integrator':<11}{'spp':>4}{'CPU s':>7}{'s':>7}  {'noise R/G/B %':<17}{'RMSE':>6}{'worst':>8}"
    f"{'99%':>7}{'halved':>7}  {'var z (98%)':<18}{'>4':>6}{'spread':>7}{'bias z':>8}  {'mean off %':<16}"
    f"{'ref':>5}"
)


def render_seeds(
    renderer,
    built: Built,
    integrator: str,
    spp: int,
    seeds: int,
    denoise: str,
    first: int = 1,
    copied: Sequence[str] | None = None,
) -> dict:
    """Raw and denoised images and standard errors [n, H, W, 3] of seeds from ``first`` on, and the times [n].

    With ``copied``, as `RenderOptions` has it, the others are None.
    """
    how = {"outputs": "A", "integrator": integrator, "spp": spp, "denoise": denoise, "copied": copied}
    renderer.render(built.T_w_v, seed=0, **how)  # compiles, makes tables, learns how to denoise
    made = {"raw": [], "stderr": [], "denoised": [], "cpu": [], "wall": []}
    for seed in range(first, first + seeds):
        watch = Stopwatch()
        image = renderer.render(built.T_w_v, seed=seed, **how).A
        for name, value in (
            ("cpu", watch.cpu_seconds),
            ("wall", watch.seconds),
            ("raw", image.radiance),
            ("stderr", image.stderr),
            ("denoised", image.denoised),
        ):
            made[name].append(image.radiance if value is None else value)
    return {name: np.array(values) for name, values in made.items()}


def row_of(made: dict, reference: Estimate) -> dict:
    """All numbers of one row; ``blocks``: means and standard errors [h, w, 3] of raw images and of the reference."""
    estimate = Estimate(made["raw"])
    names = ("mean", "stderr", "reference", "reference_stderr")
    blocks = {
        name: [[[float(f"{c:.5g}") for c in block] for block in row] for row in values]
        for name, values in zip(names, (*estimate.blocks, *reference.blocks), strict=True)
    }
    return {
        "cpu_s": float(np.median(made["cpu"])),
        "wall_s": float(np.median(made["wall"])),
        "noise": scores.noise(made["raw"], reference).tolist(),
        "rmse": scores.relative_rmse(made["denoised"], reference).tolist(),
        **scores.block_row(made["denoised"], reference),
        **scores.calibration(made["raw"], made["stderr"]),
        "spread_over_claimed": scores.spread_over_claimed(made["raw"], made["stderr"]).tolist(),
        **scores.bias(estimate, reference),
        "blocks": blocks,
    }


def line(row: dict) -> str:
    """A row of the table."""
    start = f"{row['scene']:<16}{row['integrator']:<11}{row['spp']:>4}"
    if "refused" in row:
        return f"{start}   {row['refused']}"
    noise = " ".join(f"{100 * value:.{1 if value < 0.1 else 0}f}" for value in row["noise"])
    z = f"{row['z_variance']:.2g} ({row['z_trimmed']:.2g})"
    hidden = max(row["rmse"]) < HIDDEN * row["reference_pixel_rms"]
    rmse = f"<{100 * HIDDEN * row['reference_pixel_rms']:.0f}%" if hidden else f"{100 * max(row['rmse']):.1f}%"
    off, error = np.array(row["mean_off_percent"]), np.array(row["mean_off_stderr"])
    tells = int(np.argmax(np.abs(off / error)))
    mean = f"{off[tells]:+.2f} +- {error[tells]:.2f}"
    return (
        f"{start}{row['cpu_s']:7.2f}{row['wall_s']:7.2f}  {noise:<17}{rmse:>6}"
        f"{100 * row['block_worst']:7.0f}%{100 * row['block_99']:6.1f}%{100 * row['half_off']:6.0f}%  {z:<18}"
        f"{100 * row['beyond_4']:5.1f}%{max(row['spread_over_claimed']):7.2f}{row['block_z']:8.1f}  {mean:<16}"
        f"{100 * row['reference_block_rms']:4.1f}%"
    )


def measure_scene(name: str, options, tell) -> list[dict]:
    """Rows of one scene; where no reference is kept it is what its integrator has rendered here."""
    built = build(name, options.resolution)
    path = references.file_of(options.references, name, options.resolution, options.reference_integrator)
    reference = references.load(path, built, tell)
    renderer = FrameRenderer(built.scene, options.device, built.parts)
    made, rows = {}, []
    for integrator in options.integrators:
        for spp in options.spp:
            try:
                made[integrator, spp] = render_seeds(renderer, built, integrator, spp, options.seeds, options.denoise)
            except InputError as error:
                rows.append({"scene": name, "integrator": integrator, "spp": spp, "refused": str(error)})
                tell(line(rows[-1]))
    kept = reference is not None
    reference = reference or rendered_here(made, options.reference_integrator)
    for (integrator, spp), images in made.items():
        rows.append(
            {
                "scene": name,
                "integrator": integrator,
                "spp": spp,
                "seeds": options.seeds,
                "kept_reference": kept,
                "reference_spp": float(np.sum(reference.spp)),
                **row_of(images, reference),
            }
        )
        tell(line(rows[-1]))
        if options.png:
            side_by_side(options.png / f"{name}_{integrator}_{spp}.png", images["denoised"], reference)
    return rows


def rendered_here(made: dict, integrator: str) -> Estimate:
    """All raw images of an integrator, or of the first one that there are any of: then biases cannot be told."""
    chosen = [key for key in made if key[0] == integrator] or list(made)[:1]
    if not chosen:
        raise InputError("nothing could be rendered", key="--integrators", value=integrator)
    images = [made[key]["raw"] for key in chosen]
    return Estimate(np.concatenate(images), np.repeat([float(spp) for _, spp in chosen], [len(i) for i in images]))


def make_references(options, tell) -> None:
    """Render, or lengthen, the references of the scenes."""
    for name in options.scenes:
        built = build(name, options.resolution)
        path = references.file_of(options.references, name, options.resolution, options.reference_integrator)
        references.extend(
            path,
            name,
            built,
            options.device,
            options.reference_integrator,
            options.spp[0],
            options.seeds,
            options.seconds,
            tell,
        )


def parse(arguments=None):
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names, counts = (lambda text: text.split(",")), (lambda text: [int(n) for n in text.split(",")])
    parser.add_argument("--scenes", type=names, default=list(SCENES))
    parser.add_argument("--integrators", type=names, default=["auto", "path"])
    parser.add_argument("--spp", type=counts, default=[8])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--resolution", type=lambda text: tuple(int(n) for n in text.split("x")), default=RESOLUTION)
    parser.add_argument("--device", type=resolve_device, default="cpu")
    parser.add_argument("--denoise", default="oidn")
    parser.add_argument("--references", type=Path, default=FOLDER, help="Folder that they are kept in.")
    parser.add_argument("--reference-integrator", default="path")
    parser.add_argument("--make-references", action="store_true", help="Render --seeds images more of each scene.")
    parser.add_argument("--seconds", type=float, default=60.0, help="Most that this may take a scene.")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--png", type=Path, help="Folder for the first and the worst image, reference, error map.")
    options = parser.parse_args(arguments)
    if options.seeds < 2:
        parser.error("--seeds must be at least 2")
    return options


def main(arguments=None) -> None:
    """Print the table, and write what was asked for."""
    options, tell = parse(arguments), lambda text: print(text, flush=True)
    if options.make_references:
        return make_references(options, tell)
    tell(HEAD)
    rows = []
    for name in options.scenes:
        rows += measure_scene(name, options, tell)
        if options.json:
            write(options, rows)
    return None


def write(options, rows: list[dict]) -> None:
    """Everything as JSON, a row of the table on a line."""
    head = json.dumps(
        {
            "machine": machine(options.device),
            "denoise": options.denoise,
            "resolution": options.resolution,
            "reference_integrator": options.reference_integrator,
        }
    )
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(f'{head[:-1]}, "rows": [\n' + ",\n".join(json.dumps(row) for row in rows) + "\n]}\n")


if __name__ == "__main__":
    try:
        main()
    except InputError as problem:
        sys.exit(str(problem))
