"""What dataset.json must say for a dataset to be read: the entries that this package relies on, and their kinds.

`describe` of dataset/write/texts.py writes more; what is not listed here may be missing. Names that become part of
paths, here and in exports, are held to the same patterns as in a scene file: no dataset leads out of its folder.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, create_model

from varos_warp.dataset import files
from varos_warp.dataset.layout import datasets_in
from varos_warp.dataset.links import refuse_links_out
from varos_warp.errors import InputError
from varos_warp.files import is_file
from varos_warp.limits import check_limit
from varos_warp.products.sensors.registry import SENSORS
from varos_warp.scene.block import CameraId, SequenceId, VehicleId
from varos_warp.scene.description.exposure import Gain, WhiteBalance
from varos_warp.scene.description.image_types import ImageLetter
from varos_warp.scene.description.lens import Distortion
from varos_warp.scene.description.lights import Strobe
from varos_warp.scene.description.optics import Duration, Index, Port, Vignetting
from varos_warp.scene.description.render import Integrator

SCHEMA_VERSION = 1
"""Schema version of dataset.json; raised when a key changes its meaning."""
Vec3 = tuple[float, float, float]
Row4 = tuple[float, float, float, float]
Rate = Annotated[float, Field(gt=0.0, strict=True)]
Whole = Annotated[int, Field(strict=True)]
"""A strict integer: 4.0 is refused, which no `range` takes."""
Count = Annotated[Whole, Field(ge=0, le=10**8)]
Side = Annotated[Whole, Field(ge=1, le=2**16)]
Denoiser = Literal["oidn", "nlm", "none"] | None
SampleCount = Annotated[float, Field(gt=0.0, strict=True)]
FRAMES_NAMED = 10**8
"""The names of images have eight digits."""


def read_metadata(root: Path) -> dict[str, Any]:
    """What dataset.json says, or an `InputError`: it is missing, of another version, or an entry is damaged."""
    path = root / "dataset.json"
    if not is_file(path):
        raise no_dataset(root)
    refuse_links_out(root)
    content = files.read_json(path, remedy="Make the dataset anew.")
    if not isinstance(content, dict) or content.get("schema_version") != SCHEMA_VERSION:
        raise InputError(
            f"this is not a dataset of schema version {SCHEMA_VERSION}",
            file=path,
            remedy="Make it anew, or read it with the version of varos_warp that made it.",
        )
    _renew(content)
    if flaw := first_flaw(content):
        raise InputError(f"the entry {flaw}", file=path, remedy="Make the dataset anew.")
    return content


def _renew(content: dict[str, Any]) -> None:
    """Give cameras of older datasets, and of the scene in them, their ``exposure``."""
    scene = content["scene"] if isinstance(content.get("scene"), dict) else {}
    several = scene["vehicles"] if isinstance(scene.get("vehicles"), list) else []
    for carrier in [content, scene.get("vehicle"), *several]:
        if isinstance(carrier, dict) and isinstance(carrier.get("cameras"), list):
            carrier["cameras"] = [renewed(camera) for camera in carrier["cameras"]]


def renewed(about: Any) -> Any:
    """What a dataset says of a camera, where older ones have the times of its ``exposure`` under ``shutter``."""
    old = about.get("shutter") if isinstance(about, dict) else None
    if not isinstance(old, dict) or "exposure" in about:
        return about
    times = {"time_s" if key == "exposure_s" else key: value for key, value in old.items()}
    return {"exposure" if key == "shutter" else key: times if key == "shutter" else about[key] for key in about}


def no_dataset(root: Path) -> InputError:
    """What to say of a path that holds no dataset.json: what it may be instead."""
    remedy = "Give the folder that `varos-warp run` wrote to."
    if not root.exists():
        return InputError("there is no such folder", file=root, remedy=remedy)
    inside = [str(path) for path in datasets_in(root) if path != root]
    around = [str(folder) for folder in root.parents if is_file(folder / "dataset.json")]
    if inside:
        remedy = f"Several vehicles have a dataset each: give {' and '.join(inside)}, one at a time."
    elif around:
        remedy = f"Give {around[0]}, the dataset that it lies in."
    return InputError(
        "there is no dataset.json in it, so it is not a dataset"
        if root.is_dir()
        else "is a file, and a dataset is a folder",
        file=root,
        remedy=remedy,
    )


def _ascending(ranges: list[tuple[int, int]]) -> list[tuple[int, int]]:
    ends = [end for pair in ranges for end in pair]
    if (
        ends != sorted(ends)
        or any(start == stop for start, stop in ranges)
        or (ends and not 0 <= ends[0] <= ends[-1] <= FRAMES_NAMED)
    ):
        raise ValueError("ranges are half-open, ascending and apart")
    return ranges


def _in_order(pairs: list[tuple[float, float]]) -> list[tuple[float, float]]:
    if [frame for frame, _ in pairs] != sorted(frame for frame, _ in pairs):
        raise ValueError("frames are not in order")
    return pairs


SamplesByFrame = Annotated[
    list[tuple[Annotated[float, Field(ge=0.0)], SampleCount]], Field(min_length=1), AfterValidator(_in_order)
]
"""Pairs of a frame and its samples per pixel (`Plan.spp_by_frame`)."""


def _consistent(cameras: list) -> list:
    for camera in cameras:
        port = camera.port
        if port is not None:
            whole = {name for name, field in type(port).model_fields.items() if field.default is not None}
            if not (camera.n_water and whole <= port.model_fields_set):
                raise ValueError("a port is stated whole, and the water's index beside it")
    if len({camera.id.lower() for camera in cameras}) < len(cameras):
        raise ValueError("ids of cameras differ")
    return cameras


def _block(optional: dict[str, Any] | None = None, **entries: Any) -> Any:
    """A block with these entries, perhaps the optional ones, and any others."""
    kinds: dict[str, Any] = {name: (kind, ...) for name, kind in entries.items()}
    kinds |= {name: (kind | None, None) for name, kind in (optional or {}).items()}
    return create_model("Block", __config__=ConfigDict(extra="allow", allow_inf_nan=False), **kinds)


def _metadata() -> type[BaseModel]:
    """Schema of the whole of dataset.json."""
    decision = _block({"error": Vec3}, what=str, choice=str, reason=str)
    plan = _block(
        {
            "decisions": list[decision],  # type: ignore[valid-type]
            "error": Vec3,
            "models": dict[str, str],
            "max_scatterings": Count,
            "max_bounces": Count,
            "integrator": Integrator,
            "spp_by_frame": dict[str, SamplesByFrame],
        },
        spp=SampleCount,
    )
    matrix = tuple[Row4, Row4, Row4, Row4]
    camera = _block(
        {
            "T_v_c": matrix,
            "T_w_c": matrix,
            "f_stop": float,
            "focus_m": float,
            "port": Port,
            "rays": str,
            "n_water": tuple[Index, Index, Index],
            "distortion": str | Distortion,
            "vignetting": Vignetting,
            "color_matrix": tuple[Vec3, Vec3, Vec3],
            "exposure": _block(
                {"row_poses": str, "gain": Gain, "white_balance": WhiteBalance}, time_s=Duration, readout_s=Duration
            ),
        },
        id=CameraId,
        width=Side,
        height=Side,
        K_center_half=tuple[Vec3, Vec3, Vec3],
        K_opencv=tuple[Vec3, Vec3, Vec3],
        mount=Literal["vehicle", "world"],
    )
    of_light = {
        "kind": str,
        "position": Vec3,
        "intensity": Vec3,
        "cone_deg": float,
        "fan_deg": float,
        "thickness_deg": float,
        "radius_m": float,
        "up": Vec3,
        "strobe": Strobe,
    }
    light = _block(of_light | {"T_v_light": matrix})
    of_sensors = {
        sensor.id: _block(rate_hz=Rate, T_v_s=matrix, noise=dict | None, **sensor.facts) for sensor in SENSORS
    }
    # none but these, for their names become part of paths
    sensors = create_model(
        "Sensors", __config__=ConfigDict(extra="forbid"), **{name: (block, None) for name, block in of_sensors.items()}
    )  # type: ignore[call-overload]
    ranges = Annotated[list[tuple[Whole, Whole]], AfterValidator(_ascending)]
    cameras = Annotated[list[camera], Field(min_length=1), AfterValidator(_consistent)]  # type: ignore[valid-type]
    corner = tuple[Vec3, Vec3]
    key = Annotated[str, Field(pattern=r"^(objects\.\d+|vehicles\.[0-9a-zA-Z])$")]
    lights = list[_block(of_light, T_v_light=matrix)]  # type: ignore[misc, valid-type]
    moving = _block({"lights": lights}, key=key, id=Count, box_m=corner) | _block(key=key, lights=lights)
    rows = list[list[float]]
    bands = _block(camera=str, wavelength_nm=list[float], a=list[float], b=list[float], weights=rows, white=rows)
    by_wavelength = _block(
        source=str,
        water=str,
        phase=str,
        g=float,
        wavelength_nm=list[float],
        a=list[float],
        b_water=list[float],
        b_particles=list[float],
        bands=list[bands],  # type: ignore[valid-type]
    )
    by_channel = _block(source=str, phase=str, sigma_a=Vec3, sigma_s=Vec3, albedo=Vec3, g=float)
    return _block(
        {"moving": list[moving]},  # type: ignore[valid-type]
        name=str,
        sequence=SequenceId,
        vehicle=VehicleId,
        seed=Whole,
        versions=_block(varos_warp=str),
        device=_block(name=str, model=str) | None,
        frames=_block(of=Count, ranges=ranges, rate_hz=Rate),
        outputs=list[ImageLetter],
        depth=_block(kind=Literal["z", "range"], range_m=tuple[float, float], scale_m=float),
        samples=_block(plan=plan | None, denoise=Denoiser, denoise_b=Denoiser),
        cameras=cameras,
        sensors=sensors,
        lights=list[light],  # type: ignore[valid-type]
        water=by_channel | by_wavelength,
        gravity=Vec3,
        surface_depth_m=float,
        sources=dict[str, str | None],
        scene=dict,
    )


_METADATA = _metadata()


def first_flaw(content: Any) -> str | None:
    """The first entry that is missing or damaged, such as ``cameras.0.width``, and why; None: all are there."""
    try:
        _METADATA.model_validate(content)
    except ValidationError as error:
        flaw = error.errors(include_url=False)[0]
        path = ".".join(str(part) for part in flaw["loc"]) or "all of it"
        return f"{path} is missing or damaged: {flaw['msg'].removeprefix('Value error, ')}"
    cameras = [camera["id"] for camera in content["cameras"]]
    planned = ((content["samples"]["plan"] or {}).get("spp_by_frame") or {}).keys()
    if unknown := planned - {*cameras}:
        return (
            f"samples.plan.spp_by_frame.{min(unknown)} is of no camera of the dataset, which has {', '.join(cameras)}"
        )
    check_limit("FRAMES", sum(stop - start for start, stop in content["frames"]["ranges"]), key="frames.ranges")
    return None
