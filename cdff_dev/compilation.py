# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Notice on standard error while kernels are compiled, which happens at their first use after set-up."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

#: Longest usual duration of configuring if the kernels are already compiled, seconds.
_USUAL_S = 3.0


@contextmanager
def compilation_notice(name: str, after_s: float = _USUAL_S) -> Iterator[None]:
    """Print a line if the block, which configures the DFN or DFPC ``name``, takes longer than usual."""
    timer = threading.Timer(after_s, _print_notice, [name])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _print_notice(name: str) -> None:
    sys.stderr.write(
        f"{name}: compiling kernels at their first use, some minutes on a slow machine; "
        "`make warm` compiles all\n"
    )
    sys.stderr.flush()
