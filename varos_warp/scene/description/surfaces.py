"""Surfaces of the sea: form as geometry, and layers that it masks."""

from typing import Annotated, Literal

from pydantic import Field

from varos_warp.scene.block import Block, Unit, UnitRgb, unwritten_if_absent

Relief = Literal["rock", "sand", "steel", "concrete", "zinc", "none"]

ROUGH = 0.5
"""Roughness of sand as Oren and Nayar (1994) measured it: facets of a standard deviation of 35 degrees."""

GRAIN: dict[Relief, float] = {"rock": 0.2, "sand": 0.2, "concrete": 0.15, "steel": 0.08}
"""How much the tone of a relief varies from grain to grain; of others it does not."""


WORN: frozenset[Relief] = frozenset({"steel", "concrete", "zinc", "none"})
"""Reliefs that ``wear`` changes."""


class Layered(Block):
    """A surface with form and layers (docs/surfaces.md).

    Its form is displaced triangles about two pixels wide, on which film, silt and wear lie where the form lets them.
    """

    kind: Literal["layered"]
    relief: Relief = "none"
    """The form that is added, and the layers that come with it; ``none`` adds no form, only rubbed edges, film and
    silt."""
    steep: Relief | None = Field(default=None, examples=["rock"])
    """The relief where the surface is steeper than about 35 degrees, as of outcrops in sand. Absent: the same."""
    paint: UnitRgb | None = Field(default=None, examples=[[0.45, 0.33, 0.03]])
    """Linear reflectance of the paint, or of the bare surface where there is none. Absent: as the relief has it."""
    wear: Unit = 0.3
    """How much of the paint is lost, edges are rubbed, concrete is broken and zinc is eaten. Rock and sand do not
    wear."""
    silt: Unit = 0.5
    """How much silt lies where the surface looks up and in hollows."""
    film: Unit = 0.4
    """How much of the surface is under a film of algae and bacteria."""
    diffuse_roughness: Unit = ROUGH
    """How rough the surface is below the size of a pixel: 0 is Lambert's law; the rougher, the less it darkens towards
    its rim in light from beside the camera (docs/surfaces.md)."""
    grain: Unit | None = Field(default=None, examples=[0.2])
    """How much the tone varies from grain to grain, of 7 mm and less, down to a pixel; its mean stays. Absent: as the
    relief has it."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """The patterns follow from it and from the object."""

    _written = unwritten_if_absent("steep", "paint", "grain")
