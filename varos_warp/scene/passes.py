"""Bands as passes of three: scenes whose three channels are bands of the spectrum, and how they become an image.

Light of one wavelength is not changed into another, so that a frame in N bands is N frames of one colour. The kernels
carry three of them at a time, in the place of red, green and blue.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from varos_warp.scene.description import Scene
from varos_warp.scene.description.lights import Light
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.description.water import Coefficients, Water
from varos_warp.scene.lights.spectral import spectral_intensity
from varos_warp.scene.optics.camera import water_indices
from varos_warp.scene.spectra.bands import PASS, Bands, scene_bands
from varos_warp.scene.spectra.spectrum import GRID
from varos_warp.scene.spectra.surfaces import reflectance_of_rgb
from varos_warp.scene.water import phase_function
from varos_warp.scene.water.phase.rayleigh import Rayleigh

PATHS_FITTED = 4
"""Distances, of those of the bands, for which the phase functions of passes are made."""


class BandPass(NamedTuple):
    """Three bands of a camera's image."""

    scene: Scene
    """The scene with water and lights' intensities [W/sr/nm] of the bands in place of red, green and blue."""
    wavelength_nm: np.ndarray
    """Wavelengths of the bands [3]."""
    to_bands: np.ndarray
    """Matrix from reflectances R G B to those in the bands, float64 [3 bands, 3]."""
    weights: np.ndarray
    """Weights of the bands' radiances [W/sr/m^2/nm] in the camera's channels, float64 [3 channels, 3 bands] [nm]."""
    of_ambient: np.ndarray
    """Weights of the bands in uniform light of the first light's colour, float64 [3 channels, 3 bands]; rows are 1 over
    all passes."""

    def seen_by(self, view: Camera) -> Camera:
        """A camera whose water, behind a port, has the indices of the bands in the place of those of its channels."""
        if len(set(water_indices(view.n_water))) == 1:
            return view
        return view.model_copy(update={"n_water": water_indices(view.n_water, self.wavelength_nm)})


@dataclass(frozen=True)
class BandWater:
    """Water as a camera sees it in N bands, by white light of the first lamp."""

    sigma_t: np.ndarray
    """Extinction in the bands [1/m], float64 [N]."""
    white: np.ndarray
    """Share of each band in the channels, float64 [3, N]; rows add up to 1."""

    def left(self, distance: np.ndarray) -> np.ndarray:
        """Share of light that is neither absorbed nor scattered over distances [...] [m], float64 [..., 3]."""
        return np.exp(-np.asarray(distance)[..., None] * self.sigma_t) @ self.white.T

    @classmethod
    def of_camera(cls, scene: Scene, camera: Camera) -> "BandWater":
        """Return the water as one of a scene's cameras sees it."""
        bands = scene_bands(scene, camera)
        return cls(bands.a + bands.b_water + bands.b_particles, shares(bands))

    @classmethod
    def of(cls, water: dict, camera: str) -> "BandWater":
        """Return the water as dataset.json describes it for a camera; without bands, each channel is one."""
        if "bands" not in water:
            return cls(np.add(water["sigma_a"], water["sigma_s"]), np.eye(3))
        bands = next(bands for bands in water["bands"] if bands["camera"] == camera)
        return cls(np.add(bands["a"], bands["b"]), np.array(bands["white"]))


def described(scene: Scene) -> list[dict]:
    """The bands of each camera in plain JSON types, to make anew from them what the camera sees."""
    found = []
    for camera in scene.vehicle.cameras:
        bands = scene_bands(scene, camera)
        found.append(
            {
                "camera": camera.id,
                "wavelength_nm": bands.wavelength_nm.tolist(),
                "a": bands.a.tolist(),
                "b": (bands.b_water + bands.b_particles).tolist(),
                "weights": balanced(bands).tolist(),
                "white": shares(bands).tolist(),
                "range_m": list(bands.range_m),
                "rms": bands.rms.tolist(),
                "worst": bands.worst.tolist(),
                "backscatter": backscatter_error(scene, camera).tolist(),
            }
        )
    return found


def balanced(bands: Bands) -> np.ndarray:
    """Weights float64 [3, N] [nm] of a camera that is balanced for its lamps.

    A white surface close to the first lamp is white, and as bright as the same power in a scene of three channels.
    """
    return bands.weights / bands.white[:, None]


def shares(bands: Bands) -> np.ndarray:
    """Share of each band in what the channels see of white in the light of the first lamp, float64 [3, N]."""
    seen = bands.weights * bands.lamps[0]
    return seen / seen.sum(axis=1, keepdims=True)


def passes(scene: Scene, camera: Camera) -> list[BandPass]:
    """The passes of a camera's image in a scene by wavelength; the last may have bands of weight 0.

    Raises:
        InputError: A file of the water, a light or the camera cannot be used.
    """
    bands = scene_bands(scene, camera)
    weights, white = balanced(bands), shares(bands)
    shining = np.zeros((len(scene.lights), len(bands.wavelength_nm)))
    for own, light in zip(shining, scene.lights, strict=True):
        own[:] = np.interp(bands.wavelength_nm, GRID, spectral_intensity(light, scene))
    made, of_water = [], shares_of_water(bands)
    for share, (chosen, used) in zip(of_water, _in_threes(len(bands.wavelength_nm)), strict=True):
        nm = bands.wavelength_nm[chosen]
        made.append(
            BandPass(
                _of_bands(scene, bands, chosen, shining[:, chosen], share),
                nm,
                reflectance_of_rgb(np.eye(3), nm).T,
                weights[:, chosen] * used,
                white[:, chosen] * used,
            )
        )
    return made


def _in_threes(count: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Numbers of the bands of each pass, the last band again where there are too few, and which of them count."""
    for first in range(0, count, PASS):
        number = first + np.arange(PASS)
        yield np.minimum(number, count - 1), number < count


def _seen(bands: Bands) -> np.ndarray:
    """What channels see of white at each band after some of its distances, float64 [PATHS_FITTED, 3, N]."""
    way = np.linspace(*bands.range_m, PATHS_FITTED)
    return shares(bands) * np.exp(-np.outer(way, bands.a + bands.b_water + bands.b_particles))[:, None]


def shares_of_water(bands: Bands) -> np.ndarray:
    """What the water itself scatters, as a share of all scattering in each pass, float64 [passes].

    A pass has one phase function for three bands whose shares differ. Those of the passes are such that each channel
    sees all passes together scatter what it should, over the distances of the bands, by least squares of relative
    errors; none leaves the range of its own bands.
    """
    b, threes = bands.b_water + bands.b_particles, list(_in_threes(len(bands.wavelength_nm)))
    own = bands.b_water / np.maximum(b, 1e-300)
    least, most = (np.array([of(own[chosen]) for chosen, _ in threes]) for of in (np.min, np.max))
    seen = _seen(bands).reshape(-1, len(b))
    of_water = (seen * bands.b_water).sum(axis=1)
    counts = of_water > 1e-12 * of_water.max()
    if not counts.any():
        return least
    rows = np.stack([(seen * b)[:, chosen] @ used for chosen, used in threes], axis=1)[counts] / of_water[counts, None]
    return lsq_linear(rows, np.ones(len(rows)), (least - 1e-9, most + 1e-9)).x.clip(0.0, 1.0)


def backscatter_error(scene: Scene, camera: Camera) -> np.ndarray:
    """Largest relative error of each channel's light scattered straight back, float64 [3], as passes share phases.

    Over the distances of the bands, against a phase function of each band's own. Errors of the bands come on top.

    Raises:
        InputError: A file of the water, a light or the camera cannot be used.
    """
    bands, back = scene_bands(scene, camera), np.ones(1)
    of_water, of_particles = (float(phase.eval_s(back)[0]) for phase in (Rayleigh(), phase_function(scene)))
    b = bands.b_water + bands.b_particles
    share = np.repeat(shares_of_water(bands), PASS)[: len(b)]
    ours = b * (share * of_water + (1.0 - share) * of_particles)
    known = bands.b_water * of_water + bands.b_particles * of_particles
    ours, known = (_seen(bands) @ scattered for scattered in (ours, known))
    return np.abs(np.divide(ours, known, out=np.ones_like(ours), where=known > 0.0) - 1.0).max(axis=0)


def _of_bands(scene: Scene, bands: Bands, chosen: np.ndarray, shining: np.ndarray, of_water: float) -> Scene:
    """The scene with three bands in the place of its channels.

    Args:
        shining: Intensity of each light in them [W/sr/nm].
        of_water: What the water itself scatters in them, as a share of all scattering.
    """
    b = bands.b_water[chosen] + bands.b_particles[chosen]
    phase = _phase(scene.water.spectral.phase.model_dump(), float(of_water))
    water = Water(coefficients=Coefficients(sigma_s=tuple(b), sigma_a=tuple(bands.a[chosen]), phase=phase))
    lit = {id(light): {"intensity": tuple(own)} for light, own in zip(scene.lights, shining, strict=True)}
    return with_lights(scene, lambda light: lit.get(id(light), {})).model_copy(update={"water": water})


def with_lights(scene: Scene, changes: Callable[[Light], dict[str, Any]]) -> Scene:
    """The scene with other values of some keys of its lights, on whichever vehicle; one that two share stays one."""
    made: dict[int, Light] = {}

    def of(vehicle: Any) -> Any:
        lights = [made.setdefault(id(light), light.model_copy(update=changes(light))) for light in vehicle.lights]
        return vehicle.model_copy(update={"lights": lights})

    vehicles = [of(vehicle) for vehicle in scene.vehicles] if scene.vehicles else scene.vehicles
    return scene.model_copy(update={"vehicle": of(scene.vehicle), "vehicles": vehicles})


def as_kernels_know(scene: Scene) -> Scene:
    """The scene, or of one by wavelength the first three bands of its first camera.

    Raises:
        InputError: A file of the water, a light or the camera cannot be used.
    """
    return passes(scene, scene.vehicle.cameras[0])[0].scene if scene.is_spectral else scene


def _phase(of_particles: dict, share: float) -> dict:
    """The phase function of particles and, a share of the scattering, of the water itself."""
    if share < 1e-6:
        return of_particles
    kinds = of_particles["of"] if of_particles["kind"] == "mixture" else [of_particles | {"weight": 1.0}]
    whole = sum(kind["weight"] for kind in kinds)
    mixed = [kind | {"weight": (1.0 - share) * kind["weight"] / whole} for kind in kinds]
    return {"kind": "mixture", "of": [*mixed, {"kind": "rayleigh", "weight": share}]}
