"""A figure of water by wavelength."""

from pathlib import Path

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.description import Scene
from varos_warp.scene.spectra.spectrum import GRID
from varos_warp.scene.spectra.water import water_spectra

FORMATS = (".png", ".svg", ".pdf")
LINES = {
    "a": ("absorption a", "#1b6ca8"),
    "b": ("scattering b", "#d1495b"),
    "c": ("extinction c", "black"),
    "b_b": ("backscattering b_b", "#66a182"),
}
"""Curves that are drawn [1/m]: their names and colours."""


def draw_water(scene: Scene, path: Path) -> None:
    """Draw a, b, c, b_b and the range of visibility of a scene's water by wavelength into a file.

    Raises:
        InputError: The water is not by wavelength, or the file cannot be written or is of another format.
    """
    from matplotlib.figure import Figure

    if not scene.is_spectral:
        raise InputError("has no spectra to draw", key="water", remedy="Give water.spectral, or leave out --plot.")
    if path.suffix.lower() not in FORMATS:
        raise InputError(
            "is no format of figures", key="--plot", value=str(path), remedy=f"End its name with {', '.join(FORMATS)}."
        )
    water = water_spectra(scene)
    figure = Figure(figsize=(6.0, 6.0), layout="constrained", dpi=150)
    above, below = figure.subplots(2, sharex=True, height_ratios=(2, 1))
    for name, (label, colour) in LINES.items():
        values = getattr(water, name)
        above.semilogy(GRID, np.where(values > 0.0, values, np.nan), color=colour, label=label)
    above.set(ylabel="[1/m]", title=water.source)
    above.legend(fontsize=8, frameon=False)
    below.plot(GRID, water.visibility_m, color="black")
    below.set(xlabel="wavelength [nm]", ylabel="visibility 4.8 / c [m]", ylim=(0.0, None), xlim=(400.0, 700.0))
    try:
        figure.savefig(path)
    except OSError as error:
        raise InputError(
            f"cannot be written: {error.strerror}", file=path, key="--plot", remedy="Choose another file."
        ) from None
