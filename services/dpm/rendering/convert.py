# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of a stored payload to another codec, an InFuse type, or a file format."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cdff_common.codecs import CODECS, encoding_string
from cdff_common.codecs.wire_types import base_type, wire_type
from cdff_common.errors import InputError
from cdff_common.formats.payload import FORMATS, MEDIA_TYPES, to_file
from cdff_common.geodesy import Georeference
from cdff_common.interfaces.product import Header
from services.dpm.rendering.pictures import DRAWN_TYPES


@dataclass(frozen=True, slots=True)
class Converted:
    """A converted payload.

    Attributes
    ----------
    encoding : str
        Encoding string of a codec, or media type of a file format.
    suffix : str
        Suffix of a file with the payload.
    """

    data: bytes
    encoding: str
    suffix: str


def formats_of(type_name: str) -> tuple[str, ...]:
    """Return the codecs and file formats of a type."""
    return (*CODECS, *file_formats(type_name))


def file_formats(type_name: str) -> dict[str, str]:
    """Return the file formats of a type with their media types."""
    name = base_type(type_name)
    formats = (*FORMATS.get(name, ()), *(("png",) if name in DRAWN_TYPES else ()))
    return {form: MEDIA_TYPES[form] for form in formats}


def convert(
    type_name: str,
    codec: str,
    payload: bytes | None,
    format_name: str | None,
    as_type: str | None,
    header: Header,
    value: Any = None,
    place: Georeference | None = None,
) -> Converted:
    """Return a payload in the requested format and type.

    Parameters
    ----------
    type_name, codec : str
        Type and codec of the payload.
    payload : bytes or None
        None if it is not encoded yet; then ``value`` is.
    format_name : str or None
        A codec or a file format; None or ``native`` for the stored payload.
    as_type : str or None
        An InFuse type that the value can be expressed as.
    value : optional
        The decoded payload, if the caller has it.
    place : Georeference, optional
        CRS of the header's frame, for formats that state one.

    Raises
    ------
    InputError
        If the type does not have that format; the message names its formats.
    """
    target_format = codec if format_name in (None, "native") else str(format_name)
    if as_type in (None, type_name, base_type(type_name)) and target_format == codec:
        data = encoded(value, codec) if payload is None else payload
        return Converted(data, encoding_string(type_name, codec), codec)
    stored_as, type_name = type_name, base_type(type_name)
    formats = formats_of(type_name)
    if target_format not in formats:
        raise InputError(f"format={target_format[:40]!r}: a {type_name} comes as {', '.join(formats)}")
    if payload == b"":
        raise InputError(f"product {header.id} was FAILED and has no value to convert")
    from cdff_common.codecs import decode, encode

    if value is None and payload is not None:
        value = decode(stored_as, payload, codec)
        payload = None  # its memory is free for the file, if the caller does not need it
    if as_type not in (None, type_name):
        value, type_name = _as(value, type_name, str(as_type), header), str(as_type)
    if target_format in CODECS:
        return Converted(
            encode(value, target_format), encoding_string(wire_type(value), target_format), target_format
        )
    if as_type not in (None, type(value).__name__) or target_format not in file_formats(type_name):
        raise InputError(f"format={target_format}: a {type_name} comes as {', '.join(formats_of(type_name))}")
    if target_format == "png" and type_name in DRAWN_TYPES:
        from services.dpm.rendering.pictures import picture

        return Converted(picture(value, header), MEDIA_TYPES[target_format], target_format)
    return Converted(to_file(value, target_format, place), MEDIA_TYPES[target_format], target_format)


def encoded(value: Any, codec: str) -> bytes:
    """Return a value as a payload."""
    from cdff_common.codecs import encode

    return encode(value, codec)


def _as(value: Any, type_name: str, as_type: str, header: Header) -> Any:
    from cdff_common.geometry import UncertainTransform
    from cdff_core.orchestration import conversion

    if (type_name, as_type) == ("ElevationMap", "Map"):
        return conversion.elevation_as_map(value, UncertainTransform.identity(), value.frame, header.producer)
    if (type_name, as_type) == ("TransformWithCovariance", "RigidBodyState"):
        pose, _ = conversion.pose_as(
            value.transform, value.parent_frame, value.child_frame, value.stamp_ns, as_type, header.producer
        )
        return pose
    raise InputError(f"as={as_type[:40]!r}: a {type_name} cannot be expressed as that")
