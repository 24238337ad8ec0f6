"""Level of detail against the error it makes in depth and normals, and the time it saves; writes a chart.

    python -m benchmarks.level_of_detail [SCENE] [--device cpu] -o benchmarks/results/level_of_detail

SCENE is examples/munkholmen by default. Every level is one tolerance in pixels, without the limit in steps of D; the
star is the coarse one of 4 pixels with it (half a pixel is the same with and without). Errors are those of C and D at
five frames, against every triangle. Times are CPU seconds of all threads on a CPU (which other work beside does not
lengthen much), and seconds on a GPU; the least of three.
"""

import argparse
import json
import time
from functools import partial
from pathlib import Path

import matplotlib

from benchmarks.machine import commit
from varos_warp.render.planner.detail import choose_detail, compare_images
from varos_warp.render.planner.pilot import pilot_camera
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.load import load_scene
from varos_warp.sim.trajectory import simulate

matplotlib.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
MUNKHOLMEN = HERE.parent / "examples" / "munkholmen" / "scene.yaml"
LEVELS = [(0.125, None), (0.25, None), (0.5, None), (1.0, None), (2.0, None), (4.0, None), (8.0, None), (4.0, 1.0)]
"""tolerance_px and depth_steps."""
PIXELS, SPP = 160 * 90, 4


def clock(device: str) -> float:
    """Seconds of the processor that does the work."""
    return time.process_time() if device == "cpu" else time.perf_counter()


def frame_seconds(scene, parts, T_w_v, device: str) -> dict:
    """Seconds of a small image A on a CPU, of a whole one on a GPU, and of whole ones C and D; the least of three."""
    renderer, whole = FrameRenderer(scene, device, parts), scene.vehicle.cameras[0]
    small = pilot_camera(whole, PIXELS) if device == "cpu" else whole
    seconds = {}
    for letters, camera in (("A", small), ("CD", whole)):
        times = []
        for _ in range(4):  # the first one compiles
            start = clock(device)
            renderer.render(T_w_v, camera, letters, spp=SPP if device == "cpu" else 64)
            times.append(clock(device) - start)
        seconds[letters] = min(times[1:])
    return seconds


def level(with_changes, parts, poses, device: str, pixels: float, steps: float | None, T_w_v) -> dict:
    """One level of detail: triangles and memory kept, errors of D and C, seconds.

    Args:
        with_changes: gives the scene with changes, ``key.path=value``.
        parts: its geometry, with every triangle.
        poses: T_w_v of every frame.
        device: where images are compared and timed.
        pixels, steps: ``tolerance_px`` and ``depth_steps``.
        T_w_v: pose of the frame that is timed.
    """
    block = f"{{tolerance_px: {pixels}, depth_steps: {'null' if steps is None else steps}}}"
    scene = with_changes(f"render.level_of_detail={block}")
    start = time.process_time()
    detail = choose_detail(scene, parts, poses, device, compare=False)
    reducing = time.process_time() - start
    meshes = detail.meshes | compare_images(scene, parts, detail.parts, poses, device)[0]
    depth = {key: meshes["depth_error"][key] for key in
             ("rms_mm", "p95_mm", "rms_steps", "p95_steps", "max_steps", "outline_share", "by_distance")}
    return {"tolerance_px": pixels, "depth_steps": steps, "triangles": meshes["kept"],
            "memory_mb": meshes["memory_mb"]["kept"], "depth": depth, "normal_deg": meshes["normal_error_deg"],
            "seconds": frame_seconds(scene, detail.parts, T_w_v, device), "reducing_cpu_seconds": round(reducing, 1)}


def exact_level(scene, parts, poses, device: str, T_w_v) -> dict:
    """The row of the meshes as they are."""
    exact = choose_detail(scene, parts, poses, device).meshes
    return {"tolerance_px": None, "triangles": exact["kept"], "memory_mb": exact["memory_mb"]["kept"],
            "seconds": frame_seconds(scene, parts, T_w_v, device)}


def measure(path: Path, device: str) -> dict:
    """One row per level, the first without any."""
    plain = load_scene(path)
    simulation = simulate(plain)
    poses = [simulation.trajectory.T_w_v(tick) for tick in simulation.frame_ticks]
    parts, middle = build_parts(plain), poses[len(poses) // 2]
    rows = [exact_level(plain, parts, poses, device, middle)]
    for pixels, steps in LEVELS:
        rows.append(level(partial(_changed, path), parts, poses, device, pixels, steps, middle))
        print(json.dumps({key: value for key, value in rows[-1].items() if key != "depth"}), flush=True)
    name = FrameRenderer(plain, device, parts[:0]).device_name
    return {"scene": plain.name, "frames": len(poses), "device": name, "commit": commit(), "rows": rows}


def _changed(path: Path, *changes: str):
    return load_scene(path, changes)


def chart(result: dict, path: Path) -> None:
    """Depth error, normal error and time against the triangles kept; numbers at the points are pixels."""
    exact, *levels = result["rows"]
    plain = [row for row in levels if row["depth_steps"] is None]
    star = levels[-1]
    figure, axes = plt.subplots(1, 3, figsize=(14, 4.3), constrained_layout=True)
    curves = [
        ("error of D [steps of 0.381 mm]", {
            "rms": lambda row: row["depth"]["rms_steps"], "95 %": lambda row: row["depth"]["p95_steps"],
            "95 %, nearer than 4 m": near}),
        ("error of C [degrees]", {"rms": lambda row: row["normal_deg"]["rms"],
                                  "95 %": lambda row: row["normal_deg"]["p95"]}),
        ("time and memory, all triangles = 1", {
            "image A": lambda row: row["seconds"]["A"] / exact["seconds"]["A"],
            "images C and D": lambda row: row["seconds"]["CD"] / exact["seconds"]["CD"],
            "memory": lambda row: row["memory_mb"] / exact["memory_mb"]}),
    ]
    for axis, (title, lines) in zip(axes, curves, strict=True):
        for number, (label, value) in enumerate(lines.items()):
            axis.plot([row["triangles"] for row in plain], [value(row) for row in plain], "o-", color=f"C{number}",
                      label=label)
            axis.plot(star["triangles"], value(star), "*", color=f"C{number}", markersize=14)
        first = next(iter(lines.values()))
        for row in plain:
            axis.annotate(f"{row['tolerance_px']:g}", (row["triangles"], first(row)), textcoords="offset points",
                          xytext=(4, 5), fontsize=8)
        axis.set(xlabel=f"thousands of triangles kept, of {exact['triangles'] / 1e3:.0f}", ylabel=title, xscale="log")
        axis.set_xticks([50e3, 100e3, 200e3, 400e3], ["50", "100", "200", "400"])
        axis.minorticks_off()
        axis.grid(True, which="both", alpha=0.3)
        axis.legend(fontsize=8)
    axes[0].set_yscale("log")
    axes[1].set_yscale("log")
    axes[2].set_ylim(bottom=0.0)
    figure.suptitle(f"{result['scene']}, {result['frames']} frames, {result['device']}; numbers are tolerance_px, "
                    f"the star is {star['tolerance_px']:g} with the limit of one step of D at 1 m")
    figure.savefig(path, dpi=110)


def near(row: dict) -> float:
    """The larger of the 95 % errors of depth at 1 to 2 and 2 to 4 m."""
    return max(part["p95_steps"] for part in row["depth"]["by_distance"] if part["nearest_m"][1] <= 4.0)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", type=Path, default=MUNKHOLMEN)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("-o", "--output", type=Path, default=HERE / "results" / "level_of_detail")
    arguments = parser.parse_args()
    result = measure(arguments.scene, arguments.device)
    arguments.output.with_suffix(".json").write_text(json.dumps(result, indent=1) + "\n")
    chart(result, arguments.output.with_suffix(".png"))


if __name__ == "__main__":
    main()
