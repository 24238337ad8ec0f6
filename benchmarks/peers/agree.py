"""Do all programs compute the same light? Image means of this project and of the peers, channel by channel.

Three scenes (soft tilted lights, a thin lens, real meshes), each in several waters; once bounded to one event (direct
light and single scattering), and once with light of all orders. A peer agrees if in every channel it differs from each
of our integrators by no more than a tolerance plus three standard errors of the difference.
"""

import json
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from benchmarks import peers
from benchmarks.light import scores
from benchmarks.light.scenes import from_file
from benchmarks.machine import RESULTS, Stopwatch, machine
from varos_warp.dataset.files import write_json
from varos_warp.errors import InputError
from varos_warp.render.renderer import LAYERS, FrameRenderer

HERE = Path(__file__).parent
AGREEMENT = RESULTS / "peers_agree.json"
SCENES = ("lamps", "lens", "meshes")
WATERS = {
    "ff3.6": "{kind: fournier_forand, n: 1.10, mu: 3.5835}",
    "ff4.0": "{kind: fournier_forand, n: 1.15, mu: 4.0}",
    "ff4.5": "{kind: fournier_forand, n: 1.10, mu: 4.5}",
    "hg0.8": "{kind: henyey_greenstein, g: 0.8}",
    "mixed": "{kind: mixture, of: [{kind: fournier_forand, n: 1.10, mu: 4.5, weight: 0.5}, "
    "{kind: rayleigh, weight: 0.3}, {kind: henyey_greenstein, g: 0.8, weight: 0.2}]}",
}
"""Phase functions. ff3.6 is sea water as Petzold measured it: 25 % of the light within 1 degree, 7 % within 0.1. Paths
that scatter so towards a light are rare and bright, and few samples miss them; ff4.0 has 6 % within 1 degree, ff4.5 2.
"""
CASES = tuple((scene, water) for scene in SCENES for water in WATERS)
TOLERANCE = {"one event": 1e-3, "all": 5e-3}
SIGMAS = 3.0
OURS = ("path", "field")
REPLICATES = 8
"""Renderings whose spread is the standard error of an image's mean."""
PILOT_SPP, MOST_SPP = 64, 1 << 14
"""Enough samples to tell their time from what every rendering costs."""
ONE_EVENT_SHARE, OUR_SHARE = 0.15, 0.3
"""Shares of the time: bounded paths are short with little noise, and our integrators have less than the peers."""


@dataclass(frozen=True)
class Estimate:
    """Mean over an image per channel, its standard error, and what it cost."""

    mean: np.ndarray
    stderr: np.ndarray
    spp: int
    cpu_seconds: float

    def off(self, other: "Estimate") -> tuple[np.ndarray, np.ndarray]:
        """Relative difference from another, and its standard error."""
        return self.mean / other.mean - 1.0, np.hypot(self.stderr, other.stderr) / other.mean

    def as_dict(self) -> dict:
        """Return plain types for JSON."""
        means = {"mean": self.mean.tolist(), "stderr": self.stderr.tolist()}
        return {**means, "spp": self.spp, "replicates": REPLICATES, "cpu_seconds": self.cpu_seconds}


@dataclass(frozen=True)
class Row:
    """One scene in one water with light of some orders, by every program; what refused it says why."""

    scene: str
    water: str
    light: str
    estimates: dict[str, Estimate] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)

    def excess(self, name: str, other: str) -> np.ndarray:
        """How far two programs are apart per channel, over what is granted; up to 1 they agree."""
        off, stderr = self.estimates[name].off(self.estimates[other])
        return np.abs(off) / (TOLERANCE[self.light] + SIGMAS * stderr)

    def pairs(self) -> list[tuple[str, str]]:
        """What is compared: peers with ours, and ours with each other."""
        ours = [name for name in OURS if name in self.estimates]
        return [
            (name, other)
            for name in self.estimates
            for other in ours
            if other != name and (name not in OURS or OURS.index(name) > OURS.index(other))
        ]

    def as_dict(self) -> dict:
        """Return plain types for JSON."""
        compared = []
        for name, other in self.pairs():
            off, stderr = self.estimates[name].off(self.estimates[other])
            agrees = bool(np.all(self.excess(name, other) <= 1))
            told = {"off": off.tolist(), "stderr": stderr.tolist(), "tolerance": TOLERANCE[self.light]}
            compared.append({"program": name, "against": other, **told, "agrees": agrees})
        return {
            **{name: getattr(self, name) for name in ("scene", "water", "light")},
            "estimates": {name: found.as_dict() for name, found in self.estimates.items()},
            "compared": compared,
            "refused": self.refused,
        }


class Case:
    """A scene in a water, and everything that renders it here."""

    def __init__(self, scene: str, water: str):
        self.scene, self.water = scene, water
        change = f"water.coefficients.phase={WATERS[water]}"
        self.built = from_file(HERE / "scenes" / f"{scene}.yaml", (change,))

    @cached_property
    def _renderer(self) -> FrameRenderer:
        return FrameRenderer(self.built.scene, "cpu", self.built.parts)

    def render(self, name: str, light: str, spp: int, seed: int) -> tuple[np.ndarray, float]:
        """Linear radiance [H, W, 3], and the CPU seconds that it took."""
        built, one = self.built, light == "one event"
        if name not in OURS:
            how = {"spp": spp, "seed": seed, "max_events": 1 if one else None}
            made = peers.render(name, built.scene, built.parts, built.camera, built.T_w_v, **how)
            return made.radiance, made.cpu_seconds
        watch = Stopwatch()
        how = {"integrator": name, "spp": spp, "seed": seed, "denoise": "none"}
        layers = ("direct", "single") if one else LAYERS
        image = self._renderer.render(built.T_w_v, built.camera, "A", layers=layers, **how).A
        return image.radiance, watch.cpu_seconds

    def estimate(self, name: str, light: str, seconds: float) -> Estimate:
        """Image mean by one program, in about ``seconds`` of CPU."""
        if name in OURS:
            self.render(name, light, 1, 0)  # compiles, and solves for the field
        _, cost = self.render(name, light, PILOT_SPP, 0)
        spp = int(np.clip(PILOT_SPP * seconds / REPLICATES / max(cost, 1e-3), PILOT_SPP, MOST_SPP))
        made = [self.render(name, light, spp, seed) for seed in range(1, REPLICATES + 1)]
        mean, stderr = scores.Estimate(np.array([radiance for radiance, _ in made])).whole
        return Estimate(mean, stderr, spp, sum(cpu for _, cpu in made))

    def row(self, light: str, programs, seconds: float) -> Row:
        """All programs that render it."""
        row = Row(self.scene, self.water, light)
        for name in programs:
            try:
                row.estimates[name] = self.estimate(name, light, seconds * (OUR_SHARE if name in OURS else 1.0))
            except InputError as error:
                row.refused[name] = error.problem
        return row


def measure(seconds: float, output: Path = AGREEMENT, cases=CASES, others=None, lights=tuple(TOLERANCE)) -> None:
    """Print a table in Markdown, a line for each program, and put the rows into ``output``, in place of older ones.

    ``seconds`` are of CPU for each peer, scene and water, for light of all orders; less for one event. Absent
    ``others`` are all peers that are installed.
    """
    programs = (*OURS, *(others or peers.available()))
    print(*HEADER, sep="\n")
    for scene, water in cases:
        case = Case(scene, water)
        for light in lights:
            row = case.row(light, programs, seconds * (ONE_EVENT_SHARE if light == "one event" else 1.0))
            print(*lines(row), sep="\n", flush=True)
            store(output, row)


def store(output: Path, row: Row) -> None:
    """Put a row into a file, with the machine and the commit that it was measured on."""
    name = [row.scene, row.water, row.light]
    kept = json.loads(output.read_text())["rows"] if output.exists() else []
    kept = [old for old in kept if [old["scene"], old["water"], old["light"]] != name]
    kept.append(row.as_dict() | {"machine": machine("cpu")})
    write_json(output, {"sigmas": SIGMAS, "waters": WATERS, "rows": kept})


HEADER = (
    "| scene | water | light | program | mean R / G / B | off `path` [%] | off `field` [%] | agrees |",
    "|---|---|---|---|---|---|---|---|",
)


def lines(row: Row) -> list[str]:
    """One line of the table for each program but ``path``: differences with their standard errors."""
    made, where = [], f"{row.scene} | {row.water} | {row.light}"
    for name, found in row.estimates.items():
        others = [other for first, other in row.pairs() if first == name]
        if not others:
            continue
        offs = [_percent(*found.off(row.estimates[other])) if other in others else "-" for other in OURS]
        agrees = all(np.all(row.excess(name, other) <= 1.0) for other in others)
        mean = " / ".join(f"{value:.5f}" for value in found.mean)
        made.append(f"| {where} | {name} | {mean} | {' | '.join(offs)} | {'yes' if agrees else 'NO'} |")
    return made + [f"| {where} | {name} | refused: {why} | | | |" for name, why in row.refused.items()]


def _percent(off, stderr) -> str:
    return " / ".join(f"{100 * a:+.2f}({100 * b:.2f})" for a, b in zip(off, stderr, strict=True))
