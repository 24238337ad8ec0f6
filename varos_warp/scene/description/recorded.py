"""What a scene file says of a recorded course: which columns its table has, and in which axes its poses are."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from varos_warp.scene.block import Block, unwritten_if_absent

KEYS = ("columns", "frame", "of", "body", "attitude", "origin", "start_s", "smoothing_s")
"""Keys of a trajectory that tell of its ``file``, and mean nothing without one."""

FOR_WAYPOINTS = (
    "speed",
    "max_angular_speed_deg",
    "max_acceleration",
    "overlap",
    "handover_radius_m",
    "handover_timeout_s",
    "dwell_s",
)
"""Keys of a trajectory that mean nothing where poses say when they are passed."""

Column = Annotated[str, Field(min_length=1)] | Annotated[int, Field(ge=1)]
"""A column by its name in the header, or by its number from 1."""
Of = Annotated[str, Field(pattern=r"^(vehicle|imu|[0-9a-zA-Z]{2})$")]


def _no_axis_twice_in_a_row(order: str) -> str:
    if order[0] == order[1] or order[1] == order[2]:
        raise ValueError("the same axis stands twice in a row")
    return order


Order = Annotated[str, Field(pattern=r"^([xyz]{3}|[XYZ]{3})$"), AfterValidator(_no_axis_twice_in_a_row)]


class Columns(Block):
    """Which columns of a table hold what: by their names in its header, or by their numbers from 1."""

    time: Column = Field(examples=["t"])
    """Time; its unit is ``time_unit``, or what the name ends with, as in ``t_ns`` or ``stamp_ms``; else seconds."""
    time_unit: Literal["s", "ms", "us", "ns", "min", "h"] | None = None
    """Unit of the times. Absent: what the name of the column says, else s."""
    position: tuple[Column, Column, Column] = Field(examples=[["x", "y", "z"]])
    """Position along the three axes of ``frame``, x, y, z or north, east, down [m]."""
    position_unit: Literal["m", "dm", "cm", "mm", "km", "ft", "us_ft"] | None = Field(default=None, examples=["mm"])
    """Unit of the position. Absent: what the names of its columns say, else m."""
    quaternion: tuple[Column, Column, Column, Column] | None = Field(default=None, examples=[["qw", "qx", "qy", "qz"]])
    """Attitude as a Hamilton quaternion w, x, y, z. Absent: ``euler``, ``euler_deg``, or none."""
    euler: tuple[Column, Column, Column] | None = Field(default=None, examples=[["roll", "pitch", "yaw"]])
    """Attitude as three angles in radians, in the order of ``euler_order``. Absent: another form."""
    euler_deg: tuple[Column, Column, Column] | None = Field(default=None, examples=[["roll", "pitch", "heading"]])
    """Attitude as three angles in the order of ``euler_order`` [degrees]. Absent: another form."""
    euler_order: Order = "xyz"
    """Axes of the three angles, one after the other: xyz about the fixed axes x, then y, then z, which are roll, pitch
    and yaw as in aviation and ROS; capitals about the body's own axes as they are turned."""

    @property
    def all_of_them(self) -> list[Column]:
        """All columns that are given."""
        turn = next(filter(None, (self.quaternion, self.euler, self.euler_deg)), ())
        return [self.time, *self.position, *turn]

    _written = unwritten_if_absent("time_unit", "position_unit", "quaternion", "euler", "euler_deg")

    @model_validator(mode="after")
    def _one_attitude(self):
        if sum(form is not None for form in (self.quaternion, self.euler, self.euler_deg)) > 1:
            raise ValueError("give one of quaternion, euler, euler_deg")
        return self


@dataclass(frozen=True)
class Read:
    """The poses that were read of a file, if any were. Two are always equal: they are no part of what a scene says."""

    course: Any = field(default=None, compare=False)
    """A sequence of poses; None: the file is not read yet."""
    depends_on: Any = field(default=None, compare=False)
    """Everything by which the poses would be others: the keys of the trajectory, the mount, the state of the file."""

    def poses(self) -> Sequence[Any]:
        """The poses, each as a block when it is asked for."""
        if self.course is None:
            raise ValueError("find_course(scene) comes first: the file is not read yet")
        return self.course


def check_recorded(trajectory: Any) -> None:
    """Refuse keys of a recorded course where there is none, and those that do not go together.

    Raises:
        ValueError: Naming them.
    """
    if trajectory.file is None:
        if given := [key for key in KEYS if getattr(trajectory, key) is not None]:
            raise ValueError(f"{', '.join(given)}: for a recorded course only, which `file` names")
        return
    fields = type(trajectory).model_fields
    if given := [key for key in FOR_WAYPOINTS if getattr(trajectory, key) != fields[key].default]:
        raise ValueError(f"{', '.join(given)}: for waypoints; the poses of `file` say when they are passed; leave out")
    if trajectory.body is not None and trajectory.of not in (None, "vehicle"):
        raise ValueError(
            "body: the axes of a vehicle, but the poses are `of` a camera, in its optical axes, or of the "
            "imu, in its own; leave out body"
        )
    if trajectory.body is not None and trajectory.attitude in ("along_path", "unrotated"):
        raise ValueError(
            f"body: tells of recorded attitudes, but attitude is {trajectory.attitude}; leave one of them out"
        )
