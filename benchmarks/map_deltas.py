# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sizes of the elevation patches of a store as they are, compressed, and as differences from earlier patches.

    cdff simulate rover_traverse --out LOG
    cdff replay LOG --requests FILE --profile deploy/profiles/rover_traverse.yaml --out OUT --store DIR
    python benchmarks/map_deltas.py DIR [--out FILE]

``compressed`` is the whole payload with zstd. ``by_layer`` are the observed cells of each layer, bytes
of equal significance together, with zstd. ``difference`` is the same for the bitwise or arithmetic difference
from the newest earlier value of each cell, or for the value itself if that is smaller. ``overlap`` is the
fraction of the observed cells that an earlier patch has. Sizes are fractions of those of the payloads.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from _report import write_report

from cdff_common.codecs import decode
from cdff_common.errors import ConfigurationError
from dpm_store import Query, open_store

_LEVEL = 3
_WORDS = {1: np.uint8, 2: np.uint16, 4: np.uint32, 8: np.uint64}


def compressed(data: bytes) -> int:
    """Return the size of data after compression."""
    return len(zstandard.ZstdCompressor(level=_LEVEL).compress(data))


def shuffled(words: Any) -> bytes:
    """Return words with their bytes of equal significance together."""
    return np.ascontiguousarray(words.view(np.uint8).reshape(-1, words.itemsize).T).tobytes()


def measure(patches: list[tuple[bytes, Any]]) -> dict[str, Any]:
    """Return the sizes of patches, which are in the order of their time and have one cell size."""
    grids = [value.geometry for _, value in patches]
    xmin_m, ymax_m = min(g.xmin_m for g in grids), max(g.ymax_m for g in grids)
    corners = [
        (round((ymax_m - g.ymax_m) / g.resolution_m), round((g.xmin_m - xmin_m) / g.resolution_m))
        for g in grids
    ]
    rows = max(top + g.rows for (top, _), g in zip(corners, grids, strict=True))
    columns = max(left + g.cols for (_, left), g in zip(corners, grids, strict=True))
    newest: dict[str, Any] = {}
    was_observed = np.zeros((rows, columns), dtype=bool)
    sizes: Counter[str] = Counter()
    for (payload, value), (top, left) in zip(patches, corners, strict=True):
        window = np.s_[top : top + value.geometry.rows, left : left + value.geometry.cols]
        observed = np.isfinite(np.asarray(value.layer("mean")))
        sizes["payload"] += len(payload)
        sizes["compressed"] += compressed(payload)
        sizes["cells"] += int(observed.sum())
        sizes["overlap"] += int((observed & was_observed[window]).sum())
        mask = compressed(np.packbits(observed).tobytes())
        sizes["by_layer"] += mask
        sizes["difference"] += mask
        for name in value.layer_names:
            layer = np.ascontiguousarray(value.layer(name))
            words = layer.view(_WORDS[layer.itemsize])
            earlier = newest.setdefault(name, np.zeros((rows, columns), words.dtype))
            new, old = words[observed], earlier[window][observed]
            whole = compressed(shuffled(new))
            sizes["by_layer"] += whole
            sizes["difference"] += min(whole, *(compressed(shuffled(d)) for d in (new ^ old, new - old)))
            earlier[window][observed] = new
        was_observed[window] |= observed
    fractions = {name: sizes[name] / sizes["payload"] for name in ("compressed", "by_layer", "difference")}
    return {
        "patches": len(patches),
        "megabytes": round(sizes["payload"] / 1e6, 2),
        "overlap": round(sizes["overlap"] / sizes["cells"], 3),
        **{name: round(value, 4) for name, value in fractions.items()},
    }


def main() -> None:
    """Measure and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("store", type=Path, help="directory of a store")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    with open_store(f"sqlite:///{args.store}") as store:
        records = sorted(store.search(Query(types=("dem",), limit=1000)).items, key=lambda r: r.t1_ns)
        payloads = [(store.payload(r.id), r) for r in records]
        patches = [(payload, decode(r.type_name, payload, r.codec)) for payload, r in payloads]
    if not patches:
        raise ConfigurationError(f"store {args.store}: expected elevation patches (type dem)")
    write_report(measure(patches), args.out)


if __name__ == "__main__":
    main()
