"""Peers measured: error against CPU-seconds on ref1, and whether all programs mean the same light."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks import peers
from benchmarks.errors import measure
from benchmarks.machine import Stopwatch, machine
from benchmarks.scenes import BenchScene, find, references
from varos_warp.dataset.files import write_json
from varos_warp.errors import InputError
from varos_warp.render.frame import FrameRenderer

HERE = Path(__file__).parent
REF1 = {"mitsuba": (False, (4, 16, 64, 256)), "cycles": (False, (4, 16, 64)), "cycles+oidn": (True, (16, 64))}
"""Whether denoised, and samples per pixel."""
REPEATS = ((16, 4), (64, 2))
"""Renderings with different random numbers up to so many samples; fireflies make one alone a matter of luck."""
AGREEMENT = (BenchScene("turbid", "g = 0.9, a lamp 1 m off the camera", HERE / "turbid.yaml"),
             BenchScene("soft_cone", "soft edges", HERE / "soft_cone.yaml"))
REPLICATES = 8
"""Renderings whose spread is the standard error of an image's mean."""


def peer_image(bench: BenchScene, name: str, **how) -> peers.PeerImage:
    """A scene by a peer."""
    return peers.render(name, bench.scene, bench.parts, bench.camera, bench.T_w_v, **how)


def measure_ref1(output: Path, most: int) -> None:
    """Write a row for every peer that is installed and every number of samples up to ``most``."""
    bench = find(["ref1"])[0]
    reference = references(bench, "cpu")["full"]
    rows = []
    for label, (denoise, ladder) in REF1.items():
        name = label.split("+")[0]
        if name not in peers.available():
            continue
        for spp in (spp for spp in ladder if spp <= most):
            repeats = next((count for limit, count in REPEATS if spp <= limit), 1)
            made = [peer_image(bench, name, spp=spp, denoise=denoise, seed=seed) for seed in range(repeats)]
            times = {key: float(np.median([getattr(image, key) for image in made]))
                     for key in ("seconds", "cpu_seconds", "setup_seconds")}
            errors = measure(np.array([image.radiance for image in made], float), reference)
            load = os.getloadavg()[0]  # beside others a CPU-second is worth down to half of one alone
            rows.append({"method": label, "spp": spp, "repeats": repeats, **times, "load": load, **errors,
                         "version": made[0].version, "note": made[0].note})
            print(f"{label} {spp} spp: {times['cpu_seconds']:.3g} CPU-s, rmse {errors['rmse']:.3g}, "
                  f"median {errors['median']:.3g}", flush=True)
            write_json(output, {"scene": "ref1", "machine": machine("cpu"), "rows": rows})


# ---------------------------------------------------------------------------------------------------------- agreement


@dataclass(frozen=True)
class Estimate:
    """Mean over an image per channel, its standard error, and what it cost."""

    mean: np.ndarray
    stderr: np.ndarray
    spp: int
    cpu_seconds: float


def estimate(image, seconds: float) -> Estimate:
    """Image mean by renderings of one program, about ``seconds`` of CPU together.

    Args:
        image: ``(spp, seed)`` to linear radiance [H, W, 3] and CPU seconds.
        seconds: for all renderings together.
    """
    _, cost = image(16, 0)
    spp = int(np.clip(16 * seconds / REPLICATES / max(cost, 1e-3), 16, 1 << 14))
    made = [image(spp, seed) for seed in range(1, REPLICATES + 1)]
    means = np.array([radiance.mean(axis=(0, 1), dtype=float) for radiance, _ in made])
    stderr = means.std(axis=0, ddof=1) / np.sqrt(REPLICATES)
    return Estimate(means.mean(axis=0), stderr, spp, sum(cpu for _, cpu in made))


def programs(bench: BenchScene) -> dict:
    """Everything that renders a scene here: name to what `estimate` takes."""
    renderer = FrameRenderer(bench.scene, "cpu", bench.parts)

    def ours(integrator, spp, seed):
        watch = Stopwatch()
        how = {"integrator": integrator, "spp": spp, "seed": seed, "denoise": "none"}
        image = renderer.render(bench.T_w_v, bench.camera, "A", **how).A
        return image.radiance, watch.cpu_seconds

    def peer(name, spp, seed):
        made = peer_image(bench, name, spp=spp, seed=seed)
        return made.radiance, made.cpu_seconds

    return {name: (lambda spp, seed, name=name: ours(name, spp, seed)) for name in ("path", "field")} | {
        name: (lambda spp, seed, name=name: peer(name, spp, seed)) for name in peers.available()}


def agreement(seconds: float) -> None:
    """Print a table in Markdown: image means, and how far each is from that of ``path`` in % and standard errors."""
    print("| scene | program | spp | CPU-s | mean R / G / B | off `path` [%] | of which error (1 sigma) [%] |")
    print("|---|---|---|---|---|---|---|")
    for bench in AGREEMENT:
        truth = None
        for name, image in programs(bench).items():
            try:
                found = estimate(image, seconds)
            except InputError as error:
                print(f"| {bench.name} | {name} | refused: {error.problem} | | | | |", flush=True)
                continue
            truth = truth or found
            off = 100.0 * (found.mean / truth.mean - 1.0)
            error = 100.0 * (np.hypot(found.stderr, truth.stderr if found is not truth else 0.0)) / truth.mean
            print(f"| {bench.name} | {name} | {REPLICATES} x {found.spp} | {found.cpu_seconds:.0f} | "
                  f"{_row(found.mean, '.5f')} | {_row(off, '+.2f')} | {_row(error, '.2f')} |", flush=True)


def _row(values, form):
    return " / ".join(format(value, form) for value in values)
