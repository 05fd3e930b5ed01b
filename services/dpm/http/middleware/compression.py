# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Content codings of answers (RFC 9110 §12.5.3): zstd, br and gzip, for text of some size."""

from __future__ import annotations

import functools
import gzip
import re
from collections.abc import Callable

#: Smallest answer that is compressed, bytes.
SMALLEST_BYTES = 1000
#: Largest answer that is compressed in the event loop, bytes; larger ones are compressed in a thread.
MOST_AT_ONCE_BYTES = 1 << 17
_TEXT = re.compile(r"(text/(?!event-stream)|image/svg\+xml|application/([\w.+-]+\+)?(json|xml)\b)")
_QUALITY = re.compile(r"\s*;\s*q=([01](?:\.\d{0,3})?)\s*\Z")


def _zstd(data: bytes) -> bytes:
    import zstandard

    return zstandard.ZstdCompressor(level=3).compress(data)


def _brotli(data: bytes) -> bytes:
    import brotli

    return bytes(brotli.compress(data, quality=4))


#: Codings, that which is used first where a client weights them equally.
CODINGS: dict[str, Callable[[bytes], bytes]] = {
    "zstd": _zstd,
    "br": _brotli,
    "gzip": functools.partial(gzip.compress, compresslevel=5, mtime=0),
}


def is_compressible(content_type: str) -> bool:
    """Return whether answers of a media type are worth compressing; pictures and rasters are not."""
    return _TEXT.match(content_type) is not None


def coding_for(accept_encoding: str) -> str | None:
    """Return the coding that a client prefers, None for no coding; a malformed part is ignored."""
    weights: dict[str, float] = {}
    for part in accept_encoding[:1000].split(",")[:20]:
        name, separator, parameters = part.strip().partition(";")
        quality = _QUALITY.match(separator + parameters) if separator else None
        if separator and quality is None:
            continue
        weights[name.strip().lower()] = 1.0 if quality is None else float(quality[1])
    best = max(CODINGS, key=lambda coding: weights.get(coding, weights.get("*", 0.0)))
    weight = weights.get(best, weights.get("*", 0.0))
    return best if weight > 0.0 and weight >= weights.get("identity", 0.0) else None
