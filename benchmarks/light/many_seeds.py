"""What takes many seeds: outliers, whether error bars hold, whether two integrators agree, and which is better.

    python -m benchmarks.light.many_seeds holes --scenes coastal,closed_room --seeds 1000 [--device cuda:0] [--json F]
    python -m benchmarks.light.many_seeds bars --seeds 64
    python -m benchmarks.light.many_seeds means --spp 8192 --seeds 8
    python -m benchmarks.light.many_seeds choice --resolution 640x360 --seeds 8
    python -m benchmarks.light.many_seeds tolerance --resolution 320x180 --seeds 100 --tolerance 0.03
    python -m benchmarks.light.many_seeds tolerance --planned --seeds 4 [--scenes ref1,demo]
    python -m benchmarks.light.many_seeds rate --resolution 192x112 --seeds 48 --rates 0.25,0.5,1,2

Every subject prints a line per scene. Images are by `field` with ``--spp`` samples per pixel unless stated otherwise.
``--planned`` takes the scene files of planned.yaml, with their own tolerances, instead of the dissimilar scenes.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.light import scores
from benchmarks.light.scenes import PLANNED, RESOLUTION, SCENES, Built, build, build_planned
from benchmarks.light.scores import Estimate
from benchmarks.machine import Stopwatch, command, machine, numbers, save, size, words
from varos_warp.device.launcher import timed
from varos_warp.errors import InputError
from varos_warp.render.planner.errors import BLOCKS_WITHIN
from varos_warp.render.planner.pilot import Frames
from varos_warp.render.planner.plan import PATHS_PAY, Planner, plan_render
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description.world import Diffuse

TEN_TIMES = 10.0
"""The tolerance: beyond it only one block in 10 000 may be."""
FIRST_OF_REFERENCE, SEEDS_OF_REFERENCE = 100_001, 8
"""Seeds of the images that are the reference; none is measured."""


def render_seeds(renderer, built: Built, seeds: int, first: int = 1, **how) -> dict:
    """Raw and denoised images and standard errors [n, H, W, 3] of seeds from ``first`` on, and the times [n].

    ``how`` is as `RenderOptions` has it; what it leaves out of ``copied`` is raw.
    """
    how = {"outputs": "A"} | how
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


def asked_for(name: str, options) -> Built:
    """A scene as the command line asks for it."""
    built = build_planned(name) if options.planned else build(name, options.resolution)
    if options.tolerance:
        render = built.scene.render.model_copy(update={"tolerance": options.tolerance})
        built = built._replace(scene=built.scene.model_copy(update={"render": render}))
    return softened(roughened(built, options.roughness), options.radius)


def roughened(built: Built, roughness: float) -> Built:
    """A scene with such a `diffuse_roughness` of all its surfaces of kind diffuse."""
    rough = {"diffuse_roughness": roughness}
    parts = [
        replace(part, material=part.material.model_copy(update=rough)) if isinstance(part.material, Diffuse) else part
        for part in built.parts
    ]
    return built._replace(parts=parts)


def softened(built: Built, radius_m: float) -> Built:
    """A scene whose lamps are disks of such a radius, those that may be; 0: as they are."""
    if not radius_m:
        return built
    vehicle = built.scene.vehicle
    lights = [
        light if light.kind == "point" else light.model_copy(update={"radius_m": radius_m}) for light in vehicle.lights
    ]
    vehicle = vehicle.model_copy(update={"lights": lights})
    return built._replace(scene=built.scene.model_copy(update={"vehicle": vehicle}))


def reference_of(renderer, built: Built, spp: int) -> Estimate:
    """The reference, of images of the field, or of paths where it does not serve."""
    how = {"integrator": "auto", "spp": spp, "denoise": "none"}
    return Estimate(render_seeds(renderer, built, SEEDS_OF_REFERENCE, FIRST_OF_REFERENCE, **how)["raw"])


def holes(renderer, built: Built, options) -> dict:
    """Blocks of denoised images against the mean of all raw ones; the tolerance is their own RMSE."""
    made = render_seeds(renderer, built, options.seeds, integrator="field", spp=options.spp, denoise="oidn")
    reference = Estimate(made["raw"])
    errors = np.abs(scores.worst_channel(scores.block_errors(made["denoised"], reference)))
    tolerance = float(scores.relative_rmse(made["denoised"], reference).max())
    row = scores.block_row(made["denoised"], reference)
    return {
        "tolerance": tolerance,
        "worst": row["block_worst"],
        "99%": row["block_99"],
        "images_half_off": row["half_off"],
        "reference_blocks": row["reference_block_rms"],
        "blocks_beyond_ten_times": float((errors > TEN_TIMES * tolerance).mean()),
    }


def bars(renderer, built: Built, options) -> dict:
    """Noise, variance of z, and spread of image means over the claimed one, of each integrator asked for."""
    told: dict = {}
    for integrator in options.integrators:
        made = render_seeds(renderer, built, options.seeds, integrator=integrator, spp=options.spp, denoise="none")
        row = scores.calibration(made["raw"], made["stderr"])
        told |= {f"{integrator} {name}": row[name] for name in ("z_variance", "z_trimmed", "z_pooled", "beyond_4")}
        told[f"{integrator} noise"] = scores.noise(made["raw"], Estimate(made["raw"])).tolist()
        told[f"{integrator} spread"] = scores.spread_over_claimed(made["raw"], made["stderr"]).tolist()
    return told


def means(renderer, built: Built, options) -> dict:
    """Images of the field against those of paths, which get ten times the samples: blocks by chance, means in %."""
    field, path = (
        Estimate(render_seeds(renderer, built, options.seeds, integrator=integrator, spp=spp, denoise="none")["raw"])
        for integrator, spp in (("field", options.spp), ("path", 10 * options.spp))
    )
    return scores.bias(field, path)


def choice(renderer, built: Built, options) -> dict:
    """Square of the error of denoised images x time, of paths over the field; and what the planner expects of it."""
    reference, work = reference_of(renderer, built, 32 * options.spp), {}
    for integrator in ("field", "path"):
        made = render_seeds(renderer, built, options.seeds, integrator=integrator, spp=options.spp, denoise="oidn")
        error = scores.relative_rmse(made["denoised"], reference).max()
        seconds = float(np.median(made["wall"]))
        work[integrator] = (float(error), seconds, float(error**2 * seconds))
    gain = Planner(built.scene, Frames.of(built.scene, renderer, [built.T_w_v])).gain_of_field()
    by_hand = work["path"][2] / work["field"][2]
    best = "field" if by_hand > 1.0 else "path"
    chosen = "field" if gain >= PATHS_PAY else "path"
    return {
        "path_over_field": by_hand,
        "planner": float(gain),
        "chosen": chosen,
        "over_best": work[chosen][2] / work[best][2],
        **work,
    }


def tolerance(renderer, built: Built, options) -> dict:
    """How often images of a plan keep its tolerance: RMSE, and 99 % of the blocks within five times it."""
    render, reference = built.scene.render, reference_of(renderer, built, options.reference_spp)
    plan, plan_seconds = timed(renderer, lambda: plan_render(built.scene, renderer, [built.T_w_v]))
    made = render_seeds(renderer, built, options.seeds, denoise=render.denoise, **plan.options)
    errors = np.array([scores.relative_rmse(image[None], reference).max() for image in made["denoised"]])
    blocks = np.array([scores.block_row(image[None], reference)["block_99"] for image in made["denoised"]])
    within = errors <= render.tolerance
    return {
        "tolerance": render.tolerance,
        "kept": float(np.mean(within & (blocks <= BLOCKS_WITHIN * render.tolerance))),
        "kept_rmse": float(np.mean(within)),
        "shortfall": plan.shortfall,
        "integrator": plan.integrator,
        "spp": plan.spp,
        "plan_seconds": plan_seconds,
        "predicted": plan.to_dict()["error"],
        "measured": scores.relative_rmse(made["denoised"], reference).tolist(),
        "reference_noise": scores.block_row(made["denoised"], reference)["reference_pixel_rms"],
        "median_error": float(np.median(errors)),
        "95%": float(np.quantile(errors, 0.95)),
        "blocks": float(np.median(blocks)),
        **seconds_of(made),
    }


def seconds_of(made: dict) -> dict[str, float]:
    """Median seconds of an image, on the clock and of the CPU."""
    return {"seconds": float(np.median(made["wall"])), "cpu_seconds": float(np.median(made["cpu"]))}


def rate(renderer, built: Built, options) -> dict:
    """Error of denoised images, seconds as a run has them, and whether raw ones stray as they claim, by samples."""
    reference, told = reference_of(renderer, built, int(32 * max(options.rates))), {}
    for spp in options.rates:
        how = {"integrator": "field", "spp": spp, "denoise": "oidn"}
        made = render_seeds(renderer, built, options.seeds, **how, copied=["denoised"])
        raw = render_seeds(renderer, built, options.seeds, **how)
        told[f"{spp:g}"] = {
            "rmse": float(scores.relative_rmse(made["denoised"], reference).max()),
            **seconds_of(made),
            "noise": scores.noise(raw["raw"], reference).tolist(),
            **scores.calibration(raw["raw"], raw["stderr"]),
            **scores.bias(Estimate(raw["raw"]), reference),
        }
    return told


SUBJECTS = {"holes": holes, "bars": bars, "means": means, "choice": choice, "tolerance": tolerance, "rate": rate}


def main(arguments=None) -> None:
    """Print a line a scene, and write what was asked for."""
    parser = command(__doc__, device="cpu")
    parser.add_argument("subject", choices=SUBJECTS)
    parser.add_argument("--scenes", type=words, help="absent: all")
    parser.add_argument("--planned", action="store_true", help="scenes of planned.yaml, at their own size")
    parser.add_argument("--integrators", type=words, default=["field"])
    parser.add_argument("--spp", type=int, default=8)
    parser.add_argument("--rates", type=numbers, default=[0.25, 0.5, 1, 2, 4, 8])
    parser.add_argument("--reference-spp", type=int, default=512, help="of each image by which plans are judged")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--tolerance", type=float, help="absent: each scene's own")
    parser.add_argument("--resolution", type=size, default=RESOLUTION)
    parser.add_argument("--roughness", type=float, default=0.0, help="of all surfaces of kind diffuse")
    parser.add_argument("--radius", type=float, default=0.0, help="of the lamps [m], as disks; 0: as they are")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    rows = {}
    for name in options.scenes or (PLANNED if options.planned else SCENES):
        built = asked_for(name, options)
        renderer = FrameRenderer(built.scene, options.device, built.parts)
        try:
            rows[name] = SUBJECTS[options.subject](renderer, built, options)
        except InputError as error:
            rows[name] = {"refused": str(error)}
        print(name, json.dumps(rows[name]), flush=True)
        asked = {key: getattr(options, key) for key in ("subject", "spp", "seeds", "resolution", "roughness", "radius")}
        save(options.json, {"machine": machine(options.device), **asked, "rows": rows})


if __name__ == "__main__":
    main()
