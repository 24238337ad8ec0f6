"""What masks cost: a frame over mesh files whose textures cut holes, against the same files taken as opaque.

    python -m benchmarks.masks [--device cuda:0] [--resolution 1280x720] [--spp 4]
        [--boards 60] [-o benchmarks/results/masks.json]

Boards stand in coastal water before a camera with two lamps, as leaves of kelp would. Four textures: opaque; one that
cuts a single texel of 256 x 256; one with such a hole in every triangle, which costs what looks into the mask cost; and
one that cuts half of the area, where rays go on behind the holes, so that the picture is another one. Times of the four
are taken in turns: of the kernels alone, before denoising, which vary by 0.2 % from one time to the next.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
import trimesh
import warp as wp
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from benchmarks.machine import machine
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict

ROOT = Path(__file__).parents[1]
KINDS = ("opaque", "one hole", "holes everywhere", "half")
REPEATS, FRAMES = 5, 3
LAMPS = [
    {"kind": "spot", "position": [x, -0.1, 0.2], "direction": [0, 1, 0], "cone_deg": 65, "intensity": [100, 100, 100]}
    for x in (-0.4, 0.4)
]


def leaf(kind: str) -> Image.Image:
    """A texture of 256 x 256 texels whose alpha cuts nothing, some texels or half of the area."""
    row, col = np.indices((256, 256))
    alpha = {
        "opaque": row >= 0,
        "one hole": (row != 128) | (col != 128),
        "holes everywhere": (row % 12 != 6) | (col % 64 != 32),
        "half": (np.sin(row / 7.0) + np.sin(col / 5.0)) > 0.0,
    }[kind]
    colour = np.stack([80 + row // 3, 120 + col // 3, 60 + 0 * row], axis=-1)
    return Image.fromarray(np.concatenate([colour, 255 * alpha[..., None]], axis=-1).astype(np.uint8))


def board_file(folder: Path, kind: str) -> str:
    """A GLB of a board of 0.4 m x 2 m, which bends so that it has some triangles."""
    rows = np.linspace(0, 1, 12)
    places = np.array([[0.4 * u - 0.2, 0.15 * np.sin(3 * v), 2 * v] for v in rows for u in (0, 1)])
    uv = np.array([[u, v] for v in rows for u in (0, 1)])
    faces = [face for k in range(0, 22, 2) for face in ([k, k + 1, k + 3], [k, k + 3, k + 2])]
    material = PBRMaterial(
        baseColorTexture=leaf(kind), alphaMode="OPAQUE" if kind == "opaque" else "MASK", alphaCutoff=0.5
    )
    mesh = trimesh.Trimesh(places, faces, visual=TextureVisuals(uv, material=material), process=False)
    name = f"{kind.replace(' ', '_')}.glb"
    mesh.export(folder / name)
    return name


def scene(folder: Path, kind: str, resolution: list[int], many: int):
    """Boards that stand before a camera."""
    name, rng = board_file(folder, kind), np.random.default_rng(1)
    boards = [
        {"kind": "mesh", "file": name, "up_axis": "z", "position": [x, y, 0], "rotation_euler_deg": [0, 0, turn]}
        for x, y, turn in zip(
            rng.uniform(-2, 2, many), rng.uniform(1.5, 6, many), rng.uniform(0, 360, many), strict=True
        )
    ]
    return scene_from_dict(
        {
            "water": {"jerlov": {"type": "3C"}},
            "terrain": {"kind": "procedural", "resolution": 65},
            "objects": boards,
            "vehicle": {"cameras": [{"resolution": resolution}], "lights": LAMPS},
            "trajectory": {"poses": [{"position": [0, 0, 1.0]}]},
        },
        folder,
    )


def kernel_ms(renderer: FrameRenderer, spp: int) -> float:
    """Milliseconds of all kernels of a frame, A B C D S, the mean of some."""
    wp.timing_begin(cuda_filter=wp.TIMING_KERNEL)
    for frame in range(FRAMES):
        renderer.render(np.eye(4), outputs="ABCDS", spp=spp, spp_b=spp, frame=frame, denoise="none", denoise_b="none")
    return sum(entry.elapsed for entry in wp.timing_end()) / FRAMES


def frame_times(options, resolution: list[int]) -> tuple[str, dict[str, float]]:
    """The device, and median milliseconds of a frame with each texture; the first, which compiles, is not counted."""
    with tempfile.TemporaryDirectory() as folder:
        renderers = {
            kind: FrameRenderer(scene(Path(folder), kind, resolution, options.boards), options.device) for kind in KINDS
        }
        times: dict[str, list[float]] = {kind: [] for kind in KINDS}
        for _ in range(REPEATS + 1):
            for kind, renderer in renderers.items():
                times[kind].append(kernel_ms(renderer, options.spp))
    return renderer.device, {kind: round(float(np.median(taken[1:])), 2) for kind, taken in times.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--resolution", default="1280x720")
    parser.add_argument("--spp", type=int, default=4)
    parser.add_argument("--boards", type=int, default=60, help="60 hide most of what is behind them.")
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "benchmarks" / "results" / "masks.json")
    options = parser.parse_args()
    resolution = [int(side) for side in options.resolution.split("x")]
    at, frames = frame_times(options, resolution)
    result = {
        "machine": machine(at),
        "boards": options.boards,
        "resolution": resolution,
        "spp": options.spp,
        "kernels_ms": frames,
        "of_opaque": {kind: round(ms / frames["opaque"], 4) for kind, ms in frames.items()},
    }
    print(json.dumps(result))
    options.out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
