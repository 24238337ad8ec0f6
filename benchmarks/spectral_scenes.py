"""Scenes by wavelength held against the same scenes of three channels, a triple of wavelengths at a time, by hand.

    python -m benchmarks.spectral_scenes [--scenes open,coast] [--seeds 24] [--spp 16] [--most 30]
        [--integrator path] [--by-hand path] [--json benchmarks/results/spectral_scenes_cpu.json]

Each row tells, of blocks of 8 x 8 pixels:

* ``weaving``: means over seeds against images in which coefficients, intensities, reflectances and indices of the bands
  are given as those of red, green and blue, in reverse order and with other seeds, by `--by-hand`: the worst z.
* ``bars``: squares of deviations over those that ``stderr`` tells (1: it holds; below: it is too large).
* ``reduction``: means against ``--most`` bands with the same random numbers, beside the error that the bands state.

A file that is there keeps its rows of other scenes and integrators, and of others by hand.
"""

import argparse
import json
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.light import moving_scenes, scenes, scores
from benchmarks.light.scores import Estimate
from benchmarks.machine import Stopwatch, machine
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.optics.seawater import seawater_index
from varos_warp.scene.passes import shares_of_water
from varos_warp.scene.spectra.bands import PATHS_M, scene_bands
from varos_warp.scene.spectra.lamps import lamp_spectrum
from varos_warp.scene.spectra.spectrum import GRID, STEPS
from varos_warp.scene.spectra.surfaces import reflectance_of_rgb

RESOLUTION = (48, 27)
WATTS, B = 60.0, 0.0183
OTHER_SEEDS = 10_000
SEAWATER = {"temperature_C": 10.0, "salinity": 35.0}
PORT = {"port": {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.008, "n_glass": 1.49}, "n_water": SEAWATER}
TURBID = {"iop": {"chlorophyll_mg_m3": 2.0, "cdom_440_per_m": 0.2, "minerals_g_m3": 2.0}}


@dataclass(frozen=True)
class Case:
    """A scene of `benchmarks.light.scenes`, its water, bands, and lamps in turn; ``blur``: it moves, too."""

    world: str
    water: dict
    bands: int
    lamps: tuple[str, ...] = ("led_b4",)
    view: dict = field(default_factory=dict)
    empty: bool = False
    blur: bool = False


CASES = {
    "open": Case("paper_far", {"jerlov": "IB"}, 6, empty=True),
    "coast": Case("coastal", {"jerlov": "1C"}, 6),
    "box": Case("closed_room", TURBID, 9),
    "world_camera": Case("standing_camera", {"jerlov": "3C"}, 3),
    "facing_lamp": Case("facing_lamp", {"jerlov": "II"}, 9),
    "moving": Case("coastal_pole", {"jerlov": "III"}, 3, blur=True),
    "port": Case("paper_room", {"iop": {"chlorophyll_mg_m3": 0.05}}, 6, view=PORT),
    "two_lamps": Case("canyon", {"jerlov": "1C"}, 7, ("halogen_3200K", "led_b5")),
}


class Held:
    """A case built: what is rendered, and how."""

    def __init__(self, case: Case):
        built = scenes.build(case.world, RESOLUTION)
        self.case, self.parts, self.how = case, [] if case.empty else built.parts, {"T_w_v": built.T_w_v}
        view = case.view
        if case.blur:
            moved = moving_scenes.Case(
                built.scene,
                built.parts,
                moving_scenes.Course(built.T_w_v, tuple(built.T_w_v[:3, :3] @ (0.6, 0.8, 0.1)), 20.0),
                {},
                None,
            )
            view = view | {"shutter": {"exposure_s": 0.15}}
            self.how |= {"motion": moved.motion, "time_ns": round(1e9 * moving_scenes.NOW_S)}
        self.scene = self._spectral(built.scene, view)

    def _spectral(self, scene: Scene, view: dict) -> Scene:
        dump = scene.model_dump(exclude_unset=True)
        vehicle, case = dump["vehicle"], self.case
        lights = [
            {k: v for k, v in light.items() if k != "intensity"}
            | {"spectrum": case.lamps[i % len(case.lamps)], "power_W": WATTS}
            for i, light in enumerate(vehicle["lights"])
        ]
        vehicle |= {"lights": lights, "cameras": [vehicle["cameras"][0] | {"response": "nikon_5100"} | view]}
        return Scene(**dump | {"water": {"spectral": case.water}, "vehicle": vehicle, "render": {"bands": case.bands}})

    def images(self, scene: Scene, parts, seeds, spp: int, integrator: str) -> tuple[np.ndarray, np.ndarray]:
        """Radiance and standard errors [n, H, W, 3]."""
        renderer = FrameRenderer(scene, "cpu", parts)
        made = [
            renderer.render(outputs="A", seed=seed, spp=spp, integrator=integrator, denoise="none", **self.how).A
            for seed in seeds
        ]
        return np.array([A.radiance for A in made], float), np.array([A.stderr for A in made], float)

    def with_bands(self, count: int) -> Scene:
        """The scene with so many bands."""
        return self.scene.model_copy(update={"render": self.scene.render.model_copy(update={"bands": count})})

    def by_hand(self, seeds, spp: int, integrator: str) -> np.ndarray:
        """Images [n, H, W, 3] of triples of wavelengths as red, green and blue, last first, added up."""
        bands, total = scene_bands(self.scene, self.scene.vehicle.cameras[0], PATHS_M), 0.0
        for first, share in zip(range(0, len(bands.wavelength_nm), 3), shares_of_water(bands), strict=True):
            number = np.arange(first, min(first + 3, len(bands.wavelength_nm)))[::-1]
            weights = bands.weights[:, number] / bands.white[:, None]
            number = np.pad(number, (0, 3 - len(number)), "edge")
            scene, parts = self._triple(bands, number, float(share))
            total = total + self.images(scene, parts, seeds, spp, integrator)[0][..., : weights.shape[1]] @ weights.T
        return total

    def _triple(self, bands, number, share: float):
        nm, dump = bands.wavelength_nm[number], self.scene.model_dump(exclude_unset=True)
        phase = {
            "kind": "mixture",
            "of": [
                {"kind": "fournier_forand", "backscatter_fraction": B, "weight": 1.0 - share},
                {"kind": "rayleigh", "weight": share},
            ],
        }
        b = bands.b_water + bands.b_particles
        water = {"coefficients": {"sigma_a": bands.a[number].tolist(), "sigma_s": b[number].tolist(), "phase": phase}}
        vehicle = dump["vehicle"]
        vehicle["lights"] = [_shining(light, nm) for light in vehicle["lights"]]
        view = {k: v for k, v in vehicle["cameras"][0].items() if k != "response"}
        if "n_water" in view:
            view["n_water"] = [float(seawater_index(*SEAWATER.values(), one)) for one in nm]
        vehicle["cameras"] = [view]
        parts = [
            replace(
                part,
                material=Diffuse(
                    reflectance=tuple(reflectance_of_rgb(part.material.reflectance, nm).clip(0.0, 1.0).tolist())
                ),
            )
            for part in self.parts
        ]
        return Scene(**dump | {"water": water, "vehicle": vehicle, "render": {}}), parts


def _shining(light: dict, nm: np.ndarray) -> dict:
    """A spot of some watts [W/sr/nm] at three wavelengths; its solid angle by the midpoint rule over its soft edge."""
    spectrum = lamp_spectrum(light["spectrum"], Path, "spectrum")
    size = np.cos(np.radians(light["cone_deg"]) / 2.0)
    x = np.clip((np.arange(100_000) + 0.5) / 100_000 / max(light["blend"], 1e-9), 0.0, 1.0)
    whole = 2.0 * np.pi * (1.0 - size) * np.mean(x * x * (3.0 - 2.0 * x))
    power = np.interp(nm, GRID, spectrum.at()) / (STEPS @ spectrum.at())
    kept = {k: v for k, v in light.items() if k not in ("spectrum", "power_W")}
    return kept | {"intensity": (WATTS * power / whole).tolist()}


def row_of(name: str, options) -> dict:
    """All numbers of one scene."""
    watch, held = Stopwatch(), Held(CASES[name])
    seeds = range(1, options.seeds + 1)
    ours, stderr = held.images(held.scene, held.parts, seeds, options.spp, options.integrator)
    truth = Estimate(held.by_hand([OTHER_SEEDS + seed for seed in seeds], options.spp, options.by_hand))
    row = {"scene": name, "bands": held.case.bands, "integrator": options.integrator, "by_hand": options.by_hand}
    row["weaving"] = scores.bias(Estimate(ours), truth) | {
        "reference_block_percent": 100.0 * float(scores.block_row(ours, truth)["reference_block_rms"])
    }
    row["bars"] = scores.calibration(ours, stderr)
    if options.most:
        many, _ = held.images(held.with_bands(options.most), held.parts, seeds, options.spp, options.integrator)
        row["reduction"] = reduction(ours, many, scene_bands(held.scene, held.scene.vehicle.cameras[0], PATHS_M))
    return row | {"cpu_seconds": watch.cpu_seconds}


def reduction(few: np.ndarray, many: np.ndarray, bands) -> dict:
    """What fewer bands change, in % of blocks that are not dark, and of the image; and what the bands state."""
    of_blocks, counts = Estimate(scores.block_means(few) - scores.block_means(many)), scores.block_means(many).mean(0)
    off, unsure = (values / counts for values in of_blocks.of(np.asarray(of_blocks.images)))
    off = np.where(counts > 0.1 * counts.mean(axis=(0, 1)), off, 0.0)
    farthest = np.abs(off).reshape(-1, 3).argmax(0), np.arange(3)
    whole, whole_unsure = Estimate(few - many).whole
    scale = many.mean(axis=(0, 1, 2))
    percent = {
        "mean_percent": whole / scale,
        "mean_stderr": whole_unsure / scale,
        "rms_percent": np.sqrt((off**2).mean((0, 1))),
        "block_percent": off.reshape(-1, 3)[farthest],
        "block_stderr": unsure.reshape(-1, 3)[farthest],
        "stated_rms": bands.rms,
        "stated_worst": bands.worst,
    }
    return {key: (100.0 * value).round(3).tolist() for key, value in percent.items()}


def main(arguments=None) -> None:
    """Print a line a scene, and write what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=lambda text: text.split(","), default=list(CASES))
    parser.add_argument("--integrator", default="path")
    parser.add_argument("--by-hand", default="path")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--most", type=int, default=30, help="0: bands are not held against more of them.")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    rows = json.loads(options.json.read_text())["rows"] if options.json and options.json.exists() else []
    for name in options.scenes:
        made = row_of(name, options) | {"spp": options.spp, "seeds": options.seeds, "most": options.most}
        same = ("scene", "integrator", "by_hand")
        rows = [row for row in rows if any(row.get(key, "path") != made[key] for key in same)] + [made]
        print(json.dumps(made), flush=True)
        if options.json:
            result = {"machine": machine("cpu"), "resolution": RESOLUTION, "rows": rows}
            options.json.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
