"""What is rendered, how well, and how it is exposed."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator

from varos_warp.scene.description.block import Block, NonNegative, Positive


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
    outputs: list[Literal["A", "B", "C", "D", "S", "P", "F"]] = ["A", "B", "C", "D"]
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
    """Also write A (and P) before denoising and exposure as float32 EXR, with its standard error."""
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
