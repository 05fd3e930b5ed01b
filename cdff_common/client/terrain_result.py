# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Result of an analysis of heights."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.raster.geometry import GridGeometry


@dataclass(frozen=True, slots=True, eq=False)
class TerrainResult:
    """Result of an analysis of heights.

    Attributes
    ----------
    data : bytes
        A file of the media type ``encoding``.
    metadata : mapping
        Origin: ``analysis frame resolution_m coverage patches robots newest_ns oldest_ns frames_revision``,
        and of a difference ``earlier changed_m2 raised_m3 lowered_m3 unknown_error_m2``.
    """

    data: bytes
    encoding: str
    metadata: Mapping[str, Any]

    @property
    def document(self) -> dict[str, Any]:
        """Contours as GeoJSON, or statistics; raises InputError for a raster."""
        if "json" not in self.encoding:
            raise InputError(f"{self.encoding}: not a document; use bands")
        document: dict[str, Any] = json.loads(self.data)
        return document

    @property
    def bands(self) -> dict[str, NDArray[np.float32]]:
        """Layers ``(rows, cols)`` of a raster by name, NaN where unknown; raises InputError for others."""
        arrays = self._arrays()
        return {name: values for name, values in arrays.items() if values.ndim == 2}

    @property
    def geometry(self) -> GridGeometry:
        """Grid of the bands; raises InputError if there are none."""
        arrays = self._arrays()
        shape = next(values.shape for values in arrays.values() if values.ndim == 2)
        xmin_m, ymax_m = (float(v) for v in arrays["corner_m"])
        return GridGeometry(
            str(self.metadata["frame"]), float(arrays["resolution_m"]), xmin_m, ymax_m, shape[0], shape[1]
        )

    def _arrays(self) -> dict[str, NDArray[Any]]:
        from cdff_common.formats.npz import read_npz

        if not self.encoding.endswith("npz"):
            raise InputError(f"{self.encoding}: no arrays; ask with format=npz")
        return read_npz(self.data)
