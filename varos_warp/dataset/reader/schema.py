"""What dataset.json must say for a dataset to be read: the entries that this package relies on, and their kinds.

`writers.describe` writes more; what is not listed here may be missing.
"""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

Vec3 = tuple[float, float, float]
Row4 = tuple[float, float, float, float]


class Entry(BaseModel):
    """A block; more keys than those listed are welcome."""

    model_config = ConfigDict(extra="allow")


class Versions(Entry):
    """Of the programs that shape the numbers."""

    varos_warp: str


class Device(Entry):
    """Where the first frame was rendered."""

    name: str
    model: str


class Frames(Entry):
    """Which frames of the sequence the dataset has."""

    of: int
    ranges: list[tuple[int, int]]
    rate_hz: Annotated[float, Field(gt=0.0)]


class Depth(Entry):
    """How D maps to metres."""

    kind: Literal["z", "range"]
    range_m: tuple[float, float]
    scale_m: float


class Water(Entry):
    """Optical properties by channel [1/m]."""

    source: str
    sigma_a: Vec3
    sigma_s: Vec3
    albedo: Vec3
    g: float


class Samples(Entry):
    """How A and B were rendered; null: they were not yet."""

    plan: dict | None
    denoise: str | None
    denoise_b: str | None


class Camera(Entry):
    """Calibration."""

    id: str
    width: int
    height: int
    K_center_half: tuple[Vec3, Vec3, Vec3]
    K_opencv: tuple[Vec3, Vec3, Vec3]
    mount: Literal["vehicle", "world"]


class Sensor(Entry):
    """The IMU or the depth gauge."""

    rate_hz: Annotated[float, Field(gt=0.0)]
    T_v_s: tuple[Row4, Row4, Row4, Row4]
    noise: dict | None


class Metadata(Entry):
    """The whole file."""

    name: str
    sequence: str
    vehicle: str
    seed: int
    versions: Versions
    device: Device | None
    frames: Frames
    outputs: list[Literal["A", "B", "C", "D", "S"]]
    depth: Depth
    samples: Samples
    cameras: Annotated[list[Camera], Field(min_length=1)]
    sensors: dict[Literal["imu0", "depth0"], Sensor]
    lights: list[dict]
    water: Water
    gravity: Vec3
    surface_depth_m: float
    sources: dict[str, str | None]
    scene: dict


def first_flaw(content: Any) -> str | None:
    """Path of the first entry that is missing or damaged, such as ``cameras.0.width``; None: all are there."""
    try:
        Metadata.model_validate(content)
    except ValidationError as error:
        return ".".join(str(part) for part in error.errors(include_url=False)[0]["loc"]) or "all of it"
    return None
