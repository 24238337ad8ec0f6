"""Optical properties of the water: coefficients, and the phase function."""

from varos_warp.scene.water.jerlov import JERLOV
from varos_warp.scene.water.properties import (
    OpticalProperties,
    from_coefficients,
    from_jerlov,
    from_principled,
    medium_record,
    optical_properties,
    phase_function,
)

__all__ = ["JERLOV", "OpticalProperties", "from_coefficients", "from_jerlov", "from_principled", "medium_record",
           "optical_properties", "phase_function"]
