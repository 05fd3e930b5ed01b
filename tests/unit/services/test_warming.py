# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A service loads what its first request needs before it arrives."""

from __future__ import annotations

import subprocess
import sys

_PROGRAM = """
import sys
from services.warming import load_formats
assert "numba" not in sys.modules and "rasterio" not in sys.modules
load_formats()
assert "numba" in sys.modules and "rasterio" in sys.modules
"""


def test_codecs_and_map_formats_are_loaded() -> None:
    result = subprocess.run([sys.executable, "-c", _PROGRAM], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
