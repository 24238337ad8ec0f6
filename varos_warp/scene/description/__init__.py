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
    sequence: SequenceId = "01"
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    terrain: AnyTerrain | None = None
    objects: list[Object] = []
    scatter: list[Scatter] = []
    materials: dict[str, Material] = {}
    water: Water | Literal["none"] = "none"
    surface_depth_m: Coordinate = 0.0
    """Depth of world z = 0 below the sea surface [m]."""
    gravity: Annotated[float, Field(gt=0.0, le=1e3)] = 9.81
    """[m/s^2]; ORB-SLAM3 uses the same number."""
    current: Current = Current()
    vehicle: Vehicle = Vehicle()
    trajectory: Trajectory
    render: Render = Render()

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
            raise ValueError("render.outputs: P is A without port, distortion and vignetting, and no camera has any; "
                             "leave out P, or give a camera one of them")
        return self

    def resolve(self, file: str) -> Path:
        """Path of a file that the scene names, or of a lamp that comes with the package."""
        return LAMPS[file] if file in LAMPS else absolute(self._base_dir, file)
