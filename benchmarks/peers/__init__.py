"""Other renderers on the same scenes: Mitsuba 3 and Blender's Cycles, in equal units (README.md says how).

Importing this imports neither; each rendering runs in its own process, so that times are not distorted.
"""

import importlib.util
import os
import pickle
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError, require_known

MODULES = {"mitsuba": "mitsuba", "cycles": "bpy"}
SUFFIXES = {"mitsuba": ".xml", "cycles": ".blend"}
INSTALL = {"mitsuba": "pip install mitsuba", "cycles": "pip install --no-deps 'bpy==5.0.1'"}


@dataclass(frozen=True)
class PeerImage:
    """What another renderer made of a scene."""

    radiance: np.ndarray
    """Linear radiance [W/sr/m^2], float32 [H, W, 3]."""
    seconds: float
    """Seconds of the rendering alone."""
    cpu_seconds: float
    """CPU seconds of the rendering, summed over all threads."""
    setup_seconds: float
    """Seconds of loading, exporting, compiling and building trees before it."""
    version: str
    note: str = ""
    """What else there is to say, such as a slower variant."""


def available() -> list[str]:
    """Names of the peers that are installed here."""
    return [name for name, module in MODULES.items() if importlib.util.find_spec(module) is not None]


def render(
    name: str, scene, parts, camera, T_w_v, *, spp: int, seed=0, threads=None, denoise=False, variant=None, **bounds
) -> PeerImage:
    """Image A of one camera for the vehicle at ``T_w_v`` [4, 4], by another renderer, ``mitsuba`` or ``cycles``.

    Of the bounds, ``max_scatterings`` and ``max_bounces`` are some where the other is 0, or 0; ``max_events`` is one of
    both together: 1 is direct light and single scattering. Absent ``threads`` are all; ``denoise`` is OIDN
    on colour alone, within the time; the ``variant`` of Mitsuba is ``llvm_ad_rgb``, or ``scalar_rgb`` where there is no
    LLVM. An InputError says that the peer is not installed, or cannot render this scene, a RuntimeError that it broke
    down.
    """
    check_available(name)
    from benchmarks.peers.plain import plain_scene

    plain = plain_scene(scene, parts, camera, T_w_v, **bounds)
    how = {"spp": spp, "seed": seed, "threads": threads, "denoise": denoise, "variant": variant}
    result = _ask(name, "render", plain, how)
    texts = {key: str(result[key]) for key in ("version", "note")}
    times = {key: float(result[key]) for key in ("seconds", "cpu_seconds", "setup_seconds")}
    return PeerImage(result["radiance"], **times, **texts)


def export(name: str, scene, parts, camera, T_w_v, path: Path, *, spp: int = 64) -> None:
    """Write a scene as a file that the peer opens by itself: .xml for Mitsuba (meshes beside it), .blend for Blender.

    Raises:
        InputError: the peer is not installed, cannot render this scene, or its files end otherwise.
    """
    check_available(name)
    path = Path(path).absolute()
    if path.suffix != SUFFIXES[name]:
        raise InputError(f"files of {name} end in {SUFFIXES[name]}", file=path, remedy="Change the name.")
    from benchmarks.peers.plain import plain_scene

    _ask(name, "export", plain_scene(scene, parts, camera, T_w_v), {"spp": spp, "path": path})


def check_available(name: str) -> None:
    """Refuse a peer that is not known or not installed."""
    require_known(name, MODULES, "there is no such peer", key="peer")
    if name not in available():
        raise InputError("is not installed", key="peer", value=name, remedy=f"Run `{INSTALL[name]}`.")


def _ask(name, verb, plain, how) -> dict:
    """Have a worker do something; what it gives."""
    with tempfile.TemporaryDirectory(prefix="peer-") as temp:
        folder = Path(temp)
        (folder / "request.pickle").write_bytes(pickle.dumps((f"{verb} {name}", plain, how)))
        run = run_worker(folder)
        if (folder / "refused.pickle").exists():
            raise InputError(pickle.loads((folder / "refused.pickle").read_bytes()))
        if (folder / "result.npz").exists():
            with np.load(folder / "result.npz") as result:
                return dict(result)
    if run.returncode < 0 and "variant" in how and how["variant"] is None and name == "mitsuba":
        return _ask(name, verb, plain, how | {"variant": "scalar_rgb"})  # some versions of LLVM abort
    raise RuntimeError(f"{name} ended with status {run.returncode}:\n{run.stderr[-2000:]}")


def run_worker(folder: Path) -> subprocess.CompletedProcess:
    """Run the worker on a folder with a request, with this interpreter."""
    root = str(Path(__file__).parents[2])
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-m", "benchmarks.peers.worker", str(folder)]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": path})
