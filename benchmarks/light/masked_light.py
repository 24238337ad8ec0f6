"""Images of what masks of textures cut, against the same surfaces as triangles (benchmarks/light/masked_scenes.py).

    python -m benchmarks.light.masked_light [--scenes open,coastal] [--integrators auto] [--seeds 20] [--spp 4]
        [--resolution 96x64] [--device cuda:0] [--json benchmarks/results/masked_light_cpu.json]

A row of the table is image A by one integrator, or image B, in one scene; undenoised; blocks of 8 x 8 pixels and three
channels each:
    worst z     the block farthest off in standard errors, of images with seeds of their own; below ``bound`` is chance,
                once in twenty such tables
    chi2        mean of the squares of z, and its chance: 1, were they normal and blocks independent
    off %       the largest difference of a block (of itself, or of a tenth of the image), and its standard error
    same: z, chi2, off %, alike %: the same with the same random numbers in both, whose noise cancels but where rounding
                of an edge parts two paths; and the pixels of one seed that then differ by less than 1e-4
And one of C, D and S for each scene: pixels whose S differs; of all others but for neighbours of an edge, the largest
difference of S, of D over D, and of C.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.stats import norm

from benchmarks.light import scores
from benchmarks.light.masked_scenes import NOW_S, SCENES, TWINS, build
from benchmarks.light.scenes import Built
from benchmarks.light.scores import Estimate
from benchmarks.machine import Stopwatch, machine
from varos_warp.device.devices import resolve_device
from varos_warp.render.renderer import FrameRenderer

ALIKE = 1e-4
ROUNDING = 1e-6
"""Relative error of a block by single precision, some of it alike in all images."""
FIRST_OF_OTHERS = 100_001  # seed of images that share no random numbers
CHANCE = 0.05


class Twin:
    """One of both: it renders frames of its scene."""

    def __init__(self, built: Built, device: str):
        self.renderer = FrameRenderer(built.scene, device, built.parts)
        still = lambda offset_ns: np.repeat(built.T_w_v[None], len(offset_ns), axis=0)  # noqa: E731
        self.how = {"T_w_v": built.T_w_v, "motion": still, "time_ns": round(1e9 * NOW_S), "denoise": "none"}

    def frame(self, outputs: str, **more):
        return self.renderer.render(**self.how, outputs=outputs, **more)

    def images(self, letter: str, first: int, options, integrator: str) -> np.ndarray:
        """Radiance [n, H, W, 3] of seeds from ``first`` on."""
        how = {"spp": options.spp, "spp_b": options.spp, "integrator": integrator}
        return np.array(
            [getattr(self.frame(letter, seed=first + k, **how), letter).radiance for k in range(options.seeds)]
        )


def row_of(twins: list[Twin], letter: str, options, integrator: str) -> dict:
    """All numbers of one image by one integrator."""
    textured, plain = (twin.images(letter, 1, options, integrator) for twin in twins)
    truth = Estimate(twins[1].images(letter, FIRST_OF_OTHERS, options, integrator))
    ours = Estimate(textured)
    told, errors = scores.bias(ours, truth), scores.block_errors(ours.pixels[0][None], truth)[0]
    worst = np.unravel_index(np.abs(errors).argmax(), errors.shape)
    unsure = np.hypot(ours.blocks[1], truth.blocks[1]) / np.maximum(truth.blocks[0], scores.DARKEST * truth.whole[0])
    alike = (np.abs(textured - plain) <= ALIKE * np.abs(plain)).all(axis=-1)
    return {
        "image": letter,
        "integrator": integrator,
        "blocks": errors.size,
        **told,
        **scores.chi2(ours, truth),
        "worst_percent": float(100 * errors[worst]),
        "worst_stderr": float(100 * unsure[worst]),
        **same_of(textured, Estimate(plain)),
        "alike_percent": float(100 * alike.mean()),
    }


def same_of(textured: np.ndarray, plain: Estimate) -> dict:
    """Of images with the same random numbers: the mean difference by its spread over seeds, and by rounding."""
    mean, spread = Estimate(textured - plain.images).blocks
    z = scores.as_normal(mean, spread, ROUNDING * plain.blocks[0], len(textured), 10**9)
    errors = scores.block_errors(textured.mean(axis=0)[None], plain)
    return {
        "same_z": float(z.flat[np.abs(z).argmax()]),
        "same_chi2": float(np.mean(z**2)),
        "same_percent": float(100 * np.abs(errors).max()),
    }


def geometry_row(twins: list[Twin]) -> dict:
    """C, D and S, apart from edges of S by more than a pixel."""
    ours, truth = (twin.frame("CDS") for twin in twins)
    seen, depth = truth.S.instance, truth.D.depth
    inner = maximum_filter(seen, 3) == minimum_filter(seen, 3)
    near = np.where(np.isfinite(depth), depth, 1e6)
    inner &= maximum_filter(near, 3) < 1.2 * minimum_filter(near, 3)  # a strip before another one of the same object
    there = inner & np.isfinite(depth)
    return {
        "s_differs": int((ours.S.instance != seen).sum()),
        "inner": int(inner.sum()),
        "of": int(seen.size),
        "s_differs_inner": int((ours.S.instance != seen)[inner].sum()),
        "d_relative": float(np.abs(ours.D.depth[there] / depth[there] - 1.0).max()),
        "c": float(np.abs(ours.C.normal - truth.C.normal)[inner].max()),
    }


def measure(name: str, options, tell) -> list[dict]:
    """All rows of one scene."""
    watch, rows = Stopwatch(), []
    with tempfile.TemporaryDirectory() as folder:
        twins = [Twin(build(name, twin, Path(folder), options.resolution), options.device) for twin in TWINS]
    b = [("B", "auto")] if name != "turbid_room" else []  # in a closed room it is black
    for letter, integrator in [*(("A", each) for each in options.integrators), *b]:
        rows.append({"scene": name} | row_of(twins, letter, options, integrator))
        tell(
            "{scene:<13}{image} {integrator:<10}{blocks:>6}{block_z:>8.2f}{chi2:>7.3f}{chi2_p_shared:>7.2f}"
            "{worst_percent:>8.2f} +- {worst_stderr:<6.2f}{same_z:>7.2f}{same_chi2:>6.2f}{same_percent:>7.3f}"
            "{alike_percent:>8.2f}".format(**rows[-1])
        )
    if name != "painted":  # its parts have other numbers
        rows.append({"scene": name, "image": "CDS"} | geometry_row(twins))
        tell(
            "{scene:<13}CDS {s_differs} of {of} S differ, {s_differs_inner} of {inner} within; D {d_relative:.1e}, "
            "C {c:.1e}".format(**rows[-1])
        )
    rows[-1]["seconds"] = round(watch.seconds, 1)
    return rows


def parse(arguments=None):
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = lambda text: text.split(",")  # noqa: E731
    parser.add_argument("--scenes", type=names, default=list(SCENES))
    parser.add_argument("--integrators", type=names, default=["auto"])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--spp", type=int, default=4)
    parser.add_argument("--resolution", type=lambda text: tuple(int(n) for n in text.split("x")), default=(96, 64))
    parser.add_argument("--device", type=resolve_device, default="cpu")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.scenes if name not in SCENES]:
        parser.error(f"unknown: {', '.join(unknown)}; there are: {', '.join(SCENES)}")
    return options


def main(arguments=None) -> None:
    """Print the table, and write what was asked for."""
    options, rows = parse(arguments), []
    tell = lambda text: print(text, flush=True)  # noqa: E731
    tell(
        f"{'scene':<13}{'image':<12}{'blocks':>6}{'worst z':>8}{'chi2':>7}{'p':>7}{'off %':>8}{'':10}{'same: z':>7}"
        f"{'chi2':>6}{'off %':>7}{'alike %':>8}"
    )
    for name in options.scenes:
        rows += measure(name, options, tell)
        bound = norm.isf(0.5 * CHANCE / sum(row.get("blocks", 0) for row in rows))
        facts = {
            "machine": machine(options.device),
            "seeds": options.seeds,
            "spp": options.spp,
            "resolution": options.resolution,
            "bound": float(bound),
            "rows": rows,
        }
        if options.json:
            options.json.write_text(json.dumps(facts, indent=1) + "\n")
    tell(f"bound: {bound:.2f}")


if __name__ == "__main__":
    main()
