# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Base and field types of query models: one parser for Zenoh parameters, HTTP queries, command line and
client.

Validators raise InputError, which pydantic passes through; its message names field, value and expectation.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)

from cdff_common.clock import parse_stamp
from cdff_common.contract.acquisition import AcquisitionParameters
from cdff_common.contract.limits import LATEST_NS, MAX_AGE_S, MAX_COORDINATE_M, MAX_PATH_CORNERS
from cdff_common.contract.names import MAX_FRAME_LENGTH, ROBOT_ID
from cdff_common.errors import InputError
from cdff_common.geometry import checked_frame
from cdff_common.geometry.region import Region, parse_region

_WHOLE = re.compile(r"-?\d{1,19}\Z")
#: Unknown names of a map that are reported; maps with more are refused before they are checked.
_MAX_UNKNOWN = 16
#: Characters of a message about an invalid value.
_MAX_MESSAGE = 200
_TEXT = {"type": "string"}
#: First part of the location of an error that FastAPI reports.
_ORIGINS = ("query", "path", "header")


class Parameters(BaseModel):
    """Parameters of one operation: unknown names are refused, values are text or Python values."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _check_size(cls, value: Any) -> Any:
        limit = len(cls.model_fields) + _MAX_UNKNOWN
        if isinstance(value, Mapping) and len(value) > limit:
            raise InputError(f"{cls.__name__}: {len(value)} fields, expected at most {limit}")
        return value

    @classmethod
    def parse(cls, parameters: Mapping[str, Any]) -> Self:
        """Return the checked parameters; raises InputError naming parameter, value and expectation."""
        try:
            return cls.model_validate(dict(parameters))
        except ValidationError as error:
            known = [field.alias or name for name, field in cls.model_fields.items()]
            raise InputError(validation_message(error.errors()[0], known)) from error

    def to_parameters(self) -> dict[str, Any]:
        """Return the parameters that were set, in wire names and values."""
        return self.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)


def validation_message(error: Mapping[str, Any], known: list[str] | None = None) -> str:
    """Return the message of an entry of ``ValidationError.errors()``: parameter, value, expectation."""
    loc = error["loc"]
    name = ".".join(str(part) for part in (loc[1:] if len(loc) > 1 and loc[0] in _ORIGINS else loc))
    if error["type"] == "missing":
        return f"parameter {name!r} is missing"
    if error["type"] == "extra_forbidden":
        expected = f"; known are {', '.join(sorted(known))}" if known else ""
        return f"unknown parameter {name[:80]!r}{expected}"
    name = name[:80] or "body"
    message = str(error["msg"])[:_MAX_MESSAGE].replace("Input should be ", "expected ")
    value = error.get("input")
    is_plain = value is None or isinstance(value, str | bool | int | float)
    return f"{name}={repr(value)[:80]}: {message}" if is_plain else f"{name}: {message}"


def _whole(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, bool) or (isinstance(value, str) and not _WHOLE.match(value)):
        raise InputError(f"{info.field_name}={str(value)[:80]!r}: expected a whole number")
    return value


def _number(value: Any, info: ValidationInfo) -> Any:
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{info.field_name}={str(value)[:80]!r}: expected a number") from error
    if not math.isfinite(number):
        raise InputError(f"{info.field_name}={str(value)[:80]}: expected a finite number")
    return number


def _flag(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, str):
        if value not in ("true", "false"):
            raise InputError(f"{info.field_name}={value[:80]!r}: expected true or false")
        return value == "true"
    return value


def _stamp(value: Any, info: ValidationInfo) -> int:
    stamp_ns = parse_stamp(str(value), info.field_name or "t")
    if abs(stamp_ns) > LATEST_NS:
        raise InputError(f"{info.field_name}={value}: expected a time before the year 2116")
    return stamp_ns


def _region(value: Any) -> Region:
    """Return the region of a parameter; raises InputError if a polygon intersects itself."""
    region = value if isinstance(value, Region) else parse_region(str(value))
    if region.kind == "polygon":
        import shapely

        outline = shapely.Polygon(list(zip(region.values[0::2], region.values[1::2], strict=True)))
        if not outline.is_valid:
            raise InputError(f"region={region.text[:80]!r}: {shapely.is_valid_reason(outline)}")
    return region


def _frame(value: str, info: ValidationInfo) -> str:
    return checked_frame(value, info.field_name or "frame")


def _robot(value: str) -> str:
    if not re.fullmatch(ROBOT_ID, value):
        raise InputError(f"robot={value[:80]!r}: expected a robot id or any")
    return value


def _join_list(value: Any) -> str:
    """Return comma-separated text; FastAPI passes the query value of a tuple field as a list."""
    return ",".join(str(part) for part in value) if isinstance(value, (list, tuple)) else str(value)


def _names(value: Any) -> tuple[str, ...]:
    """Return the names in comma-separated text."""
    return tuple(name for name in _join_list(value).split(",") if name)


def _numbers(value: Any, info: ValidationInfo) -> tuple[float, ...]:
    """Return the numbers in comma-separated text; raises InputError."""
    text = _join_list(value)
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"{info.field_name}={text[:80]!r}: expected numbers separated by commas") from error


def _point(value: Any, info: ValidationInfo) -> tuple[float, ...]:
    """Return x and y of a point, metres; raises InputError."""
    numbers = _numbers(value, info)
    if len(numbers) != 2:
        raise InputError(f"{info.field_name}={_join_list(value)[:80]!r}: expected x,y in metres")
    return numbers


def _path(value: Any, info: ValidationInfo) -> tuple[float, ...]:
    """Return x and y of the corners of a path in turn, metres; raises InputError."""
    numbers = _numbers(value, info)
    inside = all(abs(number) <= MAX_COORDINATE_M for number in numbers)
    if len(numbers) % 2 or not 4 <= len(numbers) <= 2 * MAX_PATH_CORNERS or not inside:
        raise InputError(
            f"{info.field_name} of {len(numbers)} numbers: expected x,y of 2 to {MAX_PATH_CORNERS} corners "
            f"within {MAX_COORDINATE_M:g} m"
        )
    return numbers


_as_text = PlainSerializer(_join_list, return_type=str)

Whole = Annotated[int, BeforeValidator(_whole)]
Revision = Annotated[int, Field(ge=0), BeforeValidator(_whole)]
Number = Annotated[float, BeforeValidator(_number)]
#: Age of a product, seconds.
Age = Annotated[float, BeforeValidator(_number), Field(ge=0, le=MAX_AGE_S)]
Flag = Annotated[
    bool, BeforeValidator(_flag), PlainSerializer(lambda flag: str(flag).lower(), return_type=str)
]
#: Nanoseconds of mission time, given as a decimal or as RFC 3339.
Stamp = Annotated[int, BeforeValidator(_stamp), WithJsonSchema(_TEXT)]
RegionText = Annotated[
    Region,
    BeforeValidator(_region),
    PlainSerializer(lambda region: region.text, return_type=str),
    WithJsonSchema(_TEXT | {"maxLength": 40_000}),
]
#: Parameters of a single acquisition, ``now`` or ``name:value,…``.
Acquire = Annotated[
    AcquisitionParameters,
    BeforeValidator(
        lambda v: v if isinstance(v, AcquisitionParameters) else AcquisitionParameters.parse(str(v))
    ),
    PlainSerializer(str, return_type=str),
    WithJsonSchema(_TEXT | {"maxLength": 400}),
]
Frame = Annotated[str, Field(max_length=MAX_FRAME_LENGTH), AfterValidator(_frame)]
Robot = Annotated[str, AfterValidator(_robot)]
#: Names separated by commas.
Names = Annotated[tuple[str, ...], BeforeValidator(_names), _as_text, WithJsonSchema(_TEXT)]
PointM = Annotated[tuple[float, float], BeforeValidator(_point), _as_text, WithJsonSchema(_TEXT)]
#: ``x1,y1,x2,y2,…``, metres.
PathM = Annotated[
    tuple[float, ...], BeforeValidator(_path), _as_text, WithJsonSchema(_TEXT | {"maxLength": 40_000})
]
