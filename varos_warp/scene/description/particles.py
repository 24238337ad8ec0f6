"""Particles that are drawn one by one: marine snow, a share of what the water scatters."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from varos_warp.scene.block import Block, NonNegative, Unit

PRESETS: dict[str, dict[str, Any]] = {
    "clear": {"share": 0.002},
    "coast": {"share": 0.006},
    "bloom": {"share": 0.012},
}
"""Keys that a preset stands for, where a block does not give them itself."""
Speed = Annotated[float, Field(ge=-10.0, le=10.0)]
RadiusM = Annotated[float, Field(ge=2e-5, le=0.05)]


class Particles(Block):
    """Bodies in the water, such as marine snow: a share of its scattering, drawn one by one (docs/snow.md)."""

    preset: Literal["clear", "coast", "bloom"] | None = Field(default=None, examples=["coast"])
    """Named values of the other keys: clear, coast or bloom; keys that stand beside it count instead."""
    share: Annotated[float, Field(ge=1e-9, le=1.0)] = 0.005
    """Share of the water's scattering coefficient that the bodies make up. Bodies scatter more light back than water
    does, so that more than some 1 % of it would be more light than there is: that is refused, with the limit."""
    radius_m: tuple[RadiusM, RadiusM] = (2e-4, 3e-3)
    """Smallest and largest radius [m], of spheres with the bodies' cross sections: bodies are flocs, which reach three
    to five times as far."""
    slope: Annotated[float, Field(ge=2.0, le=6.0)] = 3.6
    """Exponent s of the number of bodies by radius, n(r) ~ r^-s (Junge's law)."""
    opacity: Unit = 1.0
    """Share of the light that a body reflects; it transmits the rest, as evenly. 1 is an opaque grain."""
    reflectance: tuple[Unit, Unit, Unit] | None = Field(default=None, examples=[[1.0, 0.95, 0.85]])
    """Share of the light that falls on a body and that it scatters, R G B; what is left it absorbs. Absent: as the
    water's scattering, 1 in its brightest channel. Large bodies are of no colour or brownish, also where the water's
    scattering is blue; ``share`` then is that of the brightest channel times what is given here."""
    drift_m_s: tuple[Speed, Speed, Speed] = (0.0, 0.0, -0.001)
    """Velocity of the bodies in the water [m/s], beside the current: they sink."""
    wander_m_s: Annotated[NonNegative, Field(le=1.0)] = 0.002
    """Root mean square of the velocity of a body's own motion to and fro [m/s]."""
    least_px: Annotated[float, Field(ge=0.005, le=10.0)] = 0.06
    """Radius in the image [pixels] below which a body stays a part of the water. Lower is slower."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Seed of the places and sizes, together with that of the scene."""

    @model_validator(mode="before")
    @classmethod
    def _as_preset(cls, data: Any) -> Any:
        named = data.get("preset") if isinstance(data, dict) else None
        return {**PRESETS[named], **data} if isinstance(named, str) and named in PRESETS else data

    @model_validator(mode="after")
    def _radii_ascend(self):
        if not self.radius_m[0] < self.radius_m[1]:
            raise ValueError(f"radius_m: {list(self.radius_m)} does not ascend; give [smallest, largest]")
        return self
