"""One task of a peer, in its own process: ``python -m benchmarks.peers.worker FOLDER``.

FOLDER holds ``request.pickle`` (written by ``benchmarks.peers``): a task, a plain scene, and options. The result goes
to ``result.npz``, an error of the user to ``refused.pickle``.
"""

import pickle
import sys
import time
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError

LANES = 1 << 22
"""Samples that Mitsuba's vectorised variants hold at a time: they keep the state of all paths in memory."""


def main(folder: Path) -> None:
    """Do what the request asks for."""
    with open(folder / "request.pickle", "rb") as file:
        task, plain, how = pickle.load(file)
    try:
        result = TASKS[task](plain, folder, **how)
    except InputError as error:
        (folder / "refused.pickle").write_bytes(pickle.dumps(error.message))
        return
    np.savez(folder / "result.npz", **result)


def _timed(call):
    """Seconds and CPU seconds of all threads that a call takes, and what it gives."""
    wall, cpu = time.perf_counter(), time.process_time()
    value = call()
    return {"seconds": time.perf_counter() - wall, "cpu_seconds": time.process_time() - cpu}, value


def render_mitsuba(plain, folder, *, spp, seed, threads, denoise, variant):
    """Render by ``volpathmis``; a first sample per pixel compiles the kernels and counts as setup."""
    start = time.perf_counter()
    import drjit
    import mitsuba

    variant = variant or usable_variant()
    mitsuba.set_variant(variant)
    if threads:
        drjit.set_thread_count(threads)
    from benchmarks.peers.mitsuba_scene import write_mitsuba

    scene = mitsuba.load_dict(write_mitsuba(plain, folder, spp))
    np.array(mitsuba.render(scene, spp=1, seed=seed))
    finish = _denoiser() if denoise else (lambda image: image)
    setup = time.perf_counter() - start
    times, image = _timed(lambda: finish(_mitsuba_passes(mitsuba, scene, plain.resolution, spp, seed)))
    note = "" if variant.startswith("llvm") else "no LLVM here: scalar_rgb, about half as fast"
    version = f"mitsuba {mitsuba.__version__} {variant}"
    return {"radiance": image, **times, "setup_seconds": setup, "version": version, "note": note}


def _mitsuba_passes(mitsuba, scene, resolution, spp, seed):
    """Mean of as many renderings as keep the paths in memory, each with its own random numbers."""
    most = max(LANES // (resolution[0] * resolution[1]), 1)
    count = -(-spp // most)
    shares = [spp // count + (i < spp % count) for i in range(count)]
    total = 0.0
    for i, share in enumerate(shares):
        total += share * np.array(mitsuba.render(scene, spp=share, seed=seed * 4096 + i + 1), np.float64)
    return (total / spp).astype(np.float32)


def _denoiser():
    """Open Image Denoise on colour alone, as this project uses it on whole images: Mitsuba's own needs OptiX."""
    from varos_warp.render.image.denoise import denoise_image
    from varos_warp.render.image.frame import RadianceImage

    return lambda image: denoise_image(RadianceImage(image, np.ones_like(image)), "oidn")


def usable_variant() -> str:
    """``llvm_ad_rgb`` where a library of LLVM is found that Mitsuba takes, else ``scalar_rgb``."""
    import drjit

    return "llvm_ad_rgb" if drjit.has_backend(drjit.JitBackend.LLVM) else "scalar_rgb"


def render_cycles(plain, folder, *, spp, seed, threads, denoise, variant):
    """Render by Cycles on the CPU; a first sample per pixel builds its trees and counts as setup."""
    start = time.perf_counter()
    import bpy

    from benchmarks.peers import cycles_scene

    cycles_scene.build_cycles(plain, spp=1, seed=seed, threads=threads, denoise=denoise)
    cycles_scene.render_exr(folder / "first.exr")
    bpy.context.scene.cycles.samples = spp
    setup = time.perf_counter() - start
    times, _ = _timed(lambda: cycles_scene.render_exr(folder / "image.exr"))
    image = cycles_scene.read_exr(folder / "image.exr")
    version = f"cycles {bpy.app.version_string}"
    return {"radiance": image, **times, "setup_seconds": setup, "version": version, "note": ""}


def export_mitsuba(plain, folder, *, spp, path):
    """An XML file and its meshes."""
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    from benchmarks.peers.mitsuba_scene import write_xml

    write_xml(plain, path, spp)
    return {}


def export_cycles(plain, folder, *, spp, path):
    """A .blend file."""
    from benchmarks.peers import cycles_scene

    cycles_scene.build_cycles(plain, spp=spp)
    cycles_scene.write_blend(path)
    return {}


TASKS = {
    "render mitsuba": render_mitsuba,
    "render cycles": render_cycles,
    "export mitsuba": export_mitsuba,
    "export cycles": export_cycles,
}

if __name__ == "__main__":
    main(Path(sys.argv[1]))
