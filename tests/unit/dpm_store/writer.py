# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Inserts products until it is killed, and prints the number of each one that was acknowledged."""

import itertools
import sys

from cdff_common.interfaces.product import Header, product_id
from dpm_store import open_store
from dpm_store.insertion import INLINE_BYTES

with open_store(f"sqlite:///{sys.argv[1]}") as store:
    for seq in itertools.count(int(sys.argv[2])):
        t_ns = seq * 1_000_000_000
        header = Header(
            id=product_id("mana", "test", "map", t_ns, seq, "c"), seq=seq, t0_ns=t_ns, t1_ns=t_ns, frame="site",
            producer="test", config_hash="c", box_m=(seq, 0, 0, seq + 1, 1, 1), inputs=("a", "b"),
        )  # fmt: skip
        payload = seq.to_bytes(4, "big") * (10 if seq % 2 else INLINE_BYTES)
        store.put(
            header, payload, robot="mana", dfpc="digital_elevation_mapping", port="map", product="dem",
            type_name="ElevationMap",
        )  # fmt: skip
        print(seq, flush=True)
