"""Check that a change to the code leaves every byte that the package writes as it was.

    python -m benchmarks.same_bytes REVISION [NAME ...]

runs the same commands with this working tree and with a checkout of REVISION, and lists the files whose bytes differ,
except what describes the run itself: logs, checksums, reports, and the versions that dataset.json names.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.machine import ROOT, command

DEMO, STARTER = "varos_warp/data/demo.yaml", "varos_warp/data/starter.yaml"
MUNKHOLMEN = "examples/munkholmen"
SMALL = ["--device", "cpu", "-q", "--set", "vehicle.cameras.0.resolution=[48, 27]"]
ALL = [*SMALL, "--spp", "4", "--set", "render.spp_b=4", "--outputs", "A,B,C,D,S", "--linear-exr"]
GREEN = (
    "water={coefficients: {sigma_s: [0.2, 0.3, 0.4], sigma_a: [0.3, 0.1, 0.1], phase: {kind: fournier_forand, "
    "backscatter_fraction: 0.0183}}}"
)
STEREO = (
    "vehicle.cameras=[{id: L0, position: [-0.1, 0, 0], resolution: [40, 24]}, {id: R0, position: [0.1, 0, 0], "
    "resolution: [40, 24], f_stop: 0}]"
)
METAL = [
    "--set=water={jerlov: {type: 1C}}",
    "--set=materials.steel={kind: metal, base: [0.56, 0.57, 0.58], roughness: 0.3}",
]
PREPROCESS = "-o out.ply --vertices 2000 --shrinkwrap 129 --region 850,270,930,350 --device cpu -q"

JOBS = {
    "demo": ["run", DEMO, "-o", "out", "--frames", "0:2", *ALL],
    "planned": ["run", STARTER, "-o", "out", "--frames", "0:2", *SMALL, "--tolerance", "0.1", "--outputs", "A,B"],
    "path": ["run", DEMO, "-o", "out", "--frames", "3", *ALL, "--integrator", "path", "--denoise", "nlm"],
    "reference": ["render", DEMO, "-o", "out", "--frames", "3", *ALL, "--integrator", "reference"],
    "green": ["render", DEMO, "-o", "out", "--frames", "5", *ALL, "--set", GREEN],
    "metal": ["render", DEMO, "-o", "out", "--frames", "5", *ALL, *METAL],
    "stereo": ["run", DEMO, "-o", "out", "--frames", "7:9", "--device", "cpu", "-q", "--spp", "2", "--set", STEREO],
    "munkholmen": ["run", f"{MUNKHOLMEN}/scene.yaml", "-o", "out", "--frames", "120", *ALL],
    "simulate": ["simulate", f"{MUNKHOLMEN}/scene.yaml", "-o", "out", "-q"],
    "info": ["info", DEMO, "--json"],
    "preprocess": ["preprocess", f"{MUNKHOLMEN}/meshes/munkholmen_seabed.dae", *PREPROCESS.split()],
}
"""Commands by name; each is run in a folder of its own."""
AFTER = {
    "demo": [
        ["noise", "out", "--profile", "mpu6050", "-o", "noisy", "-q"],
        *(["export", "out", "--to", to, "-o", to, "-q"] for to in ("kitti", "tum", "colmap", "nerfstudio")),
    ],
    "stereo": [["export", "out", "--to", "euroc", "-o", "euroc", "-q"]],
}
UNLIKE = ("log/", "checksums", "report", "contact_sheet")
"""Parts of paths that tell of a run, or that another test compares."""


def content(path: Path) -> bytes:
    """Bytes of a file; of dataset.json without versions, and of a report of preprocessing without times."""
    if path.name not in ("dataset.json", "out.json"):
        return path.read_bytes()
    data = json.loads(path.read_text())
    data = {key: value for key, value in data.items() if key not in ("versions", "device", "seconds", "peak_memory_gb")}
    return json.dumps(data, sort_keys=True).encode()


def run(tree: Path, name: str, folder: Path) -> dict[str, str]:
    """SHA-256 of all that a job writes with a tree's code, by path; and of what it prints."""
    folder.mkdir(parents=True)
    environment = os.environ | {"PYTHONPATH": str(tree), "VAROS_WARP_CACHE": str(folder.parent / "cache")}
    printed = b""
    for words in (JOBS[name], *AFTER.get(name, ())):
        words = [str(ROOT / word) if word.startswith(("varos_warp/", "examples/")) else word for word in words]
        done = subprocess.run(
            [sys.executable, "-m", "varos_warp", *words], cwd=folder, env=environment, capture_output=True
        )
        printed += done.stdout if name == "info" else b""
        if done.returncode:
            print(f"{tree.name}: {name}: {done.stderr.decode()[-600:]}", file=sys.stderr)
            return {"status": str(done.returncode)}
    sums = {
        path.relative_to(folder).as_posix(): hashlib.sha256(content(path)).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
    sums = {path: value for path, value in sums.items() if not any(part in path for part in UNLIKE)}
    return sums | {"printed": hashlib.sha256(printed).hexdigest()}


def compare(before: dict[str, str], after: dict[str, str]) -> list[str]:
    """Paths that only one has, or whose bytes differ."""
    return [path for path in sorted({*before, *after}) if before.get(path) != after.get(path)]


def sums_of_both(name: str, tree: Path, folder: Path, kept: Path | None) -> tuple[dict[str, str], dict[str, str]]:
    """Sums of a job with the code of ``tree``, which are taken from or written to the file ``kept``, and with this."""
    with ThreadPoolExecutor(2) as pool:
        after = pool.submit(run, ROOT, name, folder / "new" / name)
        if kept and kept.exists():
            return json.loads(kept.read_text()), after.result()
        before = run(tree, name, folder / "old" / name)
        if kept:
            kept.parent.mkdir(parents=True, exist_ok=True)
            kept.write_text(json.dumps(before, indent=1))
        return before, after.result()


def main() -> int:
    """Compare; the status is the number of jobs that differ."""
    parser = command(__doc__, device=None)
    parser.add_argument("revision")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(JOBS))
    parser.add_argument("--keep", type=Path, help="Folder of the sums of REVISION, made where it is missing.")
    asked = parser.parse_intermixed_args()
    differing = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "before"
        subprocess.run(["git", "-C", ROOT, "worktree", "add", "-q", "--detach", tree, asked.revision], check=True)
        try:
            for name in asked.names or JOBS:
                kept = asked.keep and asked.keep / f"{name}.json"
                before, after = sums_of_both(name, tree, Path(folder), kept)
                paths = compare(before, after)
                differing += bool(paths)
                more = f" and {len(paths) - 6} more" if len(paths) > 6 else ""
                found = f"{', '.join(paths[:6])}{more}" if paths else f"{len(before) - 1} files alike"
                print(f"{name}: {found}", flush=True)
        finally:
            subprocess.run(["git", "-C", ROOT, "worktree", "remove", "--force", tree], check=True)
    return differing


if __name__ == "__main__":
    sys.exit(main())
