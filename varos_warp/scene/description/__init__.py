"""What a scene file may say: one pydantic model per block. Names, units and defaults of the file format live here.

SI units; angles in degrees only in keys ending in ``_deg``. Frames: world and vehicle axes are z up; the vehicle is
x right, y forward, z up, so the identity attitude looks along +y. Unknown keys are errors.
"""

import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, model_validator

from varos_warp.errors import did_you_mean
from varos_warp.files import absolute
from varos_warp.scene.block import Block, Coordinate, SequenceId, VehicleId, written_otherwise
from varos_warp.scene.calibration.read import file_part
from varos_warp.scene.description.classes import spelling_problem
from varos_warp.scene.description.exposure import varies, white_balance_of
from varos_warp.scene.description.fleet import FleetVehicle
from varos_warp.scene.description.growth import Growth, problem_of
from varos_warp.scene.description.image_types import SNOW, TWIN, WATER
from varos_warp.scene.description.lights import Light
from varos_warp.scene.description.optics import has_twin
from varos_warp.scene.description.particles import Particles
from varos_warp.scene.description.render import Render
from varos_warp.scene.description.surfaces import Layered
from varos_warp.scene.description.survey import AnyTerrain
from varos_warp.scene.description.vehicle import Camera, Current, Pose, Trajectory, Vehicle
from varos_warp.scene.description.water import Water
from varos_warp.scene.description.world import Material, Object, Scatter

LAMPS = {path.stem: path for path in (Path(__file__).parents[2] / "data" / "lamps").glob("*.csv")}
"""Profiles of lamps that come with the package, by their names."""
TO_BE_CHOSEN = Trajectory(poses=[Pose(position=(0.0, 0.0, 0.0))])
"""Stands for the observer's trajectory until it is known which vehicle that is."""


class Scene(Block):
    """A whole scene file."""

    name: str = "scene"
    """Name of the scene; datasets, reports and exports carry it."""
    sequence: SequenceId = "01"
    """Two letters or digits that name the sequence in the dataset's file names (paper, table 5)."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Seed of every random choice: the same scene with the same seed gives the same bytes."""
    terrain: AnyTerrain | None = None
    """The sea floor: from mesh files (``kind: file``), from survey files (``kind: heights``), or generated from a seed
    (``kind: procedural``). Absent: none."""
    objects: list[Object] = []
    """What stands on the sea floor or in the water: meshes, and objects made from their measures."""
    scatter: list[Scatter] = []
    """Blocks that strew many copies of an object over the terrain."""
    growth: list[Growth] = []
    """Blocks that put animals, plants and stones on surfaces (docs/growth.md)."""
    materials: dict[str, Material] = {}
    """Materials by name; terrain and objects choose one by ``material: NAME``."""
    water: Water | Literal["none"] = "none"
    """The water, in exactly one of four forms; or ``none``: no water."""
    particles: list[Particles] = []
    """Blocks of bodies in the water that are drawn one by one, such as marine snow (docs/snow.md)."""
    surface_depth_m: Coordinate = 0.0
    """Depth of world z = 0 below the sea surface [m]."""
    gravity: Annotated[float, Field(gt=0.0, le=1e3)] = 9.81
    """Acceleration by gravity, which the IMU feels [m/s^2]; ORB-SLAM3 uses the same number."""
    current: Current = Current()
    """The water's motion, which pushes the vehicle."""
    vehicle: Vehicle = Vehicle()
    """The vehicle with its lights, cameras and sensors."""
    trajectory: Trajectory
    """Course of the vehicle: waypoints, a pattern of them, or exact poses. Required, unless there are ``vehicles``."""
    vehicles: Annotated[list[FleetVehicle], Field(min_length=1)] | None = None
    """Several vehicles instead of ``vehicle`` and ``trajectory``, each with its own ``id`` (docs/vehicles.md). A run
    makes a dataset of each. Absent: the one ``vehicle``."""
    observer: VehicleId | None = Field(default=None, examples=["0"])
    """Id of the one of ``vehicles`` whose cameras see and whose sensors read; a run chooses each in turn. Absent: the
    first."""
    render: Render = Render()
    """What is rendered, how well, and how it is exposed."""

    _base_dir: Path = PrivateAttr(default=Path("."))
    """Folder of the scene file: relative paths are relative to it."""
    _source: Any = PrivateAttr(default=None)
    """File and line of every key (scene/file/source.py)."""
    _written = written_otherwise(
        lambda scene: [
            *(("vehicle", "trajectory") if scene.vehicles else ("vehicles", "observer")),
            *(() if scene.growth else ("growth",)),
            *(() if scene.particles else ("particles",)),
        ]
    )

    @model_validator(mode="before")
    @classmethod
    def _one_or_several(cls, data: Any) -> Any:
        if not isinstance(data, dict) or data.get("vehicles") is None:
            return data
        for key in ("vehicle", "trajectory"):
            if key in data:
                raise ValueError(
                    f"{key}: cannot be given beside vehicles, each of which has its own; leave out one of them"
                )
        return {"trajectory": TO_BE_CHOSEN, **data}

    @model_validator(mode="after")
    def _observer_is_there(self):
        ids = [vehicle.id for vehicle in self.vehicles or ()]
        folded = [each.lower() for each in ids]
        for i, each in enumerate(folded):
            if (first := folded.index(each)) < i:
                raise ValueError(
                    f"vehicles.{i}.id: '{ids[i]}' is that of vehicles.{first}, or differs by upper and "
                    "lower case only; give each vehicle its own"
                )
        if self.observer is not None and self.observer not in ids:
            known = f"there are: {', '.join(ids)}" if ids else "`vehicles` is absent"
            raise ValueError(f"observer: no vehicle has the id '{self.observer}' ({known})")
        if ids:
            self.__dict__.update(self._as_seen_by(self.observer or ids[0]))
        return self

    @model_validator(mode="after")
    def _fits_together(self):
        """Refuse the first problem that blocks have with each other."""
        checks = (
            self._scatter_has_ground,
            self._growth_has_hosts,
            self._materials_exist,
            self._classes_have_one_spelling,
            self._only_ground_is_steep,
            self._drifts_have_relief,
            self._twin_differs,
            self._bodies_can_be_seen,
            self._light_is_spectral_everywhere,
            self._sensor_fits_exposures,
            self._lamps_can_balance,
            self._courses_are_of_something,
        )
        if problem := next(itertools.chain.from_iterable(check() for check in checks), None):
            raise ValueError(problem)
        return self

    def _scatter_has_ground(self) -> Iterator[str]:
        if self.scatter and self.terrain is None:
            yield "scatter.0: there is no terrain to scatter anything on"

    def _growth_has_hosts(self) -> Iterator[str]:
        moves = "moves, and nothing grows on what moves as yet"
        hosts: dict[str, str | None] = {"terrain": None} if self.terrain is not None else {}
        hosts |= {f"objects.{i}": moves if block.path else None for i, block in enumerate(self.objects)}
        hosts |= {f"scatter.{i}": None for i in range(len(self.scatter))}
        if problem := problem_of(self.growth, hosts | {vehicle.key: moves for vehicle in self.vehicles or ()}):
            yield problem

    def _placed_blocks(self):
        """All that may have a material, with its key; the terrain, or None, comes first."""
        return [
            ("terrain", self.terrain),
            *((f"objects.{i}", o) for i, o in enumerate(self.objects)),
            *((f"scatter.{i}.object", s.object) for i, s in enumerate(self.scatter)),
            *((f"vehicles.{i}.body", v.body) for i, v in enumerate(self.vehicles or ())),
        ]

    def _materials_exist(self) -> Iterator[str]:
        for key, placed in self._placed_blocks():
            if placed is not None and placed.material is not None and placed.material not in self.materials:
                known = ", ".join(sorted(self.materials)) or "none"
                near = did_you_mean(placed.material, self.materials)
                yield (
                    f"{key}.material: no material named '{placed.material}' (there are: {known})"
                    + (f". {near}" if near else "")
                )

    def _classes_have_one_spelling(self) -> Iterator[str]:
        grown = self.growth if self.render.segments == "fine" else []
        if problem := spelling_problem([*self._placed_blocks(), *((f"growth.{i}", g) for i, g in enumerate(grown))]):
            yield problem

    def _only_ground_is_steep(self) -> Iterator[str]:
        """``steep`` chooses the relief of a terrain's slopes; of an object it would be left aside without a word."""
        for key, placed in self._placed_blocks()[1:]:
            material = placed and self.materials.get(placed.material or "")
            if isinstance(material, Layered) and material.steep is not None:
                yield (
                    f"materials.{placed.material}.steep: {material.steep} is the relief of steep places "
                    f"of a terrain, and {key} has this material; leave out steep, or give {key} a "
                    "material of its own"
                )

    def _drifts_have_relief(self) -> Iterator[str]:
        ground = self.terrain
        if (
            ground is not None
            and ground.around_objects
            and not isinstance(self.materials.get(ground.material or ""), Layered)
        ):
            yield (
                "terrain.around_objects: drifts and moats are form, which the terrain's material "
                f"{ground.material or 'of none'} does not have; give it a material of kind layered"
            )

    def _twin_differs(self) -> Iterator[str]:
        cameras = [camera for vehicle in self._places.values() for camera in vehicle.cameras]
        if TWIN in self.render.outputs and not any(map(has_twin, cameras)):
            yield (
                "render.outputs: P is A without port, distortion, vignetting and shutter, and no camera "
                "has any; leave out P, or give a camera one of them"
            )

    def _bodies_can_be_seen(self) -> Iterator[str]:
        if SNOW in self.render.outputs and not self.particles:
            yield (
                "render.outputs: N shows bodies in the water, and there are no particles; leave out N, or "
                "give a block particles"
            )
        if SNOW in self.render.outputs and not self.render.shows_bodies:
            yield (
                "render.outputs: N is what bodies add to A, which has none of the light scattered once "
                "that they are a part of; leave out N, or let A have it (render.layers, max_scatterings)"
            )

    def _light_is_spectral_everywhere(self) -> Iterator[str]:
        """Water, lights and cameras are all by wavelength, or none is."""
        spectral = self.is_spectral
        foreign = "means nothing unless the water is by wavelength; give water.spectral, or"
        for place, vehicle in self._places.items():
            for i, light in enumerate(vehicle.lights):
                needed = "water by wavelength needs it of every light; give one, such as led_b4, and power_W or lumen"
                if (light.spectrum is not None) != spectral:
                    problem = needed if spectral else f"{foreign} the light an intensity"
                    yield f"{place}.lights.{i}.spectrum: {problem}"
            for i, camera in enumerate(vehicle.cameras):
                needed = "water by wavelength needs it of every camera; give one, such as nikon_5100"
                if (camera.response is not None) != spectral:
                    problem = needed if spectral else f"{foreign} leave it out"
                    yield f"{place}.cameras.{i}.response: {problem}"
                if camera.color_matrix is not None and camera.response is None:
                    yield (
                        f"{place}.cameras.{i}.color_matrix: means nothing without a response, whose "
                        "channels it turns into sRGB; give water.spectral and a response, or leave it out"
                    )
        if self.particles and spectral:
            yield "particles: are not drawn in water by wavelength; leave them out, or give the water three channels"
        for key in ("bands", "bands_range_m"):
            if getattr(self.render, key) is not None and not spectral:
                yield f"render.{key}: {foreign} leave it out"

    def _sensor_fits_exposures(self) -> Iterator[str]:
        """Check what `noise_pass` asks of a dataset: every frame is exposed for the camera's time."""
        noise = self.render.noise
        if noise is None or WATER not in self.render.outputs:
            return
        for camera in (camera for vehicle in self._places.values() for camera in vehicle.cameras):
            open_s = camera.exposure.time_s
            if noise.dark_current_electrons_per_s and not open_s:
                yield (
                    f"render.noise.dark_current_electrons_per_s: camera {camera.id} has no "
                    "exposure.time_s, in which it gathers; give it one, or leave the dark current out"
                )
            if noise.electrons_per_dn is not None and open_s and varies(self.render.exposure, camera.exposure):
                yield (
                    "render.noise.electrons_per_dn: takes the gain of a frame for its time of exposure, "
                    f"but camera {camera.id} is exposed for {open_s:g} s in every frame; give "
                    "electrons_per_radiance in a block of render.noise, or the camera exposure.gain: constant"
                )

    def _lamps_can_balance(self) -> Iterator[str]:
        """White balance for lamps needs some that are always as far away, and channels."""
        for place, vehicle in self._places.items():
            for i, camera in enumerate(vehicle.cameras):
                if white_balance_of(self.render.exposure, camera.exposure, WATER) != "lamps":
                    continue
                if self.is_spectral:
                    problem = "is for water of three channels; in water by wavelength images are balanced for the lamp"
                elif camera.mount == "world":
                    problem = "is for cameras on the vehicle, as its lamps are: this one stands in the world"
                elif not vehicle.lights:
                    problem = "is for the light of the vehicle's lamps, and it has none"
                else:
                    continue
                yield f"{place}.cameras.{i}.exposure.white_balance: lamps {problem}; give grey_world or none"

    def _courses_are_of_something(self) -> Iterator[str]:
        for (place, course), vehicle in zip(self.trajectories.items(), self._places.values(), strict=True):
            if problem := vehicle.cannot_be_followed(course.of):
                yield f"{place}.of: {problem}"

    @property
    def is_spectral(self) -> bool:
        """Whether the water, and so all light, is by wavelength."""
        return self.water != "none" and self.water.spectral is not None

    def observed_by(self, vehicle_id: str) -> "Scene":
        """The scene as one of `vehicles` sees it: `vehicle` and `trajectory` are its own."""
        return self.model_copy(update=self._as_seen_by(vehicle_id))

    def _as_seen_by(self, vehicle_id: str) -> dict[str, Any]:
        chosen = next(vehicle for vehicle in self.vehicles or () if vehicle.id == vehicle_id)
        return {"observer": vehicle_id, "vehicle": chosen, "trajectory": chosen.trajectory}

    @property
    def _places(self) -> dict[str, Vehicle]:
        """All vehicles, by where the scene file has them."""
        if not self.vehicles:
            return {"vehicle": self.vehicle}
        return {f"vehicles.{i}": vehicle for i, vehicle in enumerate(self.vehicles)}

    @property
    def trajectories(self) -> dict[str, Trajectory]:
        """The courses of all vehicles, by where the scene file has them."""
        if not self.vehicles:
            return {"trajectory": self.trajectory}
        return {f"vehicles.{i}.trajectory": vehicle.trajectory for i, vehicle in enumerate(self.vehicles)}

    @property
    def companions(self) -> dict[str, FleetVehicle]:
        """The vehicles beside `vehicle`, by the keys of their bodies and poses, ``vehicles.ID``."""
        return {vehicle.key: vehicle for vehicle in self.vehicles or () if vehicle.id != self.observer}

    @property
    def lights(self) -> list[Light]:
        """The lights of `vehicle`, then those of its companions."""
        return [light for vehicle in (self.vehicle, *self.companions.values()) for light in vehicle.lights]

    @property
    def calibrations(self) -> list[str]:
        """Files that cameras are calibrated by, as the scene names them."""
        named = [camera.calibration for vehicle in self._places.values() for camera in vehicle.cameras]
        return list(dict.fromkeys(file_part(name, self._base_dir)[0] for name in named if name))

    @property
    def moving(self) -> dict[str, Object]:
        """What moves, by its key: objects, and bodies of companions."""
        objects = {f"objects.{i}": block for i, block in enumerate(self.objects) if block.path}
        return objects | {key: vehicle.body for key, vehicle in self.companions.items() if vehicle.body}

    @property
    def tracked(self) -> list[str]:
        """Keys of all whose poses a dataset has: of `moving`, and companions that only carry lights."""
        shining = [key for key, vehicle in self.companions.items() if vehicle.lights and not vehicle.body]
        return [*self.moving, *shining]

    @property
    def numbered(self) -> list[str]:
        """Keys of what has a number in image S, in the order of the numbers, from 1; the copies of `scatter` follow.

        The body of `vehicle` has a number too, so that all have the same whichever vehicle sees them.
        """
        objects = [f"objects.{i}" for i in range(len(self.objects))]
        bodies = [vehicle.key for vehicle in self.vehicles or () if vehicle.body]
        return ["terrain"] * (self.terrain is not None) + objects + bodies

    @property
    def own_body(self) -> str | None:
        """Key of the body of `vehicle`, which has a number though nothing of it is here."""
        key = f"vehicles.{self.observer}"
        return key if key in self.numbered else None

    def number_of(self, key: str) -> int:
        """Number in image S of the terrain, an object or a body."""
        return self.numbered.index(key) + 1

    def key_of_light(self, light: Light) -> str:
        """Key in the scene file of one of `lights`: of this very light, not of an equal one."""
        return next(
            f"{place}.lights.{i}"
            for place, vehicle in self._places.items()
            for i, own in enumerate(vehicle.lights)
            if own is light
        )

    def key_of_camera(self, camera: Camera) -> str:
        """Key in the scene file of one of its cameras; of any other camera, the words ``camera ID``."""
        return next(
            (
                f"{place}.cameras.{i}"
                for place, vehicle in self._places.items()
                for i, own in enumerate(vehicle.cameras)
                if own is camera
            ),
            f"camera {camera.id}",
        )

    def key_in_file(self, words: str) -> str:
        """A key, or a sentence that begins with one: what stands under ``vehicle`` and ``trajectory``, where it is."""
        if not self.vehicles:
            return words
        place = next(place for place, vehicle in self._places.items() if vehicle.id == self.vehicle.id)
        return re.sub(r"^(vehicle|(trajectory))(?=[.:]|$)", lambda key: f"{place}.{key[2]}" if key[2] else place, words)

    def resolve(self, file: str) -> Path:
        """Path of a file that the scene names, or of a lamp that comes with the package."""
        return LAMPS[file] if file in LAMPS else absolute(self._base_dir, file)
