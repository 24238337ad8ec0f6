"""Mitsuba's spectral variant as a foreign judge of water by wavelength: direct light, and light scattered once.

It samples wavelengths, and weighs them by the camera's curves on its film. Only the tables of spectra are shared.
"""

import numpy as np
import pytest
from physics.rig import Z

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.spectra.bands import PATHS_M, scene_bands
from varos_warp.scene.spectra.lamps import camera_response, lamp_spectrum
from varos_warp.scene.spectra.spectrum import GRID, STEPS
from varos_warp.scene.spectra.surfaces import reflectance_of_rgb
from varos_warp.scene.spectra.water import water_spectra

mitsuba = pytest.importorskip("mitsuba")
PAINT, G, FLOOR_M, HALF_DEG, BANDS = (0.5, 0.2, 0.1), 0.7, 2.5, 30.0, 24
LAMP = {
    "kind": "spot",
    "position": [0.4, 0.0, 0.25],
    "direction": [-0.1, 1.0, -0.05],
    "cone_deg": 2 * HALF_DEG,
    "blend": 0.0,
}
VIEW = {"id": "M0", "resolution": [24, 16], "sensor_mm": [4.5, 3.0], "focal_mm": 4.0, "response": "nikon_5100"}
SAMPLES, PARTS = 96, 16
"""Per pixel, of each of so many renderings; their spread gives the standard error."""


def ours(water, paint, layer):
    """The scene, the mean of the image [3], and its standard error [3]."""
    corners = np.array([[-50, FLOOR_M, -50], [50, FLOOR_M, -50], [50, FLOOR_M, 50], [-50, FLOOR_M, 50]], float)
    floor = Part("floor", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Diffuse(reflectance=paint))
    scene = Scene(
        water={"spectral": water | {"phase": {"g": G}}},
        render={"bands": BANDS},
        vehicle={"lights": [LAMP | {"spectrum": "led_b4", "power_W": 1.0}], "cameras": [VIEW]},
        trajectory={"poses": [{"position": [0, 0, 0]}]},
    )
    A = (
        FrameRenderer(scene, "cpu", [floor])
        .render(np.eye(4), None, "A", layers=(layer,), spp=16, integrator="path", denoise="none")
        .A
    )
    stderr = np.sqrt((A.stderr.astype(float) ** 2).sum((0, 1))) / A.radiance[..., 0].size
    return scene, A.radiance.mean((0, 1), float), stderr


def spectrum(values):
    """A table by the nanometre, which must not be 0 everywhere."""
    if not np.any(values):
        return {"type": "uniform", "value": 0.0}
    return {
        "type": "regular",
        "wavelength_min": 400.0,
        "wavelength_max": 700.0,
        "values": ", ".join(f"{v:.9g}" for v in np.broadcast_to(values, GRID.shape)),
    }


def theirs(lamp, paint, sigma_t, albedo, phase):
    """Means of the channels of images, float64 [PARTS, 3]."""
    view = mitsuba.ScalarTransform4f().look_at([0, 0, 0], [0, 1, 0], [0, 0, 1])
    beam = mitsuba.ScalarTransform4f().look_at(
        LAMP["position"], np.add(LAMP["position"], LAMP["direction"]).tolist(), [0, 0, 1]
    )
    film = {"type": "specfilm", "width": 24, "height": 16, "component_format": "float32", "rfilter": {"type": "box"}}
    film |= {f"srf{i}": spectrum(curve) for i, curve in enumerate(camera_response("nikon_5100", None, ""))}
    sensor = {
        "type": "perspective",
        "fov_axis": "x",
        "fov": float(np.degrees(2 * np.arctan(2.25 / 4.0))),
        "to_world": view,
        "film": film,
        "near_clip": 1e-3,
        "sampler": {"type": "independent"},
    }
    if np.any(sigma_t):
        sensor["medium"] = {
            "type": "homogeneous",
            "phase": phase,
            **{
                name: {"type": "constvolume", "value": spectrum(values)}
                for name, values in (("sigma_t", sigma_t), ("albedo", albedo))
            },
        }
    square = mitsuba.ScalarTransform4f().look_at([0, FLOOR_M, 0], [0, 0, 0], [0, 0, 1]).scale(50.0)
    scene = mitsuba.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "volpathmis", "max_depth": 2, "rr_depth": 100},
            "sensor": sensor,
            "floor": {
                "type": "rectangle",
                "to_world": square,
                "bsdf": {"type": "twosided", "material": {"type": "diffuse", "reflectance": spectrum(paint)}},
            },
            "lamp": {
                "type": "spot",
                "to_world": beam,
                "cutoff_angle": HALF_DEG,
                "beam_width": HALF_DEG,
                "intensity": spectrum(lamp),
            },
        }
    )
    images = [np.array(mitsuba.render(scene, spp=SAMPLES, seed=seed), float) for seed in range(PARTS)]
    return np.array([image.mean((0, 1)) for image in images])


def compared(water, paint, layer) -> dict[str, np.ndarray]:
    """Our mean over Mitsuba's less 1 of each channel, its standard error, and the stated error of the bands."""
    mitsuba.set_variant("scalar_spectral")
    scene, mean, stderr = ours(water, paint, layer)
    spectra, lamp = water_spectra(scene), lamp_spectrum("led_b4", None, "").at()
    lamp /= (STEPS @ lamp) * 2.0 * np.pi * (1.0 - np.cos(np.radians(HALF_DEG)))  # of one watt in the cone
    curves = reflectance_of_rgb(paint)
    if layer == "direct":
        images = theirs(lamp, curves, spectra.c, 0.0, {"type": "isotropic"})
    else:  # once is a sum: by particles, and by the water itself, 1 + 0.835 cos^2
        own = {"type": "blendphase", "weight": 0.1287, "first": {"type": "rayleigh"}, "then": {"type": "isotropic"}}
        images = theirs(lamp, curves, spectra.c, spectra.b_particles / spectra.c, {"type": "hg", "g": G}) + theirs(
            lamp, curves, spectra.c, spectra.b_water / spectra.c, own
        )
    white = camera_response("nikon_5100", None, "") @ (STEPS * lamp) / (STEPS @ lamp)
    truth, unsure = images.mean(0) / white, images.std(0, ddof=1) / np.sqrt(PARTS) / white
    return {
        "off": mean / truth - 1.0,
        "stderr": np.hypot(stderr, unsure) / truth,
        "stated": scene_bands(scene, scene.vehicle.cameras[0], PATHS_M).worst,
    }


@pytest.mark.parametrize(
    "water",
    [{"jerlov": "1C"}, {"jerlov": "IA"}, {"iop": {"chlorophyll_mg_m3": 0.05}}],
    ids=["coast", "clear sea", "few particles"],
)
@pytest.mark.parametrize(("layer", "paint"), [("direct", PAINT), ("single", (0.0, 0.0, 0.0))])
def test_mitsuba_sees_the_same_light(water, layer, paint):
    """Image means of direct light off a painted floor, and of light scattered once before a black one."""
    told = compared(water, paint, layer)
    assert (told["stderr"] < 0.01).all(), told
    assert (np.abs(told["off"]) < told["stated"] + Z * told["stderr"]).all(), told
