"""What a camera's lens is: measured intrinsics, distortion by any of the models, and both from a calibration file."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, TypeAdapter, ValidationError, ValidationInfo

from varos_warp.errors import InputError
from varos_warp.scene.block import Block, Unit
from varos_warp.scene.calibration.read import read_calibration
from varos_warp.scene.optics.distortion import canonical

Coefficient = Annotated[float, Field(ge=-1e6, le=1e6)]
FocalLength = Annotated[float, Field(ge=1e-3, le=1e7)]
"""A focal length [pixels]."""
PrincipalPoint = Annotated[float, Field(ge=-1e6, le=1e6)]
"""A coordinate of a principal point [pixels]."""
Pixels = Annotated[int, Field(ge=1, le=16384)]
Resolution = tuple[Pixels, Pixels]
MORE_OF_OPENCV = "what follows OpenCV's first 8 is of thin prisms and tilted sensors, which no camera has here"


class Intrinsics(Block):
    """Focal lengths and principal point as calibrations give them: OpenCV's, Kalibr's and ROS's."""

    fx: FocalLength = Field(examples=[985.5])
    """Focal length across [pixels]; of a fisheye per radian, of a double sphere 1 + xi times that in the middle."""
    fy: FocalLength = Field(examples=[985.5])
    """Focal length down [pixels]."""
    cx: PrincipalPoint = Field(examples=[639.5])
    """Column of the principal point [pixels]; 0 is the centre of the top left pixel, as in OpenCV, so that the middle
    of an image is at half its width less 0.5."""
    cy: PrincipalPoint = Field(examples=[359.5])
    """Row of the principal point [pixels], counted as the column is."""


def _as_mapping(intrinsics: Any) -> Any:
    """Refuse four numbers in a list, which are of some program in an order that only their file tells."""
    if isinstance(intrinsics, list | tuple) and len(intrinsics) == 4:
        named = zip(("fx", "fy", "cx", "cy"), intrinsics, strict=True)
        words = ", ".join(f"{name}: {number}" for name, number in named)
        raise ValueError(f"should say which number is which, such as {{{words}}}")
    return intrinsics


MeasuredIntrinsics = Annotated[Intrinsics, BeforeValidator(_as_mapping)]


def _of_brown_conrady(k: Any) -> Any:
    if isinstance(k, list | tuple) and len(k) == 8:
        raise ValueError("has 8 coefficients, which are of OpenCV's rational model; give model: rational")
    return _counted(k, (4, 5), "k1, k2, p1, p2 and perhaps k3")


def _of_rational(k: Any) -> Any:
    return _counted(k, (8,), "k1, k2, p1, p2, k3, k4, k5, k6")


def _counted(k: Any, counts: tuple[int, ...], names: str) -> Any:
    """Refuse another number of coefficients in words."""
    if isinstance(k, list | tuple) and len(k) not in counts:
        raise ValueError(f"has {len(k)} coefficients; {MORE_OF_OPENCV if len(k) > 8 else f'give {names}'}")
    return k


class NoDistortion(Block):
    """No distortion: a pinhole, as without the key."""

    model: Literal["none", "pinhole"]


class BrownConrady(Block):
    """Distortion of a lens as OpenCV's calib3d has it; Kalibr's radtan, ROS's plumb_bob."""

    model: Annotated[Literal["brown_conrady", "radtan", "plumb_bob"], AfterValidator(canonical)]
    k: Annotated[
        tuple[Coefficient, ...],
        BeforeValidator(_of_brown_conrady),
        Field(min_length=4, max_length=5),
        AfterValidator(lambda k: (*k, 0.0)[:5]),
    ] = Field(examples=[[-0.15, 0.03, 0.001, -0.002, 0.0]])
    """Coefficients k1, k2, p1, p2, k3, in OpenCV's order; k3 may be left out, and is then 0."""


class Rational(Block):
    """OpenCV's rational model, for lenses that distort much; ROS's rational_polynomial."""

    model: Annotated[Literal["rational", "rational_polynomial"], AfterValidator(canonical)]
    k: Annotated[tuple[Coefficient, ...], BeforeValidator(_of_rational), Field(min_length=8, max_length=8)] = Field(
        examples=[[4.1, 2.7, 0.0001, -0.0002, 0.1, 4.5, 4.0, 0.9]]
    )
    """Coefficients k1, k2, p1, p2, k3, k4, k5, k6, in OpenCV's order."""


class KannalaBrandt(Block):
    """A fisheye as OpenCV's has it, Kalibr's and ROS's equidistant: ``focal_mm`` is per radian off the axis."""

    model: Annotated[Literal["kannala_brandt", "equidistant", "fisheye"], AfterValidator(canonical)]
    k: tuple[Coefficient, Coefficient, Coefficient, Coefficient] = (0.0, 0.0, 0.0, 0.0)
    """Coefficients k1, k2, k3, k4, in OpenCV's order; all 0 is the equidistant fisheye."""


class DoubleSphere(Block):
    """A fisheye as the double sphere of Usenko et al. (2018), Kalibr's ds.

    Its focal length is 1 + xi times that in the middle of the image.
    """

    model: Annotated[Literal["double_sphere", "ds"], AfterValidator(canonical)]
    xi: Annotated[float, Field(gt=-1.0, le=100.0)] = Field(examples=[-0.2])
    """Distance from the centre of the first sphere to that of the second, in radii."""
    alpha: Unit = Field(examples=[0.6])
    """Share of the distance of the second sphere in the divisor; the rest is of the depth."""


Distortion = Annotated[
    Annotated[NoDistortion | BrownConrady | Rational | KannalaBrandt | DoubleSphere, Field(discriminator="model")],
    AfterValidator(lambda block: None if isinstance(block, NoDistortion) else block),
]
"""A model of distortion, kept under one name each; a model of none is kept as no block."""
_PARTS: dict[str, TypeAdapter] = {
    "intrinsics": TypeAdapter(Intrinsics),
    "distortion": TypeAdapter(Distortion | None),
    "resolution": TypeAdapter(Resolution),
}


def with_calibration(camera: Any, info: ValidationInfo) -> Any:
    """Put what the ``calibration`` of a camera's block says into the block, as if it stood there.

    A validator that comes before all others. Files are relative to the ``base_dir`` of the validation's context.
    """
    if not isinstance(camera, dict) or not isinstance(name := camera.get("calibration"), str):
        return camera
    try:
        read = _checked(name, Path((info.context or {}).get("base_dir", ".")).resolve())
    except InputError as error:
        raise ValueError(f"calibration: {error.message.rstrip('.')}") from None
    for key in ("intrinsics", "distortion"):
        if camera.get(key) is not None:
            raise ValueError(f"{key}: stands beside calibration, which gives it; leave out one of them")
    size, given = read.pop("resolution", None), camera.get("resolution")
    if size is None and given is None:
        raise ValueError("calibration: the file does not say of what resolution it is; give resolution, too")
    if size is not None and given is not None and list(given if isinstance(given, list | tuple) else ()) != list(size):
        raise ValueError(f"resolution: is not that of the calibration, {size[0]} x {size[1]}; leave it out")
    return camera | read | {"resolution": given if size is None else size}


def _checked(name: str, base: Path) -> dict[str, Any]:
    """Keys of a camera's block that a calibration file gives, and that they may have."""
    found = read_calibration(name, base)
    values: dict[str, Any] = {
        "intrinsics": dict(zip(("fx", "fy", "cx", "cy"), found.intrinsics, strict=True)),
        "distortion": found.distortion,
    }
    if found.resolution is not None:
        values["resolution"] = found.resolution
    checked = {}
    for key, value in values.items():
        try:
            checked[key] = _PARTS[key].validate_python(value)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(str(part) for part in (key, *first["loc"][-1:]))
            raise InputError(
                first["msg"].removeprefix("Value error, "),
                file=name,
                key=place,
                value=first["input"],
                remedy="Calibrate again, or mend the file.",
            ) from None
    return checked
