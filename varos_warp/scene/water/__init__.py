"""Optical properties of the water: coefficients, and the phase function."""

from varos_warp.scene.water.jerlov import JERLOV
from varos_warp.scene.water.properties import OpticalProperties, medium_record, optical_properties, phase_function

__all__ = ["JERLOV", "OpticalProperties", "medium_record", "optical_properties", "phase_function"]
