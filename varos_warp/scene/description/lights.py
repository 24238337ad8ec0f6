"""The lights of a vehicle, and when they flash."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from varos_warp.scene.block import (
    Block,
    Position,
    Unit,
    Vec3,
    kind_by_default,
    outside,
    written_otherwise,
)
from varos_warp.scene.description.optics import SHORTEST_S, Index

Intensity = Annotated[float, Field(ge=0.0, le=1e20), outside(0.0, 1e-20, "an intensity is 0 or at least 1e-20 W/sr")]
"""Radiant intensity [W/sr]; beyond these bounds, single precision over- or underflows on the way of the light."""
IntensityRgb = tuple[Intensity, Intensity, Intensity]


def _check_direction(value):
    """Directions of lights have a length: float32 on the device squares it."""
    if np.linalg.norm(value) < 1e-6:
        raise ValueError("the direction of a light must be at least 1e-6 long")
    return value


Direction = Annotated[Vec3, AfterValidator(_check_direction)]
"""Direction in vehicle axes, of any length."""
Radius = Annotated[float, Field(gt=0.0, le=100.0)]
"""Radius of a lamp [m]: a disk across its axis, each point of which shines as the whole lamp does."""


class Strobe(Block):
    """A light that flashes with every frame instead of shining all the time."""

    on_s: Annotated[float, Field(ge=SHORTEST_S, le=60.0, examples=[0.002])]
    """Duration of the flash [s]."""
    delay_s: Annotated[float, Field(ge=-60.0, le=60.0)] = 0.0
    """Time from the frame's time stamp to the middle of the flash [s]."""


class LampPort(Block):
    """A flat pane before a lamp, perpendicular to its axis: the beam narrows and brightens as it enters the water."""

    kind: Literal["flat"] = "flat"
    n_glass: Index = 1.49
    """Refractive index of the pane, relative to air; 1.49 is acrylic."""
    n_water: Index = 1.34
    """Refractive index of the water, relative to air."""


class Shining(Block):
    """A light whose brightness is ``intensity``, or by wavelength ``spectrum`` and ``power_W`` or ``lumen``."""

    spectrum: str | None = Field(default=None, examples=["led_b4"])
    """The light by wavelength, in water by wavelength (docs/spectra.md): a name that comes with the package, or a CSV
    file with the columns wavelength_nm and power, of any scale. Absent: ``intensity`` tells each channel."""
    power_W: Annotated[float, Field(gt=0.0, le=1e6)] | None = Field(default=None, examples=[30])  # noqa: N815
    """Power of the light between 400 and 700 nm, in all directions together [W]; with ``spectrum``."""
    lumen: Annotated[float, Field(gt=0.0, le=1e8)] | None = Field(default=None, examples=[5000])
    """Luminous flux in all directions together [lm], instead of ``power_W``; with ``spectrum``."""

    @model_validator(mode="after")
    def _one_brightness(self):
        amounts = [self.power_W, self.lumen].count(None)
        if self.spectrum is None and amounts < 2:
            raise ValueError("power_W and lumen are of a light with spectrum; give one, such as led_b4, or intensity")
        if self.spectrum is not None and amounts != 1:
            raise ValueError("give a light with spectrum either power_W or lumen")
        if self.spectrum is not None and "intensity" in self.model_fields_set:
            raise ValueError("give intensity, or spectrum and its power_W or lumen, not both")
        return self


def _unwritten_of_light(*keys: str) -> Any:
    """Serializer of a light that leaves out absent keys, and the intensity where a spectrum stands instead."""
    keys = (*keys, "spectrum", "power_W", "lumen")
    return written_otherwise(
        lambda light: [
            *(key for key in keys if getattr(light, key) is None),
            *(["intensity"] if light.spectrum else []),
        ]
    )


class SpotLight(Shining):
    """A spot light on the vehicle: ``intensity`` [W/sr] inside the cone, Blender's soft edge of width ``blend``."""

    kind: Literal["spot"] = "spot"
    position: Position = (0.0, 0.0, 0.0)
    """Position in vehicle axes: x right, y forward, z up [m]."""
    direction: Direction = (0.0, 1.0, 0.0)
    """Direction of the light's axis, in vehicle axes, of any length: (0, 1, 0) is straight ahead."""
    cone_deg: Annotated[
        float,
        Field(ge=1.0, le=360.0),
        outside(359.9, 360.0, "a cone is at most 359.9 degrees wide, or 360 for a light without one"),
    ] = 65.0
    """Full angle of the cone [degrees], at most 359.9, or 360 for a light without one; single precision cannot
    represent the cosines of cones below 1 degree."""
    blend: Unit = 0.0
    """Width of the cone's soft edge as in Blender: 0 is a hard edge, 1 fades from the axis on."""
    intensity: IntensityRgb = (100.0, 100.0, 100.0)
    """Radiant intensity inside the cone for red, green and blue [W/sr]. Blender's power P in watts is 4 pi times it."""
    port: LampPort | None = None
    """A flat pane before the lamp. With one, cone and intensity are those in air. Absent: they are those in the
    water."""
    radius_m: Radius | None = Field(default=None, examples=[0.03])
    """Radius of the lamp, a disk across its axis each point of which shines as the whole lamp does [m]; it softens
    shadows. Absent: a point."""
    strobe: Strobe | None = None
    """Strobe: the light flashes with every frame. Absent: it shines all the time."""

    _written = _unwritten_of_light("port", "radius_m", "strobe")


def _is_across(value, info: ValidationInfo) -> bool:
    """Whether a vector has a length and a part across the light's direction."""
    direction = info.data.get("direction", (0.0, 1.0, 0.0))  # absent if it was refused
    size = np.linalg.norm(value) * np.linalg.norm(direction)
    return np.linalg.norm(np.cross(value, direction)) > 1e-3 * size


class ProfileLight(Shining):
    """A lamp whose intensity by direction a file tells: IES LM-63, or CSV."""

    kind: Literal["profile"]
    file: str = Field(examples=["led_flood"])
    """File of the intensity by direction, of any scale: IES LM-63 (types C, B and A), or CSV with the columns angle_deg
    and intensity, or polar_deg, azimuth_deg and intensity. Or the name of a lamp that comes with the package,
    ``led_flood``."""
    position: Position = (0.0, 0.0, 0.0)
    """Position in vehicle axes: x right, y forward, z up [m]."""
    direction: Direction = (0.0, 1.0, 0.0)
    """Direction of the light's axis, in vehicle axes, of any length: (0, 1, 0) is straight ahead."""
    up: Position | None = Field(default=None, examples=[[0, 0, 1]])
    """The lamp's own upward direction, in vehicle axes, of any length, for lamps that are not the same all around.
    There are C = 0 of type C, V = 90 of types B and A, and azimuth_deg = 0; along the direction is the angle 0 of all.
    What of it lies along the direction is left out. Absent: as of a camera, upwards as far as the direction allows; of
    a lamp straight down, forwards."""
    intensity: IntensityRgb = (100.0, 100.0, 100.0)
    """Radiant intensity at the profile's peak for red, green and blue [W/sr]."""
    port: LampPort | None = None
    """A flat pane before the lamp. With one, profile and intensity are those in air. Absent: they are those in the
    water."""
    radius_m: Radius | None = Field(default=None, examples=[0.02])
    """Radius of the lamp, a disk across its axis each point of which shines as the whole lamp does [m]; it softens
    shadows. Absent: a point."""
    strobe: Strobe | None = None
    """Strobe: the light flashes with every frame. Absent: it shines all the time."""

    @field_validator("up")
    @classmethod
    def _across(cls, value, info: ValidationInfo):
        if value is not None and not _is_across(value, info):
            raise ValueError("up of a lamp must have a length, and not lie along its direction")
        return value

    _written = _unwritten_of_light("up", "radius_m", "strobe")


class PointLight(Shining):
    """A light that shines equally in every direction, ``intensity`` [W/sr]."""

    kind: Literal["point"]
    position: Position = (0.0, 0.0, 0.0)
    """Position in vehicle axes: x right, y forward, z up [m]."""
    intensity: IntensityRgb = (100.0, 100.0, 100.0)
    """Radiant intensity in every direction for red, green and blue [W/sr]."""
    strobe: Strobe | None = None
    """Strobe: the light flashes with every frame. Absent: it shines all the time."""

    _written = _unwritten_of_light("strobe")


class SheetLight(Shining):
    """A sheet of light, as of a line laser: ``intensity`` [W/sr] between two pairs of planes through the light, else 0.

    The angles between the planes are ``fan_deg``, in the sheet, and ``thickness_deg``, across it.
    """

    kind: Literal["sheet"]
    position: Position = (0.0, 0.0, 0.0)
    """Position in vehicle axes: x right, y forward, z up [m]."""
    direction: Direction = (0.0, 1.0, 0.0)
    """Direction of the middle of the fan, in vehicle axes, of any length."""
    normal: Position = Field(examples=[[0, 0.6, 1]])
    """Normal of the sheet in vehicle axes, of any length; what of it lies along the direction is left out."""
    fan_deg: Annotated[float, Field(ge=0.1, le=170.0)] = Field(examples=[60])
    """Full angle of the fan, in the sheet [degrees]."""
    thickness_deg: Annotated[float, Field(ge=0.01, le=170.0)] = Field(examples=[0.3])
    """Full angle across the sheet [degrees]; single precision cannot represent much thinner ones."""
    intensity: IntensityRgb = (100.0, 100.0, 100.0)
    """Radiant intensity inside the sheet for red, green and blue [W/sr]."""
    strobe: Strobe | None = None
    """Strobe: the light flashes with every frame. Absent: it shines all the time."""

    @field_validator("normal")
    @classmethod
    def _across(cls, value, info: ValidationInfo):
        if not _is_across(value, info):
            raise ValueError("the normal of a sheet must have a length, and not lie along its direction")
        return value

    _written = _unwritten_of_light("strobe")


Light = Annotated[
    SpotLight | PointLight | ProfileLight | SheetLight, Field(discriminator="kind"), kind_by_default("spot")
]
