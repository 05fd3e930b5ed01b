# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""File with one pose: a JSON value, a 4x4 text, or one TUM line."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.errors import CdffError, InputError
from cdff_common.formats.file_source import Readable, load
from cdff_common.formats.tum import read_tum
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.points import checked_transform

#: Largest size of a file with one pose, bytes.
_TEXT_LIMIT = 1 << 16


@dataclass(frozen=True, slots=True, eq=False)
class PoseValue:
    """Transform ``T_parent_child`` of a file; frames are empty and the stamp 0 if the file does not state
    them.

    Attributes
    ----------
    T : UncertainTransform
    covariance_kind : str
        calibrated, formal or none.
    """

    T: UncertainTransform
    parent: str = ""
    child: str = ""
    stamp_ns: int = 0
    covariance_kind: str = "none"

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form; the stamp is a decimal string, since JSON numbers lose digits."""
        c = self.T.covariance
        return {
            "parent": self.parent,
            "child": self.child,
            "stamp_ns": str(self.stamp_ns),
            "T": self.T.matrix.tolist(),
            "covariance": None if c is None else c.tolist(),
            "covariance_kind": "none" if c is None else self.covariance_kind,
        }

    @classmethod
    def from_json(cls, data: Any, subject: str) -> PoseValue:
        """Return the pose of a JSON form; only ``T`` is required. Raises InputError with the name
        ``subject``.
        """
        if not isinstance(data, dict) or "T" not in data:
            raise InputError(
                f'{subject}: expected a pose {{"parent", "child", "stamp_ns", "T": 4x4 rows, "covariance"}}'
            )
        try:
            covariance = data.get("covariance")
            T = UncertainTransform(
                checked_transform(data["T"], f"{subject}: T"),
                None if covariance is None else np.array(covariance, dtype=np.float64),
            )
            return cls(
                T,
                str(data.get("parent") or ""),
                str(data.get("child") or ""),
                int(data.get("stamp_ns") or 0),
                str(data.get("covariance_kind") or "none"),
            )
        except (TypeError, ValueError) as error:
            raise InputError(f"{subject}: {error}") from error


def read_pose(source: Readable) -> PoseValue:
    """Read one pose from JSON, a 4x4 (or 3x4) text or one TUM line; raises CodecError with the file name."""
    s = load(source)
    text = s.data[:_TEXT_LIMIT].decode("utf-8", "replace").strip()
    if len(s.data) > _TEXT_LIMIT:
        raise s.error(f"{len(s.data)} bytes, expected one pose")
    try:
        if text.startswith("{"):
            data = json.loads(text)
            return PoseValue.from_json(data.get("value", data) if isinstance(data, dict) else data, s.name)
        lines = [line.split("#")[0].replace(",", " ").split() for line in text.splitlines()]
        numbers = [w for line in lines for w in line]
        if len(numbers) == 8:
            stamps, T = read_tum(s.data)
            return PoseValue(UncertainTransform(T[0]), stamp_ns=int(stamps[0]))
        if len(numbers) in (12, 16):
            T44 = np.vstack([np.array(numbers, dtype=np.float64).reshape(-1, 4), [[0, 0, 0, 1]]])[:4]
            # A rotation in few digits is not exact; a larger deviation is still an error.
            return PoseValue(UncertainTransform(_orthonormal(T44)))
    except (CdffError, ValueError) as error:
        raise s.error(str(error).removeprefix(f"{s.name}: ")) from error
    raise s.error(f"{len(numbers)} numbers, expected a pose: json, 4x4 rows, or stamp_s x y z qx qy qz qw")


def _orthonormal(T: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the nearest rigid transform if it is within 1e-3, else ``T``."""
    from cdff_common.geometry import se3

    if not se3.is_transform(T, tolerance=1e-3):
        return T
    return se3.transform(se3.normalise_rotation(T[:3, :3]), T[:3, 3])
