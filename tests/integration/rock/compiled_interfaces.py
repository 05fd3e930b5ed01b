# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Python modules of the interfaces of ROCK, for programs in the environment of omniORB (build/rock-peers)."""

from __future__ import annotations

import pathlib
import subprocess
import sys
import tempfile


def compile_interfaces(folder: str) -> None:
    """Compile ``rtt.idl`` and ``base.idl`` of a folder, so that their modules can be imported."""
    out = tempfile.mkdtemp()
    compiler = str(pathlib.Path(sys.executable).parent / "omniidl")
    for name in ("rtt", "base"):
        subprocess.run([compiler, "-bpython", f"-C{out}", f"{folder}/{name}.idl"], check=True)
    sys.path.insert(0, out)
