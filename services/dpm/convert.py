# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From a stored payload to what was asked for: another codec, an InFuse type, or a file format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cdff_common.codecs.encoding import CODECS, encoding_string
from cdff_common.codecs.siblings import base_type, wire_type
from cdff_common.errors import InputError
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


@dataclass(frozen=True, slots=True)
class _FileFormat:
    media_type: str
    write: Callable[[Any, Header], bytes]


def formats_of(type_name: str) -> tuple[str, ...]:
    """Formats in which a type can be had."""
    return (*CODECS, *_FORMATS.get(base_type(type_name), {}))


def file_formats(type_name: str) -> dict[str, str]:
    """File formats in which a type can be had, with their media types."""
    return {name: form.media_type for name, form in _FORMATS.get(base_type(type_name), {}).items()}


def convert(
    type_name: str, codec: str, payload: bytes, format_name: str | None, as_type: str | None, header: Header,
    value: Any = None,
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
    if as_type not in (None, type(value).__name__) or wanted not in _FORMATS.get(type_name, {}):
        raise InputError(f"format={wanted}: a {type_name} comes as {', '.join(formats_of(type_name))}")
    file_format = _FORMATS[type_name][wanted]
    return Converted(file_format.write(value, header), file_format.media_type, wanted)


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


def _tif(value: Any, _header: Header) -> bytes:
    from cdff_common.formats.geotiff import write_map

    return write_map(value)


def _map_npz(value: Any, _header: Header) -> bytes:
    from cdff_common.formats.npz import write_npz

    g = value.geometry
    layers = {name: value.layer(name) for name in value.layer_names}
    return write_npz({**layers, "resolution_m": g.resolution_m, "xmin_m": g.xmin_m, "ymax_m": g.ymax_m})


def _ply(value: Any, header: Header) -> bytes:
    from cdff_common.formats.ply import write_ply

    return write_ply(_cloud(value), comments={"frame": header.frame, "stamp_ns": str(header.t1_ns)})


def _pcd(value: Any, _header: Header) -> bytes:
    from cdff_common.formats.pcd import write_pcd

    return write_pcd(_cloud(value))


def _las(value: Any, _header: Header) -> bytes:
    from cdff_common.formats.las import write_las

    return write_las(_cloud(value))


def _cloud_npz(value: Any, _header: Header) -> bytes:
    from cdff_common.formats.npz import write_npz

    return write_npz({"points_m": value.points_m})


def _cloud(value: Any) -> Any:
    from cdff_common.formats.cloud import CloudArrays

    intensity = value.intensity
    return CloudArrays.of(value.points_m, intensity if intensity is not None and len(intensity) else None)


def _pose_tum(value: Any, _header: Header) -> bytes:
    from cdff_common.formats.tum import write_tum

    return write_tum([value.stamp_ns], value.transform.matrix[None])


def _trajectory_tum(value: Any, _header: Header) -> bytes:
    from cdff_common.formats.tum import write_tum

    return write_tum(value.stamps_ns, value.matrices)


def _image_png(value: Any, _header: Header) -> bytes:
    from cdff_common.formats.image import write_png

    return write_png(value.image)


def _image_npz(value: Any, _header: Header) -> bytes:
    from cdff_common.formats.npz import write_npz

    return write_npz({"image": value.image})


def _picture(value: Any, header: Header) -> bytes:
    from services.dpm.pictures import picture

    return picture(value, header)


_PNG = _FileFormat("image/png", _picture)
_FORMATS: dict[str, dict[str, _FileFormat]] = {
    "ElevationMap": {
        "tif": _FileFormat("image/tiff; application=geotiff", _tif),
        "npz": _FileFormat("application/x-npz", _map_npz),
        "png": _PNG,
    },
    "NavigationMap": {
        "tif": _FileFormat("image/tiff; application=geotiff", _tif),
        "npz": _FileFormat("application/x-npz", _map_npz),
        "png": _PNG,
    },
    "Pointcloud": {
        "ply": _FileFormat("application/x-ply", _ply),
        "pcd": _FileFormat("application/x-pcd", _pcd),
        "las": _FileFormat("application/vnd.las", _las),
        "npz": _FileFormat("application/x-npz", _cloud_npz),
        "png": _PNG,
    },
    "TransformWithCovariance": {"tum": _FileFormat("text/plain; charset=utf-8", _pose_tum)},
    "PoseTrajectory": {"tum": _FileFormat("text/plain; charset=utf-8", _trajectory_tum), "png": _PNG},
    "Frame": {"png": _FileFormat("image/png", _image_png), "npz": _FileFormat("application/x-npz", _image_npz)},
}
