"""Spectra from files: what is refused, and how it is told."""

import numpy as np
import pytest

from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.info import water_info
from varos_warp.scene.spectra.bands import scene_bands
from varos_warp.scene.spectra.plot import draw_water
from varos_warp.scene.spectra.spectrum import GRID, Spectrum, read_spectra
from varos_warp.scene.spectra.water import pure_absorption, water_spectra

LAMP = {"kind": "spot", "spectrum": "led_b4", "power_W": 10}
DATA = {
    "water": {"spectral": {"jerlov": "1C"}},
    "trajectory": {"poses": [{"position": [0, 0, 0]}]},
    "vehicle": {"lights": [LAMP], "cameras": [{"response": "nikon_5100"}]},
}


def spectral(tmp_path, **changes):
    data = DATA | changes
    return scene_from_dict(data, tmp_path)


def table(path, header, *columns):
    path.write_text("\n".join([header, *(",".join(f"{x:.6g}" for x in row) for row in zip(*columns, strict=True))]))
    return path


def test_a_spectrum_is_linear_between_its_wavelengths():
    spectrum = Spectrum(np.array([400.0, 500.0, 700.0]), np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(spectrum.at([450.0, 600.0, 390.0]), [0.5, 0.5, 0.0])
    assert spectrum.integral() == pytest.approx(150.0)
    assert Spectrum(np.array([400.0, 700.0]), np.array([2.0, 2.0])).integral() == pytest.approx(600.0)


NM = np.arange(400.0, 701.0, 10.0)
BROKEN = [
    ("goes from 450 to 700 nm", NM[5:], np.ones(26)),
    ("goes from 400 to 690 nm", NM[:-1], np.ones(30)),
    ("look like micrometres", NM / 1e3, np.ones(31)),
    ("look like metres", NM * 1e-9, np.ones(31)),
    ("look like Angstrom", NM * 10.0, np.ones(31)),
    ("power is negative", NM, np.where(NM == 500.0, -0.1, 1.0)),
    ("power is 0 everywhere", NM, np.zeros(31)),
    ("wavelength_nm does not increase", np.where(NM == 500.0, 480.0, NM), np.ones(31)),
]


@pytest.mark.parametrize(("problem", "nm", "values"), BROKEN, ids=[case[0] for case in BROKEN])
def test_a_broken_spectrum_is_refused_by_file_and_key(tmp_path, problem, nm, values):
    path = table(tmp_path / "lamp.csv", "wavelength_nm,power", nm, values)
    with pytest.raises(InputError, match=problem) as refused:
        read_spectra(path, "vehicle.lights.0.spectrum", "spectrum of a lamp", ("power",))
    assert refused.value.file == path
    assert refused.value.key == "vehicle.lights.0.spectrum"
    assert refused.value.remedy


@pytest.mark.parametrize(("scale", "unit"), [(0.01, "1/cm"), (0.3, "1/m")])
def test_water_that_absorbs_less_than_pure_water_has_other_units(tmp_path, scale, unit):
    path = table(tmp_path / "iop.csv", "wavelength_nm,a,b", NM, scale * pure_absorption(NM), np.full(31, 0.1))
    with pytest.raises(InputError, match="pure water alone absorbs") as refused:
        water_spectra(spectral(tmp_path, water={"spectral": {"file": "iop.csv"}}))
    assert (refused.value.file, refused.value.key) == (path, "water.spectral.file")
    assert unit in refused.value.remedy
    assert ("multiply" in refused.value.remedy) == (unit == "1/cm")


def test_a_file_of_water_is_what_it_says(tmp_path):
    a, b = pure_absorption(NM) + 0.02, np.linspace(0.4, 0.2, 31)
    table(tmp_path / "iop.csv", "wavelength_nm,a,b", NM, a, b)
    water = water_spectra(spectral(tmp_path, water={"spectral": {"file": "iop.csv"}}))
    np.testing.assert_allclose(water.a[::10], a, rtol=1e-5)
    np.testing.assert_allclose(water.b[::10], b, rtol=1e-5)
    np.testing.assert_allclose(water.c, water.a + water.b)


@pytest.mark.parametrize(
    ("spectrum", "response", "key"),
    [("led_b9", "nikon_5100", "vehicle.lights.0.spectrum"), ("led_b4", "nikkon_5100", "vehicle.cameras.0.response")],
)
def test_names_that_do_not_exist_are_told_with_those_that_do(tmp_path, spectrum, response, key):
    scene = spectral(tmp_path, vehicle={"lights": [LAMP | {"spectrum": spectrum}], "cameras": [{"response": response}]})
    with pytest.raises(InputError, match="Did you mean") as refused:
        scene_bands(scene, scene.vehicle.cameras[0], (1.0, 4.0))
    assert refused.value.key == key


REFUSED = [
    ("exactly one of jerlov, iop, file", {"water": {"spectral": {}}}),
    ("exactly one of jerlov, iop, file", {"water": {"spectral": {"jerlov": "II", "file": "x.csv"}}}),
    ("either power_W or lumen", {"vehicle": {"lights": [{"spectrum": "led_b4"}], "cameras": [{"response": "x"}]}}),
    ("either power_W or lumen", {"vehicle": {"lights": [LAMP | {"lumen": 100}], "cameras": [{"response": "x"}]}}),
    ("not both", {"vehicle": {"lights": [LAMP | {"intensity": [1, 1, 1]}], "cameras": [{"response": "x"}]}}),
    ("of a light with spectrum", {"vehicle": {"lights": [{"power_W": 3}], "cameras": [{"response": "x"}]}}),
    ("needs it of every light", {"vehicle": {"lights": [{}], "cameras": [{"response": "x"}]}}),
    ("needs it of every camera", {"vehicle": {"lights": [LAMP]}}),
    ("means nothing unless", {"water": "none"}),
    ("means nothing unless", {"water": "none", "vehicle": {"cameras": [{"response": "x"}]}}),
    ("means nothing unless", {"water": "none", "vehicle": {}, "render": {"bands": "auto"}}),
    ("render.bands", {"render": {"bands": 2}}),
]


@pytest.mark.parametrize(("problem", "changes"), REFUSED)
def test_what_does_not_fit_together_is_refused(tmp_path, problem, changes):
    with pytest.raises(InputError, match=problem):
        spectral(tmp_path, **changes)


def test_a_scene_by_wavelength_comes_back_from_its_data(tmp_path):
    scene = spectral(tmp_path)
    data = scene.model_dump(mode="json")
    assert "intensity" not in data["vehicle"]["lights"][0]
    assert scene_from_dict(data, tmp_path) == scene


def test_bodies_in_water_by_wavelength_are_refused(tmp_path):
    with pytest.raises(InputError, match="particles: are not drawn in water by wavelength"):
        spectral(tmp_path, particles=[{"share": 1e-4}])


def test_info_tells_spectra_range_and_bands(tmp_path):
    info = water_info(spectral(tmp_path))
    at = info["wavelength_nm"].index(550.0)
    assert (info["a"][at], info["b"][at]) == (pytest.approx(0.0988), pytest.approx(0.427))
    assert info["visibility_m"][at] == pytest.approx(4.8 / 0.5258)
    assert info["b_b"][at] == pytest.approx(0.0183 * 0.427, rel=0.15)
    (bands,) = info["bands"]
    assert max(bands["rms"]) <= 0.02


def test_a_figure_is_drawn_and_another_format_refused(tmp_path):
    draw_water(spectral(tmp_path), tmp_path / "water.png")
    assert (tmp_path / "water.png").read_bytes()[:4] == b"\x89PNG"
    for scene, name, problem in (
        (spectral(tmp_path), "water.xyz", "no format"),
        (spectral(tmp_path, water="none", vehicle={}), "water.svg", "no spectra"),
    ):
        with pytest.raises(InputError, match=problem):
            draw_water(scene, tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["water.png"]


def test_the_grid_covers_the_visible():
    assert (GRID[0], GRID[-1], len(GRID)) == (400.0, 700.0, 301)
