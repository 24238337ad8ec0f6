"""Density of sea water."""

WATER_DENSITY = 1025.0
"""Sea water [kg/m^3]."""
