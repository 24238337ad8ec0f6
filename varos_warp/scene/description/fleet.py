"""Several vehicles in one scene: each with its course, and the body that the others see."""

from pydantic import field_validator

from varos_warp.products.sensors.registry import ASKED_FOR
from varos_warp.scene.block import unwritten_if_absent
from varos_warp.scene.description.patterns import HullFollowing
from varos_warp.scene.description.vehicle import Pose, Trajectory, Vehicle, Waypoint
from varos_warp.scene.description.world import Object


class FleetVehicle(Vehicle):
    """One of several vehicles: as ``vehicle`` is, with its ``trajectory`` and its ``body``."""

    trajectory: Trajectory
    """Course of the vehicle: waypoints, a pattern of them, or exact poses. All vehicles begin at time 0."""
    body: Object | None = None
    """What the other vehicles see of it: a mesh or an object made from its measures, placed in vehicle axes. Its own
    cameras do not see it, nor does it shade its own lights. Absent: nothing."""

    _written = unwritten_if_absent(*ASKED_FOR, "rigid_body", "body")

    @field_validator("body")
    @classmethod
    def _goes_with_the_vehicle(cls, body):
        if body is not None and body.path is not None:
            raise ValueError("path: the body goes where its vehicle does; leave it out")
        return body

    @property
    def key(self) -> str:
        """Key that names its body and its poses: ``vehicles.ID``."""
        return f"vehicles.{self.id}"

    @property
    def start(self) -> Waypoint | Pose:
        """First waypoint or pose of the course; only an approximate one for a course along a surface."""
        pattern = self.trajectory.pattern
        if isinstance(pattern, HullFollowing):
            return Waypoint(position=pattern.through[0])  # the first waypoint is near, but only the meshes tell
        return self.trajectory.stops[0]
