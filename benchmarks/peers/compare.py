"""Peers measured: error against CPU-seconds on ref1."""

import os
from pathlib import Path

import numpy as np

from benchmarks import peers
from benchmarks.errors import measure
from benchmarks.machine import machine
from benchmarks.scenes import BenchScene, find, references
from varos_warp.dataset.files import write_json

REF1 = {"mitsuba": (False, (4, 16, 64, 256)), "cycles": (False, (4, 16, 64)), "cycles+oidn": (True, (16, 64))}
"""Whether denoised, and samples per pixel."""
REPEATS = ((16, 4), (64, 2))
"""Renderings with different random numbers up to so many samples; fireflies make one alone a matter of luck."""


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
            times = {
                key: float(np.median([getattr(image, key) for image in made]))
                for key in ("seconds", "cpu_seconds", "setup_seconds")
            }
            errors = measure(np.array([image.radiance for image in made], float), reference)
            load = os.getloadavg()[0]  # beside others a CPU-second is worth down to half of one alone
            rows.append(
                {
                    "method": label,
                    "spp": spp,
                    "repeats": repeats,
                    **times,
                    "load": load,
                    **errors,
                    "version": made[0].version,
                    "note": made[0].note,
                }
            )
            print(
                f"{label} {spp} spp: {times['cpu_seconds']:.3g} CPU-s, rmse {errors['rmse']:.3g}, "
                f"median {errors['median']:.3g}",
                flush=True,
            )
            write_json(output, {"scene": "ref1", "machine": machine("cpu"), "rows": rows})
