"""A long run of small frames: does anything grow? Samples memory, open files and threads, and writes a chart.

    python -m benchmarks.soak [--frames 10000] [--size 16x9] [--integrator path] [--device cpu]
        [-o benchmarks/results/soak_cpu]

The whole job runs (simulation, rendering of A, B, C and D, denoising, writing, exposure), with a camera that keeps
turning in a small scene. The rates are the slopes of straight lines through the samples after the first fifth of the
run, when all buffers are allocated.
"""

import json
import os
import tempfile
import threading
from pathlib import Path

import numpy as np

from benchmarks.chart import plt, save_figure
from benchmarks.light.shapes import PAPER, paper_lamps
from benchmarks.machine import RESULTS, Stopwatch, command, machine, save, size
from varos_warp.dataset.run.produce import produce
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict

SAMPLES = 100
"""Most samples of a run."""
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
    pipe = {"kind": "pipe", "radius": 0.2, "length": 3.0, "position": [0, 4, 0], "rotation_euler_deg": [0, 90, 0]}
    camera = {"id": "M0", "resolution": list(size), "position": [0, 0, 1]}
    return scene_from_dict(
        {
            "name": "soak",
            "seed": 1,
            "water": PAPER,
            "terrain": {"kind": "procedural", "size_m": 20, "resolution": 33, "relief_m": 1.0},
            "objects": [pipe],
            "vehicle": {"lights": paper_lamps(), "cameras": [camera]},
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


def python_threads() -> int:
    """Threads of Python, but for the helpers that a process keeps from first use on (device/launch.py)."""
    return sum(not thread.name.startswith("helper") for thread in threading.enumerate())


class Watched(FrameRenderer):
    """A renderer that looks at the process every so many images."""

    def __init__(self, scene, device: str, every: int):
        super().__init__(scene, device)
        self.every, self.count, self.samples, self.watch = every, 0, [], Stopwatch()

    def render(self, *args, **options):
        """Render as `FrameRenderer.render` does, and note the memory."""
        image = super().render(*args, **options)
        with self.launcher.turn:
            self.note()
        return image

    def note(self):
        """Look at the process, if it is time."""
        if self.count % self.every == 0:
            self.samples.append({"frame": self.count, "seconds": round(self.watch.seconds, 2), **resources()})
        self.count += 1


def growth(samples: list[dict]) -> dict[str, float]:
    """How much each kind grows with each frame once the run has settled: memory in bytes."""
    settled = samples[int(SETTLED * len(samples)) :]
    frame = [sample["frame"] for sample in settled]
    slopes = {name: float(np.polyfit(frame, [sample[name] for sample in settled], 1)[0]) for name in COUNTED}
    return {"bytes": 1e6 * slopes["rss_mb"], "handles": slopes["handles"], "threads": slopes["threads"]}


def soak(frames: int, size: tuple[int, int], device: str, out: Path, **render) -> dict:
    """Run, with keys of the scene's block ``render``, and return the samples and what they say."""
    scene = small_scene(frames, size, **render)
    before, watch = python_threads(), Stopwatch()
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
        "seconds": round(watch.seconds, 1),
        "cpu_seconds": round(watch.cpu_seconds, 1),
        "stages": summary.stages,
        "growth_per_frame": growth(renderer.samples),
        "after": resources(),
        "python_threads_left": python_threads() - before,
        "samples": renderer.samples,
    }


def chart(result: dict, path: Path) -> None:
    """Memory above, handles and threads below, over the frames."""
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
    save_figure(figure, path)


def main() -> None:
    parser = command(__doc__, device="cpu")
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--size", type=size, default="16x9")
    parser.add_argument("--integrator", default="auto")
    parser.add_argument("-o", "--out", type=Path, default=RESULTS / "soak_cpu")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "soak"
        result = soak(options.frames, options.size, options.device, out, integrator=options.integrator)
    save(options.out.with_suffix(".json"), result)
    chart(result, options.out.with_suffix(".png"))
    print(json.dumps({key: value for key, value in result.items() if key != "samples"}, indent=1))


if __name__ == "__main__":
    main()
