"""What sea water weighs."""

WATER_DENSITY = 1025.0
"""Sea water [kg/m^3]."""
