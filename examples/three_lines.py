# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Request the elevation around a rover from a running system (``cdff demo``) in three lines.

python examples/three_lines.py [ROBOT]
"""

import sys

from cdff_common.client import Client

robot = sys.argv[1] if len(sys.argv) > 1 else "mana"

with Client() as c:
    dem = c.request("dem", robot=robot, region=f"near:{robot}/base,5")
    print(dem.value.geometry, dem.value.layer("mean"), dem.delivered, sep="\n")
