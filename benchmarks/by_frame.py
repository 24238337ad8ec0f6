"""Is the plan of a sequence kept? Errors of frames that the plan did not try, and their samples.

    python -m benchmarks.by_frame [--scene examples/munkholmen/scene.yaml] [--set KEY=VALUE ...] [--device cuda:0]
        [--frames 24] [--seed 1] [-o benchmarks/results/by_frame]

Plans the sequence, picks random frames, renders A as a run would, and measures its error with independent estimates of
far more samples, whose noise is subtracted (render/planner/errors.py). Writes the errors and a chart of them along the
sequence.
"""

from pathlib import Path

import numpy as np

from benchmarks.chart import plt, save_figure, subtitle
from benchmarks.machine import Stopwatch, command, machine, save
from varos_warp.device.launcher import timed
from varos_warp.render.decisions import Plan
from varos_warp.render.image.denoise import available_method
from varos_warp.render.planner.errors import error
from varos_warp.render.planner.pilot import Frames
from varos_warp.render.planner.plan import plan_render
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import load_scene
from varos_warp.sim.trajectory import simulate

ROOT = Path(__file__).parents[1]
ESTIMATES, ESTIMATE_LEVEL = 4, 8
"""Independent estimates, of so many times as many samples as the frame takes."""
SEED = 9000


def check(frames: Frames, plan: Plan, frame: int) -> dict:
    """Error of one frame as planned, its samples, and the seconds that rendering it took."""
    renderer = frames.renderer
    scene, (camera, *_) = renderer.scene, renderer.scene.vehicle.cameras

    def image(**how):
        return frames.render(frame, camera, "A", frame=frame, **(plan.options | how)).A

    spp, method = plan.spp_of(camera.id, frame), available_method(scene.render.denoise)
    made, seconds = timed(renderer, lambda: image(spp=spp, denoise=method, copied=["denoised"]))
    estimates = [image(spp=ESTIMATE_LEVEL * spp, seed=SEED + k).radiance for k in range(ESTIMATES)]
    found, upper = error([made.denoised], estimates, (0.0, 1.0)).max(1)
    return {
        "frame": frame,
        "spp": made.spp,
        "error": round(float(found), 5),
        "with_a_standard_error": round(float(upper), 5),
        "seconds": round(seconds, 4),
    }


def run(scene, device: str, frames: int, seed: int, keep=lambda result: None) -> dict:
    """Plan a sequence and check some of its frames; ``keep`` is told after each."""
    simulation = simulate(scene)
    poses = list(simulation.frames.poses())
    renderer, watch = FrameRenderer(scene, device), Stopwatch()
    plan = plan_render(scene, renderer, poses, motion=simulation.motion)
    planning = watch.seconds
    chosen = np.sort(np.random.default_rng(seed).choice(len(poses), min(frames, len(poses)), replace=False)).tolist()
    camera = scene.vehicle.cameras[0].id
    result = {
        "machine": machine(device),
        "scene": scene.name,
        "frames": len(poses),
        "tolerance": scene.render.tolerance,
        "resolution": scene.vehicle.cameras[0].resolution,
        "planning_s": round(planning, 1),
        "spp": plan.spp,
        "mean_spp": round(plan.mean_spp(camera, len(poses)), 2),
        "spp_by_frame": plan.spp_by_frame,
        "predicted": None if plan.error is None else plan.error.round(5).tolist(),
        "checked": [],
    }
    for frame in chosen:
        result["checked"].append(check(Frames.of(scene, renderer, poses, motion=simulation.motion), plan, frame))
        keep(result)
    return result


def chart(result: dict, path: Path) -> None:
    """Errors and samples along the sequence."""
    rows = result["checked"]
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(9, 5), sharex=True, constrained_layout=True)
    top.plot([row["frame"] for row in rows], [100 * row["error"] for row in rows], "o", label="measured")
    top.axhline(100 * result["tolerance"], color="k", linestyle="--", linewidth=0.8, label="tolerance")
    top.set(ylabel="error of A, worst channel [%]", ylim=(0, None))
    top.legend(fontsize=9)
    everywhere = {"": [[frame, result["spp"]] for frame in (0, result["frames"] - 1)]}
    for camera, pairs in (result["spp_by_frame"] or everywhere).items():
        bottom.plot(*zip(*pairs, strict=True), ".-", label=camera)
    bottom.set(xlabel="frame", ylabel="samples per pixel", ylim=(0, None))
    width, height = result["resolution"]
    figure.suptitle(
        f"{result['scene']}: {result['frames']} frames of {width} x {height}, {result['mean_spp']:.3g} "
        f"samples on average\n{subtitle(result)}",
        fontsize=11,
    )
    save_figure(figure, path)


def main() -> None:
    parser = command(__doc__, device="cuda:0")
    parser.add_argument("--scene", type=Path, default=ROOT / "examples" / "munkholmen" / "scene.yaml")
    parser.add_argument("--set", dest="changed", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "benchmarks" / "results" / "by_frame")
    options = parser.parse_args()

    def keep(result):
        save(options.out.with_suffix(".json"), result)
        print(result["checked"][-1], flush=True)

    result = run(load_scene(options.scene, options.changed), options.device, options.frames, options.seed, keep)
    print({key: value for key, value in result.items() if key not in ("checked", "machine")})
    chart(result, options.out.with_suffix(".png"))


if __name__ == "__main__":
    main()
