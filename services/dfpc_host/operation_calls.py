# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters and value of an operation for ``cdff call``: parsing, JSON form and file formats."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cdff_common.codecs import CODECS, encode
from cdff_common.codecs.dict_form import to_dict_form
from cdff_common.errors import InputError
from cdff_common.formats.payload import FORMATS, pose_value, to_file
from cdff_common.json_form import jsonable
from cdff_common.output import format_of_suffix, is_standard_output
from cdff_common.value_text import value_lines


def file_format(out: Path, type_name: str) -> str:
    """Return the format selected by the suffix of a file; raises InputError if the type does not have it."""
    if not type_name[:1].isupper():
        raise InputError(f"--out {out}: a {type_name} is printed: no --out")
    if is_standard_output(out):
        return next(iter(FORMATS.get(type_name, ("uper",))))
    return format_of_suffix(out, (*FORMATS.get(type_name, ()), *CODECS), type_name)


def file_bytes(value: Any, form: str) -> bytes:
    """Return a typed value in a file format or a codec."""
    return encode(value, form) if form in CODECS else to_file(value, form)


def printable(value: Any, provenance: Mapping[str, Any]) -> Any:
    """Return the JSON form of a value: plain data and poses as they are, other types with a summary."""
    if value is None or isinstance(value, (bool, int, float, str, list, dict)):
        return value
    name = type(value).__name__
    if name == "TransformWithCovariance":
        quality = provenance.get("quality", {})
        return pose_value(value, quality.get("covariance_kind", "none")).to_json()
    extent = value.extent_m() if hasattr(value, "extent_m") else None
    header_fields = {k: provenance[k] for k in ("frame", "child", "resolution_m") if provenance.get(k)}
    header_fields |= {
        k: str(provenance[k]) for k in ("t0_ns", "t1_ns") if k in provenance
    }  # JSON numbers lose digits
    formats = [*FORMATS.get(name, ()), "uper"]
    return {
        "type": name,
        **header_fields,
        "extent_m": None if extent is None else list(extent),
        "out": formats,
        "value": jsonable(to_dict_form(value)),
    }


def text(value: Any, provenance: Mapping[str, Any]) -> str:
    """Return a value in words and units, plain data as JSON."""
    if value is None or isinstance(value, (bool, int, float, str, list, dict)):
        return json.dumps(value, indent=1, ensure_ascii=False)
    formats = ", ".join((*FORMATS.get(type(value).__name__, ()), "uper"))
    quality = provenance.get("quality", {})
    state = (
        [f"quality: {' '.join((quality['status'], *quality.get('reasons', ())))}"]
        if "status" in quality
        else []
    )
    return "\n".join([type(value).__name__, *value_lines(value), *state, f"formats of --out: {formats}"])
