"""What a scene file may say: one pydantic model per block. Names, units and defaults of the file format live here.

SI units; angles in degrees only in keys ending in ``_deg``. Frames: world and vehicle axes are z up; the vehicle is
x right, y forward, z up, so the identity attitude looks along +y. Unknown keys are errors.
"""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, PrivateAttr, model_validator

from varos_warp.scene.description.block import Block, Coordinate, SequenceId
from varos_warp.scene.description.optics import has_twin
from varos_warp.scene.description.render import Render
from varos_warp.scene.description.vehicle import Current, Trajectory, Vehicle
from varos_warp.scene.description.world import AnyTerrain, Material, Object, Scatter, Water
from varos_warp.scene.files import absolute

LAMPS = {path.stem: path for path in (Path(__file__).parents[2] / "data" / "lamps").glob("*.csv")}
"""Profiles of lamps that come with the package, by their names."""


class Scene(Block):
    """A whole scene file."""

    name: str = "scene"
    """Name of the scene; datasets, reports and exports carry it."""
    sequence: SequenceId = "01"
    """Two letters or digits that name the sequence in the dataset's file names (paper, table 5)."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Every random choice depends on it: the same scene with the same seed gives the same bytes."""
    terrain: AnyTerrain | None = None
    """The sea floor: from mesh files (``kind: file``), or generated from a seed (``kind: procedural``). Absent:
    none."""
    objects: list[Object] = []
    """What stands on the sea floor or in the water: meshes, and objects made from their measures."""
    scatter: list[Scatter] = []
    """Blocks that strew many copies of an object over the terrain."""
    materials: dict[str, Material] = {}
    """Materials by name; terrain and objects choose one by ``material: NAME``."""
    water: Water | Literal["none"] = "none"
    """The water, in exactly one of three forms; or ``none``: no water."""
    surface_depth_m: Coordinate = 0.0
    """Depth of world z = 0 below the sea surface [m]."""
    gravity: Annotated[float, Field(gt=0.0, le=1e3)] = 9.81
    """Acceleration by gravity, which the IMU feels [m/s^2]; ORB-SLAM3 uses the same number."""
    current: Current = Current()
    """The water's motion, which pushes the vehicle."""
    vehicle: Vehicle = Vehicle()
    """The vehicle with its lights, cameras and sensors."""
    trajectory: Trajectory
    """Where the vehicle goes: waypoints, a pattern of them, or exact poses."""
    render: Render = Render()
    """What is rendered, how well, and how it is exposed."""

    _base_dir: Path = PrivateAttr(default=Path("."))
    """Folder of the scene file: relative paths are relative to it."""

    @model_validator(mode="after")
    def _scatter_has_ground(self):
        if self.scatter and self.terrain is None:
            raise ValueError("scatter.0: there is no terrain to scatter anything on")
        return self

    @model_validator(mode="after")
    def _materials_exist(self):
        blocks = [("terrain", self.terrain), *((f"objects.{i}", o) for i, o in enumerate(self.objects)),
                  *((f"scatter.{i}.object", s.object) for i, s in enumerate(self.scatter))]
        for key, placed in blocks:
            if placed is not None and placed.material is not None and placed.material not in self.materials:
                known = ", ".join(sorted(self.materials)) or "none"
                raise ValueError(f"{key}.material: no material named '{placed.material}' (there are: {known})")
        return self

    @model_validator(mode="after")
    def _twin_differs(self):
        cameras = self.vehicle.cameras
        if "P" in self.render.outputs and not any(map(has_twin, cameras)):
            raise ValueError("render.outputs: P is A without port, distortion, vignetting and shutter, and no camera "
                             "has any; leave out P, or give a camera one of them")
        return self

    @property
    def moving(self) -> dict[int, Object]:
        """The objects that move, by their place among ``objects``."""
        return {i: block for i, block in enumerate(self.objects) if block.path}

    def number_of_object(self, i: int) -> int:
        """Number in image S of the i-th of ``objects``: the terrain comes before them."""
        return i + 1 + (self.terrain is not None)

    def resolve(self, file: str) -> Path:
        """Path of a file that the scene names, or of a lamp that comes with the package."""
        return LAMPS[file] if file in LAMPS else absolute(self._base_dir, file)
