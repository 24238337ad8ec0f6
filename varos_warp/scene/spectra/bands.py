"""The fewest wavelengths that stand for a spectrum: quadrature of lamp, water and camera, with a stated error.

What channel k of a camera sees directly of a surface of reflectance r, over a path d through the water, is

    S_k(d) = int R_k(w) L(w) r(w) exp(-c(w) d) dw,   approximated by   sum_j W_kj L(w_j) r(w_j) exp(-c(w_j) d)

Bands are wavelengths w_j with weights W_kj >= 0, shared by all lamps, distances and surfaces. For given wavelengths the
weights are the nonnegative least squares of the relative errors; wavelengths are added one by one where they help the
worst channel most, and then moved to neighbours while that helps. They grow from none, and from the bands that served
for fewer: what is better is taken, and can be a fourth better. Light scattered in the water is such a sum as well,
with b(w) in the place of r(w), and that is among the surfaces.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from varos_warp.cache import digest
from varos_warp.scene.description import Scene
from varos_warp.scene.description.render import MOST_BANDS
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.spectra.lamps import HALOGEN_K, black_body, camera_response, lamp_spectrum, per_watt
from varos_warp.scene.spectra.spectrum import GRID, STEPS, Spectrum
from varos_warp.scene.spectra.surfaces import chart_reflectances, reflectance_of_rgb
from varos_warp.scene.spectra.water import WaterSpectra, water_spectra

CANDIDATES = np.arange(0, len(GRID), 5)
"""Numbers of the wavelengths on `GRID` that may become bands."""
FITTED = ("white", "foliage", "blue", "red", "yellow", "cyan")
"""Patches of the colour chart whose light the weights are fitted to; the error is stated for all 24."""
PAINTS = ((0.5, 0.1, 0.05), (0.05, 0.3, 0.1), (0.05, 0.1, 0.5))
"""Colours of materials, linear R G B, whose light the weights are fitted to as well, and for which the error is stated:
spectra made of colours are unlike measured ones."""
FITTED_DISTANCES = 8
"""Distances that the weights are fitted to; the error is stated for four times as many."""
FEW = 12
"""Bands from which on it matters little whether they grow from none or from those that served for fewer."""
MOST_STEPS = 100
"""Most steps of the fit for each band. Turbid water and a halogen lamp take up to 6; scipy's own bound is 3."""
PASS = 3
"""Bands that a pass of the renderer carries, one in each of its channels; ``auto`` fills its passes."""

PATHS_M = (1.0, 20.0)
"""Paths from light to surface to camera for which bands are chosen unless the scene says [m]: what a light at the
camera shows up to 10 m."""


@dataclass(frozen=True)
class Bands:
    """Wavelengths that stand for the spectrum, and what is there to know at them."""

    wavelength_nm: np.ndarray
    """[N], ascending."""
    weights: np.ndarray
    """Weight of each band in the channels of the camera, float64 [3, N] [nm]."""
    a: np.ndarray
    """Absorption of the water at them [1/m]."""
    b_water: np.ndarray
    """Scattering by the water itself [1/m]."""
    b_particles: np.ndarray
    """Scattering by particles [1/m]."""
    lamps: np.ndarray
    """Power of each lamp at them for one watt within 400 to 700 nm, float64 [lamps, N] [1/nm]."""
    white: np.ndarray
    """What each channel sees of white in the light of one watt of the first lamp, by the nanometre, float64 [3]."""
    rms: np.ndarray
    """Root mean square of the relative errors of each channel, over the same cases as `worst`, float64 [3]."""
    worst: np.ndarray
    """Worst relative error of each channel's direct signal against integration by 1 nm, float64 [3].

    Over the lamps, the distances asked for, the 24 patches of the colour chart, and `PAINTS`."""
    range_m: tuple[float, float]
    """Shortest and longest way of light that they were chosen for [m]."""


class _Problem:
    """Light by candidate wavelength in every case (lamp, surface, distance), relative to what each channel sees."""

    def __init__(
        self, water: WaterSpectra, lamps: np.ndarray, response: np.ndarray, surfaces: np.ndarray, distances: np.ndarray
    ):
        beam = np.exp(-np.outer(distances, water.c))
        self.light = np.einsum("lw,sw,dw->lsdw", lamps, surfaces, beam).reshape(-1, len(GRID))
        self.exact = (self.light * STEPS) @ response.T
        self.counts = self.exact > 1e-12 * self.exact.max(axis=0)

    def weights(self, chosen: Sequence[int]) -> np.ndarray:
        """The best nonnegative weights [3, N] of some wavelengths."""
        return np.array([self._fitted(k, chosen)[0] for k in range(3)])

    def residual(self, chosen: Sequence[int]) -> float:
        """Root mean square of the relative errors in the worst channel."""
        return max(self._fitted(k, chosen)[1] / np.sqrt(self.counts[:, k].sum()) for k in range(3))

    def errors(self, chosen: Sequence[int], weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Root mean square and maximum of the relative errors of each channel, float64 [3]."""
        found = self.light[:, chosen] @ weights.T
        relative = np.divide(found, self.exact, out=np.ones_like(found), where=self.counts) - 1.0
        return np.sqrt((relative**2).sum(axis=0) / self.counts.sum(axis=0)), np.abs(relative).max(axis=0)

    def _fitted(self, channel: int, chosen: Sequence[int]) -> tuple[np.ndarray, float]:
        """Nonnegative weights [N] of least relative errors, and the norm of these."""
        cases = self.counts[:, channel]
        relative = self.light[np.ix_(cases, chosen)] / self.exact[cases, channel, None]
        return nnls(relative, np.ones(len(relative)), maxiter=MOST_STEPS * len(chosen))


def choose_bands(
    water: WaterSpectra,
    lamps: Sequence[Spectrum],
    response: np.ndarray,
    distances: tuple[float, float],
    bands: int | str = "auto",
    tolerance: float = 0.02,
) -> Bands:
    """The bands for a water, its lamps and a camera.

    Args:
        lamps: Relative power of each lamp, of any scale.
        response: Sensitivities of the camera on `GRID`, of any scale, float64 [3, 301].
        distances: Shortest and longest path from lamp to surface to camera [m].
        bands: How many; ``auto``: the fewest, by whole passes, whose `Bands.rms` keeps the tolerance, and at most
            `MOST_BANDS`.
        tolerance: Relative error that ``auto`` allows; what is reached stands in the result.
    """
    power = np.array([per_watt(lamp) for lamp in lamps])
    fitted = [
        *(chart_reflectances()[name].at() for name in FITTED),
        *reflectance_of_rgb(PAINTS),
        water.b / max(water.b.max(), 1e-300),
    ]
    problem = _Problem(water, power, response, np.array(fitted), np.linspace(*distances, FITTED_DISTANCES))
    judge = _judge(water, power, response, distances)
    chosen: list[int] = []
    auto = bands == "auto"
    for count in range(PASS, MOST_BANDS + 1, PASS) if auto else [*range(PASS, min(int(bands), FEW), PASS), int(bands)]:
        made = [_moved(problem, _grown(problem, begun, count)) for begun in ([], chosen)]
        chosen = min(made, key=problem.residual)
        weights = problem.weights(chosen)
        rms, worst = judge.errors(chosen, weights)
        if auto and rms.max() <= tolerance:
            break
    return Bands(
        GRID[chosen],
        weights,
        water.a[chosen],
        water.b_water[chosen],
        water.b_particles[chosen],
        power[:, chosen],
        (response * STEPS) @ power[0],
        rms,
        worst,
        distances,
    )


def _judge(water: WaterSpectra, power: np.ndarray, response: np.ndarray, distances: tuple[float, float]) -> _Problem:
    """What errors are stated for: every patch and paint, at many distances."""
    surfaces = [*(patch.at() for patch in chart_reflectances().values()), *reflectance_of_rgb(PAINTS)]
    return _Problem(water, power, response, np.array(surfaces), np.linspace(*distances, 4 * FITTED_DISTANCES))


def scene_bands(scene: Scene, camera: Camera, distances: tuple[float, float] | None = None) -> Bands:
    """The bands of a scene's water, the lights that shine in it, and one of its cameras, for the scene's ways of light.

    They are chosen once for what they follow from, and kept.

    Raises:
        InputError: A file of the water, a light or the camera cannot be used.
    """
    given = given_spectra(scene, camera)
    distances = distances or scene.render.bands_range_m or PATHS_M
    more = (distances, scene.render.bands or "auto", scene.render.tolerance)
    arrays = [given.water.a, given.water.b_water, given.water.b_particles, given.response, *map(per_watt, given.lamps)]
    return _chosen(_Asked(digest(*arrays), more, given))


def rms_over(scene: Scene, camera: Camera, distances: tuple[float, float]) -> np.ndarray:
    """Root mean square of the relative errors of the scene's bands over other ways of light [m], float64 [3].

    Raises:
        InputError: As `scene_bands`.
    """
    bands, given = scene_bands(scene, camera), given_spectra(scene, camera)
    judge = _judge(given.water, np.array([per_watt(lamp) for lamp in given.lamps]), given.response, distances)
    return judge.errors(np.searchsorted(GRID, bands.wavelength_nm), bands.weights)[0]


class Given(NamedTuple):
    """Spectra of a scene that bands stand for."""

    water: WaterSpectra
    lamps: list[Spectrum]
    response: np.ndarray


def given_spectra(scene: Scene, camera: Camera) -> Given:
    """The spectra of a scene's water and lights, of which none is a halogen lamp, and of one of its cameras.

    Raises:
        InputError: A file of the water, a light or the camera cannot be used.
    """
    lamps = [
        lamp_spectrum(light.spectrum, scene.resolve, f"{scene.key_of_light(light)}.spectrum") for light in scene.lights
    ]
    response = camera_response(camera.response, scene.resolve, scene.key_of_camera(camera) + ".response")
    return Given(water_spectra(scene), lamps or [black_body(HALOGEN_K)], response)


@dataclass(frozen=True)
class _Asked:
    """What bands are asked for; equal to another if they are the same."""

    spectra: str
    """Digest of all spectra."""
    more: tuple[tuple[float, float], int | str, float]
    """Distances, number of bands and tolerance."""
    given: Given = field(compare=False)


@lru_cache(maxsize=64)
def _chosen(asked: _Asked) -> Bands:
    """Bands whose arrays nobody may change, as they are kept."""
    bands = choose_bands(*asked.given, *asked.more)
    for value in vars(bands).values():
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
    return bands


def _grown(problem: _Problem, chosen: list[int], count: int) -> list[int]:
    """Choose so many wavelengths: each is the one that leaves the least error beside those before it."""
    while len(chosen) < count:
        left = [i for i in CANDIDATES if i not in chosen]
        chosen = sorted([*chosen, min(left, key=lambda i: problem.residual(sorted([*chosen, i])))])
    return chosen


def _moved(problem: _Problem, chosen: list[int]) -> list[int]:
    """Move each of the wavelengths to its neighbours as long as that makes the error less."""
    best, step = problem.residual(chosen), int(CANDIDATES[1])
    while step:
        before = best
        for at in range(len(chosen)):
            for moved in (chosen[at] - step, chosen[at] + step):
                trial = sorted({*chosen[:at], *chosen[at + 1 :], moved})
                if 0 <= moved < len(GRID) and len(trial) == len(chosen) and (new := problem.residual(trial)) < best:
                    chosen, best = trial, new
        if best > 0.99 * before:
            step //= 2
    return chosen
