"""Are plans kept? On many scenes, is the error within the predicted one?

    python -m benchmarks.planned [NAMES...] [--device cuda:0] [-o benchmarks/results/planned.json]

For each scene: the plan, images rendered by it, their error measured with independent estimates of far more samples,
and their time. The field and the kernels are made before the clock starts. Writes a row per scene as they come.
"""

import json
from pathlib import Path

import numpy as np

from benchmarks.machine import Stopwatch, command, machine, save
from benchmarks.scenes import HERE, BenchScene
from varos_warp.device.launcher import timed
from varos_warp.render.field.open_water import unavailable
from varos_warp.render.image.adapt import brightness
from varos_warp.render.planner import errors
from varos_warp.render.planner.plan import plan_render
from varos_warp.render.renderer import FrameRenderer, resolve_integrator
from varos_warp.scene.file.load import demo_scene_path

EXAMPLE = HERE.parent / "examples/munkholmen/scene.yaml"
SIZE = "vehicle.cameras.0.resolution=[320,180]"
CLEAR, REF1 = HERE / "scenes/floor_clear.yaml", HERE / "scenes/ref1/scene.yaml"
PAPER = (
    "water={principled: {density: 0.125, color: [0.014, 0.146, 0.345], absorption_color: [0.0, 0.394, 1.0], "
    "anisotropy: 0.8}}"
)
ABOVE = "trajectory.poses=[{position: [0, 0, 6], look_at: [0, 3, 0]}]"
NEAR = "trajectory.poses=[{position: [-0.4, 3.0, 0.9], look_at: [0, 5, 0.2]}]"


def jerlov(kind: str) -> str:
    """Water of a Jerlov type, with its phase function."""
    return f"water={{jerlov: {{type: {kind}}}}}"


def case(title: str, path: Path, changes: tuple[str, ...] = (), frame: int = 0) -> BenchScene:
    """A scene of a file, small, with what it differs in."""
    return BenchScene(title, title, path, (SIZE, "render.spp=null", *changes), frame)


CASES = {
    "clear": case("Jerlov IA", CLEAR, (jerlov("IA"),)),
    "oceanic": case("Jerlov II", CLEAR, (jerlov("II"),)),
    "paper": case("the paper's water", CLEAR, (PAPER,)),
    "paper_above": case("the paper's water, from 6 m", CLEAR, (PAPER, ABOVE)),
    "ref1": case("ref1: 522 000 triangles", REF1, ("render.denoise=oidn",)),
    "ref1_plain": case("ref1 without a denoiser, 3 %", REF1, ("render.denoise=none", "render.tolerance=0.03")),
    "ref1_tight": case("ref1, 1 %", REF1, ("render.denoise=oidn", "render.tolerance=0.01")),
    "ref1_loose": case(
        "ref1, 5 %, 1280 x 720",
        REF1,
        ("render.denoise=oidn", "render.tolerance=0.05", "vehicle.cameras.0.resolution=[1280,720]"),
    ),
    "demo": case("the demo: textures, lens", demo_scene_path(), ("render.spp=null",), 6),
    "ocean_III": case("Jerlov III, from 6 m", CLEAR, (jerlov("III"), ABOVE)),
    "near_IB": case("Jerlov IB, near by", CLEAR, (jerlov("IB"), NEAR)),
    "munkholmen": case("examples/munkholmen: 759 000 triangles, textures, stones", EXAMPLE, frame=60),
    "coastal": case("Jerlov 1C", CLEAR, (jerlov("1C"),)),
    "turbid": case("Jerlov 3C", CLEAR, (jerlov("3C"),)),
    "harbour": case("Jerlov 5C, near by", CLEAR, (jerlov("5C"), NEAR)),
    "boom": case(
        "lights a metre off",
        CLEAR,
        (PAPER, *(f"vehicle.lights.{i}.position=[{x},0,0]" for i, x in enumerate((-1.0, 1.0)))),
    ),
    "peaked": case("Jerlov II with g = 0.95", CLEAR, ("water={jerlov: {type: II, phase: {g: 0.95}}}",)),
    "fixed_camera": case(
        "a camera in the world",
        CLEAR,
        (
            PAPER,
            "vehicle.cameras.0.mount=world",
            "vehicle.cameras.0.position=[-1.5,1,1.3]",
            "vehicle.cameras.0.look_at=[0,5,0.2]",
            "render.tolerance=0.03",
        ),
    ),
    "no_water": case("no water", CLEAR, ("water=none", "render.tolerance=0.02")),
}

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
