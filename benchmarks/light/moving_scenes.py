"""Dissimilar scenes in which lights, bodies and cameras move while a shutter is open, and the same at an instant.

Everything moves in closed form, at constant speed along a line and about z, so that an instant is placed by hand: all
lights on one vehicle, every body a still part, no shutter and no strobe (`Case.instant`).
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from benchmarks.light.scenes import RESOLUTION, Built, build
from benchmarks.light.shapes import BLUE, box, spot
from varos_warp.scene.description import Scene
from varos_warp.scene.description.exposure import CameraExposure
from varos_warp.scene.description.lights import Strobe
from varos_warp.scene.description.placed import Stop
from varos_warp.scene.frames import inverse, transform
from varos_warp.scene.geometry.parts import Moving, Part
from varos_warp.scene.geometry.placed import moving_part, object_part

NOW_S = 0.5
"""Time of the frame, half way along every course of a second."""


@dataclass(frozen=True)
class Course:
    """A constant speed [m/s] in the world, and turning [deg/s] about the own z axis; ``T`` is of the frame's time."""

    T: np.ndarray
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_deg: float = 0.0

    def at(self, offset_s) -> np.ndarray:
        """Poses [N, 4, 4] at times from the frame's [N]."""
        t = np.atleast_1d(np.asarray(offset_s, float))
        poses = np.repeat(self.T[None], len(t), axis=0)
        poses[:, :3, :3] = self.T[:3, :3] @ np.array([_about_z(self.turn_deg * s) for s in t])
        poses[:, :3, 3] += t[:, None] * self.velocity
        return poses

    def stops(self) -> list[dict]:
        """Return the stops as a scene file has them, for what stands upright."""
        yaw = np.degrees(np.arctan2(self.T[1, 0], self.T[0, 0]))
        return [
            {
                "time_s": NOW_S + s,
                "position": self.at(s)[0, :3, 3].tolist(),
                "rotation_euler_deg": [0.0, 0.0, yaw + s * self.turn_deg],
            }
            for s in (-NOW_S, NOW_S)
        ]


def _about_z(angle_deg: float) -> np.ndarray:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


class Place(NamedTuple):
    """A world, and where in it others are met: so far before the camera, to the right of it, and above it [m]."""

    world: str
    ahead: float
    right: float
    above: float
    speaks: bool = False
    """True if a vehicle whose lamp faces the camera is there whatever else moves."""


SCENES = {
    "open": Place("paper_far", 3.0, 0.4, -0.3),
    "coastal": Place("coastal", 2.2, 0.4, -0.3),
    "confined": Place("closed_room", 1.3, 0.35, 0.0),
    "world_camera": Place("standing_camera", 2.6, 0.3, -0.2),
    "facing_lamp": Place("paper_pipes", 2.2, 0.5, -0.3, True),
}


class Kind(NamedTuple):
    """What moves, and how the image is exposed."""

    exposure: CameraExposure
    moves: float = 0.0
    """Speed of the vehicle that sees, in shares of 1 m/s and 20 deg/s."""
    others: int = 0
    """Vehicles with a body and two lamps, on courses of their own."""
    thing: bool = False
    strobe: Strobe | None = None


KINDS = {
    "vehicles": Kind(CameraExposure(time_s=0.1), 0.3, 2),
    "object": Kind(CameraExposure(time_s=0.15), thing=True),
    "blur": Kind(CameraExposure(time_s=0.15), 1.0),
    "rolling": Kind(CameraExposure(time_s=0.03, readout_s=0.12), 1.0),
    "strobe": Kind(CameraExposure(time_s=0.06, readout_s=0.06), 1.0, strobe=Strobe(on_s=0.04, delay_s=0.01)),
}

BODY = {"kind": "pipe", "radius": 0.11, "length": 0.4, "wall": 1, "rotation_euler_deg": [90, 0, 0]}
LAMPS = [
    spot((0.2, 0.1, 0.1), (0.2, 1.0, -0.1), 80.0, 0.3, (25.0, 20.0, 15.0)),
    spot((-0.2, 0.1, 0.1), (-0.1, 1.0, -0.3), 70.0, 0.3, (15.0, 20.0, 25.0)),
]
FACING = [spot((0.0, 0.2, 0.1), (0.1, 1.0, 0.05), 80.0, 0.15, (60.0, 60.0, 60.0))]


@dataclass(frozen=True)
class Case:
    """A scene in which something moves, and all that an instant of it is made of."""

    scene: Scene
    still: list[Part]
    own: Course
    others: dict[str, Course]
    """Other courses by key, as `Scene.companions` has them."""
    thing: Course | None

    @property
    def exposure(self) -> CameraExposure:
        """Of the camera."""
        return self.scene.vehicle.cameras[0].exposure

    def motion(self, offset_ns: np.ndarray) -> np.ndarray:
        """Motion of the vehicle that sees, as a renderer takes it."""
        return self.own.at(1e-9 * np.asarray(offset_ns))

    def parts(self) -> list[Part]:
        """All that is solid, with what moves."""
        bodies = [moving_part(self.scene, key) for key in self.others if self.scene.companions[key].body]
        return [*self.still, *bodies, *([] if self.thing is None else [self._moving_thing(self.thing)])]

    @staticmethod
    def _moving_thing(course: Course) -> Moving:
        start = course.at(-NOW_S)[0]
        path = tuple(Stop(**stop) for stop in course.stops())
        return Moving(
            **vars(replace(_placed(_thing(), start), origin=tuple(start[:3, 3].tolist()))),
            path=path,
            R_w_o=start[:3, :3],
        )

    def instant(self, offset_s: float) -> Built:
        """The still scene at a time from the frame's: one vehicle that has all lights, and bodies where they are."""
        own = self.own.at(offset_s)[0]
        lights = [light.model_copy(update={"strobe": None}) for light in self.scene.vehicle.lights]
        parts = list(self.still)
        for key, course in self.others.items():
            vehicle, there = self.scene.companions[key], course.at(offset_s)[0]
            lights += [_carried(light, inverse(own) @ there) for light in vehicle.lights]
            if vehicle.body:
                parts.append(_placed(object_part(self.scene, vehicle.body, key), there))
        if self.thing:
            parts.append(_placed(_thing(), self.thing.at(offset_s)[0]))
        view = self.scene.vehicle.cameras[0].model_copy(update={"exposure": CameraExposure()})
        seen = self.scene.vehicle.model_copy(update={"lights": lights, "cameras": [view]})
        still = {"vehicle": seen, "vehicles": None, "observer": None}
        return Built(self.scene.model_copy(update=still), parts, own)


def _thing() -> Part:
    """A block, in axes of its own."""
    return box("thing", (0.35, 0.2, 0.3), (0, 0, 0), BLUE)


def _placed(part: Part, T: np.ndarray) -> Part:
    return replace(part, vertices=part.vertices @ T[:3, :3].T + T[:3, 3])


def _carried(light, T: np.ndarray):
    """A spot of another vehicle, in axes of the one that sees."""
    return light.model_copy(
        update={
            "position": tuple(T[:3, :3] @ light.position + T[:3, 3]),
            "strobe": None,
            "direction": tuple(T[:3, :3] @ light.direction),
        }
    )


def make(place: str, kind: str, resolution=RESOLUTION) -> Case:
    """A scene and what moves in it, by name."""
    at, how = SCENES[place], KINDS[kind]
    built = build(at.world, resolution)
    own = Course(built.T_w_v, tuple(how.moves * built.T_w_v[:3, :3] @ (0.6, 0.8, 0.1)), 20.0 * how.moves)
    fleet = {
        f"vehicles.{i}": (course, {"body": BODY, "lights": LAMPS})
        for i, course in enumerate(_others(built, at)[: how.others], 1)
    }
    if at.speaks:
        facing = Course(_met(built, at, at.ahead, -at.right, at.above, 170.0), (0.5, -0.1, 0.0), 30.0)
        fleet["vehicles.9"] = facing, {"lights": FACING}
    thing = Course(_met(built, at, 0.75 * at.ahead, 0.0, 0.0, 20.0), (1.0, -0.4, 0.3), 60.0) if how.thing else None
    return Case(_scene(built.scene, how, fleet), built.parts, own, {key: each[0] for key, each in fleet.items()}, thing)


def _others(built: Built, at: Place) -> list[Course]:
    """One that comes towards the camera and turns, and one that crosses."""
    return [
        Course(_met(built, at, at.ahead, at.right, at.above, 150.0), (-0.8, -0.5, 0.1), 40.0),
        Course(_met(built, at, 1.1 * at.ahead, -at.right, at.above, -100.0), (1.0, 0.2, 0.0), -20.0),
    ]


def _met(built: Built, at: Place, ahead: float, right: float, above: float, yaw_deg: float) -> np.ndarray:
    """An upright pose so far from the camera, which may stand in the world."""
    view = built.scene.vehicle.cameras[0]
    if view.mount == "world":
        start, forward = np.array(view.position), np.array(view.look_at) - view.position
    else:
        start, forward = built.T_w_v[:3, 3], built.T_w_v[:3, 1]
    forward = np.array([forward[0], forward[1], 0.0]) / np.hypot(*forward[:2])
    place = start + ahead * forward + right * np.cross(forward, (0, 0, 1)) + above * np.array([0, 0, 1])
    return transform(_about_z(yaw_deg), place)


def _scene(scene: Scene, how: Kind, fleet: dict) -> Scene:
    """The scene with a shutter, strobes, and other vehicles."""
    strobe = {"strobe": how.strobe}
    lights = [light.model_copy(update=strobe) for light in scene.vehicle.lights]
    view = scene.vehicle.cameras[0].model_copy(update={"exposure": how.exposure})
    vehicle = scene.vehicle.model_copy(update={"lights": lights, "cameras": [view]})
    scene = scene.model_copy(update={"vehicle": vehicle})
    if not fleet:
        return scene
    course = scene.trajectory.model_dump(exclude_unset=True)
    own = vehicle.model_dump(exclude_unset=True) | {"id": "0", "trajectory": course}
    others = [
        {
            "id": key[-1],
            "trajectory": {"poses": course.stops()},
            **carried,
            "lights": [light | strobe for light in carried["lights"]],
        }
        for key, (course, carried) in fleet.items()
    ]
    return Scene(**scene.model_dump(exclude_unset=True, exclude={"vehicle", "trajectory"}), vehicles=[own, *others])
