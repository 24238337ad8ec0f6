"""Ready trajectories: blocks that stand for the waypoints of a survey, an inspection or a way there and back.

Headings and bearings are a compass's: clockwise seen from above, with +y for north and +x for east.
"""

from math import ceil, radians
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PrivateAttr, field_validator, model_validator

from varos_warp.scene.block import Angle, Block, Coordinate, Position, kind_by_default

STEP_DEG = 5.0
"""Turn from one waypoint to the next on arcs: chords are within 0.1 % of the radius of their circle."""
MOST_LANES = 500
"""Most lanes of a lawn mower; they have nearly 20 000 waypoints."""

Pitch = Annotated[float, Field(ge=-90.0, le=90.0)]
"""Pitch angle of the vehicle, positive with the nose up [degrees]."""
Length = Annotated[float, Field(gt=0.0, le=1e6)]
"""A length [m]."""


def compass(angle_deg) -> np.ndarray:
    """Unit vectors [..., 3] in the horizontal plane, by their headings [...] [degrees]."""
    angle = np.radians(angle_deg)
    return np.stack([np.sin(angle), np.cos(angle), np.zeros_like(angle)], axis=-1)


def _stop(position: np.ndarray, heading_deg: float, pitch_deg: float, **more) -> dict[str, Any]:
    return {"position": tuple(position.tolist()), "rotation_euler_deg": (pitch_deg, 0.0, -heading_deg), **more}


class LawnMower(Block):
    """Parallel lanes up and down an area, joined by half circles beyond it; the vehicle looks where it goes."""

    kind: Literal["lawn_mower"]
    centre: Position = Field(examples=[[0, 0, 2]])
    """Middle of the area, at the height of the vehicle [m]."""
    heading_deg: Angle = 0.0
    """Heading of the first lane, which is the leftmost: clockwise from +y [degrees]."""
    length_m: Length = Field(examples=[10])
    """Length of a lane [m]."""
    width_m: Length = Field(examples=[6])
    """Distance from the first lane to the last [m]."""
    spacing_m: Length = Field(examples=[1.5])
    """Largest distance of neighbouring lanes [m]; they share the width evenly."""
    pitch_deg: Pitch = 0.0
    """Pitch of the vehicle, positive with the nose up [degrees]."""

    @field_validator("spacing_m")
    @classmethod
    def _few_lanes(cls, spacing, info):
        width = info.data.get("width_m", spacing)  # absent if it was refused
        if not width / spacing <= MOST_LANES - 1:
            raise ValueError(f"more than {MOST_LANES} lanes: width_m is {width:g}; raise spacing_m or divide the area")
        return spacing

    @property
    def lanes(self) -> int:
        """Number of lanes."""
        return ceil(round(self.width_m / self.spacing_m, 9)) + 1

    def waypoints(self) -> list[dict]:
        """Waypoints at both ends of each lane, and along the half circle to the next."""
        ahead, right = compass(self.heading_deg), compass(self.heading_deg + 90.0)
        gap = self.width_m / (self.lanes - 1)
        turned = np.arange(STEP_DEG, 180.0, STEP_DEG)
        stops = []
        for i in range(self.lanes):
            up, heading = 1.0 - 2.0 * (i % 2), self.heading_deg + 180.0 * (i % 2)
            middle = np.array(self.centre) + (i * gap - 0.5 * self.width_m) * right
            ends = [middle - 0.5 * up * self.length_m * ahead, middle + 0.5 * up * self.length_m * ahead]
            stops += [_stop(end, heading, self.pitch_deg) for end in ends]
            for angle in turned if i + 1 < self.lanes else ():
                on_arc = 0.5 * gap * (up * np.sin(radians(angle)) * ahead + (1.0 - np.cos(radians(angle))) * right)
                stops.append(_stop(ends[1] + on_arc, heading + up * angle, self.pitch_deg))
        return stops


class Orbit(Block):
    """A circle around a point, which the vehicle looks at."""

    kind: Literal["orbit"]
    centre: Position = Field(examples=[[0, 5, 0.2]])
    """Centre of the circle, which the vehicle looks at [m]."""
    radius_m: Length = Field(examples=[4])
    """Horizontal distance of the vehicle from the centre [m]."""
    height_m: Coordinate = 0.0
    """Height of the vehicle above the centre [m]."""
    bearing_deg: Angle = 0.0
    """Start of the circle: its bearing from the centre, clockwise from +y [degrees]."""
    turns: Annotated[float, Field(ge=-100.0, le=100.0)] = 1.0
    """Number of turns, clockwise seen from above; negative: the other way."""

    @field_validator("turns")
    @classmethod
    def _turns(cls, turns):
        if abs(turns) < 0.01:
            raise ValueError("is less than a hundredth of a turn")
        return turns

    def waypoints(self) -> list[dict]:
        """Return the waypoints, one every 5 degrees or a little less."""
        return self._around(0.0)

    def _around(self, rise_m: float) -> list[dict]:
        share = np.linspace(0.0, 1.0, ceil(round(360.0 * abs(self.turns) / STEP_DEG, 6)) + 1)[:, None]
        centres = np.array(self.centre) + share * [0.0, 0.0, rise_m]
        places = centres + self.radius_m * compass(self.bearing_deg + 360.0 * self.turns * share[:, 0])
        places[:, 2] += self.height_m
        return [
            {"position": tuple(place), "look_at": tuple(centre)}
            for place, centre in zip(places.tolist(), centres.tolist(), strict=True)
        ]


class Spiral(Orbit):
    """An orbit whose centre rises or sinks with the vehicle, as around a pile or a riser."""

    kind: Literal["spiral"]  # type: ignore[assignment]
    rise_m: Coordinate = Field(examples=[2])
    """How far vehicle and centre rise from the beginning to the end, over all turns [m]; negative: they sink."""

    def waypoints(self) -> list[dict]:
        """Return the waypoints, one every 5 degrees or a little less."""
        return self._around(self.rise_m)


class ThereAndBack(Block):
    """Straight from start to end and back, with a stop at each; the vehicle faces the end all the time."""

    kind: Literal["there_and_back"]
    start: Position = Field(examples=[[0, 0, 1]])
    """Start of the course, to which the vehicle returns [m]."""
    end: Position = Field(examples=[[0, 5, 1]])
    """Point where the vehicle turns back, and which it faces all the time [m]."""
    times: Annotated[int, Field(ge=1, le=1000)] = 1
    """Number of times that the vehicle goes there and back."""
    pitch_deg: Pitch = 0.0
    """Pitch of the vehicle, positive with the nose up [degrees]."""

    @model_validator(mode="after")
    def _apart(self):
        if self.start == self.end:
            raise ValueError("start and end must differ")
        return self

    def waypoints(self) -> list[dict]:
        """Start and end in turn; the vehicle does not brake on the way, so there are none between."""
        start, end = np.array(self.start), np.array(self.end)
        heading = float(np.degrees(np.arctan2(*(end - start)[:2])))
        return [_stop(place, heading, self.pitch_deg, dwell_s=0.0) for place in [start, *([end, start] * self.times)]]


class HullFollowing(Block):
    """A course from point to point along a surface, at a constant distance from it, the vehicle facing it."""

    kind: Literal["hull_following"]
    surface: Annotated[str, Field(pattern=r"^(terrain|objects\.\d+)$")] = Field(examples=["objects.0"])
    """``terrain``, or an object by its number in the scene file, ``objects.0``."""
    through: Annotated[list[Position], Field(min_length=2, max_length=1000)] = Field(
        examples=[[[2.0, -3.0, 0.5], [2.0, 3.0, 0.5]]]
    )
    """Points on the surface or on that side of it [m]; the vehicle passes where it is nearest to each."""
    distance_m: Annotated[float, Field(ge=0.01, le=1e3)] = Field(examples=[1.2])
    """Distance of the vehicle's origin from the nearest point of the surface [m]."""
    spacing_m: Length = 0.25
    """Largest distance between waypoints [m]."""

    _found: list[dict] | None = PrivateAttr(default=None)
    """Waypoints, which `scene.geometry.course` finds, as that needs the mesh."""

    def waypoints(self) -> list[dict]:
        """Return the waypoints, one at least every ``spacing_m``."""
        if self._found is None:
            raise ValueError("find_course(scene) comes first: the mesh of the surface is needed")
        return self._found


Pattern = Annotated[
    LawnMower | Orbit | Spiral | ThereAndBack | HullFollowing, Field(discriminator="kind"), kind_by_default("")
]
