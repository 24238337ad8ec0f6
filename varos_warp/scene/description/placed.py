"""What stands or moves in the world: its place, its path, and what objects made from measures share."""

import itertools
from typing import Annotated, Literal

from pydantic import Field, model_validator

from varos_warp.scene.block import (
    Block,
    EulerAngles,
    Position,
    Positive,
    Quaternion,
    check_look_at,
    unwritten_if_absent,
)

ClassName = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^\S(.*\S)?$")]
"""Name of a class of objects in labels."""


class Placed(Block):
    """Anything that stands in the world: position [m], rotation (about fixed x, then y, then z) and scale."""

    position: Position = (0.0, 0.0, 0.0)
    """Position of its origin, in world axes [m]."""
    rotation_euler_deg: EulerAngles = (0.0, 0.0, 0.0)
    """Rotation about the world's fixed axes x, then y, then z [degrees]."""
    scale: Positive | tuple[Positive, Positive, Positive] = 1.0
    """Factor of its size: one number, or one for each of its own axes; 0.001 if a file is in millimetres."""
    material: str | None = Field(default=None, examples=["rusty"])
    """Name of one of ``materials``; absent: the colours that a mesh file or a structure brings along,
    else grey."""
    smooth_angle_deg: Annotated[float, Field(ge=0.0, le=180.0)] = 30.0
    """Edges at most this sharp get smooth normals (paper, image type C) [degrees]."""
    class_: ClassName | None = Field(default=None, alias="class", examples=["valve"])
    """Its class in labels (docs/labels.md), one spelling of each. Absent: of an object the name of its mesh file, in
    lower case, or its kind; of the sea floor terrain."""

    _written = unwritten_if_absent("class_")


class Stop(Block):
    """Position and attitude of a moving object at a time. The attitude is given as for a pose of the vehicle."""

    time_s: Annotated[float, Field(ge=0.0, le=86_400.0)] = 0.0
    """Time at which the object is here, from the start of the sequence [s]."""
    position: Position = Field(examples=[[2, 5, 1]])
    """Position of the object's origin here, in world axes [m]."""
    look_at: Position | None = Field(default=None, examples=[[4, 5, 1]])
    """Point that its own y axis faces here, in world axes [m]; instead of ``rotation_euler_deg``."""
    rotation_euler_deg: EulerAngles | None = Field(default=None, examples=[[0, 0, 90]])
    """Rotation about the world's fixed axes x, then y, then z [degrees]; without any of the three the attitude stays
    that of the stop before, at first the object's own."""
    quaternion: Quaternion | None = Field(default=None, examples=[[0.966, 0.0, 0.0, 0.259]])
    """Rotation as a Hamilton quaternion w, x, y, z, object to world; instead of ``rotation_euler_deg``."""

    _looks_somewhere = model_validator(mode="after")(check_look_at)
    _written = unwritten_if_absent("quaternion")


class Movable(Placed):
    """Anything that may move: what is one of ``objects``."""

    path: Annotated[list[Stop], Field(min_length=2)] | None = Field(
        default=None, examples=[[{"time_s": 0, "position": [2, 5, 1]}, {"time_s": 10, "position": [4, 5, 1]}]]
    )
    """Stops of the object at given times; splines pass through them, as through the poses of a vehicle. After the last
    it brakes, and is at rest 2 s later; likewise before the first it comes from rest. Absent: it stands still."""

    _written = unwritten_if_absent("path", "class_")

    @model_validator(mode="before")
    @classmethod
    def _begins_its_path(cls, block):
        stops = block.get("path") if isinstance(block, dict) else None
        if isinstance(stops, list) and stops and isinstance(stops[0], dict) and "position" in stops[0]:
            return {"position": stops[0]["position"], **block}
        return block

    @model_validator(mode="after")
    def _path_leads_on(self):
        stops = self.path or []
        if stops and self.position != stops[0].position:
            raise ValueError(
                f"path begins at {list(stops[0].position)}, not at the object's position "
                f"{list(self.position)}; leave out position"
            )
        for i, (before, stop) in enumerate(itertools.pairwise(stops), 1):
            if stop.time_s <= before.time_s:
                raise ValueError(
                    f"path.{i}.time_s: {stop.time_s:g} s is not after the stop before it, at "
                    f"{before.time_s:g} s; give the stops in order of time, each its own time"
                )
        return self

    @property
    def stops(self) -> list[Stop]:
        """The path, empty for none, with the object's own attitude at the first stop if that names none."""
        if not self.path:
            return []
        first, *rest = self.path
        if first.look_at is None and first.rotation_euler_deg is None and first.quaternion is None:
            first = first.model_copy(update={"rotation_euler_deg": self.rotation_euler_deg})
        return [first, *rest]


Measure = Annotated[float, Field(ge=1e-4, le=100.0)]
"""A measure of a parametric object [m]; its triangles stay few enough to be made in seconds."""


class Parametric(Movable):
    """An object made from its measures."""

    chord_error_m: Annotated[float, Field(ge=1e-6)] | None = Field(default=None, examples=[0.001])
    """How far its triangles may lie from the true surface [m]; absent: a 500th of its radius, 0.05 to 0.38 mm;
    for a boulder an 80th of its radius."""
    max_edge_m: Annotated[float, Field(ge=1e-4)] | None = Field(default=None, examples=[0.01])
    """Longest edge of its triangles in the world [m]: it is made of even grids then, for displacement and colours per
    vertex. Absent: as few triangles as its true surface needs."""
    shading: Literal["flat", "smooth"] = "smooth"
    """Normals that A and B are lit with, of the triangles or smoothed; C always has the smoothed ones."""

    _written = unwritten_if_absent("path", "class_", "max_edge_m")
