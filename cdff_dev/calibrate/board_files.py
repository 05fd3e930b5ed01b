# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Descriptions of boards: ``charuco:9x7:0.03:0.022`` and target files of Kalibr."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from cdff_common.errors import InputError
from cdff_core.calibration.boards import Board

FORMS = (
    "charuco:COLUMNSxROWS:SQUARE_M:MARKER_M[:DICTIONARY], chessboard:COLUMNSxROWS:SQUARE_M (inner corners), "
    "aprilgrid:COLUMNSxROWS:TAG_M:SPACING, tags:COLUMNSxROWS:TAG_M:SPACING, or a target file of Kalibr"
)


def read_board(text: str) -> Board:
    """Return the board of a description or of a target file; raises InputError."""
    if Path(text).suffix in (".yaml", ".yml"):
        return _of_kalibr(Path(text))
    kind, *parts = text.split(":")
    try:
        columns, rows = (int(v) for v in parts[0].lower().split("x"))
        size_m, *rest = parts[1:]
        if kind == "chessboard" and not rest:
            return Board("chessboard", columns, rows, float(size_m))
        if kind == "aprilgrid" and len(rest) == 1:
            return Board("aprilgrid", columns, rows, float(size_m), float(rest[0]))
        if kind == "tags" and len(rest) == 1:
            return Board("tags", columns, rows, float(size_m), float(rest[0]))
        if kind == "charuco" and len(rest) in (1, 2):
            return Board("charuco", columns, rows, float(size_m), float(rest[0]), *rest[1:])
    except (ValueError, IndexError) as error:
        raise InputError(f"board {text!r}: {error}; expected {FORMS}") from error
    raise InputError(f"board {text!r}: expected {FORMS}")


def _of_kalibr(path: Path) -> Board:
    try:
        document: Any = yaml.safe_load(path.read_text(encoding="utf-8"))
        kind = document["target_type"]
        if kind == "aprilgrid":
            size_m, spacing = float(document["tagSize"]), float(document["tagSpacing"])
            return Board("aprilgrid", int(document["tagCols"]), int(document["tagRows"]), size_m, spacing)
        if kind == "checkerboard":
            size_m = float(document["colSpacingMeters"])
            if size_m != float(document["rowSpacingMeters"]):
                raise InputError(f"{path}: squares that are not square: expected equal spacings")
            return Board("chessboard", int(document["targetCols"]), int(document["targetRows"]), size_m)
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: {type(error).__name__} {error}; expected a target file of Kalibr"
        ) from error
    raise InputError(f"{path}: target_type {kind!r}, expected aprilgrid or checkerboard")
