"""The table of methods: all of ours for image A, and those of other programs that are installed."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from benchmarks import peers
from benchmarks.machine import Budget, Stopwatch
from benchmarks.scenes import BenchScene
from varos_warp.errors import require_known
from varos_warp.render.renderer import FrameRenderer

LADDER = (1, 4, 16, 64, 256, 1024)
"""Samples per pixel, as far as the time allows."""
REPEATS, REPEAT_SECONDS = 3, 2.0
"""Renderings that a point is the mean of, as long as they take no longer than this together."""


@dataclass(frozen=True)
class Method:
    """One series of the chart."""

    name: str
    label: str
    family: str
    """What sets its colour."""
    how: dict = field(default_factory=dict)
    """Keyword arguments of `FrameRenderer.render`."""
    spp: tuple[int, ...] = LADDER
    denoise: str = "none"
    truth: tuple[str, ...] = ("full",)
    """What it is compared with: the light of all orders, so that the chart shows what leaving some out costs; and
    ``single`` as well where a method claims no more than that."""
    peer: str | None = None
    """Name of the other program that renders it."""


NOTHING_MORE, PATH, SINGLE = ("full", "single"), {"integrator": "path"}, {"layers": ("direct", "single")}
OURS = (
    Method("direct", "direct light only", "direct", {"layers": ("direct",)}, LADDER[:4]),
    Method("single", "direct + single scattering", "single", SINGLE, LADDER[:4], truth=NOTHING_MORE),
    *(
        Method(
            f"scatterings_{n}", f"paths, at most {n} scattering{s}", f"scatterings_{n}", PATH | {"max_scatterings": n}
        )
        for n, s in ((1, ""), (2, "s"), (3, "s"))
    ),
    Method("reference", "plain path tracer", "reference", {"integrator": "reference"}),
    Method("path", "paths", "path", PATH),
    Method("path+nlm", "paths, NLM", "path", PATH, LADDER[:5], denoise="nlm"),
    Method("path+oidn", "paths, OIDN", "path", PATH, denoise="oidn"),
    Method("field", "field", "field", {"integrator": "field"}),
    Method("field+nlm", "field, NLM", "field", {"integrator": "field"}, LADDER[:5], denoise="nlm"),
    Method("field+oidn", "field, OIDN", "field", {"integrator": "field"}, denoise="oidn"),
)
QUICK = ("direct", "single", "reference", "path", "field", "field+oidn")


DENOISING_PEERS = ("cycles",)


def of_peers() -> list[Method]:
    """The other programs that are installed, plain and denoised."""
    return [
        Method(f"{name}{added}", f"{name.capitalize()}{words}", name, spp=LADDER[1:], denoise=denoise, peer=name)
        for name in peers.available()
        for added, words, denoise in (("", "", "none"), ("+oidn", ", OIDN", "oidn"))
        if denoise == "none" or name in DENOISING_PEERS
    ]


def find(names, quick: bool = False) -> list[Method]:
    """Methods by name; where none is named all of them, or the few that a quick run has time for."""
    known = {method.name: method for method in (*OURS, *of_peers())}
    for name in names:
        require_known(name, known, "there is no such method", key="--methods")
    return [known[name] for name in dict.fromkeys(names or (QUICK if quick else known))]


# ---------------------------------------------------------------------------------------------------------- rendering


@dataclass(frozen=True)
class Timed:
    """Renderings [k, H, W, 3] of a method with different random numbers, and the median time of one."""

    images: np.ndarray
    seconds: float
    cpu_seconds: float
    setup_seconds: float = 0.0
    """Seconds that another program takes to set up its scene, for every image."""


Render = Callable[[int], Timed]
"""Renders with so many samples per pixel."""


@dataclass
class Workshop:
    """Prepares methods for one scene on one device: uploads, tables and compilation come before the clock starts."""

    bench: BenchScene
    device: str
    compile_seconds: float = 0.0
    """Seconds on the clock on the wall."""
    cost: float = 0.0
    """Cost of all preparation, as a `Budget` counts it."""

    @cached_property
    def _renderer(self) -> FrameRenderer:
        return FrameRenderer(self.bench.scene, self.device, self.bench.parts)

    def prepare(self, method: Method) -> tuple[Render, float]:
        """How to render a method, if it serves this scene, and the seconds of its preparation, compilation aside."""
        if method.peer:
            return (lambda spp: self._peer(method, spp)), 0.0
        watch, budget = Stopwatch(), Budget(self.device)
        before = self._renderer.compile_seconds
        self._render(method, spp=1, frame=0)  # compiles, and solves for the field
        compiling = self._renderer.compile_seconds - before
        self.compile_seconds += compiling
        self.cost += budget.seconds
        return (lambda spp: self._ours(method, spp)), watch.seconds - compiling

    def _render(self, method: Method, spp: int, frame: int) -> np.ndarray:
        how = {"spp": spp, "denoise": method.denoise, "frame": frame} | method.how
        image = self._renderer.render(self.bench.T_w_v, self.bench.camera, "A", **how).A
        return image.radiance if method.denoise == "none" else image.denoised

    def _ours(self, method: Method, spp: int) -> Timed:
        images, wall, cpu, whole = [], [], [], Stopwatch()
        while not images or (len(images) < REPEATS and whole.seconds * (1 + 1 / len(images)) < REPEAT_SECONDS):
            watch = Stopwatch()
            images.append(self._render(method, spp, frame=len(images)))
            wall.append(watch.seconds)
            cpu.append(watch.cpu_seconds)
        return Timed(np.array(images, float), float(np.median(wall)), float(np.median(cpu)))

    def _peer(self, method: Method, spp: int) -> Timed:
        seen = (self.bench.scene, self.bench.parts, self.bench.camera, self.bench.T_w_v)
        made = peers.render(method.peer, *seen, spp=spp, denoise=method.denoise != "none")
        return Timed(np.array([made.radiance], float), made.seconds, made.cpu_seconds, made.setup_seconds)
