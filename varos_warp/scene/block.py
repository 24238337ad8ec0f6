"""What blocks of a scene file are made of: lengths, angles, colours, and the base of every block."""

from collections.abc import Callable, Iterable, Iterator
from math import hypot
from typing import Annotated, Any, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationError,
    model_serializer,
    model_validator,
)
from pydantic_core import InitErrorDetails

SequenceId = Annotated[str, Field(pattern=r"^[0-9a-zA-Z]{2}$")]
CameraId = Annotated[str, Field(pattern=r"^[0-9a-zA-Z]{2}$")]
"""Type (M mono, L stereo left, R stereo right ...) and number, as in the file names (paper, table 5)."""
VehicleId = Annotated[str, Field(pattern=r"^[0-9a-zA-Z]$")]
Vec3 = tuple[float, float, float]
Coordinate = Annotated[float, Field(ge=-1e9, le=1e9)]
"""A coordinate [m]; float64 is finer than 0.2 micrometres up to the bound, and rays are no longer."""
Position = tuple[Coordinate, Coordinate, Coordinate]
Angle = Annotated[float, Field(ge=-1e6, le=1e6)]
"""An angle [degrees]; much larger ones would lose all digits to whole turns."""
EulerAngles = tuple[Angle, Angle, Angle]
QUATERNION_SLACK = 1e-3
"""How far the length of a quaternion may be from 1: three decimals of each part, and no more."""


def _is_unit(value):
    size = hypot(*value)
    if abs(size - 1.0) > QUATERNION_SLACK:
        raise ValueError(f"the length of the quaternion w, x, y, z is {size:.6g}, not 1")
    return value


Quaternion = Annotated[tuple[float, float, float, float], AfterValidator(_is_unit)]
"""A Hamilton quaternion w, x, y, z; its length is made 1 where it is used."""
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Unit = Annotated[float, Field(ge=0.0, le=1.0)]
UnitRgb = tuple[Unit, Unit, Unit]
Coefficient = Annotated[float, Field(ge=0.0, le=1e6)]
"""A scattering or absorption coefficient [1/m]; beyond the bound, light ends within a micrometre."""
CoefficientRgb = tuple[Coefficient, Coefficient, Coefficient]


def plain_number(value: float) -> float:
    """An int where there is no fraction, as people write it: 4 for 4.0."""
    return int(value) if float(value).is_integer() else value


AS_WRITTEN = AfterValidator(plain_number), PlainSerializer(plain_number, return_type=Any)
"""Keeps a number as written: an int if it has no fraction. Bounds come before these, or a schema would lack them."""


def _has_area(value):
    if not (value[0] < value[2] and value[1] < value[3]):
        raise ValueError("a rectangle is [xmin, ymin, xmax, ymax] with xmin < xmax and ymin < ymax")
    return value


Rectangle = Annotated[tuple[float, float, float, float], AfterValidator(_has_area)]
"""xmin, ymin, xmax, ymax [m]."""


def outside(low: float, high: float, problem: str) -> AfterValidator:
    """Return a validator that refuses numbers between two values.

    Such are, for example, those that single precision takes for 0 but are not.
    """

    def check(value: float) -> float:
        if low < value < high:
            raise ValueError(problem)
        return value

    return AfterValidator(check)


class Block(BaseModel):
    """Base of every block: unknown keys, NaN and infinity are errors, and a loaded block does not change."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, use_attribute_docstrings=True)

    @model_validator(mode="before")
    @classmethod
    def _yes_is_no_number(cls, data: Any) -> Any:
        """Refuse true and false, also yes and off of YAML, where numbers belong: Python takes them for 1 and 0."""
        if not isinstance(data, dict):
            return data
        given = ((field.alias or name, field.annotation) for name, field in cls.model_fields.items())
        wrong = [
            InitErrorDetails(type="float_type", loc=place, input=value)
            for key, annotation in given
            for place, value in _truth_values(data.get(key), (key,))
            if {int, float} & (kinds := {*_types_in(annotation)}) and bool not in kinds
        ]
        if wrong:
            raise ValidationError.from_exception_data(cls.__name__, wrong)
        return data


def _truth_values(value: Any, place: tuple) -> Iterator[tuple[tuple, bool]]:
    """Places of true and false in a value, or in a list and the lists in it; blocks look after their own keys."""
    if isinstance(value, bool):
        yield place, value
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            yield from _truth_values(item, (*place, i))


def _types_in(annotation: Any) -> Iterator[Any]:
    """All types that an annotation mentions, also as items or among others."""
    yield annotation
    for inner in get_args(annotation):
        yield from _types_in(inner)


def check_look_at(block):
    """An attitude must be given once, and what is looked at must lie somewhere else."""
    if getattr(block, "quaternion", None) is not None:
        if block.look_at is not None or block.rotation_euler_deg is not None:
            raise ValueError("give one of look_at, rotation_euler_deg, quaternion")
        return block
    if block.look_at is None:
        return block
    if block.rotation_euler_deg not in (None, (0.0, 0.0, 0.0)):
        raise ValueError("give look_at or rotation_euler_deg, not both")
    if block.look_at == block.position:
        raise ValueError("look_at must differ from the position")
    return block


FILE_KEYS = {"class_": "class"}
"""Keys of the file by the names of their fields, where they are no names in Python."""


def unwritten_if_absent(*keys: str) -> Any:
    """Serializer of a block that does not write down some keys where they are absent.

    What came later than other keys then changes no byte of the datasets of scenes without it.
    """
    return written_otherwise(lambda block: [key for key in keys if getattr(block, key) is None])


def written_otherwise(left_out: Callable[[Any], Iterable[str]]) -> Any:
    """Serializer of a block that does not write down what ``left_out`` names of it.

    Fields have their keys of the file, which differ for words of Python (`FILE_KEYS`).
    """

    def written(self, handler):
        out = left_out(self)
        return {FILE_KEYS.get(key, key): value for key, value in handler(self).items() if key not in out}

    return model_serializer(mode="wrap")(written)


def keys_without_effect(block: Block, path: str = "") -> dict[str, str]:
    """Keys that a block gives although they mean nothing any more (deprecated fields), and what holds instead."""
    found = {}
    for name, info in type(block).model_fields.items():
        value = vars(block)[name]
        if info.deprecated and value is not None:
            found[path + name] = str(info.deprecated)
        elif isinstance(value, Block):
            found |= keys_without_effect(value, f"{path}{name}.")
    return found


def kind_by_default(kind: str) -> BeforeValidator:
    """Return a validator for a union of blocks that gives a block without ``kind`` this kind.

    So ``{file: x.dae}`` may be short for a mesh.
    """

    def with_kind(block: Any):
        return {"kind": kind, **block} if isinstance(block, dict) and "kind" not in block else block

    return BeforeValidator(with_kind)
