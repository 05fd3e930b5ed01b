# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From a stored payload to what was asked for: another codec, an InFuse type, or a file format."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cdff_common.codecs.encoding import CODECS, encoding_string
from cdff_common.codecs.siblings import base_type, wire_type
from cdff_common.errors import InputError
from cdff_common.formats.payload import FORMATS, MEDIA_TYPES, to_file
from cdff_common.interfaces.product import Header


@dataclass(frozen=True, slots=True)
class Converted:
    """Bytes and what they are.

    Attributes
    ----------
    encoding : str
        Encoding string of contract §5 for a codec, media type for a file format.
    suffix : str
        Of a file that would hold them.
    """

    data: bytes
    encoding: str
    suffix: str


#: Types of which ``png`` is a picture for people, of limited size.
_PICTURED = ("ElevationMap", "NavigationMap", "Pointcloud", "PoseTrajectory")


def formats_of(type_name: str) -> tuple[str, ...]:
    """Formats in which a type can be had."""
    return (*CODECS, *file_formats(type_name))


def file_formats(type_name: str) -> dict[str, str]:
    """File formats in which a type can be had, with their media types."""
    name = base_type(type_name)
    formats = (*FORMATS.get(name, ()), *(("png",) if name in _PICTURED else ()))
    return {form: MEDIA_TYPES[form] for form in formats}


def convert(
    type_name: str, codec: str, payload: bytes, format_name: str | None, as_type: str | None, header: Header,
    value: Any = None, wkt: str | None = None,
) -> Converted:  # fmt: skip
    """Return a payload in the format and type asked.

    Parameters
    ----------
    type_name, codec : str
        Of the payload.
    format_name : str or None
        A codec or a file format; None or ``native`` for the payload as it is.
    as_type : str or None
        An InFuse type that the value can be expressed as.
    value : optional
        The decoded payload, where the caller has it.
    wkt : str, optional
        CRS of the header's frame, for formats that say one.

    Raises
    ------
    InputError
        If the type cannot be had in that format; the message names those it can.
    """
    wanted = codec if format_name in (None, "native") else str(format_name)
    if as_type in (None, type_name, base_type(type_name)) and wanted == codec:
        return Converted(payload, encoding_string(type_name, codec), codec)
    stored_as, type_name = type_name, base_type(type_name)
    formats = formats_of(type_name)
    if wanted not in formats:
        raise InputError(f"format={wanted[:40]!r}: a {type_name} comes as {', '.join(formats)}")
    if not payload:
        raise InputError(f"product {header.id} was FAILED and has no value to convert")
    from cdff_common.codecs import decode, encode

    if value is None:
        value = decode(stored_as, payload, codec)
    if as_type not in (None, type_name):
        value, type_name = _as(value, type_name, str(as_type), header), str(as_type)
    if wanted in CODECS:
        return Converted(encode(value, wanted), encoding_string(wire_type(value), wanted), wanted)
    if as_type not in (None, type(value).__name__) or wanted not in file_formats(type_name):
        raise InputError(f"format={wanted}: a {type_name} comes as {', '.join(formats_of(type_name))}")
    if wanted == "png" and type_name in _PICTURED:
        from services.dpm.pictures import picture

        return Converted(picture(value, header), MEDIA_TYPES[wanted], wanted)
    return Converted(to_file(value, wanted, wkt), MEDIA_TYPES[wanted], wanted)


def _as(value: Any, type_name: str, as_type: str, header: Header) -> Any:
    from cdff_common.geometry import UncertainTransform
    from cdff_core.orchestration import translate

    if (type_name, as_type) == ("ElevationMap", "Map"):
        return translate.elevation_as_map(value, UncertainTransform.identity(), value.frame, header.producer)
    if (type_name, as_type) == ("TransformWithCovariance", "RigidBodyState"):
        pose, _ = translate.pose_as(
            value.transform, value.parent_frame, value.child_frame, value.stamp_ns, as_type, header.producer
        )
        return pose
    raise InputError(f"as={as_type[:40]!r}: a {type_name} cannot be expressed as that")
