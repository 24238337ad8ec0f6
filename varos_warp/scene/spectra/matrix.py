"""A camera's colour matrix: from its own channels, balanced for the first lamp, to linear sRGB."""

import numpy as np

from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.spectra.bands import given_spectra
from varos_warp.scene.spectra.lamps import per_watt
from varos_warp.scene.spectra.spectrum import STEPS, Spectrum
from varos_warp.scene.spectra.surfaces import chart_colours, chart_reflectances


def color_matrix(scene: Scene, camera: Camera) -> np.ndarray | None:
    """The matrix of a scene's camera, float64 [3, 3]; None: it has none.

    Raises:
        InputError: ``auto``, and a file of a light or the camera cannot be used.
    """
    if camera.color_matrix is None:
        return None
    if camera.color_matrix != "auto":
        return np.array(camera.color_matrix)
    given = given_spectra(scene, camera)
    return fitted_matrix(given.lamps[0], given.response)


def fitted_matrix(lamp: Spectrum, response: np.ndarray) -> np.ndarray:
    """The matrix that turns what a camera sees of the 24 patches under a lamp into their linear sRGB colours under D65.

    Least squares over the patches, of all matrices that leave white as it is: rows add up to 1.

    Args:
        lamp: Relative power, of any scale.
        response: Sensitivities on `GRID`, of any scale, float64 [3, 301].

    Returns:
        float64 [3, 3], rows are red, green and blue of sRGB.
    """
    light = response * per_watt(lamp) * STEPS
    patches = np.array([patch.at() for patch in chart_reflectances().values()])
    seen = patches @ light.T / light.sum(axis=1)
    beside_blue = seen[:, :2] - seen[:, 2:]  # a row m0, m1, 1 - m0 - m1
    rows = np.linalg.lstsq(beside_blue, chart_colours() - seen[:, 2:], rcond=None)[0].T
    return np.column_stack([rows, 1.0 - rows.sum(axis=1)])
