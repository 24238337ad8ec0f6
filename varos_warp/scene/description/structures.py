"""Structures from their measures: a piece of a ship's hull, a mooring chain, a quay wall, a panel for ROVs, an ROV."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from varos_warp.scene.block import NonNegative, Position
from varos_warp.scene.description.placed import Measure, Parametric

HullPiece = Literal["plating", "stiffeners", "bilge_keel", "marks"]
QuayPiece = Literal["piles", "coping", "fenders", "ladder"]
PanelPiece = Literal["panel", "receptacles", "stems", "handles", "marks"]
RovPiece = Literal["foam", "frame", "housings", "lamps", "thrusters", "tether"]
FITTINGS_LIMIT = 400
"""Most fittings on a panel."""


class HullSection(Parametric):
    """A section of a ship's steel hull along its own x axis: side, bilge and bottom, and what stiffens them.

    The side lies in the plane y = 0 and faces -y, the bottom in the plane z = 0 and faces down; x = 0 is the middle.
    """

    kind: Literal["hull_section"]
    length_m: Measure = 8.0
    """Length along its own x axis [m]."""
    height_m: Measure = 4.0
    """Height from the bottom to the upper edge of the side [m]."""
    breadth_m: Measure = 3.0
    """Breadth from the side to the edge of the bottom [m]."""
    bilge_radius_m: Measure = 1.0
    """Radius of the bilge, between side and bottom [m]."""
    plate_m: Annotated[float, Field(ge=0.003, le=0.1)] = 0.014
    """Thickness of the plates [m]."""
    strake_m: Annotated[float, Field(ge=0.2, le=20.0)] = 2.2
    """Distance from one longitudinal weld seam to the next, along the section [m]."""
    butt_m: Annotated[float, Field(ge=0.2, le=50.0)] = 3.0
    """Distance from one transverse weld seam to the next [m]."""
    seam_m: Annotated[float, Field(ge=0.0, le=0.02)] = 0.003
    """Height of the weld seams [m]; 0: ground flush."""
    spacing_m: Annotated[float, Field(ge=0.2, le=5.0)] = 0.7
    """Distance from one longitudinal stiffener to the next [m]."""
    frame_m: Annotated[float, Field(ge=0.4, le=20.0)] = 2.4
    """Distance from one web frame to the next [m]."""
    dent_m: Annotated[float, Field(ge=0.0, le=0.05)] = 0.004
    """How deep the plates are dented between stiffeners and frames at most, by the shrinking of welds [m]; IACS
    Recommendation 47 has 4 mm as standard and 8 mm as limit."""
    stiffeners: Literal["inside", "outside", "none"] = "inside"
    """Side of the plates on which longitudinal stiffeners and web frames stand."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Seed of the depth of each dent."""
    bilge_keel_m: Annotated[float, Field(ge=0.05, le=3.0)] | None = Field(default=None, examples=[0.3])
    """Depth of the bilge keel, a flat bar that stands on the bilge [m]; absent: there is none."""
    marks: bool = True
    """Whether raised draught figures stand on the side, at x = 0: metres above the bottom, each 0.2 m, 0.1 m high."""
    only: Annotated[list[HullPiece], Field(min_length=1)] | None = Field(default=None, examples=[["marks"]])
    """Which pieces are made: plating, stiffeners, bilge_keel, marks; several objects at one place give each its own
    material. Absent: all."""

    @model_validator(mode="after")
    def _bilge_fits(self):
        if self.bilge_radius_m > min(self.height_m, self.breadth_m) - 0.05:
            raise ValueError(
                f"bilge_radius_m: {self.bilge_radius_m:g} m does not fit into height_m and breadth_m, of "
                f"which the lesser is {min(self.height_m, self.breadth_m):g} m; it may be 0.05 m less"
            )
        if self.bilge_radius_m < 2.0 * self.plate_m:
            raise ValueError(f"bilge_radius_m: must be twice plate_m ({self.plate_m:g} m) or more")
        return self


class MooringChain(Parametric):
    """A stud-link chain (ISO 1704) from its origin on: straight along its own x axis, or hanging in a catenary."""

    kind: Literal["mooring_chain"]
    link_m: Annotated[float, Field(ge=0.005, le=0.3)] = 0.076
    """Nominal diameter d of the links' bar [m]; a link is 6 d long and 3.6 d wide, and takes 4 d of the length."""
    links: Annotated[int, Field(ge=1, le=2000)] = 20
    """Number of links."""
    sag_m: NonNegative = 0.0
    """How far its middle hangs below its ends, which are level [m]; 0: straight."""
    end: Position | None = Field(default=None, examples=[[3, 0, 2]])
    """End of the chain, in its own axes [m]; the chain hangs from its origin to there, with all its length. Instead of
    ``sag_m``."""
    roll_deg: Annotated[float, Field(ge=0.0, le=90.0)] = 45.0
    """Links are turned about the chain by this angle and this less 90 degrees, in turn [degrees]."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Seed of the small turns of the links."""

    @property
    def length(self) -> float:
        """Length of all its links [m]."""
        return 4.0 * self.link_m * self.links

    @model_validator(mode="after")
    def _reaches_its_end(self):
        if self.end is not None and self.sag_m:
            raise ValueError("give sag_m or end, not both: how far it hangs follows from its end")
        if self.sag_m and self.sag_m > 0.49 * self.length:
            raise ValueError(
                f"sag_m: {self.sag_m:g} m is more than 0.49 of the chain's {self.length:g} m; "
                "add links, or let it sag less"
            )
        if self.end is not None:
            away, across = sum(x * x for x in self.end) ** 0.5, (self.end[0] ** 2 + self.end[1] ** 2) ** 0.5
            if away > 0.9999 * self.length or across < 0.02 * self.length:
                raise ValueError(
                    f"end: is {away:.4g} m away, {across:.4g} m of it level; this chain of "
                    f"{self.length:.4g} m hangs to where it is {0.02 * self.length:.4g} m away or more "
                    f"level, and {0.9999 * self.length:.4g} m or less in all; change links or end"
                )
        return self


class QuayWall(Parametric):
    """A quay wall of U-shaped steel sheet piles under a concrete coping, along its own x axis, that faces -y.

    Its foot lies in z = 0, the outer faces of the piles in y = 0; x = 0 is the middle.
    """

    kind: Literal["quay_wall"]
    length_m: Measure = 9.6
    """Length along its own x axis [m]; made a whole number of piles."""
    height_m: Measure = 8.0
    """Height from the foot to the top of the coping [m]."""
    pile_width_m: Annotated[float, Field(ge=0.2, le=2.0)] = 0.6
    """Width of a pile [m]: that of Larssen 603."""
    pile_depth_m: Annotated[float, Field(ge=0.1, le=1.0)] = 0.31
    """Depth from the outer faces of the wall to its inner ones [m]."""
    pile_plate_m: Annotated[float, Field(ge=0.004, le=0.04)] = 0.0097
    """Thickness of the piles [m]."""
    coping_m: Annotated[float, Field(ge=0.1, le=10.0)] = 1.2
    """Height of the coping [m]."""
    fender_m: Annotated[float, Field(ge=0.5, le=50.0)] | None = Field(default=2.4, examples=[2.4])
    """Distance from one rubber fender to the next [m]; null: there are none."""
    fender_length_m: Measure = 3.0
    """Length of a fender, from 0.2 m below the top of the coping down [m]."""
    ladder_m: float | None = Field(default=0.6, examples=[0.6])
    """Place of the ladder along x [m]; null: there is none."""
    only: Annotated[list[QuayPiece], Field(min_length=1)] | None = Field(default=None, examples=[["ladder"]])
    """Which pieces are made: piles, coping, fenders, ladder; several objects at one place give each its own material.
    Absent: all."""

    @model_validator(mode="after")
    def _is_a_wall(self):
        if self.coping_m > self.height_m - 0.5:
            raise ValueError(
                f"coping_m: {self.coping_m:g} m leaves no 0.5 m of piles under a top at {self.height_m:g} m"
            )
        if self.fender_length_m > self.height_m - 0.2:
            raise ValueError(
                f"fender_length_m: {self.fender_length_m:g} m reaches below the foot; at most {self.height_m - 0.2:g} m"
            )
        if self.length_m < 2.0 * self.pile_width_m:
            raise ValueError(f"length_m: a wall is two piles long or more, {2.0 * self.pile_width_m:g} m")
        if self.ladder_m is not None and abs(self.ladder_m) > 0.5 * self.length_m - 0.3:
            raise ValueError(f"ladder_m: {self.ladder_m:g} m lies beside the wall, which is {self.length_m:g} m long")
        if self.pile_plate_m > 0.1 * self.pile_depth_m:
            raise ValueError(f"pile_plate_m: at most a tenth of pile_depth_m ({self.pile_depth_m:g} m)")
        return self


Fitting = Literal["bucket", "hot_stab", "t_bar", "valve_stem", "none"]


class WellheadPanel(Parametric):
    """A panel with interfaces for ROVs, as API 17H knows them, in its own xz plane, centred, that faces -y."""

    kind: Literal["wellhead_panel"]
    width_m: Annotated[float, Field(ge=0.2, le=20.0)] = 1.6
    """Width along its own x axis [m]."""
    height_m: Annotated[float, Field(ge=0.2, le=20.0)] = 1.2
    """Height along its own z axis [m]."""
    plate_m: Annotated[float, Field(ge=0.004, le=0.1)] = 0.015
    """Thickness of the plate [m]."""
    fittings: Annotated[list[Annotated[list[Fitting], Field(min_length=1)]], Field(min_length=1)] = [
        ["bucket", "bucket", "bucket", "bucket"],
        ["t_bar", "valve_stem", "valve_stem", "t_bar"],
        ["hot_stab", "hot_stab", "bucket", "hot_stab"],
    ]
    """Rows of what is mounted, from above and from the left, each row evenly across the panel: bucket (a receptacle
    for torque tools, class 1 to 4), hot_stab, t_bar, valve_stem, none."""
    marks: bool = True
    """Whether each fitting has a raised label: its row's letter and its number."""
    only: Annotated[list[PanelPiece], Field(min_length=1)] | None = Field(default=None, examples=[["handles"]])
    """Which pieces are made: panel, receptacles, stems, handles, marks; several objects at one place give each its own
    material. Absent: all."""

    @model_validator(mode="after")
    def _fittings_fit(self):
        if sum(map(len, self.fittings)) > FITTINGS_LIMIT:
            raise ValueError(f"fittings: are more than {FITTINGS_LIMIT}")
        if len(self.fittings) > 26:
            raise ValueError("fittings: are more than 26 rows, A to Z")
        needed, cells = (
            0.3,
            {"height_m": (self.height_m, len(self.fittings)), "width_m": (self.width_m, max(map(len, self.fittings)))},
        )
        for key, (size, count) in cells.items():
            if size < needed * count:
                raise ValueError(f"{key}: {count} fittings need {needed:g} m each, {needed * count:g} m in all")
        return self


class Rov(Parametric):
    """An inspection ROV in axes of a vehicle: x right, y forward, z up, its middle at the origin; as a ``body``."""

    kind: Literal["rov"]
    length_m: Annotated[float, Field(ge=0.3, le=5.0)] = 0.75
    """Length along its own y axis, without lamps [m]."""
    width_m: Annotated[float, Field(ge=0.25, le=5.0)] = 0.55
    """Width along its own x axis, without lamps [m]."""
    height_m: Annotated[float, Field(ge=0.2, le=5.0)] = 0.42
    """Height along its own z axis [m]."""
    lamps: Annotated[list[Position], Field(max_length=16)] = [(-0.2, 0.45, 0.05), (0.2, 0.45, 0.05)]
    """Middles of the front panes of its lamps, which look along +y, in its axes [m]; a light of the vehicle shines from
    a few centimetres before each, so that no housing shades it."""
    lamp_radius_m: Annotated[float, Field(ge=0.01, le=0.5)] = 0.045
    """Radius of a lamp's housing [m]."""
    tether_m: Annotated[float, Field(ge=0.5, le=100.0)] | None = Field(default=None, examples=[8.0])
    """Length of the tether that leaves its stern upwards in bights [m]; it is stiff, and moves with the vehicle.
    Absent: none."""
    only: Annotated[list[RovPiece], Field(min_length=1)] | None = Field(default=None, examples=[["foam"]])
    """Which pieces are made: foam, frame, housings, lamps, thrusters, tether. Absent: all."""
