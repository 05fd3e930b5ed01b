# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Loading of codecs and file formats before the first request needs them.

It takes about a second of CPU time, on a busy machine several seconds: the time limit of a first request
would pass. In a background thread it would delay the first requests.
"""

from __future__ import annotations

from contextlib import suppress


def load_formats() -> None:
    """Load the codecs and the libraries of the file formats of maps."""
    import numpy as np

    from cdff_common.codecs.warm import warm_wire
    from cdff_common.formats.payload import to_file
    from cdff_common.raster import GridGeometry
    from cdff_common.types import ElevationMap

    warm_wire()
    geometry = GridGeometry("site", resolution_m=1.0, xmin_m=0.0, ymax_m=0.0, rows=2, cols=2)
    with suppress(ImportError):  # an optional library
        to_file(ElevationMap.from_layers(geometry, {"mean": np.zeros((2, 2))}, t0_ns=0, t1_ns=0), "tif")
