"""References: many independent renderings of a scene, kept in a folder so that more can be added later."""

import hashlib
import json
from pathlib import Path

import numpy as np

from benchmarks.light.scenes import Built
from benchmarks.light.scores import Estimate
from benchmarks.machine import Stopwatch, commit
from varos_warp.render.renderer import FrameRenderer

SEED = 1_000_003
"""Of the first image of a reference; unlike any that is measured."""


def file_of(folder: Path, name: str, resolution, integrator: str) -> Path:
    """Where a reference is kept."""
    return folder / f"{name}_{resolution[0]}x{resolution[1]}_{integrator}.npz"


def fingerprint(built: Built) -> str:
    """What the light depends on: another one, and a reference is out of date."""
    scene, digest = built.scene, hashlib.sha256()
    blocks = {"vehicle", "materials", "surface_depth_m"}
    water = scene.water if isinstance(scene.water, str) else scene.water.model_dump(mode="json", exclude_none=True)
    digest.update(json.dumps([water, scene.model_dump(mode="json", include=blocks, exclude_defaults=True)]).encode())
    for part in built.parts:
        digest.update(np.round(part.vertices, 6).tobytes() + part.faces.tobytes())
        digest.update(part.material.model_dump_json(exclude_defaults=True).encode())
    digest.update(np.round(built.T_w_v, 6).tobytes())
    return digest.hexdigest()[:16]


def load(path: Path, built: Built, tell=print) -> Estimate | None:
    """The reference, if there is one of this scene as it is now."""
    if not path.exists():
        return None
    with np.load(path) as file:
        if str(file["fingerprint"]) != fingerprint(built):
            tell(f"{path.name}: the scene has changed since; it is not used")
            return None
        return Estimate(file["images"], file["spp"])


def extend(
    path: Path, name: str, built: Built, device: str, integrator: str, spp: int, count: int, seconds: float, tell=print
) -> None:
    """Render up to ``count`` images more and keep them; none is begun that would end after ``seconds``.

    Seconds are of the CPU, or on the clock if the device is a GPU. At least two images are kept.
    """
    known = load(path, built, tell)
    images, samples = ([], []) if known is None else (list(known.images), list(known.spp))
    renderer = FrameRenderer(built.scene, device, built.parts)
    how = {"outputs": "A", "integrator": integrator, "denoise": "none"}
    renderer.render(built.T_w_v, spp=2, seed=SEED - 1, **how)  # compiles
    watch = Stopwatch()
    for k in range(count):
        spent = watch.cpu_seconds if renderer.device == "cpu" else watch.seconds
        if k and len(images) >= 2 and spent * (k + 1) / k > seconds:
            break
        images.append(renderer.render(built.T_w_v, spp=spp, seed=SEED + len(images), **how).A.radiance)
        samples.append(spp)
    made = Estimate(np.array(images, np.float32), np.array(samples, float))
    _keep(path, made, built)
    error = np.sqrt((made.blocks[1] ** 2).mean(axis=(0, 1))) / made.whole[0]
    tell(
        f"{name}: {len(images)} images, {sum(samples):g} samples in all, {watch.seconds:.0f} s; standard error of a "
        f"block {100 * error.max():.2f} % of the mean"
    )


def _keep(path: Path, made: Estimate, built: Built) -> None:
    """Write a reference, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    kept = path.with_suffix(".tmp.npz")
    np.savez_compressed(kept, images=made.images, spp=made.spp, fingerprint=fingerprint(built), commit=commit())
    kept.replace(path)
