"""Images of what moves against the mean of instants placed by hand (benchmarks/light/moving_scenes.py).

    python -m benchmarks.light.moving [--scenes open,coastal] [--kinds blur,strobe] [--integrators auto,path]
        [--spp 8] [--seeds 24] [--instants 4] [--truth path] [--truth-spp 32]
        [--device cuda:0] [--json out.json] [--png out.png]

Every image of the truth is a mean over ``--instants`` times to an exposure, which begin at random for each image.
A row of the table is one integrator in one scene:
    noise       RMS standard deviation of a raw pixel over seeds, worst channel, in % of the image's mean
    mean        error of the mean and its standard error, in the most significant channel; and as a normal number
    var z       variance of z = (pixel - mean) / stderr, and of its central 98 %: 1 if stderr holds
    raw         the block of 8 x 8 pixels of the mean of raw images that is farthest from the truth in standard errors,
                and the largest difference of a block in % (of itself, or of a tenth of the image)
    denoised    the same of the mean of denoised images, and the worst block of any one of them
    chi2        mean of the squares of the blocks' standard errors; its chance if blocks were independent, and in truth
    truth       RMS standard error of the truth's blocks, in % of the image's mean
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from benchmarks.light import moving_scenes, scores
from benchmarks.light.moving_scenes import NOW_S, Case
from benchmarks.light.pictures import row_of_images
from benchmarks.light.scenes import RESOLUTION
from benchmarks.light.scores import Estimate
from benchmarks.machine import Stopwatch, machine
from varos_warp.device.devices import resolve_device
from varos_warp.errors import InputError
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.optics.shutter import row_offsets_s

SEED = 1_000_003
"""Of the first image of the truth; unlike any that is measured."""
HEAD = (
    f"{'scene':<14}{'what':<10}{'by':<11}{'noise':>6}  {'mean off %':<15}{'z':>5}  {'var z (98%)':<13}"
    f"{'raw: z':>7}{'%':>7}  {'denoised: z':>11}{'%':>7}{'one %':>7}  {'chi2':>5}{'p':>9}{'p':>7}{'truth %':>8}"
)


def lit(case: Case) -> np.ndarray:
    """When each row sees light, [H, 2] from the frame's time [s]."""
    view, half = case.scene.vehicle.cameras[0], 0.5 * case.shutter.exposure_s
    rows = row_offsets_s(view)[:, None] + np.array([-half, half])
    if strobe := case.scene.lights[0].strobe:  # all have the same
        rows = np.clip(rows, strobe.delay_s - 0.5 * strobe.on_s, strobe.delay_s + 0.5 * strobe.on_s)
    return rows


class Truth:
    """Means of still images over the exposure of each row.

    The times of an image are equally far from each other and begin at random: every row has as many of them (with a
    strobe, one more or less), and their mean over images is that over the exposure, without an error of the step.
    """

    def __init__(self, case: Case, options):
        self.case, self.device, self.rows = case, options.device, lit(case)
        self.how = {"outputs": "A", "spp": options.truth_spp, "integrator": options.truth}
        self.seconds = self.rows[:, 1] - self.rows[:, 0]
        self.step = min(case.shutter.exposure_s / options.instants, 0.99 * float(self.seconds.min()))
        still = case.instant(0.0)
        bodies = case.thing is not None or len(still.parts) > len(case.still)
        self.renderer = None if bodies else FrameRenderer(still.scene, self.device, still.parts)

    def image(self, seed: int) -> np.ndarray:
        """One of them [H, W, 3]."""
        begin = self.rows[0, 0] + self.step * np.random.default_rng(seed).random()
        times = np.arange(begin, self.rows[-1, 1], self.step)
        sees = (self.rows[:, :1] <= times) & (times < self.rows[:, 1:])
        share = (self.seconds / self.case.shutter.exposure_s / sees.sum(axis=1))[:, None] * sees
        return sum(
            share[:, frame, None, None] * self._instant(offset_s, seed, frame)
            for frame, offset_s in enumerate(times)
            if sees[:, frame].any()
        )

    def _instant(self, offset_s: float, seed: int, frame: int) -> np.ndarray:
        still = self.case.instant(offset_s)
        if self.renderer is None:
            renderer = FrameRenderer(still.scene, self.device, still.parts)
        else:
            renderer = self.renderer.relit(still.scene) if self.case.others else self.renderer
        return renderer.render(still.T_w_v, seed=seed, frame=frame, **self.how).A.radiance


def truth_of(case: Case, options) -> Estimate:
    """As many images as of an integrator."""
    truth = Truth(case, options)
    return Estimate(np.array([truth.image(SEED + k) for k in range(options.seeds)]))


def render_seeds(renderer: FrameRenderer, case: Case, integrator: str, options) -> dict:
    """Raw and denoised images and standard errors [n, H, W, 3]."""
    made: dict[str, list] = {"raw": [], "stderr": [], "denoised": []}
    for seed in range(1, options.seeds + 1):
        A = renderer.render(
            case.own.T,
            outputs="A",
            motion=case.motion,
            time_ns=round(1e9 * NOW_S),
            seed=seed,
            integrator=integrator,
            spp=options.spp,
            denoise=options.denoise,
        ).A
        for name, value in (("raw", A.radiance), ("stderr", A.stderr), ("denoised", A.denoised)):
            made[name].append(A.radiance if value is None else value)
    return {name: np.array(values) for name, values in made.items()}


def row_of(made: dict, truth: Estimate) -> dict:
    """All numbers of one integrator in one scene."""
    raw, denoised = Estimate(made["raw"]), Estimate(made["denoised"])
    of_raw, count = scores.bias(raw, truth), (len(raw.images), len(truth.images))
    whole = scores.as_normal(raw.whole[0] - truth.whole[0], raw.whole[1], truth.whole[1], *count)
    worst = {
        f"{name}_block_percent": float(100 * np.abs(scores.block_errors(each.pixels[0][None], truth)).max())
        for name, each in (("raw", raw), ("denoised", denoised))
    }
    of_denoised = scores.bias(denoised, truth)
    return {
        "noise": scores.noise(made["raw"], truth).tolist(),
        **of_raw,
        "mean_z": whole.tolist(),
        **worst,
        "denoised_block_z": of_denoised["block_z"],
        "denoised_block_z_at": of_denoised["block_z_at"],
        **scores.block_row(made["denoised"], truth),
        **scores.calibration(made["raw"], made["stderr"]),
        **scores.chi2(raw, truth),
    }


def line(row: dict) -> str:
    """A row of the table."""
    tells = int(np.argmax(np.abs(row["mean_z"])))
    mean = f"{row['mean_off_percent'][tells]:+.2f} +- {row['mean_off_stderr'][tells]:.2f}"
    z = f"{row['z_variance']:.2g} ({row['z_trimmed']:.2g})"
    p = f"{row['chi2_p']:9.2g}{row['chi2_p_shared']:7.2f}"
    return (
        f"{row['scene']:<14}{row['kind']:<10}{row['integrator']:<11}{100 * max(row['noise']):5.0f}%  {mean:<15}"
        f"{row['mean_z'][tells]:5.1f}  {z:<13}{row['block_z']:7.1f}{row['raw_block_percent']:6.1f}%  "
        f"{row['denoised_block_z']:11.1f}{row['denoised_block_percent']:6.1f}%{100 * row['block_worst']:6.0f}%  "
        f"{row['chi2']:5.2f}{p}{100 * row['reference_block_rms']:7.2f}%"
    )


def measure(place: str, kind: str, options, tell) -> tuple[list[dict], list[np.ndarray]]:
    """Rows of the table of one scene, and of pictures."""
    case, watch = moving_scenes.make(place, kind, options.resolution), Stopwatch()
    truth = truth_of(case, options)
    renderer, rows, pictures = FrameRenderer(case.scene, options.device, case.parts()), [], []
    for integrator in options.integrators:
        made = render_seeds(renderer, case, integrator, options)
        rows.append({"scene": place, "kind": kind, "integrator": integrator} | row_of(made, truth))
        pictures.append(row_of_images(made["denoised"], truth))
        tell(line(rows[-1]))
    rows[-1] |= {"seconds": watch.seconds, "compile_seconds": renderer.compile_seconds}
    return rows, pictures


def sheet(path: Path, pictures: list[tuple[str, np.ndarray]]) -> None:
    """All rows of pictures below each other: the first image, the worst, the truth, and the errors of the worst."""
    tall, wide = pictures[0][1].shape[:2]
    page = Image.new("RGB", (wide, len(pictures) * (tall + 12)), "white")
    for k, (title, picture) in enumerate(pictures):
        page.paste(Image.fromarray(picture), (0, k * (tall + 12) + 12))
        ImageDraw.Draw(page).text((2, k * (tall + 12)), title, fill="black")
    path.parent.mkdir(parents=True, exist_ok=True)
    page.save(path)


def parse(arguments=None):
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = lambda text: text.split(",")  # noqa: E731
    parser.add_argument("--scenes", type=names, default=list(moving_scenes.SCENES))
    parser.add_argument("--kinds", type=names, default=list(moving_scenes.KINDS))
    parser.add_argument("--integrators", type=names, default=["auto", "path"])
    parser.add_argument("--spp", type=int, default=8)
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--instants", type=int, default=4, help="To an exposure.")
    parser.add_argument("--truth", default="path", help="Integrator of the instants.")
    parser.add_argument("--truth-spp", type=int, default=32, help="Samples per pixel of each.")
    parser.add_argument("--denoise", default="oidn")
    parser.add_argument("--resolution", type=lambda text: tuple(int(n) for n in text.split("x")), default=RESOLUTION)
    parser.add_argument("--device", type=resolve_device, default="cpu")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--png", type=Path)
    options = parser.parse_args(arguments)
    for given, known in ((options.scenes, moving_scenes.SCENES), (options.kinds, moving_scenes.KINDS)):
        if unknown := [name for name in given if name not in known]:
            parser.error(f"unknown: {', '.join(unknown)}; there are: {', '.join(known)}")
    if options.seeds < 2:
        parser.error("--seeds must be at least 2")
    return options


def main(arguments=None) -> None:
    """Print the table, and write what was asked for; what is there already is kept if it is cut off."""
    options, rows, pictures = parse(arguments), [], []
    facts = {"machine": machine(options.device)} | {
        key: getattr(options, key)
        for key in ("spp", "seeds", "instants", "truth", "truth_spp", "denoise", "resolution")
    }
    print(HEAD, flush=True)
    for place in options.scenes:
        for kind in options.kinds:
            made, shown = measure(place, kind, options, lambda text: print(text, flush=True))
            rows += made
            pictures += [
                (f"{place}, {kind}, {row['integrator']}", picture) for row, picture in zip(made, shown, strict=True)
            ]
            if options.json:
                options.json.parent.mkdir(parents=True, exist_ok=True)
                options.json.write_text(json.dumps(facts | {"rows": rows}, indent=1) + "\n")
        if options.png:
            sheet(options.png, pictures)


if __name__ == "__main__":
    try:
        main()
    except InputError as problem:
        sys.exit(str(problem))
