# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Write the hillshade of an elevation map of all rovers of the demonstration: the picture in the README.

make demo                                           # in one terminal
.venv/bin/python examples/hillshade.py OUT.png      # in another, after all requests were answered
"""

import sys
from pathlib import Path

from cdff_common.client import Client
from cdff_common.formats.hillshade import hillshade_png

REGION = "bbox:-11,-8,10,8"

with Client() as client:
    dem = client.request("dem", robot="any", region=REGION, resolution_m=0.1)
Path(sys.argv[1]).write_bytes(hillshade_png(dem.value))
print(
    f"{sys.argv[1]}: {dem.value.geometry.shape} cells, {dem.delivered['coverage']:.2f} of the region observed"
)
