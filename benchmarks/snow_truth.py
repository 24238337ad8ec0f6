"""Marine snow over many seeds: the mean of what bodies add is what is taken out for them, in unlike scenes.

    python -m benchmarks.snow_truth [seeds] [words of names ...]

For each scene a line: the mean of S over that of E with its standard error, the largest |mean (S - E)| of the 8 x 8
blocks in standard errors and the skewness of that block over seeds, and how many blocks exceed 4.
"""

import sys

import numpy as np
import warp as wp
from scipy import stats

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import transform

FOURNIER_FORAND = {"kind": "fournier_forand", "n": 1.10, "mu": 3.5835}
CAMERA = {"id": "M0", "resolution": [64, 40], "sensor_mm": [8, 5], "focal_mm": 6}
LAMP = {"kind": "spot", "position": [0.5, 0, 0.2], "direction": [-0.1, 1, 0], "intensity": [100, 100, 100],
        "cone_deg": 90, "blend": 0.5}
FOUR = [LAMP | {"position": [x, 0, z], "direction": [-0.3 * x, 1, -0.6 * z], "cone_deg": 70}
        for x in (-0.5, 0.5) for z in (-0.3, 0.3)]
TERRAIN = {"terrain": {"kind": "procedural", "size_m": 12, "resolution": 65, "relief_m": 0.3, "position": [0, 2, -0.8]},
           "scatter": [{"object": {"kind": "boulder", "diameter": 0.3, "seed": 2}, "count": 30, "circle": [0, 2, 1.5]}]}
SHUTTER = {"exposure_s": 0.05}
N_WATER = {"temperature_C": 10, "salinity": 35}


def water(kind):
    return {"jerlov": {"type": kind, "phase": FOURNIER_FORAND}}


def scene(camera=None, lights=(LAMP,), kind="1C", share=0.005, **more):
    return scene_from_dict({
        "water": water(kind), "particles": [{"share": share}],
        "vehicle": {"lights": list(lights), "cameras": [CAMERA | (camera or {})]},
        "trajectory": {"poses": [{"position": [0, 0, 0]}]}} | more)


SCENES = {
    **{f"{kind}, share {share}": ({"kind": kind, "share": share}, False)
       for kind in ("IB", "1C") for share in (0.002, 0.005, 0.013)},
    "terrain, four lamps": ({"lights": FOUR, "kind": "3C"} | TERRAIN, False),
    "lamp in view": ({"lights": [LAMP | {"position": [0.3, 1.2, 0.1], "direction": [-0.3, -0.2, 0], "cone_deg": 120}]},
                     False),
    "moving, shutter": ({"camera": {"shutter": SHUTTER}}, True),
    "rolling": ({"camera": {"shutter": SHUTTER | {"readout_s": 0.05}}}, True),
    "dome port": ({"camera": {"port": {"kind": "dome", "radius_m": 0.05}}}, False),
    "fisheye": ({"camera": {"focal_mm": 3, "distortion": {"model": "kannala_brandt", "k": [0.01, 0, 0, 0]}}}, False),
    "dispersion": ({"camera": {"n_water": N_WATER, "port": {"kind": "flat", "distance_m": 0.02}}}, False),
    "disk lamps": ({"lights": [LAMP | {"radius_m": 0.1}]}, False),
    "strobe": ({"lights": [LAMP | {"strobe": {"on_s": 0.005}}], "camera": {"shutter": SHUTTER}}, True),
}


def moving(offset_ns):
    return transform(np.eye(3), np.multiply.outer(1e-9 * offset_ns, [0.5, 0.2, 0.1]))


def blocks(values):
    height, width = (n // 8 * 8 for n in values.shape[:2])
    return values[:height, :width].reshape(height // 8, 8, width // 8, 8, -1).mean((1, 3), dtype=float)


def layers(of_scene, moves, seeds):
    """S and E of blocks, [seed, row, column, channel]."""
    renderer = FrameRenderer(of_scene, "cpu")
    drawn, mean = [], []
    for seed in range(1000, 1000 + seeds):
        renderer.snow.scene = of_scene.model_copy(update={"seed": seed})
        n = renderer.render(np.eye(4), outputs="N", seed=seed, motion=moving if moves else None).N
        drawn.append(blocks(n.light))
        mean.append(blocks(n.light - n.added))
    return np.array(drawn), np.array(mean)


def line_of(drawn, mean):
    """A line of the table."""
    seeds, off = len(drawn), drawn - mean
    z = off.mean(0) / np.maximum(off.std(0, ddof=1) / np.sqrt(seeds), 1e-30)
    worst = tuple(map(int, np.unravel_index(np.abs(z).argmax(), z.shape)))
    frames, total = drawn.mean((1, 2, 3)), mean.mean()
    return (f"{frames.mean() / total:7.4f} +- {frames.std(ddof=1) / np.sqrt(seeds) / total:.4f}   "
            f"z of frames {(off.mean((1, 2, 3)).mean() / off.mean((1, 2, 3)).std(ddof=1) * np.sqrt(seeds)):5.2f}   "
            f"largest {z[worst]:6.2f} at {worst}, skewness {stats.skew(off[(slice(None), *worst)]):5.2f}   "
            f"{(np.abs(z) > 4).sum()} of {z.size} beyond 4")


def main(arguments):
    wp.config.quiet = True
    seeds = int(arguments[0]) if arguments else 256
    for name, (how, moves) in SCENES.items():
        if len(arguments) > 1 and not any(word in name for word in arguments[1:]):
            continue
        print(f"{name:22s}", line_of(*layers(scene(**how), moves, seeds)), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
