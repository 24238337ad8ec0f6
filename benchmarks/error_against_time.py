"""Error of image A against seconds, from 1 to many samples per pixel, by each integrator; writes a chart.

    python -m benchmarks.error_against_time SCENE REFERENCE.npz [--device cuda:0] [-o chart]

REFERENCE holds ``mean`` and ``stderr`` [height, width, 3]. Writes chart.json and chart.png. The error is the relative
RMSE over the image less the noise of the reference, and the median relative error of a pixel (which is not cleared
of it), in the channel where each is largest.
"""

import argparse
import json
from pathlib import Path

import matplotlib
import numpy as np

from benchmarks.bench_frame import commit, time_method
from varos_warp.render.frame import INTEGRATORS, FrameRenderer
from varos_warp.scene.load import load_scene
from varos_warp.sim.trajectory import simulate

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def errors(radiance, reference) -> dict:
    """Relative RMSE and median relative error, both of the worst channel."""
    mean, stderr = reference["mean"].astype(float), reference["stderr"].astype(float)
    squared = np.mean((radiance - mean) ** 2 - stderr**2, axis=(0, 1))
    rmse = np.sqrt(np.maximum(squared, 0.0)) / mean.mean(axis=(0, 1))
    median = np.median(np.abs(radiance - mean) / np.maximum(mean, 1e-30), axis=(0, 1))
    return {"rmse": float(rmse.max()), "median": float(median.max())}


def measure(scene_file: str, reference_file: str, device: str, most: int, integrators: list[str]) -> dict:
    """One point per integrator and number of samples."""
    scene, reference = load_scene(scene_file), np.load(reference_file)
    T_w_v = simulate(scene).trajectory.T_w_v(0)
    renderer = FrameRenderer(scene, device)
    points = []
    for name in integrators:
        spp = 2
        while spp <= most:
            images, seconds = time_method(renderer, T_w_v, spp, 3 if spp < 64 else 1, name)
            points.append({"integrator": name, "spp": spp, "seconds": seconds, **errors(images[-1], reference)})
            print(points[-1], flush=True)
            spp *= 4
    return {"scene": scene.name, "device": renderer.device_name, "commit": commit(), "points": points}


def chart(result: dict, path: Path):
    """Error against seconds, both logarithmic."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharex=True, constrained_layout=True)
    for axis, kind, title in zip(axes, ("rmse", "median"), ("relative RMSE", "median relative error"), strict=True):
        for integrator in dict.fromkeys(p["integrator"] for p in result["points"]):
            points = [p for p in result["points"] if p["integrator"] == integrator]
            axis.loglog([p["seconds"] for p in points], [p[kind] for p in points], "o-", label=integrator)
            for p in points:
                axis.annotate(
                    f"{p['spp']}", (p["seconds"], p[kind]), textcoords="offset points", xytext=(4, 4), fontsize=8
                )
        axis.set(xlabel="seconds per frame", ylabel=title)
        axis.grid(True, which="both", alpha=0.3)
        axis.legend()
    figure.suptitle(f"{result['scene']}, all orders of scattering, {result['device']}; numbers are samples per pixel")
    figure.savefig(path, dpi=110)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("reference")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--most", type=int, default=512)
    parser.add_argument("--integrators", nargs="+", choices=INTEGRATORS, default=["path", "reference"])
    parser.add_argument("-o", "--output", type=Path, default=Path("error_against_time"))
    arguments = parser.parse_args()
    result = measure(arguments.scene, arguments.reference, arguments.device, arguments.most, arguments.integrators)
    arguments.output.with_suffix(".json").write_text(json.dumps(result, indent=1) + "\n")
    chart(result, arguments.output.with_suffix(".png"))


if __name__ == "__main__":
    main()
