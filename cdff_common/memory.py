# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the C library's allocator, so that freed memory returns to the system; no effect without glibc.

glibc raises the size from which it maps blocks separately to that of the largest freed block (up to 32 MB).
Large arrays then come from the heap of the thread, and a small block above them keeps the whole heap.
"""

from __future__ import annotations

import ctypes
import functools
import gc
import os
import threading

from cdff_common.clock import monotonic_s

#: Parameters of ``mallopt`` (malloc.h).
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
#: Blocks of this size and more are mapped separately, and returned when they are freed.
_MAPPED_BYTES = 1 << 20
#: Free memory at the end of a heap that is not returned at once.
_KEPT_BYTES = 8 << 20
#: Largest size that ``M_MMAP_THRESHOLD`` can have, and free memory that a process for large messages keeps.
_LARGEST_REUSED_BYTES, _REUSED_BYTES = 32 << 20, 64 << 20
#: Least interval between two releases, seconds.
_RELEASE_PERIOD_S = 1.0
#: Numbers of allocations and of younger collections after which a collection of each generation begins.
_GC_THRESHOLDS = (20_000, 20, 20)
#: Cache of raster blocks; by default a twentieth of the machine's memory.
_GDAL_CACHE_MB = "32"

_lock = threading.Lock()
#: Monotonic time of the last release.
_last_release = {"s": -_RELEASE_PERIOD_S}


def limit_retained_memory() -> None:
    """Return large blocks to the system when they are freed; call it before large allocations."""
    libc = _glibc()
    if libc is not None:
        libc.mallopt(_M_MMAP_THRESHOLD, _MAPPED_BYTES)
        libc.mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)
    os.environ.setdefault("GDAL_CACHEMAX", _GDAL_CACHE_MB)


def reuse_large_blocks() -> None:
    """Keep up to 64 MB of freed memory for the next large message, instead of returning it to the system.

    The system clears each page that it gives to a process. For a message of 1 MB that is copied several times
    this takes longer than the copies. For processes whose only large blocks are messages that pass.
    """
    libc = _glibc()
    if libc is not None:
        libc.mallopt(_M_MMAP_THRESHOLD, _LARGEST_REUSED_BYTES)
        libc.mallopt(_M_TRIM_THRESHOLD, _REUSED_BYTES)


def freeze_heap() -> None:
    """Exclude all present objects from garbage collections; call it when a service is ready.

    The modules and descriptions of a service stay until it ends. A full collection that visits them needs
    some hundred milliseconds, in which no other thread runs. The default thresholds are for small programs:
    a service with many objects would collect often and free nothing.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(*_GC_THRESHOLDS)


def release_memory() -> None:
    """Return the freed memory of all heaps to the system, at most once a second."""
    libc = _glibc()
    with _lock:
        if libc is None or monotonic_s() - _last_release["s"] < _RELEASE_PERIOD_S:
            return
        _last_release["s"] = monotonic_s()
    libc.malloc_trim(0)


@functools.cache
def _glibc() -> ctypes.CDLL | None:
    """Return the C library if it has the functions of glibc."""
    try:
        libc = ctypes.CDLL(None)
    except OSError:
        return None
    return libc if hasattr(libc, "mallopt") and hasattr(libc, "malloc_trim") else None
