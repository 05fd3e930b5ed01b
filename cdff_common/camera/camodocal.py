# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cameras of camodocal (VINS-Fusion, KITTI-360): ``model_type`` PINHOLE, MEI or KANNALA_BRANDT."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cdff_common.camera.lenses import LensName
from cdff_common.camera.model import CameraModel
from cdff_common.errors import InputError


def camodocal_camera(document: Mapping[str, Any]) -> CameraModel:
    """Return the camera of a document with ``model_type`` and ``projection_parameters``.

    Raises
    ------
    InputError
        If the model is unknown.
    KeyError
        If a parameter is missing.
    """
    model, projection = str(document["model_type"]).upper(), document["projection_parameters"]
    distortion = document.get("distortion_parameters", {})
    radial_tangential = [float(distortion.get(name, 0.0)) for name in ("k1", "k2", "p1", "p2")]
    lens: LensName
    if model == "PINHOLE":
        lens, names, coefficients = "pinhole", ("fx", "fy", "cx", "cy"), radial_tangential
    elif model == "MEI":
        lens, names = "omnidirectional", ("gamma1", "gamma2", "u0", "v0")
        coefficients = [float(document["mirror_parameters"]["xi"]), *radial_tangential]
    elif model == "KANNALA_BRANDT":
        lens, names = "fisheye", ("mu", "mv", "u0", "v0")
        coefficients = [float(projection[name]) for name in ("k2", "k3", "k4", "k5")]
    else:
        raise InputError(f"model_type {model}: expected PINHOLE, MEI or KANNALA_BRANDT")
    fx, fy, cx, cy = (float(projection[name]) for name in names)
    size = {"rows": int(document.get("image_height", 0)), "cols": int(document.get("image_width", 0))}
    K = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    return CameraModel.from_matrix(K, coefficients, lens=lens, **size)
