"""What a scene file may say: one pydantic model per block. Names, units and defaults of the file format live here.

SI units; angles in degrees only in keys ending in ``_deg``. Frames: world and vehicle axes are z up; the vehicle is
x right, y forward, z up, so the identity attitude looks along +y. Unknown keys are errors.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PrivateAttr, field_validator, model_validator

from varos_warp.scene.description.block import Block, Coordinate, NonNegative, Positive, SequenceId
from varos_warp.scene.description.vehicle import Current, Trajectory, Vehicle
from varos_warp.scene.description.world import AnyTerrain, Material, Object, Scatter, Water
from varos_warp.scene.files import absolute


class Exposure(Block):
    """Exposure correction before 8-bit output (paper 3.2.1)."""

    A: Literal["adaptive", "constant"] | Positive = "adaptive"
    B: Literal["adaptive", "constant"] | Positive = "constant"


def field_by_old_name(name):
    """``field`` for what older scene files call ``tables``."""
    return "field" if name == "tables" else name


class Render(Block):
    """What is rendered and how well."""

    frame_rate_hz: Positive = 10.0
    outputs: list[Literal["A", "B", "C", "D", "S"]] = ["A", "B", "C", "D"]
    tolerance: Annotated[float, Field(gt=0.0, le=1.0)] = 0.02
    """Relative RMSE of an image A, in its worst channel, where ``spp`` is absent (docs/models.md)."""
    max_seconds_per_frame: Positive | None = None
    """Sampling of A stops after about this long, whatever the tolerance; absent: 60 on a CPU, 5 on a GPU."""
    spp: Annotated[int, Field(ge=1)] | None = None
    """Samples per pixel of A; absent: the planner's choice."""
    spp_b: Annotated[int, Field(ge=1)] = 20
    """Samples per pixel of B (paper 3.2.1)."""
    max_scatterings: Annotated[int, Field(ge=0)] | None = None
    max_bounces: Annotated[int, Field(ge=0)] | None = None
    layers: list[Literal["direct", "single", "multiple"]] = ["direct", "single", "multiple"]
    integrator: Annotated[Literal["auto", "field", "path", "reference"], BeforeValidator(field_by_old_name)] = "auto"
    """How the light of A is computed: path tracing with the precomputed field of open water, or without; ``reference``:
    a plain, slow path tracer, to compare the others with. Older files call the field ``tables``."""
    denoise: Literal["oidn", "nlm", "none"] = "oidn"
    denoise_b: Literal["oidn", "nlm", "none"] = "nlm"
    exposure: Exposure = Exposure()
    depth_kind: Literal["z", "range"] = "z"
    depth_range_m: tuple[NonNegative, Positive] = (0.0, 25.0)
    linear_exr: bool = False
    """Also write A before denoising and exposure as float32 EXR, with its standard error."""
    depth_exr: bool = False
    """Also write planar depth and range as float32 EXR (channels Z and range)."""
    level_of_detail: Annotated[Any, Field(exclude=True, deprecated="every triangle of every mesh is rendered")] = None
    """Older files ask for meshes reduced by need."""

    @field_validator("depth_range_m")
    @classmethod
    def _depth_ends_after_its_start(cls, value):
        if not value[1] > value[0]:
            raise ValueError("the end of the depth range must lie beyond its start")
        return value

    @field_validator("outputs", "layers")
    @classmethod
    def _some(cls, value):
        if not value or len(set(value)) < len(value):
            raise ValueError("name at least one, each once")
        return value


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

    def resolve(self, file: str) -> Path:
        """Path of a file that the scene names."""
        return absolute(self._base_dir, file)
