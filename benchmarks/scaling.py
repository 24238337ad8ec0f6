"""Strong scaling: the same frames with 1, 2, 4 ... workers on this host, one per GPU; writes numbers and a chart.

    python -m benchmarks.scaling [--scene examples/munkholmen/scene.yaml] [--frames 200] [--step 1] [--workers 1,2,4]
        [--device auto] [--set KEY=VALUE ...] [-o benchmarks/results/scaling]

Each run is the whole job, with all files written. The rate is that between the first and the last image; compiling
(done by an extra run), loading and planning are listed separately. 0 workers means one process. Workers on a CPU share
its cores, so more of them are no faster: there only the overhead is measured.
"""

import argparse
import json
import os
import tempfile
from pathlib import Path

from benchmarks.machine import machine
from varos_warp.dataset.run.produce import produce
from varos_warp.device.devices import resolve_device
from varos_warp.scene.file.load import load_scene

ROOT = Path(__file__).parents[1]
MUNKHOLMEN = ROOT / "examples" / "munkholmen" / "scene.yaml"


def measure(scene, frames: int, workers: int, device: str, out: Path, step: int = 1) -> dict:
    """One run.

    Args:
        scene: The scene.
        frames: How many of its frames.
        workers: Processes; 0: none, all in this one.
        device: As `produce` has it.
        out: Folder to make.
        step: Every so many-th frame.
    """
    summary = produce(
        scene, out, device=device, frames=slice(0, step * frames, step), workers=workers or None, quiet=True
    )
    logs = [json.loads(path.read_text()) for path in (out / "log").glob("*.json")]
    seconds, spp = summary.stages, [entry["spp"] for log in logs for entry in log["frames"] if "spp" in entry]
    ending, images = seconds["expose"] + seconds["checksums"], sum(len(log["frames"]) for log in logs)
    return {
        "workers": workers,
        "device": summary.device,
        "frames": frames,
        "images": summary.rendered,
        "frames_per_s": summary.rate,
        "seconds": summary.seconds,
        "until_first_image_s": round(summary.seconds - ending - (images - 1) / summary.rate, 2),
        "load_s": seconds["load"],
        "plan_s": seconds["plan"],
        "expose_and_checksums_s": ending,
        "compile_s": max(log["compile_seconds"] for log in logs),
        "spp": round(sum(spp) / len(spp), 2) if spp else None,
        "stages": seconds,
        "checksums": (out / "checksums").read_text(),
    }


def scaling(
    scene,
    frames: int,
    counts: list[int],
    device: str,
    folder: Path,
    compiled: bool = False,
    step: int = 1,
    say=print,
    keep=lambda result: None,
) -> dict:
    """All runs, and what they gained over one worker; ``keep`` is told after each."""
    if not compiled:
        measure(scene, max(1, *counts), max(counts), device, folder / "first")
    rows = []
    for count in counts:
        rows.append(measure(scene, frames, count, device, folder / str(count), step))
        result = {
            "machine": machine(resolve_device(device)),
            "scene": scene.name,
            "frames": frames,
            "differ": differ([row["checksums"] for row in rows]),
            "resolution": scene.vehicle.cameras[0].resolution,
            "outputs": scene.render.outputs,
            "runs": [compared(row, rows) for row in rows],
        }
        say(json.dumps({key: value for key, value in result["runs"][-1].items() if key != "stages"}))
        keep(result)
    return result


def differ(checksums: list[str]) -> list[str]:
    """Names of files whose bytes are not the same in all datasets, by the text of their checksums."""
    lines = [{*text.splitlines()} for text in checksums]
    return sorted({line.split(maxsplit=1)[1] for line in set.union(*lines) - set.intersection(*lines)})


def compared(row: dict, rows: list[dict]) -> dict:
    """A run with what it gained over one worker, without its checksums."""
    one = next((other["frames_per_s"] for other in rows if other["workers"] == 1), None)
    gained = round(row["frames_per_s"] / (one * row["workers"]), 3) if one and row["workers"] else None
    return {key: value for key, value in row.items() if key != "checksums"} | {"efficiency": gained}


def chart(result: dict, path: Path) -> None:
    """Rate against workers with the straight line of one worker's, and the seconds that are spent once."""
    import matplotlib.pyplot as plt

    from benchmarks.chart import save, subtitle

    rows = sorted((row for row in result["runs"] if row["workers"]), key=lambda row: row["workers"])
    if not rows:
        return
    counts, rates = [row["workers"] for row in rows], [row["frames_per_s"] for row in rows]
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.8), constrained_layout=True)
    left.plot(counts, [rates[0] / counts[0] * n for n in counts], "--", color="#999999", label="in proportion")
    left.plot(counts, rates, "o-", label="workers")
    for row in rows:
        left.annotate(
            f"{row['frames_per_s']:.3g}" + (f", {row['efficiency']:.0%}" if row["efficiency"] else ""),
            (row["workers"], row["frames_per_s"]),
            textcoords="offset points",
            xytext=(6, -12),
            fontsize=9,
        )
    for row in (row for row in result["runs"] if not row["workers"]):
        left.axhline(row["frames_per_s"], color="C2", linestyle=":", label=f"one process: {row['frames_per_s']:.3g}")
    left.set(
        xlabel="workers",
        ylabel="frames/s from the first image on, all files written",
        ylim=(0, None),
        xticks=counts,
        xlim=(0, 1.2 * counts[-1]),
    )
    left.legend(fontsize=9)
    bottom = [0.0] * len(rows)
    for name in ("until_first_image_s", "expose_and_checksums_s"):
        heights = [row[name] for row in rows]
        right.bar([str(n) for n in counts], heights, bottom=bottom, label=name[:-2].replace("_", " "))
        bottom = [low + height for low, height in zip(bottom, heights, strict=True)]
    right.set(xlabel="workers", ylabel="seconds that are spent once")
    right.margins(y=0.25)
    right.legend(fontsize=9, loc="upper center", ncols=2)
    width, height = result["resolution"]
    figure.suptitle(
        f"{result['scene']}: {result['frames']} frames of {width} x {height}, "
        f"{''.join(result['outputs'])}\n{subtitle(result)}",
        fontsize=11,
    )
    save(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", type=Path, default=MUNKHOLMEN)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--step", type=int, default=1, help="Every so many-th frame, over a long course.")
    parser.add_argument("--workers", default="0,1,2,4", help="Numbers of workers; 0: one process.")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--compiled", action="store_true", help="Kernels are in the cache: no run before the others.")
    parser.add_argument("--set", dest="changed", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "benchmarks" / "results" / "scaling")
    parser.add_argument("--folder", type=Path, help="Where the datasets go for a while; a temporary folder by default.")
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)

    def keep(result):
        options.out.with_suffix(".json").write_text(json.dumps(result, indent=1) + "\n")

    counts = [int(count) for count in options.workers.split(",")]
    if options.folder:
        os.makedirs(options.folder, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        result = scaling(
            load_scene(options.scene, options.changed),
            options.frames,
            counts,
            options.device,
            Path(folder),
            options.compiled,
            options.step,
            keep=keep,
        )
    chart(result, options.out.with_suffix(".png"))


if __name__ == "__main__":
    main()
