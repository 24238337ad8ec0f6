"""A long run of small frames: does anything grow? Samples memory, open files and threads, and writes a chart.

    python -m benchmarks.soak [--frames 10000] [--size 16x9] [--integrator path] [--device cpu]
        [-o benchmarks/results/soak_cpu]

The whole job runs (simulation, rendering of A, B, C and D, denoising, writing, exposure), with a camera that keeps
turning in a small scene. The rates are the slopes of straight lines through the samples after the first fifth of the
run, when all buffers are allocated.
"""

import argparse
import json
import os
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from benchmarks.machine import machine
from varos_warp.dataset.run.produce import produce
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict

SAMPLES = 100
"""At most so many samples of a run."""
SETTLED = 0.2
"""Share of a run after which nothing should grow any more."""
COUNTED = ("rss_mb", "handles", "threads")


def small_scene(frames: int, size: tuple[int, int], **render):
    """Two lights and a camera that turn over a rough floor; as many frames as asked for."""
    seconds = (frames - 1) / 10.0
    poses = [
        {"time_s": t, "position": [0, 0, 0], "rotation_euler_deg": [-20, 0, 40 * (k % 2)]}
        for k, t in enumerate(np.linspace(0.0, seconds, 2 + frames // 100))
    ]
    lamps = [
        {
            "kind": "spot",
            "position": [x, -0.1, 0],
            "direction": [0, 1, 0],
            "cone_deg": 65,
            "blend": 0.15,
            "intensity": [100, 100, 100],
        }
        for x in (-0.15, 0.15)
    ]
    return scene_from_dict(
        {
            "name": "soak",
            "seed": 1,
            "water": {
                "principled": {
                    "density": 0.125,
                    "color": [0.014, 0.146, 0.345],
                    "absorption_color": [0.0, 0.394, 1.0],
                    "anisotropy": 0.8,
                }
            },
            "terrain": {"kind": "procedural", "size_m": 20, "resolution": 33, "relief_m": 1.0},
            "objects": [
                {"kind": "pipe", "radius": 0.2, "length": 3.0, "position": [0, 4, 0], "rotation_euler_deg": [0, 90, 0]}
            ],
            "vehicle": {"lights": lamps, "cameras": [{"id": "M0", "resolution": list(size), "position": [0, 0, 1]}]},
            "trajectory": {"poses": poses},
            "render": {"frame_rate_hz": 10, "spp": 1, "spp_b": 1, **render},
        }
    )


def resources() -> dict[str, float]:
    """What the process holds: resident memory [MB], open handles, threads of the operating system."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return {
        "rss_mb": pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
        "handles": len(os.listdir("/proc/self/fd")),
        "threads": len(os.listdir("/proc/self/task")),
    }


class Watched(FrameRenderer):
    """A renderer that looks at the process every so many images."""

    def __init__(self, scene, device: str, every: int):
        super().__init__(scene, device)
        self.every, self.count, self.samples, self.start = every, 0, [], time.perf_counter()

    def render(self, *args, **options):
        """As `FrameRenderer.render`."""
        image = super().render(*args, **options)
        with self.launcher.turn:
            self.note()
        return image

    def note(self):
        """Look at the process, if it is time."""
        if self.count % self.every == 0:
            self.samples.append(
                {"frame": self.count, "seconds": round(time.perf_counter() - self.start, 2), **resources()}
            )
        self.count += 1


def growth(samples: list[dict]) -> dict[str, float]:
    """How much each kind grows with each frame once the run has settled: memory in bytes."""
    settled = samples[int(SETTLED * len(samples)) :]
    frame = [sample["frame"] for sample in settled]
    slopes = {name: float(np.polyfit(frame, [sample[name] for sample in settled], 1)[0]) for name in COUNTED}
    return {"bytes": 1e6 * slopes["rss_mb"], "handles": slopes["handles"], "threads": slopes["threads"]}


def soak(frames: int, size: tuple[int, int], device: str, out: Path, **render) -> dict:
    """Run, and return the samples and what they say.

    Args:
        frames: How many.
        size: Width and height [px].
        device: ``cpu`` or ``cuda:N``.
        out: Folder of the dataset.
        **render: Keys of the scene's block of that name.
    """
    scene = small_scene(frames, size, **render)
    before, wall, cpu = threading.active_count(), time.perf_counter(), time.process_time()
    renderer = Watched(scene, device, max(1, frames // SAMPLES))
    summary = produce(scene, out, device=device, renderer=renderer, quiet=True)
    if not summary.complete:
        raise RuntimeError("the dataset is not complete")
    return {
        "machine": machine(device),
        "frames": frames,
        "size": list(size),
        "render": render,
        "images": summary.rendered,
        "seconds": round(time.perf_counter() - wall, 1),
        "cpu_seconds": round(time.process_time() - cpu, 1),
        "stages": summary.stages,
        "growth_per_frame": growth(renderer.samples),
        "after": resources(),
        "python_threads_left": threading.active_count() - before,
        "samples": renderer.samples,
    }


def chart(result: dict, path: Path) -> None:
    """Memory above, handles and threads below, over the frames."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    frame = [sample["frame"] for sample in result["samples"]]
    figure, axes = plt.subplots(2, 1, figsize=(9, 5.5), sharex=True, constrained_layout=True)
    for axis, names in zip(axes, (COUNTED[:1], COUNTED[1:]), strict=True):
        for name in names:
            axis.plot(frame, [sample[name] for sample in result["samples"]], label=name)
        axis.set_ylim(0.0, 1.15 * max(sample[name] for sample in result["samples"] for name in names))
        axis.grid(alpha=0.3)
        axis.legend()
    axes[0].set(ylabel="resident memory [MB]")
    axes[1].set(xlabel="frame", ylabel="count")
    width, height = result["size"]
    figure.suptitle(
        f"{result['frames']} frames of {width} x {height}, A B C D: "
        f"{result['growth_per_frame']['bytes'] / 1e3:.2f} kB a frame, {result['seconds']:.0f} s on "
        f"{result['machine']['cores']} cores",
        fontsize=11,
    )
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--size", default="16x9")
    parser.add_argument("--integrator", default="auto")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("-o", "--out", type=Path, default=Path(__file__).parent / "results" / "soak_cpu")
    options = parser.parse_args()
    size = tuple(map(int, options.size.split("x")))
    with tempfile.TemporaryDirectory() as folder:
        result = soak(options.frames, size, options.device, Path(folder) / "soak", integrator=options.integrator)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.with_suffix(".json").write_text(json.dumps(result, indent=1) + "\n")
    chart(result, options.out.with_suffix(".png"))
    print(json.dumps({key: value for key, value in result.items() if key != "samples"}, indent=1))


if __name__ == "__main__":
    main()
