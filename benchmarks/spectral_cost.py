"""Seconds a frame of water by wavelength over those of three channels, in one run, in turns.

    python -m benchmarks.spectral_cost [--device cuda:0] [--templates starter,hull] [--bands 3,6,9] [--outputs A,ABCD]
        [--resolution 640x360] [--spp 8] [--integrator auto] [--repeats 12] [-o benchmarks/results/spectral_cost.json]

Scenes are the package's templates, in Jerlov 1C once as three channels and once by wavelength. Every repeat renders one
pose with all of them, each time another one first; the ratio of a repeat is of two frames side by side. Frames are
denoised and copied as in a run. The first frame of each, which compiles and solves for the field, is told apart.
"""

import json
from pathlib import Path

import numpy as np

from benchmarks.frame_cost import AS_IN_A_RUN
from benchmarks.machine import Stopwatch, command, counts, machine, save, size, words
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.file.load import DATA, scene_from_dict
from varos_warp.scene.file.templates import template_text
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.plain_yaml import parse
from varos_warp.sim.trajectory import simulate

KIND, LAMP, CAMERA, WATTS = "1C", "led_b4", "nikon_5100", 60.0


def scene_of(template: str, bands: int | None, resolution: tuple[int, int]) -> Scene:
    """A template in Jerlov 1C, in three channels or in so many bands, seen by the first camera."""
    tree = parse(template_text(template))
    owners = tree.get("vehicles") or [tree["vehicle"]]
    owners[0]["cameras"] = [owners[0]["cameras"][0] | {"resolution": list(resolution)}]
    for owner in owners:
        owner["lights"] = [_light(light, bands) for light in owner.get("lights", [])]
        if bands:
            owner["cameras"] = [view | {"response": CAMERA} for view in owner.get("cameras", [])]
    tree["water"] = {"spectral": {"jerlov": KIND}} if bands else {"jerlov": {"type": KIND}}
    tree["render"] = tree.get("render", {}) | ({"bands": bands} if bands else {})
    tree.pop("particles", None)
    return scene_from_dict(tree, DATA)


def _light(light: dict, bands: int | None) -> dict:
    """A light of a template, or an LED in its place."""
    if not bands:
        return light
    kept = {key: value for key, value in light.items() if key not in ("intensity", "power_W", "color")}
    return kept | {"spectrum": LAMP, "power_W": WATTS}


class Variant:
    """A scene in three channels or in bands, ready to be rendered."""

    def __init__(self, scene: Scene, parts, options):
        self.renderer, self.how = (
            FrameRenderer(scene, options.device, parts),
            AS_IN_A_RUN | {"spp": options.spp, "integrator": options.integrator},
        )
        if options.spp_b:
            self.how |= {"spp_b": options.spp_b}

    def seconds(self, T_w_v: np.ndarray, letters: str, frame: int) -> float:
        """Measure the wall time of one frame [s]."""
        watch = Stopwatch()
        self.renderer.render(T_w_v, outputs=letters, frame=frame, **self.how)
        return watch.seconds


def ratios(template: str, letters: str, options) -> dict:
    """Medians over the repeats; ``over_rgb``: of the ratios, with their quartiles."""
    ways: list[int | None] = [None, *options.bands]
    rgb = scene_of(template, None, options.resolution)
    parts, poses = build_parts(rgb), list(simulate(rgb).frames.poses())
    made = {count: Variant(scene_of(template, count, options.resolution), parts, options) for count in ways}
    first = {count: made[count].seconds(poses[0], letters, 0) for count in ways}
    seconds: dict[int | None, list[float]] = {count: [] for count in ways}
    for repeat in range(options.repeats):
        for turn in range(len(ways)):
            count = ways[(repeat + turn) % len(ways)]
            pose = poses[repeat * len(poses) // options.repeats]
            seconds[count].append(made[count].seconds(pose, letters, repeat + 1))
    row = {
        "template": template,
        "outputs": letters,
        "rgb_s": float(np.median(seconds[None])),
        "rgb_first_s": first[None],
    }
    for count in options.bands:
        ratio = np.divide(seconds[count], seconds[None])
        low, middle, high = np.quantile(ratio, (0.25, 0.5, 0.75)).round(3).tolist()
        row[f"{count}_bands"] = {
            "over_rgb": middle,
            "quartiles": [low, high],
            "passes": -(-count // 3),
            "over_passes": round(middle / -(-count // 3), 3),
            "first_s": first[count],
        }
    return row


def main(arguments=None) -> None:
    """Print a line a template, and write what was asked for."""
    parser = command(__doc__, device="cpu")
    parser.add_argument("--templates", type=words, default=["starter", "hull"])
    parser.add_argument("--bands", type=counts, default=[3, 6, 9])
    parser.add_argument("--outputs", type=words, default=["A", "ABCD"])
    parser.add_argument("--resolution", type=size, default=(640, 360))
    parser.add_argument("--spp", type=float, default=8)
    parser.add_argument("--spp-b", type=int)
    parser.add_argument("--integrator", default="auto")
    parser.add_argument("--repeats", type=int, default=12)
    parser.add_argument("-o", "--out", type=Path)
    options = parser.parse_args(arguments)
    rows = []
    for template in options.templates:
        for letters in options.outputs:
            rows.append(ratios(template, letters, options))
            print(json.dumps(rows[-1]), flush=True)
    asked = {key: getattr(options, key) for key in ("spp", "spp_b", "integrator", "repeats", "resolution")}
    save(options.out, {"machine": machine(options.device), **asked, "rows": rows})


if __name__ == "__main__":
    main()
