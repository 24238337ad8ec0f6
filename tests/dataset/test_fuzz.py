"""Files turned at random into others: each is read, or refused as bad input, within 10 CPU-seconds and 1 GB.

Scenes that load are built and checked, too, and one in four of them is simulated.

``VAROS_WARP_FUZZ`` sets the number of files (500), ``VAROS_WARP_FUZZ_SEED`` where they begin (0).
"""

import copy
import json
import os
import random
import shutil
import signal
import sys
import warnings

import pytest
import yaml
from fuzz_seeds import QUADS, SURVEYS, seeds

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.report import PAGES, facts
from varos_warp.errors import InputError
from varos_warp.scene.checks import check_scene
from varos_warp.scene.description.survey import Heights
from varos_warp.scene.file.load import load_scene, scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.mesh_files import load_mesh
from varos_warp.scene.geometry.survey import read_survey
from varos_warp.scene.lights.distribution import of_profile
from varos_warp.scene.lights.profiles import read_profile
from varos_warp.scene.materials.textures import read_image
from varos_warp.sim.trajectory import simulate

COUNT, SEED = int(os.environ.get("VAROS_WARP_FUZZ", "500")), int(os.environ.get("VAROS_WARP_FUZZ_SEED", "0"))
FEW = ("render.max_triangles=20000", "growth=[]")
"""Surfaces with relief, and what grows on them, may take longer than that where they are as fine as a camera sees."""
SECONDS, WAIT_SECONDS, BYTES = 25, 240, 1_000_000_000  # the surfaces of a scene take 7, on a busy core twice that
FACTORS = [-1, 0, 1e-9, 1e-3, 0.5, 2, 1e3, 1e9]
NUMBERS = ["1e308", "-1", "0", "NaN", ".nan", "1e999", "1000000000000", "5e-324", "-2147483649", "4294967295", "", "x"]
TEXTS = [b"*a", b"&a ", b"!!int ", b"{", b"[", b"\0", b"\xff", b"/dev/zero", b"../", b"\\ud800", b"<<: ", b"<script>"]
VALUES = [
    None,
    True,
    -1,
    10**12,
    1e308,
    float("nan"),
    float("inf"),
    "",
    "../x",
    "a/b",
    "\0",
    "<script>",
    [],
    {},
    [[]],
    {"id": "/"},
    [0] * 1000,
]


def mutated(data: bytes, rng: random.Random) -> bytes:
    """A few changes: bits, slices, numbers, words."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 8))):
        at, end = sorted(rng.randrange(len(out) + 1) for _ in range(2))
        how = rng.randrange(7)
        if how == 0 and out:
            out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
        elif how == 1:
            del out[at : at + rng.choice((1, 4, 64, end - at))]
        elif how == 2:
            out[at:at] = out[at : at + rng.choice((1, 4, 64))] * rng.choice((1, 2, 50))
        elif how == 3:
            out[at : at + 4] = rng.choice((b"\xff" * 4, b"\0" * 4, b"\x7f" * 4, rng.randbytes(4)))
        elif how == 4:
            out[at:at] = rng.choice(TEXTS)
        else:
            digits = [i for i in range(len(out)) if out[i : i + 1].isdigit()] or [0]
            at = rng.choice(digits)
            out[at : at + 1] = rng.choice(NUMBERS).encode()
    return bytes(out)


def spoil(block, rng: random.Random) -> None:
    """Replace, remove or add an entry somewhere in a tree; a number is as often multiplied."""
    while isinstance(block, dict | list) and block:
        key = rng.choice(list(block)) if isinstance(block, dict) else rng.randrange(len(block))
        if isinstance(block[key], dict | list) and block[key] and rng.random() < 0.8:
            block = block[key]
            continue
        if rng.random() < 0.15:
            del block[key]
        elif type(block[key]) in (int, float) and rng.random() < 0.5:
            block[key] *= rng.choice(FACTORS)
        else:
            block[key] = copy.deepcopy(rng.choice(VALUES))
        return


def read(path, simulated: bool) -> None:
    """What a user of the file does with it first; of a scene, what `varos-warp info` does, to 5 s of its course."""
    if path.name == "dataset.json":
        data = Dataset(path.parent)
        facts.headline(data)
        for make in (facts.water, facts.cameras, facts.equipment, facts.plan, facts.provenance):
            assert "<script>" not in PAGES.get_template("blocks.html").module.show(make(data))
    elif path.stem == "calibrated":
        check_scene(scene := calibrated(path), build_parts(scene))
    elif path.suffix == ".yaml":
        load_scene(path)
        scene = load_scene(path, FEW)
        check_scene(scene, build_parts(scene))
        if simulated:
            simulate(load_scene(path, ("trajectory.duration_s=5",)))
    elif path.name in SURVEYS:
        read_survey(Heights(kind="heights", file=str(path), **SURVEYS[path.name]))
    elif path.suffix in (".png", ".jpeg", ".tiff"):
        read_image(path)
    elif path.suffix == ".mtl":
        path.with_suffix(".obj").write_text(QUADS)
        load_mesh(path.with_suffix(".obj"))

    elif path.suffix in (".ies", ".csv"):
        values = of_profile(read_profile(path, "file")).profile
        assert 0.0 <= min(values) <= max(values) <= 1.0 + 1e-9
    else:
        load_mesh(path)


def calibrated(path):
    """A scene whose camera is that of a calibration file."""
    return scene_from_dict(
        {"vehicle": {"cameras": [{"calibration": path.name}]}, "trajectory": {"poses": [{"position": [0, 0, 0]}]}},
        path.parent,
    )


def attempt(path, simulated: bool) -> None:
    """Read a file: an `InputError` is an answer, anything else is not, nor is much work, nor waiting."""
    import resource

    def late(*_):
        raise AssertionError(f"not read within {SECONDS} CPU-seconds, or {WAIT_SECONDS} s")

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    old = [(s, signal.signal(s, late)) for s in (signal.SIGALRM, signal.SIGPROF)]
    signal.setitimer(signal.ITIMER_PROF, SECONDS)  # CPU time: the host may be busy
    signal.alarm(WAIT_SECONDS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read(path, simulated)
    except InputError:
        pass
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0)
        for number, handler in old:
            signal.signal(number, handler)
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 < BYTES


def changed(original: bytes, name: str, number: int) -> bytes:
    """A file changed: entries of dataset.json and of every other scene, else bytes."""
    rng = random.Random(f"{name} {number}")
    if name.endswith((".json", ".yaml", ".gltf")) and (name == "dataset.json" or number % 2):
        tree = yaml.safe_load(original) if name.endswith(".yaml") else json.loads(original)
        for _ in range(rng.choice((1, 1, 2, 5))):
            spoil(tree, rng)
        return (yaml.safe_dump if name.endswith(".yaml") else json.dumps)(tree).encode()
    return mutated(original, rng)


@pytest.mark.skipif(sys.platform != "linux", reason="alarms, and memory in kB")
@pytest.mark.parametrize("name", [*seeds(), "dataset.json"])
def test_files_that_were_changed_at_random_are_read_or_refused(written, tmp_path, name):
    names = [*seeds(), "dataset.json"]
    if name == "dataset.json":
        shutil.copytree(written, tmp_path, dirs_exist_ok=True)
    good, path = seeds().get(name), tmp_path / name
    original = path.read_bytes() if good is None else good
    for number in range(SEED, SEED + -(-COUNT // len(names))):
        data = changed(original, name, number)
        path.write_bytes(data)
        try:
            attempt(path, simulated=number % 4 == 1)
        except BaseException as error:
            error.add_note(f"{name}, number {number}: {data[:2000]!r}")
            raise
