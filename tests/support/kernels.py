# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled kernels of this process."""

from __future__ import annotations

import sys

from numba.core.dispatcher import Dispatcher


def compiled_signatures(prefix: str) -> dict[str, int]:
    """Return the number of compiled signatures of each kernel in the imported modules of a package."""
    return {
        f"{name}.{kernel}": len(value.signatures)
        for name, module in list(sys.modules.items())
        if name.startswith(prefix)
        for kernel, value in vars(module).items()
        if isinstance(value, Dispatcher)
    }
