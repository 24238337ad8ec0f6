"""Error of image B against its samples and denoiser, on unlike scenes.

    python -m benchmarks.ambient [--device cpu] [-o benchmarks/results/ambient.json]

For each scene: relative RMSE of the image, of the twentieth of its pixels where it varies most (edges), and the worst
8 x 8 block, in percent; means over `SEEDS` images, against two estimates whose noise cancels. Seconds are those of all
cores together, with denoising.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

from benchmarks.machine import machine
from varos_warp.render.planner.errors import DARK, block_means
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import load_scene
from varos_warp.sim.trajectory import simulate

ROOT = Path(__file__).parents[1]
DATA = ROOT / "varos_warp/data"
SCENES = {
    "munkholmen": ROOT / "examples/munkholmen/scene.yaml",
    "starter": DATA / "starter.yaml",
    **{name: DATA / "templates" / f"{name}.yaml" for name in ("hull", "pipeline_inspection", "harbour_wall")},
}
RESOLUTION = (320, 180)
WAYS = ((4, "oidn"), (8, "oidn"), (16, "oidn"), (8, "nlm"), (20, "nlm"), (20, "none"))
SEEDS, ESTIMATE_SPP, EDGES = 3, 256, 0.05


def percent(image: np.ndarray, estimates: list[np.ndarray]) -> list[float]:
    """Error of an image as a whole, at its edges and in its worst block [%]."""
    one, two = estimates
    mean = 0.5 * (one + two)
    square = ((image - one) * (image - two)).mean(-1)
    slope = np.hypot(*np.gradient(mean.mean(-1)))
    edges = slope > np.quantile(slope, 1.0 - EDGES)
    blocks, *known = (block_means(part) for part in (image, one, two))
    level = np.maximum(0.5 * (known[0] + known[1]), DARK * mean.mean())
    worst = ((blocks - known[0]) * (blocks - known[1]) / level**2).mean(-1).max()
    squares = [square.mean() / mean.mean() ** 2, square[edges].mean() / mean.mean() ** 2, worst]
    return (100.0 * np.sqrt(np.maximum(squares, 0.0))).tolist()


def measured(path: Path, device: str) -> list[dict]:
    """A row for each of `WAYS`."""
    scene = load_scene(path)
    poses = list(simulate(scene).frames.poses())
    renderer, pose = FrameRenderer(scene, device), poses[len(poses) // 2]
    view = scene.vehicle.cameras[0].model_copy(update={"resolution": RESOLUTION})

    def image(spp: int, method: str, seed: int):
        return renderer.render(pose, view, "B", seed=seed, spp_b=spp, denoise_b=method).B

    estimates = [image(ESTIMATE_SPP, "none", 900 + k).radiance.astype(np.float64) for k in range(2)]
    rows = []
    for spp, method in WAYS:
        image(1, method, 0)  # compiles
        found, start = [], time.process_time()
        for seed in range(SEEDS):
            made = image(spp, method, seed)
            found.append(made.radiance if method == "none" else made.denoised)
        seconds = (time.process_time() - start) / SEEDS
        whole, edges, worst = np.mean([percent(one, estimates) for one in found], axis=0).round(2).tolist()
        rows.append(
            {
                "spp": spp,
                "denoise": method,
                "whole": whole,
                "edges": edges,
                "worst_block": worst,
                "core_seconds": round(seconds, 2),
            }
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "benchmarks" / "results" / "ambient.json")
    options = parser.parse_args()
    result = {"machine": machine(options.device), "resolution": RESOLUTION, "seeds": SEEDS, "scenes": {}}
    options.out.parent.mkdir(parents=True, exist_ok=True)
    for name, path in SCENES.items():
        result["scenes"][name] = measured(path, options.device)
        print(name, *result["scenes"][name], sep="\n", flush=True)
    options.out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
