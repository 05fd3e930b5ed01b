# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cameras in the documents of data sets and tools: ViSP, M3T, BOP and EuRoC."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree

from cdff_common.camera.model import CameraModel, LensName
from cdff_common.errors import InputError

_VISP = ("px", "py", "u0", "v0")
_M3T = ("f_u", "f_v", "pp_x", "pp_y")
_BOP = ("fx", "fy", "cx", "cy")
#: Names of the distortion of EuRoC; "equidistant" is that of a fisheye lens.
_EUROC_DISTORTIONS = ("radial-tangential", "equidistant")


def xml_camera(text: str) -> dict[str, float]:
    """Return the numbers of the element ``camera`` of a ViSP configuration.

    Raises
    ------
    InputError
        If the text is not XML, declares entities, or has no such element.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("XML with a document type declaration, expected a file without")
    try:
        camera = ElementTree.fromstring(text).find(".//camera")
    except ElementTree.ParseError as error:
        raise InputError(f"not XML: {error}") from error
    if camera is None:
        raise InputError("XML without an element 'camera'")
    return {child.tag: float(child.text or "nan") for child in camera}


def data_set_camera(document: Mapping[str, Any]) -> CameraModel | None:
    """Return the camera of a document, or None if it has none of these forms.

    =====  ===========================================================================================
    form   fields
    =====  ===========================================================================================
    ViSP   ``px py u0 v0``, and ``w h``
    M3T    ``intrinsics: {f_u f_v pp_x pp_y width height}``
    BOP    ``fx fy cx cy``, and ``width height``
    EuRoC  ``intrinsics: [fu, fv, cu, cv]``, ``distortion_model``, ``distortion_coefficients``, ``resolution``
    =====  ===========================================================================================

    Raises
    ------
    InputError
        If its numbers are not those of a camera.
    """
    intrinsics = document.get("intrinsics")
    if isinstance(intrinsics, Mapping) and set(_M3T) <= set(intrinsics):
        return _ideal(intrinsics, _M3T, "width", "height")
    if set(_VISP) <= set(document):
        return _ideal(document, _VISP, "w", "h")
    if set(_BOP) <= set(document):
        return _ideal(document, _BOP, "width", "height")
    if isinstance(intrinsics, list) and "distortion_coefficients" in document:
        return _of_euroc(document)
    return None


def depth_unit_m(document: Mapping[str, Any]) -> float | None:
    """Return the metres of a depth value of 1, or None if the document does not contain it.

    ``depthScale`` (ViSP) and the ``depth_scale`` of M3T are in metres, the ``depth_scale`` of BOP in
    millimetres.
    """
    if "depthScale" in document:
        return float(document["depthScale"])
    if "depth_scale" in document:
        return float(document["depth_scale"]) * (1.0 if "intrinsics" in document else 1e-3)
    return None


def _ideal(numbers: Mapping[str, Any], names: tuple[str, ...], width: str, height: str) -> CameraModel:
    fx, fy, cx, cy = (float(numbers[name]) for name in names)
    return CameraModel(int(numbers.get(height, 0)), int(numbers.get(width, 0)), fx, fy, cx, cy)


def _of_euroc(document: Mapping[str, Any]) -> CameraModel:
    """Return the camera of a ``sensor.yaml`` of EuRoC; raises InputError for an unknown distortion model."""
    model = document.get("distortion_model", "radial-tangential")
    if model not in _EUROC_DISTORTIONS:
        raise InputError(f"distortion_model {model!r}: expected {' or '.join(_EUROC_DISTORTIONS)}")
    fx, fy, cx, cy = (float(v) for v in document["intrinsics"])
    cols, rows = (int(v) for v in document["resolution"])
    matrix = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    coefficients = document["distortion_coefficients"]
    lens: LensName = "fisheye" if model == "equidistant" else "pinhole"
    return CameraModel.from_matrix(matrix, coefficients, rows=rows, cols=cols, lens=lens)
