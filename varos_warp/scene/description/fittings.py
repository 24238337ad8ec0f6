"""What is fitted to structures: anodes, bolted flanges, hand wheels, blocks of concrete."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from varos_warp.scene.description.placed import Measure, Parametric

AnodePiece = Literal["zinc", "straps"]
JointPiece = Literal["flanges", "gasket", "bolts"]
BlockPiece = Literal["block", "eyes"]


class Anode(Parametric):
    """A sacrificial anode: a cast bar on a steel strap, or a bracelet of two half shells around a pipe.

    A bar lies along its own x axis on the plane y = 0 and faces -y; a bracelet lies around its own z axis, centred.
    """

    kind: Literal["anode"]
    form: Literal["bar", "bracelet"] = "bar"
    """Form of the anode: bar (fitted to plates) or bracelet (around a pipe)."""
    length_m: Annotated[float, Field(ge=0.1, le=5.0)] = 0.6
    """Length of the zinc, at its foot [m]."""
    width_m: Annotated[float, Field(ge=0.03, le=1.0)] = 0.13
    """Width of a bar at its foot [m]."""
    thick_m: Annotated[float, Field(ge=0.015, le=0.5)] = 0.065
    """Thickness of the zinc [m]."""
    pipe_radius_m: Measure | None = Field(default=None, examples=[0.2])
    """Outer radius of the pipe that a bracelet lies around [m]."""
    only: Annotated[list[AnodePiece], Field(min_length=1)] | None = Field(default=None, examples=[["zinc"]])
    """Which pieces are made: zinc, straps; several objects at one place give each its own material. Absent: all."""

    @model_validator(mode="after")
    def _has_what_its_form_needs(self):
        if self.form == "bracelet" and self.pipe_radius_m is None:
            raise ValueError("pipe_radius_m: is missing; a bracelet needs it")
        if self.form == "bar" and self.pipe_radius_m is not None:
            raise ValueError("pipe_radius_m: means nothing for a bar; leave it out, or set form: bracelet")
        if self.form == "bar" and self.width_m < self.thick_m:
            raise ValueError(f"width_m: a bar is as wide as it is thick or wider, {self.thick_m:g} m")
        if self.length_m < 2.0 * self.thick_m:
            raise ValueError(f"length_m: an anode is twice as long as it is thick or longer, {2.0 * self.thick_m:g} m")
        if self.pipe_radius_m is not None and self.pipe_radius_m < 0.03:
            raise ValueError("pipe_radius_m: a bracelet lies around a pipe of 0.03 m radius or more")
        return self


class FlangeJoint(Parametric):
    """Two welding-neck flanges (EN 1092-1, PN 16) with a gasket and stud bolts, around its own z axis, centred."""

    kind: Literal["flange_joint"]
    radius: Measure = Field(examples=[0.15])
    """Outer radius of the pipe [m]; between the standard's sizes the nearest one, scaled."""
    only: Annotated[list[JointPiece], Field(min_length=1)] | None = Field(default=None, examples=[["bolts"]])
    """Which pieces are made: flanges, gasket, bolts; several objects at one place give each its own material. Absent:
    all."""


class HandWheel(Parametric):
    """A dished hand wheel around its own z axis, its rim in z = 0, with hub, spokes and a stem below."""

    kind: Literal["hand_wheel"]
    radius: Annotated[float, Field(ge=0.03, le=5.0)] = 0.25
    """Outer radius of the rim [m]."""
    spokes: Annotated[int, Field(ge=2, le=24)] = 5
    """Number of spokes."""
    stem_m: Annotated[float, Field(ge=0.0, le=20.0)] = 0.3
    """Length of the stem below the hub [m]; 0: there is none."""


class ConcreteBlock(Parametric):
    """A cast block on the plane z = 0, centred in x and y, chamfered, with lifting eyes of bent bar on its top."""

    kind: Literal["concrete_block"]
    size_m: tuple[Measure, Measure, Measure] = (1.2, 0.6, 0.6)
    """Length, width and height [m], each 0.1 or more."""
    chamfer_m: Annotated[float, Field(ge=0.0, le=0.2)] = 0.02
    """Radius of its edges [m]; at most a fifth of the least size is made of it."""
    eyes: Annotated[int, Field(ge=0, le=8)] = 2
    """Number of lifting eyes along its top."""
    only: Annotated[list[BlockPiece], Field(min_length=1)] | None = Field(default=None, examples=[["eyes"]])
    """Which pieces are made: block, eyes; several objects at one place give each its own material. Absent: all."""

    @model_validator(mode="after")
    def _eyes_fit(self):
        if min(self.size_m) < 0.1:
            raise ValueError("size_m: a block is 0.1 m or more in length, width and height")
        if self.eyes * 0.2 > self.size_m[0]:
            raise ValueError(
                f"eyes: {self.eyes} need 0.2 m each, {0.2 * self.eyes:g} m in all; size_m has "
                f"{self.size_m[0]:g} m along x"
            )
        return self
