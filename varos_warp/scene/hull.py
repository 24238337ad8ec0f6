"""The vehicle's hull: a sphere that displaces what carries it (paper 3.3.2)."""

from math import pi

from varos_warp.errors import InputError
from varos_warp.scene.description import Scene
from varos_warp.scene.seawater import WATER_DENSITY


def displaced_volume(mass_kg: float, net_buoyancy: float, gravity: float) -> float:
    """Volume [m^3] of water that weighs as much as the vehicle and its net buoyancy [N]; gravity in [m/s^2].

    Raises:
        InputError: The vehicle weighs more under water than in air.
    """
    mass = mass_kg + net_buoyancy / gravity
    if mass <= 0.0:
        raise InputError(
            "would leave the vehicle without volume",
            key="vehicle.net_buoyancy",
            value=net_buoyancy,
            remedy=f"It must be above -mass_kg * gravity = {-mass_kg * gravity:g} N",
        )
    return mass / WATER_DENSITY


def sphere_radius(volume: float) -> float:
    """Radius [m] of a sphere of ``volume`` [m^3]."""
    return (3.0 * volume / (4.0 * pi)) ** (1.0 / 3.0)


def vehicle_radius(scene: Scene) -> float:
    """Radius [m] of the vehicle's hull."""
    return sphere_radius(displaced_volume(scene.vehicle.mass_kg, scene.vehicle.net_buoyancy, scene.gravity))
