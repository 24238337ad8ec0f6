"""What dataset.json must say for a dataset to be read: the entries that this package relies on, and their kinds.

`writers.describe` writes more; what is not listed here may be missing.
"""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

Vec3 = tuple[float, float, float]
Row4 = tuple[float, float, float, float]
Rate = Annotated[float, Field(gt=0.0)]


def _block(**entries: Any) -> Any:
    """A block with these entries, and any others."""
    required: dict[str, Any] = {name: (kind, ...) for name, kind in entries.items()}
    return create_model("Block", __config__=ConfigDict(extra="allow"), **required)


def _metadata() -> type[BaseModel]:
    """The whole file."""
    camera = _block(id=str, width=int, height=int, K_center_half=tuple[Vec3, Vec3, Vec3],
                    K_opencv=tuple[Vec3, Vec3, Vec3], mount=Literal["vehicle", "world"])
    sensor = _block(rate_hz=Rate, T_v_s=tuple[Row4, Row4, Row4, Row4], noise=dict | None)
    return _block(
        name=str, sequence=str, vehicle=str, seed=int, versions=_block(varos_warp=str),
        device=_block(name=str, model=str) | None, frames=_block(of=int, ranges=list[tuple[int, int]], rate_hz=Rate),
        outputs=list[Literal["A", "B", "C", "D", "S"]],
        depth=_block(kind=Literal["z", "range"], range_m=tuple[float, float], scale_m=float),
        samples=_block(plan=dict | None, denoise=str | None, denoise_b=str | None),
        cameras=Annotated[list[camera], Field(min_length=1)],  # type: ignore[valid-type]  # made at run time
        sensors=dict[Literal["imu0", "depth0"], sensor], lights=list[dict],  # type: ignore[valid-type]
        water=_block(source=str, sigma_a=Vec3, sigma_s=Vec3, albedo=Vec3, g=float),
        gravity=Vec3, surface_depth_m=float, sources=dict[str, str | None], scene=dict)


_METADATA = _metadata()


def first_flaw(content: Any) -> str | None:
    """Path of the first entry that is missing or damaged, such as ``cameras.0.width``; None: all are there."""
    try:
        _METADATA.model_validate(content)
    except ValidationError as error:
        return ".".join(str(part) for part in error.errors(include_url=False)[0]["loc"]) or "all of it"
    return None
