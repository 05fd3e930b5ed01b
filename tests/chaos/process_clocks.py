# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wall clocks of the services, which can jump while the clock of the machine does not."""

from __future__ import annotations

import shutil
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

SOURCE = Path(__file__).with_name("clock.c")
MODULES = ("services.router", "services.dpm", "services.orchestrator", "services.icu", "services.dfpc_host")
_OFFSET = struct.Struct("<q")


@dataclass(slots=True)
class ProcessClocks:
    """Offsets of the wall clocks, a file for each Python module that runs as a process.

    Attributes
    ----------
    is_built : bool
        False without a C compiler; the clocks then never jump.
    """

    folder: Path
    is_built: bool = False

    def build(self) -> None:
        """Compile the library of the clocks; report on standard error if there is no compiler."""
        self.folder.mkdir(parents=True, exist_ok=True)
        for module in MODULES:
            self.set(module, 0.0)
        compiler = shutil.which("cc") or shutil.which("gcc")
        if compiler is None:
            sys.stderr.write("chaos: NO CLOCK JUMPS, there is no C compiler\n")
            return
        command = [compiler, "-shared", "-fPIC", "-O2", "-o", str(self._library), str(SOURCE), "-ldl"]
        subprocess.run(command, check=True)
        self.is_built = True

    @property
    def _library(self) -> Path:
        return self.folder / "clock.so"

    def environment(self) -> dict[str, str]:
        """Return the variables of processes with such a clock."""
        if not self.is_built:
            return {}
        return {"LD_PRELOAD": str(self._library), "CHAOS_CLOCKS": str(self.folder)}

    def set(self, module: str, offset_s: float) -> None:
        """Set the offset of a module's clock."""
        path = self.folder / module
        with path.open("r+b" if path.exists() else "wb") as file:
            file.write(_OFFSET.pack(int(offset_s * 1e9)))

    @contextmanager
    def jumped(self, module: str, offset_s: float) -> Iterator[None]:
        """Let the clock of a module jump for the duration of the block."""
        self.set(module, offset_s)
        try:
            yield
        finally:
            self.set(module, 0.0)
