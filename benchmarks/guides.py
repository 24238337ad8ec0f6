"""Error of denoised A with and without guides for its correction, on unlike scenes.

    python -m benchmarks.guides [--device cuda:0] [--scenes coastal,starter] [-o benchmarks/results/guides.json]

For each scene, integrator and number of samples: relative RMSE of the worst channel, 99 % of all 8 x 8 blocks and the
worst one, in percent, over `SEEDS` images, when the denoiser is guided by
    none        nothing
    surfaces    albedo and normals of surfaces at full strength, whatever water is before them
    light       those of surfaces as far as light comes from them, and the base itself (render/image/denoise.py)
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import warp as wp

from benchmarks.ambient import SCENES as FILES
from benchmarks.light import scores
from benchmarks.light.scenes import SCENES as UNLIKE
from benchmarks.light.scenes import Built, build
from benchmarks.light.scores import Estimate
from benchmarks.machine import machine
from varos_warp.device.devices import resolve_device, upload
from varos_warp.device.launcher import Launcher
from varos_warp.render.image.denoise import PART_QUALITY, Denoiser, denoise_image
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import load_scene
from varos_warp.scene.geometry.build import build_parts
from varos_warp.sim.trajectory import simulate

ROOT = Path(__file__).parents[1]
TEMPLATES = {name: ROOT / f"varos_warp/data/templates/{name}.yaml" for name in ("turbid_water", "static_observer")}
SCENES = [name for name in (*UNLIKE, *FILES, *TEMPLATES) if name != "open_coastal"]  # which has no surfaces
RESOLUTION = (320, 180)
SEEDS, SPP, ESTIMATES, ESTIMATE_SPP = 4, (2, 8), 8, 512


def built(name: str) -> Built:
    """An unlike scene, or the middle of a file's sequence."""
    if name in UNLIKE:
        return build(name, RESOLUTION)
    scene = load_scene((FILES | TEMPLATES)[name], (f"vehicle.cameras.0.resolution={list(RESOLUTION)}",))
    poses = list(simulate(scene).frames.poses())
    return Built(scene, build_parts(scene), poses[len(poses) // 2])


def denoised(image, **guides: np.ndarray) -> np.ndarray:
    """`denoise_image` with the correction guided otherwise."""
    base, correction = image.radiance - image.correction, image.correction
    clean = denoise_image(replace(image, radiance=base, correction=np.zeros_like(base), albedo=None), "oidn")
    there = partial(upload, dtype=wp.vec3, device="cpu")
    result, part, denoiser = there(clean), there(correction), Denoiser(Launcher("cpu"))
    for sign in (1.0, -1.0):
        denoiser.add_denoised(result, part, sign, PART_QUALITY, {name: there(guide) for name, guide in guides.items()})
    return np.maximum(result.numpy(), np.float32(0.0))


def ways(frame) -> dict[str, np.ndarray]:
    """A as it is denoised with each of the guides."""
    found = {"none": denoised(frame.A), "surfaces": denoised(frame.A, albedo=frame.B.albedo, normal=frame.B.normal)}
    return found | ({} if frame.A.albedo is None else {"light": denoise_image(frame.A, "oidn")})


def measured(name: str, device: str) -> Iterator[dict]:
    """A row for each integrator, number of samples and guide."""
    scene, parts, T_w_v = built(name)
    renderer = FrameRenderer(scene, device, parts)

    def rendered(seed: int, **how):
        return renderer.render(T_w_v, seed=seed, outputs="AB", denoise_b="oidn", spp_b=8, **how)

    how = {"integrator": "field", "spp": ESTIMATE_SPP}
    reference = Estimate(np.array([rendered(900 + k, **how).A.radiance for k in range(ESTIMATES)]))
    for integrator in ("field", "path"):
        for spp in SPP:
            frames = [ways(rendered(seed, integrator=integrator, spp=spp)) for seed in range(1, SEEDS + 1)]
            for guides in frames[0]:
                images = np.array([frame[guides] for frame in frames])
                row = scores.block_row(images, reference)
                yield {
                    "scene": name,
                    "integrator": integrator,
                    "spp": spp,
                    "guides": guides,
                    "error": round(100 * float(scores.relative_rmse(images, reference).max()), 3),
                    "block_99": round(100 * row["block_99"], 2),
                    "worst_block": round(100 * row["block_worst"], 2),
                }


def main() -> None:
    """Print the rows, and write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", type=resolve_device, default="cuda:0")
    parser.add_argument("--scenes", type=lambda text: text.split(","), default=SCENES)
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "benchmarks/results/guides.json")
    options = parser.parse_args()
    head = {"machine": machine(options.device), "resolution": RESOLUTION, "seeds": SEEDS}
    rows = []
    for name in options.scenes:
        for row in measured(name, options.device):
            rows.append(row)
            print(json.dumps(row), flush=True)
        options.out.parent.mkdir(parents=True, exist_ok=True)
        lines = ",\n".join(json.dumps(row) for row in rows)
        options.out.write_text(f'{json.dumps(head)[:-1]}, "rows": [\n{lines}\n]}}\n')


if __name__ == "__main__":
    main()
