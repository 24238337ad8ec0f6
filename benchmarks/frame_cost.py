"""Time of a frame on a GPU, kernel by kernel, and the error that its samples leave.

    python -m benchmarks.frame_cost [--scene examples/munkholmen/scene.yaml] [--device cuda:0] [--frames 60,150]
        [--spp 1,2,3.25,8,16] [--spp-b 2,4,6,8,20] [-o benchmarks/results/frame_cost.json]

Times are for A, for B, and for C, D and S separately, as in a run: denoised on the device, with the results copied to
the host. The first rendering of each kind, which compiles, is not counted. Errors are relative RMSE per channel after
denoising, measured with two estimates of ``--estimate-spp`` samples, whose noise is subtracted
(render/planner/errors.py).
"""

import json
from pathlib import Path

import numpy as np
import warp as wp

from benchmarks.machine import MUNKHOLMEN, RESULTS, Stopwatch, command, counts, machine, numbers, save
from varos_warp.render.planner.errors import error
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import load_scene
from varos_warp.sim.trajectory import simulate

AS_IN_A_RUN = {"denoise": "oidn", "denoise_b": "oidn", "copied": ["denoised"]}
REPEATS = 6
SEED = 9000


def cost(renderer, poses, letters: str, **how) -> dict:
    """Median milliseconds of a frame, and those of its kernels, of which the launches of one are added up."""
    renderer.render(poses[0], outputs=letters, **how)
    walls = []
    for k in range(REPEATS):
        watch = Stopwatch()
        renderer.render(poses[k * len(poses) // REPEATS], outputs=letters, frame=k, **how)
        walls.append(1e3 * watch.seconds)
    wp.timing_begin(cuda_filter=wp.TIMING_ALL)
    renderer.render(poses[len(poses) // 2], outputs=letters, **how)
    kernels: dict[str, float] = {}
    for entry in wp.timing_end():
        name = kernel_name(entry.name)
        kernels[name] = kernels.get(name, 0.0) + entry.elapsed
    kernels = {name: round(ms, 2) for name, ms in sorted(kernels.items(), key=lambda item: -item[1]) if ms >= 0.05}
    return {"outputs": letters, "ms": round(float(np.median(walls)), 2), "kernels_ms": kernels}


def kernel_name(timed: str) -> str:
    """The function's name in what Warp calls an entry: ``forward kernel make_x__locals__trace_rays_1a2b3c4d``."""
    name = timed.split("(", maxsplit=1)[0].removeprefix("forward kernel ").split("__locals__")[-1]
    head, _, tail = name.rpartition("_")
    return head if head and len(tail) == 8 and all(c in "0123456789abcdef" for c in tail) else name


def errors(renderer, pose, letter: str, ladder: list[float], estimate_spp: int) -> list[dict]:
    """Error of images of one pose with so many samples."""
    key, method = ("spp", "denoise") if letter == "A" else ("spp_b", "denoise_b")

    def image(spp, seed, denoise):
        return getattr(renderer.render(pose, outputs=letter, seed=seed, **{key: spp, method: denoise}), letter)

    estimates = [image(estimate_spp, SEED + k, "none").radiance for k in range(2)]
    rows = []
    for spp in ladder:
        images = [image(spp, SEED // 2 + k, "oidn").denoised for k in range(2)]
        rows.append({"output": letter, "spp": spp, "error": error(images, estimates, 0.0).round(5).tolist()})
    return rows


def main() -> None:
    parser = command(__doc__, device="cuda:0")
    parser.add_argument("--scene", type=Path, default=MUNKHOLMEN)
    parser.add_argument("--frames", type=counts, default="60,150", help="Whose errors are measured.")
    parser.add_argument("--spp", type=numbers, default="1,2,3.25,8,16")
    parser.add_argument("--spp-b", type=counts, default="2,4,6,8,20")
    parser.add_argument("--estimate-spp", type=int, default=768)
    parser.add_argument("-o", "--out", type=Path, default=RESULTS / "frame_cost.json")
    options = parser.parse_args()
    scene = load_scene(options.scene)
    simulation = simulate(scene)
    poses = list(simulation.frames.poses())
    renderer = FrameRenderer(scene, options.device)
    result = {
        "machine": machine(renderer.device),
        "scene": scene.name,
        "resolution": scene.vehicle.cameras[0].resolution,
        "estimate_spp": options.estimate_spp,
    }
    result["cost"] = [{"spp": spp} | cost(renderer, poses, "A", spp=spp, **AS_IN_A_RUN) for spp in options.spp]
    result["cost"] += [{"spp": spp} | cost(renderer, poses, "B", spp_b=spp, **AS_IN_A_RUN) for spp in options.spp_b]
    result["cost"].append(cost(renderer, poses, "CDS"))
    result["errors"] = [
        {"frame": frame} | row
        for frame in options.frames
        for letter, ladder in (("A", options.spp), ("B", options.spp_b))
        for row in errors(renderer, poses[frame], letter, ladder, options.estimate_spp)
    ]
    for row in result["cost"] + result["errors"]:
        print(json.dumps(row))
    save(options.out, result)


if __name__ == "__main__":
    main()
