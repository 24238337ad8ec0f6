"""Scenes for comparing methods, and their references: radiance known better than any method computes it."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from operator import attrgetter
from pathlib import Path

import numpy as np

from benchmarks.closed_form import single_scattering_image
from benchmarks.errors import Reference
from benchmarks.light import scenes as unlike
from benchmarks.light.scenes import Built, from_file
from benchmarks.machine import command
from varos_warp.cache import cached
from varos_warp.errors import require_known
from varos_warp.render.renderer import FrameRenderer

HERE = Path(__file__).parent
REFERENCES = HERE / "references"
"""References that come with the checkout; others are rendered on first use and kept in the user's cache."""
REFERENCE_VERSION = 1
"""Raise it when what an integrator converges to changes."""
REFERENCE_SEED = 77_003
"""Unlike any seed that a method renders with."""
BATCHES = 32
"""Renderings that a reference is the mean of; their spread is its standard error."""
BATCH_SPP = {"cpu": 32, "cuda": 512}
RESOLUTION = (160, 90)


@dataclass(frozen=True)
class BenchScene:
    """A named scene, seen by its first camera; it is made when it is first asked for."""

    name: str
    title: str
    make: Callable[[], Built]

    @cached_property
    def built(self) -> Built:
        """The scene, its geometry, and the pose of the vehicle."""
        return self.make()

    scene = property(attrgetter("built.scene"))
    parts = property(attrgetter("built.parts"))
    T_w_v = property(attrgetter("built.T_w_v"))
    camera = property(attrgetter("built.camera"))


def _of_file(name: str, title: str, path: str, *changes: str) -> BenchScene:
    return BenchScene(name, title, partial(from_file, HERE / "scenes" / path, changes))


SCENES = {
    scene.name: scene
    for scene in (
        _of_file("ref1", "a sea floor and pipes of 522 000 triangles, the paper's water", "ref1/scene.yaml"),
        _of_file("open_water", "the paper's water with two lights, no surfaces", "open_water.yaml"),
        *(
            BenchScene(name, unlike.SCENES[name]["title"], partial(unlike.build, name, RESOLUTION))
            for name in ("jerlov_1b", "jerlov_1c", "jerlov_3c", "jerlov_5c", "closed_room")
        ),
        _of_file(
            "demo",
            "a pipe and boulders: textures, depth of field",
            "textured.yaml",
            "vehicle.cameras.0.resolution=[160,90]",
        ),
    )
}
QUICK = ("open_water", "jerlov_1b")


def find(names) -> list[BenchScene]:
    """Scenes by name; all of them where none is named."""
    for name in names:
        require_known(name, SCENES, "there is no such scene", key="SCENE-NAMES")
    return [SCENES[name] for name in dict.fromkeys(names or SCENES)]


# --------------------------------------------------------------------------------------------------------- references


def references(bench: BenchScene, device: str, tell: Callable[[str], None] = lambda text: None) -> dict[str, Reference]:
    """What is known of a scene: ``full``, light of all orders, and ``single``, direct and single scattering, or not.

    ``tell`` is called with a line of text before something that takes long.
    """
    known = {"full": _full(bench, device, tell)}
    single = REFERENCES / f"{bench.name}_single.npz"
    if single.exists():
        with np.load(single) as file:
            known["single"] = Reference(file["mean"], file["stderr"])
    elif not bench.parts:
        known["single"] = _closed_form(bench)
    return known


def _full(bench: BenchScene, device: str, tell) -> Reference:
    shipped = REFERENCES / f"{bench.name}_full.npz"
    depends_on = _depends_on(bench)
    if shipped.exists():
        with np.load(shipped) as file:
            if "depends_on" not in file or str(file["depends_on"]) == json.dumps(depends_on, sort_keys=True):
                return Reference(file["mean"], file["stderr"])
        tell(f"{bench.name} has changed since its reference was made")
    spp = BATCH_SPP["cpu" if device == "cpu" else "cuda"]

    def build():
        tell(f"rendering a reference of {bench.name}, {BATCHES} x {spp} samples per pixel")
        return render_reference(bench, device, spp)

    arrays = cached(f"bench-{bench.name}", depends_on | {"spp": spp * BATCHES}, build)
    return Reference(arrays["mean"], arrays["stderr"])


def render_reference(bench: BenchScene, device: str, spp: int) -> dict[str, np.ndarray]:
    """Mean and standard error, float32 [H, W, 3], of `BATCHES` renderings with ``spp`` samples each.

    By the field where it serves: in the sea's water ``path`` would take a hundred times as long, and the means of both
    are within 0.1 % of each other (docs/results.md).
    """
    renderer = FrameRenderer(bench.scene, device, bench.parts)
    how = {"outputs": "A", "integrator": "auto", "denoise": "none", "spp": spp, "seed": REFERENCE_SEED}
    total = squares = 0.0
    for frame in range(BATCHES):
        image = renderer.render(bench.T_w_v, bench.camera, frame=frame, **how).A.radiance.astype(float)
        total, squares = total + image, squares + image**2
    mean = total / BATCHES
    variance = np.maximum(squares / BATCHES - mean**2, 0.0) / (BATCHES - 1)
    return {"mean": mean.astype(np.float32), "stderr": np.sqrt(variance).astype(np.float32)}


def _depends_on(bench: BenchScene) -> dict:
    """What the light depends on; numbers that follow from a seed only as far as every machine gets them alike."""
    blocks = {"terrain", "objects", "scatter", "materials", "water", "vehicle"}
    scene = bench.scene.model_dump(mode="json", include=blocks, exclude_defaults=True)
    bounds = [np.round([part.vertices.min(axis=0), part.vertices.max(axis=0)], 2).tolist() for part in bench.parts]
    return {
        "scene": scene,
        "T_w_v": np.round(bench.T_w_v, 6).tolist(),
        "version": REFERENCE_VERSION,
        "triangles": [len(part.faces) for part in bench.parts],
        "bounds": bounds,
    }


def _closed_form(bench: BenchScene) -> Reference:
    """Single scattering by quadrature; its standard error is what fewer nodes and points change, rounding at least."""

    def build():
        mean = single_scattering_image(bench.scene, nodes=12, points=3)
        coarse = single_scattering_image(bench.scene, nodes=10, points=2)
        return {"mean": mean, "stderr": np.maximum(np.abs(mean - coarse), 1e-7 * mean)}

    arrays = cached(f"bench-{bench.name}-single", _depends_on(bench), build)
    return Reference(arrays["mean"], arrays["stderr"])


def ship(names, device: str) -> None:
    """Render references and put them beside the code, with what they depend on."""
    for bench in find(names):
        text = json.dumps(_depends_on(bench), sort_keys=True)
        arrays = render_reference(bench, device, BATCH_SPP["cpu" if device == "cpu" else "cuda"])
        np.savez_compressed(REFERENCES / f"{bench.name}_full.npz", depends_on=np.array(text), **arrays)
        noise = np.sqrt((arrays["stderr"] ** 2).mean(axis=(0, 1))) / arrays["mean"].mean(axis=(0, 1))
        print(f"{bench.name}: noise of a pixel {100 * noise} % of the mean", flush=True)


if __name__ == "__main__":
    parser = command("Render references and put them beside the code.", device="cuda:0")
    parser.add_argument("scenes", nargs="+")
    arguments = parser.parse_args()
    ship(arguments.scenes, arguments.device)
