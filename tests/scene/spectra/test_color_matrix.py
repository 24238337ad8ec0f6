"""Colour matrices of cameras: how they are fitted, and what is refused."""

import colour
import numpy as np
import pytest
from scipy.optimize import minimize

from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_from_dict, scene_to_dict
from varos_warp.scene.spectra.lamps import camera_response, lamp_spectrum
from varos_warp.scene.spectra.matrix import color_matrix, fitted_matrix
from varos_warp.scene.spectra.spectrum import STEPS
from varos_warp.scene.spectra.surfaces import chart_colours, chart_reflectances

NIKON = camera_response("nikon_5100", None, "")
GIVEN = [[1.6, -0.5, -0.1], [-0.2, 1.5, -0.3], [0.0, -0.6, 1.6]]


def seen(lamp, response=NIKON):
    """Patches [24, 3] in the channels of a camera that is balanced for a lamp."""
    light = response * lamp.at() * STEPS
    return np.array([(light * patch.at()).sum(axis=1) for patch in chart_reflectances().values()]) / light.sum(axis=1)


def scene_of(matrix="auto", spectral=True, lamp="led_b4", **camera):
    view = {"color_matrix": matrix, **camera} | ({"response": "nikon_5100"} if spectral else {})
    light = {"spectrum": lamp, "power_W": 10.0} if spectral else {"intensity": [1, 1, 1]}
    return scene_from_dict(
        {
            "water": {"spectral": {"jerlov": "IB"}} if spectral else "none",
            "vehicle": {"lights": [light], "cameras": [view]},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
        },
        ".",
    )


@pytest.mark.parametrize("name", ["led_b1", "led_b4", "halogen_3200K"])
def test_it_leaves_white_and_is_the_best_that_does(name):
    """Against a search over all six free numbers."""
    lamp = lamp_spectrum(name, None, "")
    found, channels = fitted_matrix(lamp, NIKON), seen(lamp)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, rtol=1e-12)

    def missed(free):
        rows = np.column_stack([free.reshape(3, 2), 1.0 - free.reshape(3, 2).sum(axis=1)])
        return ((channels @ rows.T - chart_colours()) ** 2).sum()

    best = minimize(missed, np.eye(3)[:, :2].ravel(), tol=1e-14)
    np.testing.assert_allclose(found[:, :2].ravel(), best.x, atol=1e-5)


def test_colours_are_nearer_to_those_of_the_patches_than_the_channels_are():
    """By CIE 2000, on average: noticeable is about 1, and colour-science's own least squares are no better by much."""
    channels = seen(lamp_spectrum("led_b4", None, ""))
    matrix = fitted_matrix(lamp_spectrum("led_b4", None, ""), NIKON)
    theirs = colour.matrix_colour_correction(channels, chart_colours(), method="Cheung 2004")

    def differs(linear):
        lab = [colour.XYZ_to_Lab(colour.RGB_to_XYZ(np.clip(x, 0.0, 1.0), "sRGB")) for x in (linear, chart_colours())]
        return float(colour.delta_E(*lab, method="CIE 2000").mean())

    raw, ours, free = differs(channels), differs(channels @ matrix.T), differs(channels @ theirs.T)
    assert ours < 0.4 * raw
    assert ours < free + 0.5


def test_a_response_that_is_the_eyes_gives_back_the_colours_of_patches(tmp_path):
    """Channels that see sRGB as they are under D65: the matrix is one, up to what is left out beyond 400 to 700 nm."""
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(colour.SpectralShape(400, 700, 1))
    d65 = colour.SDS_ILLUMINANTS["D65"].copy().align(colour.SpectralShape(380, 780, 1))
    table = tmp_path / "d65.csv"
    table.write_text(
        "wavelength_nm,power\n" + "".join(f"{w:g},{v}\n" for w, v in zip(d65.wavelengths, d65.values, strict=True))
    )
    found = fitted_matrix(lamp_spectrum("d65.csv", lambda name: tmp_path / name, ""), observer.values.T)
    white = observer.values.T @ (d65.values[20:-80] * STEPS)
    exact = colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB * (white / white[1])
    np.testing.assert_allclose(found, exact, atol=0.02)


def test_it_follows_the_first_lamp_and_numbers_count_as_they_are():
    scenes = {lamp: scene_of(lamp=lamp) for lamp in ("led_b1", "led_b5")}
    for lamp, scene in scenes.items():
        np.testing.assert_array_equal(
            color_matrix(scene, scene.vehicle.cameras[0]), fitted_matrix(lamp_spectrum(lamp, None, ""), NIKON)
        )
    given = scene_of(GIVEN)
    np.testing.assert_array_equal(color_matrix(given, given.vehicle.cameras[0]), GIVEN)
    none = scene_of(None)
    assert color_matrix(none, none.vehicle.cameras[0]) is None
    assert "color_matrix" not in scene_to_dict(none)["vehicle"]["cameras"][0]


@pytest.mark.parametrize(
    ("matrix", "says"),
    [
        ([[1, 0, 0], [0, 1, 0]], "color_matrix"),
        ([[1, 0], [0, 1], [1, 1]], "color_matrix"),
        (GIVEN[0], "color_matrix"),
        ([[1, 0, 0], [0, 1, 0], [0, 0, float("nan")]], "color_matrix"),
        ("automatic", "color_matrix"),
        ([[1, 0, 0], [0, 1, 0], [0, 0, float("inf")]], "color_matrix"),
        ([[1, 0, 0], [0, 1, 0], [1, 1, 0]], "the rows are not independent"),
        ([[-1, 0, 0], [0, -1, 0], [0, 0, -1]], "grey would be black"),
        ([[1, 0, 0], [0, 1, 0], [0, 1, -1]], "up to more than 0"),
        ([[1e39, 0, 0], [0, 1, 0], [0, 0, 1]], "numbers up to 1000"),
    ],
)
def test_what_is_no_matrix_is_refused_by_key(matrix, says):
    with pytest.raises(InputError, match=r"vehicle\.cameras\.0\.color_matrix") as refused:
        scene_of(matrix)
    assert says in str(refused.value)


@pytest.mark.parametrize("matrix", ["auto", GIVEN])
def test_without_a_response_it_means_nothing(matrix):
    with pytest.raises(InputError, match=r"vehicle\.cameras\.0\.color_matrix.*without a response"):
        scene_of(matrix, spectral=False)
