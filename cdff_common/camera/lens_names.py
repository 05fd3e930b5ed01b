# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names of lens models in files of OpenCV, ROS, Kalibr, EuRoC and camodocal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cdff_common.camera.lenses import LensName
from cdff_common.errors import InputError

_NAMES: dict[LensName, tuple[str, ...]] = {
    "pinhole": (
        "",
        "none",
        "pinhole",
        "perspective",
        "plumb_bob",
        "rational_polynomial",
        "radtan",
        "radial-tangential",
        "radial_tangential",
        "thin_prism",
        "opencv",
        "brown_conrady",
    ),
    "fisheye": ("fisheye", "equidistant", "kannala_brandt", "kannala_brandt4", "kb4"),
    "omnidirectional": ("omnidirectional", "omni", "mei"),
    "fov": ("fov", "atan"),
    "division": ("division",),
}
_LENSES = {name: lens for lens, names in _NAMES.items() for name in names}


def lens_named(name: str) -> LensName:
    """Return the lens model of a name, in any case; raises InputError if it is unknown."""
    lens = _LENSES.get(name.strip().lower())
    if lens is None:
        known = ", ".join(n for names in _NAMES.values() for n in names if n)
        raise InputError(f"camera or distortion model {name!r}: expected one of {known}")
    return lens


def lens_of_document(document: Mapping[str, Any]) -> LensName:
    """Return the lens that ``camera_model`` and ``distortion_model`` of a document name together.

    ``pinhole`` with ``equidistant`` is a fisheye; a document with ``xi`` is omnidirectional.

    Raises
    ------
    InputError
        If a name is unknown, or the two name different lenses.
    """
    names = [str(document[key]) for key in ("camera_model", "distortion_model") if key in document]
    lenses = {lens_named(name) for name in names} - {"pinhole"}
    if "xi" in document:
        lenses.add("omnidirectional")
    if len(lenses) > 1:
        raise InputError(f"camera and distortion model {' with '.join(names)}: expected one lens model")
    return lenses.pop() if lenses else "pinhole"
