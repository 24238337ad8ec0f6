"""Are plans kept? On many scenes, is the error within the predicted one?

    python -m benchmarks.planned [NAMES...] [--device cuda:0] [-o benchmarks/results/planned.json]

For each scene: the plan, images rendered by it, their error measured with independent estimates of far more samples,
and their time. The field and the kernels are made before the clock starts. Writes a row per scene as they come.
"""

import json
from pathlib import Path

import numpy as np
import yaml

from benchmarks.machine import Stopwatch, command, machine, save
from benchmarks.scenes import HERE, BenchScene
from varos_warp.device.launcher import timed
from varos_warp.render.field.open_water import unavailable
from varos_warp.render.image.adapt import brightness
from varos_warp.render.planner import errors
from varos_warp.render.planner.plan import plan_render
from varos_warp.render.renderer import FrameRenderer, resolve_integrator

SMALL = ("vehicle.cameras.0.resolution=[320,180]", "render.spp=null")
FLOOR = "benchmarks/scenes/floor_clear.yaml"


def case(said: dict) -> BenchScene:
    """What planned.yaml says, of which lists of changes may hold lists."""
    changes = [c for change in said.get("changes", ()) for c in ([change] if isinstance(change, str) else change)]
    path = HERE.parent / said.get("file", FLOOR)
    return BenchScene(said["title"], said["title"], path, (*SMALL, *changes), said.get("frame", 0))


CASES = {name: case(said) for name, said in yaml.safe_load((HERE / "planned.yaml").read_text()).items()}
SEEDS, RUNS = 9000, 3
ESTIMATE_SPP = {"field": 512, "path": 2048}
ESTIMATES, ESTIMATE_SECONDS = 4, 8.0
"""Fewest images, and seconds in which more are made until their noise is a fifth of the tolerance."""


def noise(images: list[np.ndarray]) -> float:
    """Relative RMSE of the mean of independent images, worst channel."""
    variance = np.var(images, axis=0, ddof=1).mean((0, 1)) / len(images)
    return float(np.max(np.sqrt(variance) / brightness(np.mean(images, axis=(0, 1, 2)))))


class Bench:
    """One case on one device."""

    def __init__(self, seen: BenchScene, device: str):
        self.seen, self.device, self.scene = seen, device, seen.scene
        self.renderer = FrameRenderer(self.scene, device, seen.parts)
        self.denoise = self.scene.render.denoise

    def image(self, seed: int, **how):
        """One image A."""
        return self.renderer.render(self.seen.T_w_v, self.seen.camera, "A", seed=SEEDS + seed, **how).A

    def estimates(self) -> list[np.ndarray]:
        """Independent images with the field, whose own error `plan.FIELD_ERROR` states, or else by paths."""
        return self.many(resolve_integrator("auto", None, lambda: unavailable(self.scene)))

    def many(self, integrator: str) -> list[np.ndarray]:
        """Independent images with many samples each."""
        watch, images = Stopwatch(), []
        while len(images) < ESTIMATES or (
            noise(images) > 0.2 * self.scene.render.tolerance and watch.seconds < ESTIMATE_SECONDS
        ):
            image = self.image(-1 - len(images), integrator=integrator, spp=ESTIMATE_SPP[integrator]).radiance
            images.append(image.astype(float))
        return images

    def measure(self, estimates: list, runs: int = RUNS, **how) -> dict:
        """Error per channel, as the planner means it, and median seconds of an image."""
        self.image(0, denoise=self.denoise, **how)
        images, seconds = [], []
        for k in range(runs):
            watch = Stopwatch()
            image = self.image(1 + k, denoise=self.denoise, **how)
            seconds.append(watch.seconds if self.device != "cpu" else watch.cpu_seconds)
            images.append((image.radiance if self.denoise == "none" else image.denoised).astype(float))
        error = errors.error(images, estimates, sigmas=0.0)
        return {"error": error.tolist(), "seconds": float(np.median(seconds)), "spp": image.spp}


def check(name: str, device: str) -> dict:
    """One row."""
    bench = Bench(CASES[name], device)
    estimates, tolerance = bench.estimates(), bench.scene.render.tolerance
    bench.image(0, spp=1)
    plan, planning = timed(bench.renderer, lambda: plan_render(bench.scene, bench.renderer, [bench.seen.T_w_v]))
    made = bench.measure(estimates, **plan.options)
    return {
        "case": name,
        "title": bench.seen.title,
        "tolerance": tolerance,
        "plan": plan.to_dict(),
        "predicted": plan.error.tolist(),
        "measured": made["error"],
        "seconds": made["seconds"],
        "spp": made["spp"],
        "planning_s": planning,
        "estimates_noise": noise(estimates),
        "bounded": bool(np.all(np.array(made["error"]) <= plan.error)),
        "kept": bool(max(made["error"]) <= tolerance),
    }


TOLD = ("case", "predicted", "measured", "spp", "seconds", "planning_s", "estimates_noise")


def main():
    parser = command(__doc__, device="cuda:0")
    parser.add_argument("names", nargs="*", choices=[*CASES, []])
    parser.add_argument("-o", "--out", type=Path, default=Path("planned.json"))
    asked = parser.parse_args()
    rows: list[dict] = json.loads(asked.out.read_text())["rows"] if asked.out.exists() else []
    for name in asked.names or CASES:
        row = check(name, asked.device)
        rows = [old for old in rows if old["case"] != name] + [row]
        save(asked.out, {**machine(asked.device), "rows": rows})
        print({key: row[key] for key in TOLD}, flush=True)


if __name__ == "__main__":
    main()
