"""Water: its coefficients, and its phase function, which says where scattered light goes."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from varos_warp.scene.block import (
    Block,
    Coefficient,
    CoefficientRgb,
    NonNegative,
    UnitRgb,
    kind_by_default,
    unwritten_if_absent,
)

MeanCosine = Annotated[float, Field(ge=-0.99, le=0.999)]
"""Mean cosine of a phase function; beyond these bounds, single precision does not hold the angles of its peak
(docs/stability.md)."""


class HenyeyGreenstein(Block):
    """Phase function of Henyey and Greenstein (1941) with mean cosine ``g``."""

    kind: Literal["henyey_greenstein"] = "henyey_greenstein"
    g: MeanCosine = 0.0
    """Mean cosine of the scattering angle: 0 scatters evenly, towards 1 ahead; sea water has about 0.9."""


class FournierForand(Block):
    """Phase function of Fournier and Forand for sea water: ``n`` and ``mu``, or ``backscatter_fraction``."""

    kind: Literal["fournier_forand"]
    n: Annotated[float, Field(gt=1.0, le=1.5)] | None = Field(default=None, examples=[1.1])
    """Refractive index of the particles, relative to water; with ``mu``."""
    mu: Annotated[float, Field(gt=3.0, le=5.0)] | None = Field(default=None, examples=[3.5835])
    """Slope of the power law of the particles' sizes; at 3 all light would go straight on."""
    backscatter_fraction: Annotated[float, Field(ge=0.0001, le=0.15)] | None = Field(default=None, examples=[0.0183])
    """Share of the light scattered by more than 90 degrees, instead of ``n`` and ``mu``; n = 1.01 + 0.1542 (mu - 3)
    (Mobley et al. 2002)."""

    @model_validator(mode="after")
    def _one_form(self):
        given = [value is not None for value in (self.n, self.mu, self.backscatter_fraction)]
        if given not in ([True, True, False], [False, False, True]):
            raise ValueError("give either n and mu (such as 1.10 and 3.5835) or backscatter_fraction (such as 0.0183)")
        return self


class Petzold(Block):
    """Average particle phase function of Petzold's measurements in sea water (Mobley et al. 1993)."""

    kind: Literal["petzold"]


class Rayleigh(Block):
    """Phase function of pure water, in proportion to 1 + 0.835 cos^2."""

    kind: Literal["rayleigh"]


class Tabulated(Block):
    """Phase function from a table, interpolated log-log and normalised."""

    kind: Literal["tabulated"]
    file: Annotated[str, Field(min_length=1)] = Field(examples=["phase.csv"])
    """CSV file with the columns angle_deg and p (any scale), relative to the scene file."""


class Weighted(Block):
    """A part of a mixture."""

    weight: NonNegative = Field(examples=[1.0])
    """Share of the scattering, in any scale."""


class WeightedHenyeyGreenstein(HenyeyGreenstein, Weighted):
    """Phase function of Henyey and Greenstein as a part of a mixture."""

    g: Annotated[float, Field(ge=-0.6, le=0.999)] = 0.0
    """Mean cosine of the scattering angle. A mixture becomes a table, which does not hold sharper peaks behind: at -0.6
    it is right to 0.05 %."""


class WeightedFournierForand(FournierForand, Weighted):
    """Phase function of Fournier and Forand as a part of a mixture."""


class WeightedPetzold(Petzold, Weighted):
    """Petzold's phase function as a part of a mixture."""


class WeightedRayleigh(Rayleigh, Weighted):
    """Phase function of pure water as a part of a mixture."""


class WeightedTabulated(Tabulated, Weighted):
    """Phase function from a table as a part of a mixture."""


Part = Annotated[
    WeightedHenyeyGreenstein | WeightedFournierForand | WeightedPetzold | WeightedRayleigh | WeightedTabulated,
    Field(discriminator="kind"),
    kind_by_default("henyey_greenstein"),
]


class Mixture(Block):
    """Weighted mean of other phase functions; the weights are divided by their sum."""

    kind: Literal["mixture"]
    of: Annotated[list[Part], Field(min_length=1)]
    """The parts, each a phase function with a weight."""

    @model_validator(mode="after")
    def _some_weight(self):
        if not sum(part.weight for part in self.of) > 0.0:
            raise ValueError("the weights of a mixture sum to 0; give one of its parts a weight above 0")
        return self


Phase = Annotated[
    HenyeyGreenstein | FournierForand | Petzold | Rayleigh | Tabulated | Mixture,
    Field(discriminator="kind"),
    kind_by_default("henyey_greenstein"),
]


# ------------------------------------------------------------------------------------------------------- coefficients


class Principled(Block):
    """Blender's Principled Volume (paper, table 1)."""

    density: Coefficient = Field(examples=[0.125])
    """Density, which multiplies scattering and absorption [1/m]."""
    color: CoefficientRgb = Field(examples=[[0.014, 0.146, 0.345]])
    """Scattering, as a share of the density, for red, green and blue."""
    absorption_color: UnitRgb = Field(examples=[[0.0, 0.394, 1.0]])
    """Tint of what is not scattered, for red, green and blue: absorption is density (1 - color) (1 -
    sqrt(absorption_color)), each at least 0."""
    anisotropy: MeanCosine = 0.0
    """Mean cosine g of Henyey and Greenstein's phase function: 0 scatters evenly, towards 1 ahead."""


class Coefficients(Block):
    """Scattering and absorption coefficients [1/m] per channel."""

    sigma_s: CoefficientRgb = Field(examples=[[0.0018, 0.0183, 0.0431]])
    """Scattering coefficients for red, green and blue [1/m]; oceanography's b."""
    sigma_a: CoefficientRgb = Field(examples=[[0.1233, 0.0397, 0.0]])
    """Absorption coefficients for red, green and blue [1/m]; oceanography's a."""
    phase: Phase = HenyeyGreenstein()
    """Phase function: where scattered light goes (docs/phase_functions.md)."""


JerlovType = Literal["I", "IA", "IB", "II", "III", "1C", "3C", "5C", "7C", "9C", "IC"]


class Jerlov(Block):
    """A Jerlov water type."""

    type: JerlovType
    """I to III: oceans, from clear to turbid; 1C to 9C: coasts. IC is an old name of 1C."""
    phase: Phase = FournierForand(kind="fournier_forand", backscatter_fraction=0.0183)
    """Phase function (docs/phase_functions.md). Absent: Fournier and Forand's, with the backscatter fraction of
    Petzold's average particles."""


class Constituents(Block):
    """What is in the sea water: chlorophyll, dissolved matter, minerals (docs/spectra.md)."""

    chlorophyll_mg_m3: Annotated[float, Field(ge=0.0, le=30.0)] = 0.0
    """Chlorophyll a [mg/m^3]: 0.05 in the clearest oceans, 0.5 usual, 10 in a bloom. With it come the particles and
    their scattering."""
    cdom_440_per_m: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0
    """Absorption of coloured dissolved organic matter at 440 nm [1/m]."""
    minerals_g_m3: Annotated[float, Field(ge=0.0, le=500.0)] = 0.0
    """Suspended minerals, dry mass [g/m^3]."""
    temperature_C: Annotated[float, Field(ge=-2.0, le=35.0)] = 10.0  # noqa: N815
    """Temperature [degrees Celsius]; the scattering of pure sea water changes a little with it."""
    salinity: Annotated[float, Field(ge=0.0, le=45.0)] = 35.0
    """Salinity [per mille]; 0 is fresh water."""


class SpectralWater(Block):
    """Water by wavelength: one of a Jerlov type, constituents, and a file (docs/spectra.md)."""

    jerlov: JerlovType | None = Field(default=None, examples=["1C"])
    """A Jerlov type by wavelength. IC is an old name of 1C."""
    iop: Constituents | None = None
    """Constituents of the water, from which its optical properties follow."""
    file: Annotated[str, Field(min_length=1)] | None = Field(default=None, examples=["iop.csv"])
    """CSV file with the columns wavelength_nm, a and b [1/m], from 400 to 700 nm at least."""
    phase: Phase = FournierForand(kind="fournier_forand", backscatter_fraction=0.0183)
    """Phase function of the particles; the water itself scatters by Rayleigh's. Absent: Fournier and Forand's, with the
    backscatter fraction of Petzold's average particles."""

    @model_validator(mode="after")
    def _one_form(self):
        if sum(form is not None for form in (self.jerlov, self.iop, self.file)) != 1:
            raise ValueError("give exactly one of jerlov, iop, file")
        return self


class Water(Block):
    """The water, in exactly one of four forms."""

    principled: Principled | None = None
    """Blender's Principled Volume, as in the VAROS paper."""
    coefficients: Coefficients | None = None
    """Scattering and absorption coefficients."""
    jerlov: Jerlov | None = None
    """A Jerlov type, which stands for measured coefficients."""
    spectral: SpectralWater | None = None
    """Water by wavelength (docs/spectra.md)."""

    _written = unwritten_if_absent("spectral")

    @model_validator(mode="after")
    def _one_form(self):
        if sum(form is not None for form in (self.principled, self.coefficients, self.jerlov, self.spectral)) != 1:
            raise ValueError("give exactly one of principled, coefficients, jerlov, spectral (or `water: none`)")
        return self
