"""Images of what moves against the mean of instants placed by hand (benchmarks/light/moving_scenes.py).

    python -m benchmarks.light.moving [--scenes open,coastal] [--kinds blur,strobe] [--integrators auto,path]
        [--spp 8] [--seeds 24] [--instants 4] [--truth path] [--truth-spp 32] [--device cuda:0] [--json out.json]

Every image of the truth is a mean over ``--instants`` times to an exposure, which begin at random for each image. A row
is one integrator in one scene: noise, what the mean and the worst blocks of raw and denoised images are off by, in
standard errors and in %, and whether pixels stray as ``stderr`` says (benchmarks/light/scores.py).
"""

import json
from pathlib import Path

import numpy as np

from benchmarks.light import moving_scenes, scores
from benchmarks.light.moving_scenes import NOW_S, Case
from benchmarks.light.scenes import RESOLUTION
from benchmarks.light.scores import Estimate
from benchmarks.machine import Stopwatch, command, machine, save, size, words
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.optics.shutter import row_offsets_s

SEED = 1_000_003
"""Seed of the first image of the truth; unlike any that is measured."""


def lit(case: Case) -> np.ndarray:
    """When each row sees light, [H, 2] from the frame's time [s]."""
    view, half = case.scene.vehicle.cameras[0], 0.5 * case.exposure.time_s
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
        self.step = min(case.exposure.time_s / options.instants, 0.99 * float(self.seconds.min()))
        still = case.instant(0.0)
        bodies = case.thing is not None or len(still.parts) > len(case.still)
        self.renderer = None if bodies else FrameRenderer(still.scene, self.device, still.parts)

    def image(self, seed: int) -> np.ndarray:
        """One of them [H, W, 3]."""
        begin = self.rows[0, 0] + self.step * np.random.default_rng(seed).random()
        times = np.arange(begin, self.rows[-1, 1], self.step)
        sees = (self.rows[:, :1] <= times) & (times < self.rows[:, 1:])
        share = (self.seconds / self.case.exposure.time_s / sees.sum(axis=1))[:, None] * sees
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
    """Render as many images of the truth as of an integrator."""
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
    }


def measure(place: str, kind: str, options) -> list[dict]:
    """Rows of one scene."""
    case, watch = moving_scenes.make(place, kind, options.resolution), Stopwatch()
    truth = truth_of(case, options)
    renderer, rows = FrameRenderer(case.scene, options.device, case.parts()), []
    for integrator in options.integrators:
        made = render_seeds(renderer, case, integrator, options)
        rows.append({"scene": place, "kind": kind, "integrator": integrator} | row_of(made, truth))
        print(json.dumps(rows[-1]), flush=True)
    rows[-1] |= {"seconds": watch.seconds, "compile_seconds": renderer.compile_seconds}
    return rows


def main(arguments=None) -> None:
    """Print the rows, and write what was asked for; what is there already is kept if it is cut off."""
    parser, rows = command(__doc__, device="cpu"), []
    parser.add_argument("--scenes", type=words, default=list(moving_scenes.SCENES))
    parser.add_argument("--kinds", type=words, default=list(moving_scenes.KINDS))
    parser.add_argument("--integrators", type=words, default=["auto", "path"])
    parser.add_argument("--spp", type=float, default=8)
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--instants", type=int, default=4, help="To an exposure.")
    parser.add_argument("--truth", default="path", help="Integrator of the instants.")
    parser.add_argument("--truth-spp", type=int, default=32, help="Samples per pixel of each.")
    parser.add_argument("--denoise", default="oidn")
    parser.add_argument("--resolution", type=size, default=RESOLUTION)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    asked = ("spp", "seeds", "instants", "truth", "truth_spp", "denoise", "resolution")
    facts = {"machine": machine(options.device)} | {key: getattr(options, key) for key in asked}
    for place in options.scenes:
        for kind in options.kinds:
            rows += measure(place, kind, options)
            save(options.json, facts | {"rows": rows})


if __name__ == "__main__":
    main()
