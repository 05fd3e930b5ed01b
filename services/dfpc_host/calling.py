# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What ``cdff call`` takes and shows: parameters of an operation, and its value as JSON or a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cdff_common.codecs import encode
from cdff_common.codecs.encoding import CODECS
from cdff_common.errors import InputError
from cdff_common.formats.payload import FORMATS, pose_value, to_file


def parameters_of(items: list[str]) -> dict[str, str]:
    """``KEY=VALUE`` items as a mapping; raises InputError on one without = or given twice."""
    found: dict[str, str] = {}
    for item in items:
        name, equals, value = item.partition("=")
        if not equals or not name.isidentifier():
            raise InputError(f"parameter {item!r}: expected KEY=VALUE, as child=mana/base")
        if name in found:
            raise InputError(f"parameter {name} is given twice")
        found[name] = value
    return found


def format_of(out: Path, type_name: str) -> str:
    """The format that a file's ending names; raises InputError where the type has none such."""
    form = out.suffix.lower().removeprefix(".")
    form = {"tiff": "tif"}.get(form, form)
    is_typed = type_name[:1].isupper()
    known = (*FORMATS.get(type_name, ()), *CODECS) if is_typed else ()
    if form not in known:
        expected = f"expected one of {', '.join(f'.{k}' for k in known)}" if known else "its value is printed: no --out"
        raise InputError(f"--out {out}: the ending {out.suffix!r} names no format of a {type_name}; {expected}")
    return form


def file_of(value: Any, form: str) -> bytes:
    """Bytes of a typed value in a file format or a codec."""
    return encode(value, form) if form in CODECS else to_file(value, form)


def told(value: Any, provenance: Mapping[str, Any]) -> Any:
    """What is printed of a value: plain data as it is, a pose as in files, of other types what they are."""
    if value is None or isinstance(value, (bool, int, float, str, list, dict)):
        return value
    name = type(value).__name__
    if name == "TransformWithCovariance":
        quality = provenance.get("quality", {})
        return pose_value(value, quality.get("covariance_kind", "none")).to_json()
    extent = value.extent_m() if hasattr(value, "extent_m") else None
    stated = {k: provenance[k] for k in ("frame", "child", "resolution_m") if provenance.get(k)}
    stated |= {k: str(provenance[k]) for k in ("t0_ns", "t1_ns") if k in provenance}  # JSON numbers lose digits
    formats = [*FORMATS.get(name, ()), "uper"]
    return {"type": name, **stated, "extent_m": None if extent is None else list(extent), "out": formats}
