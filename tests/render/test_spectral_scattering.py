"""Light scattered once in water by wavelength, against an integral over wavelengths and along the ray, by scipy."""

from itertools import pairwise

import numpy as np
import pytest
from physics.rig import Z, hg, smoothstep_edge
from scipy.integrate import quad_vec

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.lights.spectral import spectral_intensity
from varos_warp.scene.passes import shares, shares_of_water
from varos_warp.scene.spectra.bands import PATHS_M, scene_bands
from varos_warp.scene.spectra.lamps import camera_response
from varos_warp.scene.spectra.spectrum import STEPS
from varos_warp.scene.spectra.water import water_spectra

G = 0.9
"""Mean cosine of the particles' phase function."""
BESIDE = {"kind": "spot", "position": [0.3, 0.0, -0.1], "direction": [-0.1, 1.0, 0.0], "cone_deg": 70.0, "blend": 0.4}
AROUND = {"kind": "point", "position": [-0.2, -0.1, 0.4]}
FACING = {"kind": "point", "position": [0.5, 3.0, 0.3]}
RAYS = ((0.0, 1.0, 0.0), (0.3, 1.0, -0.2), (-0.5, 1.0, 0.3))
"""What single pixels look along."""
CASES = {
    "coast": ({"jerlov": "1C"}, BESIDE),
    "clear sea": ({"jerlov": "IA"}, FACING),
    "measured sea": ({"jerlov": "IB"}, BESIDE),
    "few particles": ({"iop": {"chlorophyll_mg_m3": 0.05}}, AROUND),
}


def scene_of(water, lamp, folder, **render):
    """Every pixel of each camera sees one ray, to 1e-7 rad."""
    cameras = [
        {
            "id": f"M{i}",
            "look_at": ray,
            "resolution": [16, 16],
            "sensor_mm": [1e-3, 1e-3],
            "focal_mm": 1e4,
            "response": "nikon_5100",
        }
        for i, ray in enumerate(RAYS)
    ]
    return scene_from_dict(
        {
            "water": {"spectral": water | {"phase": {"g": G}}},
            "vehicle": {"lights": [lamp | {"spectrum": "led_b4", "lumen": 5000.0}], "cameras": cameras},
            "render": render,
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
        },
        folder,
    )


def scattered_once(water, lamp, ray) -> np.ndarray:
    """Radiance per intensity by wavelength [1/m^2], along ``ray`` from the origin through endless water.

    Each wavelength has a phase function of its own: the particles' and the water's by what each scatters there. The
    variable is the angle at the lamp, in which 1 / d^2 is even.
    """
    p, u = np.asarray(lamp["position"], float), np.asarray(ray, float) / np.linalg.norm(ray)
    foot = p @ u
    h = np.linalg.norm(p - foot * u)

    def integrand(theta):
        t, d = foot + h * np.tan(theta), h / np.cos(theta)
        cosine = -np.sin(theta)
        own = 0.06225 * (1.0 + 0.835 * cosine**2)
        there = (water.b_particles * hg(cosine, G) + water.b_water * own) * np.exp(-water.c * (t + d)) / h
        if "direction" in lamp:
            axis = np.array(lamp["direction"]) / np.linalg.norm(lamp["direction"])
            there = there * smoothstep_edge((t * u - p) @ axis / d, lamp["cone_deg"], lamp["blend"])
        return there

    ends = np.linspace(np.arctan2(-foot, h), np.pi / 2, 33)
    return sum(quad_vec(integrand, *piece, epsrel=1e-6, epsabs=1e-12)[0] for piece in pairwise(ends))


@pytest.mark.parametrize("case", CASES)
def test_single_scattering_is_an_integral_by_the_nanometre(case, tmp_path):
    """Within what is stated of the bands and the noise; phase functions of passes hold that of each wavelength."""
    water, lamp = CASES[case]
    scene = scene_of(water, lamp, tmp_path)
    spectra, light = water_spectra(scene), spectral_intensity(scene.lights[0], scene)
    weights = camera_response("nikon_5100", scene.resolve, "response") * STEPS * light
    stated = scene_bands(scene, scene.vehicle.cameras[0], PATHS_M).worst
    renderer = FrameRenderer(scene, "cpu")
    for i, ray in enumerate(RAYS):
        exact = weights @ scattered_once(spectra, lamp, ray) / weights.sum(1) * (STEPS @ light)
        A = renderer.render(np.eye(4), f"M{i}", "A", spp=64, seed=3, integrator="path", layers=("single",)).A
        off = A.radiance.reshape(-1, 3).mean(0, float) / exact - 1.0
        stderr = np.sqrt((A.stderr.astype(float) ** 2).sum((0, 1))) / 256 / exact
        assert (stderr < 0.001).all(), stderr
        assert (np.abs(off) < stated + Z * stderr).all(), (off, stderr, stated)


@pytest.mark.parametrize(
    "water",
    [{"jerlov": kind} for kind in ("I", "IA", "IB", "II", "III", "1C", "3C", "9C")]
    + [{"iop": {"chlorophyll_mg_m3": chlorophyll}} for chlorophyll in (0.0, 0.05, 0.2, 2.0)],
)
def test_phase_functions_of_passes_send_back_what_the_bands_do(water, tmp_path):
    """By white light in each channel, over paths of 0.5 to 20 m: by a half of the water's own scattering and B of the
    particles', to what docs/spectra.md states.
    """
    scene = scene_of(water, AROUND, tmp_path, bands="auto")
    camera = scene.vehicle.cameras[0]
    bands, B = scene_bands(scene, camera, PATHS_M), water_spectra(scene).backscatter_fraction
    b = bands.b_water + bands.b_particles
    share = np.repeat(shares_of_water(bands), 3)[: len(b)]
    for d in (0.5, 1.0, 3.0, 10.0, 20.0):
        seen = shares(bands) * np.exp(-d * (bands.a + b))
        sent, due = seen @ (b * (0.5 * share + B * (1.0 - share))), seen @ (0.5 * bands.b_water + B * bands.b_particles)
        np.testing.assert_allclose(sent, due, rtol=0.014)
