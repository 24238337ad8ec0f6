"""Strong scaling: the same frames with 1, 2, 4 ... workers on this host, one per GPU.

    python -m benchmarks.scaling [--scene examples/munkholmen/scene.yaml] [--frames 200] [--step 1] [--workers 1,2,4]
        [--device auto] [--set KEY=VALUE ...] [-o benchmarks/results/scaling.json]

Each run is the whole job, with all files written. The rate is that between the first and the last image; compiling
(done by an extra run), loading and planning are listed separately. 0 workers means one process. Workers on a CPU share
its cores, so more of them are no faster: there only the overhead is measured.
"""

import json
import tempfile
from functools import partial
from pathlib import Path

from benchmarks.machine import MUNKHOLMEN, RESULTS, command, counts, machine, save
from varos_warp.dataset.run.produce import produce
from varos_warp.device.devices import resolve_device
from varos_warp.scene.file.load import load_scene


def measure(scene, frames: int, workers: int, device: str, out: Path, step: int = 1) -> dict:
    """One run, of every ``step``-th frame, with so many workers; 0: none, all in this process."""
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


def scaling(scene, frames: int, workers: list[int], device: str, folder: Path, step: int, keep) -> dict:
    """All runs, after one that compiles, and what they gained over one worker; ``keep`` is told after each."""
    measure(scene, max(1, *workers), max(workers), device, folder / "first")
    rows, result = [], {}
    for count in workers:
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
        print(json.dumps({key: value for key, value in result["runs"][-1].items() if key != "stages"}))
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


def main() -> None:
    parser = command(__doc__)
    parser.add_argument("--scene", type=Path, default=MUNKHOLMEN)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--step", type=int, default=1, help="Every so many-th frame, over a long course.")
    parser.add_argument("--workers", type=counts, default="0,1,2,4", help="Numbers of workers; 0: one process.")
    parser.add_argument("--set", dest="changed", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("-o", "--out", type=Path, default=RESULTS / "scaling.json")
    asked = parser.parse_args()
    scene = load_scene(asked.scene, asked.changed)
    with tempfile.TemporaryDirectory() as folder:
        scaling(scene, asked.frames, asked.workers, asked.device, Path(folder), asked.step, partial(save, asked.out))


if __name__ == "__main__":
    main()
