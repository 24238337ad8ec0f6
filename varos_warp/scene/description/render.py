"""What is rendered, how well, and how it is exposed."""

from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator

from varos_warp.scene.block import AS_WRITTEN, Block, NonNegative, Positive, written_otherwise
from varos_warp.scene.description.exposure import Exposure
from varos_warp.scene.description.image_types import AMBIENT, DEPTH, IMAGE_TYPES, NORMALS, TWIN, WATER, ImageLetter
from varos_warp.scene.description.noise_profile import CameraNoise

MOST_METRES = 1000.0
"""Longest way of light for which bands are chosen [m]: no water leaves any light after it."""
MOST_BANDS = 30
"""Bands beyond make no image better: cameras' curves are known in steps of 5 to 10 nm."""
LEAST_SPP, MOST_SPP = 0.25, 1 << 24
"""Least and most samples per pixel: of 2 x 2 pixels one; their numbers have 32 bits, and more would take days."""


def field_by_old_name(name):
    """``field`` for what older scene files call ``tables``."""
    return "field" if name == "tables" else name


Integrator = Annotated[Literal["auto", "field", "path", "reference"], BeforeValidator(field_by_old_name)]


def sees_water(outputs: Iterable[str]) -> bool:
    """Whether there is an image of light in water among the outputs, A or P: only those need lights and a plan."""
    return not {WATER, TWIN}.isdisjoint(outputs)


def _is_read(noise: Any) -> Any:
    """Profiles are read where a scene is loaded, for paths are relative to its folder."""
    if isinstance(noise, str):
        raise ValueError(f"is a profile, which load_scene and scene_from_dict read; here give the block: '{noise}'")
    return noise


def _or_name(schema: dict[str, Any]) -> None:
    schema["anyOf"].insert(1, {"type": "string"})


class Render(Block):
    """What is rendered and how well."""

    frame_rate_hz: Positive = 10.0
    """Frames per second [Hz]."""
    outputs: list[ImageLetter] = Field(
        default=[WATER, AMBIENT, NORMALS, DEPTH],
        description=f"Image types: {', '.join(f'{letter} {line.words}' for letter, line in IMAGE_TYPES.items())}.",
    )
    tolerance: Annotated[float, Field(gt=0.0, le=1.0)] = 0.02
    """Relative RMSE asked of an image A, in its worst channel, where ``spp`` is absent (docs/models.md)."""
    max_seconds_per_frame: Positive | None = Field(default=None, examples=[20])
    """The planner chooses no more samples of A than take about this long, whatever the tolerance [s]; absent: 60 on a
    CPU, 5 on a GPU."""
    spp: Annotated[float, Field(ge=LEAST_SPP, le=MOST_SPP), *AS_WRITTEN] | None = Field(default=None, examples=[16])
    """Samples per pixel of A; absent: the planner's choice. With the field this is a mean over the image, and fractions
    count, below one too; else they are rounded up."""
    spp_b: Annotated[int, Field(ge=1, le=MOST_SPP)] = 8
    """Samples per pixel of B (docs/models.md); in the paper (3.2.1) 20, with ``denoise_b: nlm``."""
    max_scatterings: Annotated[int, Field(ge=0)] | None = Field(default=None, examples=[2])
    """Most scatterings in the water on a path of light. Absent: no bound."""
    max_bounces: Annotated[int, Field(ge=0)] | None = Field(default=None, examples=[8])
    """Most reflections on surfaces on a path of light. Absent: no bound."""
    layers: list[Literal["direct", "single", "multiple"]] = ["direct", "single", "multiple"]
    """Which light A holds: reflected once (direct), scattered once (single), everything else (multiple)."""
    integrator: Integrator = "auto"
    """How the light of A is computed: path tracing with the precomputed field of open water, or without; ``reference``:
    a plain, slow path tracer, to compare the others with. Older files call the field ``tables``."""
    denoise: Literal["oidn", "nlm", "none"] = "oidn"
    """Denoiser of A: Open Image Denoise, non-local means, or none."""
    denoise_b: Literal["oidn", "nlm", "none"] = "oidn"
    """Denoiser of B."""
    exposure: Exposure = Exposure()
    """Exposure of the 8-bit images A and B."""
    dither: Literal["tpdf"] | None = Field(default=None, examples=["tpdf"])
    """Noise of triangular density that is added to A, B and P before they are rounded to 8 bits, so that water has no
    bands (docs/dataset.md). Absent: none."""
    noise: Annotated[
        CameraNoise | None, BeforeValidator(_is_read), Field(json_schema_extra=_or_name, examples=["machine_vision"])
    ] = None
    """The image sensor that sees A: a profile of docs/noise.md by its name or file, or the block ``camera`` of one. A
    has its noise, and A_clean has none. Absent: A has none; ``varos-warp noise`` adds noise later."""
    depth_kind: Literal["z", "range"] = "z"
    """D's depth: along the optical axis (z), or along the ray (range)."""
    depth_range_m: tuple[NonNegative, Positive] = (0.0, 25.0)
    """Depths that D's 0 and 65535 stand for [m]."""
    linear_exr: bool = False
    """Also write A (and P) before denoising and exposure as float32 EXR, with its standard error."""
    depth_exr: bool = False
    """Also write planar depth and range as float32 EXR (channels Z and range)."""
    max_triangles: Annotated[int, Field(ge=1000)] | None = Field(default=None, examples=[8_000_000])
    """Most triangles of surfaces with relief (docs/surfaces.md); where they would take more, their edges are longer by
    one factor, which is told. Absent: 3 million."""
    segments: Literal["host", "fine"] = "host"
    """What S calls a copy of `growth`: the number of what it grows on, or one of its own (fine)."""
    bands: Literal["auto"] | Annotated[int, Field(ge=3, le=MOST_BANDS)] | None = Field(default=None, examples=["auto"])
    """How many wavelengths stand for the spectrum in water by wavelength; ``auto``, as if absent: the fewest that keep
    ``tolerance`` (docs/spectra.md)."""
    bands_range_m: tuple[Positive, Positive] | None = Field(default=None, examples=[[1, 20]])
    """Shortest and longest way of light from lamps over surfaces to cameras, in water by wavelength, for which bands
    are chosen and their error is stated [m]. Absent: 1 to 20 m. ``info`` warns where the scene has others."""
    level_of_detail: Annotated[Any, Field(exclude=True, deprecated="every triangle of every mesh is rendered")] = None
    """Has no effect any more; older files ask for meshes reduced by need."""

    _written = written_otherwise(
        lambda render: [
            *(
                key
                for key in ("max_triangles", "dither", "noise", "bands", "bands_range_m")
                if getattr(render, key) is None
            ),
            *(["segments"] if render.segments == "host" else []),
        ]
    )

    @property
    def shows_bodies(self) -> bool:
        """Whether A has the light that bodies in the water scatter: it is a part of what is scattered once."""
        return "single" in self.layers and self.max_scatterings != 0

    @field_validator("depth_range_m")
    @classmethod
    def _depth_ends_after_its_start(cls, value):
        if not value[1] > value[0]:
            raise ValueError("the end of the depth range must lie beyond its start")
        return value

    @field_validator("bands_range_m")
    @classmethod
    def _ways_have_a_length(cls, value):
        if value is not None and not (value[1] > value[0] and value[1] <= MOST_METRES):
            raise ValueError(f"the longest way must be longer than the shortest, and at most {MOST_METRES:g} m")
        return value

    @field_validator("outputs", "layers")
    @classmethod
    def _some(cls, value):
        if not value or len(set(value)) < len(value):
            raise ValueError("name at least one, each once")
        return value
