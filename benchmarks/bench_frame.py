"""Speed and error of one image A with each integrator, in the same run.

    python -m benchmarks.bench_frame SCENE [--device cpu] [--spp 16] [--integrators path reference] [-o results.json]

Prints paths/s, rays/s, ms/frame, peak memory, and the work: relative variance times seconds. Compile time is reported
separately. A path is one camera sample with everything that follows from it.
"""

import argparse
import json
import resource
import time
from pathlib import Path

import numpy as np
import warp as wp

from benchmarks.machine import commit, cpu_name
from benchmarks.ray_ceiling import ceilings
from varos_warp.render.renderer import INTEGRATORS, FrameRenderer
from varos_warp.scene.file.load import load_scene
from varos_warp.sim.trajectory import simulate


def time_method(renderer, T_w_v, spp: int, repeat: int, integrator: str):
    """Radiance float64 [repeat, H, W, 3] of ``repeat`` renderings, and their median seconds."""
    renderer.render(T_w_v, outputs="A", spp=1, integrator=integrator)
    seconds, images = [], []
    for frame in range(repeat):
        start = time.perf_counter()
        image = renderer.render(T_w_v, outputs="A", spp=spp, frame=frame, integrator=integrator).A
        seconds.append(time.perf_counter() - start)
        images.append(image.radiance.astype(float))
    return np.array(images), float(np.median(seconds))


def rays_per_path(renderer, T_w_v, integrator: str) -> float:
    """Nearest-hit and visibility rays per camera sample, counted in a few samples per pixel."""
    counter = wp.zeros(1, dtype=wp.int64, device=renderer.device)
    renderer.world.data.ray_count = counter
    renderer.render(T_w_v, outputs="A", spp=4, integrator=integrator)
    renderer.world.data.ray_count = wp.array(dtype=wp.int64, device=renderer.device)
    width, height = renderer.scene.vehicle.cameras[0].resolution
    return float(counter.numpy()[0]) / (4 * width * height)


def relative_work(radiance, variance, seconds):
    """Mean relative variance of a pixel times seconds, per channel: what a given error costs."""
    return (variance.mean(axis=(0, 1)) / radiance.mean(axis=(0, 1)) ** 2 * seconds).tolist()


def peak_memory_mib(device: str) -> float:
    """Of the process on the CPU, of the device's pool on a GPU."""
    if device == "cpu":
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return wp.get_mempool_used_mem_high(device) / 2**20


def measure(
    scene_file: str, device: str, spp: int, resolution: str | None, repeat: int, integrators: list[str]
) -> dict:
    """One row of results."""
    width_height = [] if resolution is None else [f"vehicle.cameras.0.resolution=[{resolution.replace('x', ',')}]"]
    scene = load_scene(scene_file, width_height)
    T_w_v = simulate(scene).trajectory.T_w_v(0)
    start = time.perf_counter()
    renderer = FrameRenderer(scene, device)
    setup = time.perf_counter() - start
    width, height = scene.vehicle.cameras[0].resolution
    row = {
        "scene": scene.name,
        "resolution": [width, height],
        "spp": spp,
        "device": renderer.device,
        "device_name": renderer.device_name,
        "threads": renderer.launcher.threads,
        "cpu": cpu_name(),
        "warp": wp.__version__,
        "commit": commit(),
        "setup_s": round(setup, 2),
    }
    for name in integrators:
        images, seconds = time_method(renderer, T_w_v, spp, repeat, name)
        # between renderings: samples within one claim too much where they are a low-discrepancy sequence, and nothing
        # where pixels share them
        radiance, variance = images[-1], np.var(images, axis=0, ddof=1)
        relative = np.sqrt(variance) / np.maximum(radiance, 1e-30)
        row[name] = {
            "ms_per_frame": seconds * 1e3,
            "paths_per_s": width * height * spp / seconds,
            "rays_per_s": width * height * spp / seconds * rays_per_path(renderer, T_w_v, name),
            "work_rgb": relative_work(radiance, variance, seconds),
            "median_relative_stderr_rgb": np.median(relative, axis=(0, 1)).tolist(),
            "mean_rgb": radiance.mean(axis=(0, 1)).tolist(),
        }
    row["compile_s"] = round(renderer.compile_seconds, 2)
    row["peak_memory_mib"] = round(peak_memory_mib(renderer.device), 1)
    row["ceiling_rays_per_s"] = ceilings(renderer, T_w_v)
    if "reference" in integrators:
        compare(row, integrators)
    return row


def compare(row: dict, integrators: list[str]):
    """Add to each integrator how it stands beside the reference integrator."""
    plain = row["reference"]
    for one in (row[name] for name in integrators if name != "reference"):
        one["speed_ratio"] = one["paths_per_s"] / plain["paths_per_s"]
        one["work_ratio_rgb"] = (np.array(plain["work_rgb"]) / np.array(one["work_rgb"])).tolist()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--resolution", help="WIDTHxHEIGHT instead of the scene's")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--integrators", nargs="+", choices=INTEGRATORS, default=["path", "reference"])
    parser.add_argument("-o", "--output", type=Path, help="append the row to this JSON file")
    arguments = parser.parse_args()
    options = (arguments.device, arguments.spp, arguments.resolution, arguments.repeat, arguments.integrators)
    row = measure(arguments.scene, *options)
    print(json.dumps(row, indent=1))
    if arguments.output:
        rows = json.loads(arguments.output.read_text()) if arguments.output.exists() else []
        arguments.output.write_text(json.dumps([*rows, row], indent=1) + "\n")


if __name__ == "__main__":
    main()
