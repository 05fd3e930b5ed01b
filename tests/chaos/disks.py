# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Small file systems for the store and for the outboxes, which can be filled."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from tests.integration.conftest import fill_disk


@dataclass(slots=True)
class SmallDisks:
    """Two tmpfs: the data folder, and in it the folder of the outboxes and checkpoints of DFPCs.

    Attributes
    ----------
    is_mounted : bool
        False where this process must not mount; the disks are then never filled.
    """

    data: Path
    is_mounted: bool = False
    _mounted: list[Path] = field(default_factory=list)

    @property
    def spool(self) -> Path:
        """Folder of the outboxes."""
        return self.data / "dfpc"

    def mount(self) -> None:
        """Mount both; report on standard error if this is not permitted."""
        for folder, size in ((self.data, "512m"), (self.spool, "32m")):
            folder.mkdir(parents=True, exist_ok=True)
            command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
            mount_process = subprocess.run(command, capture_output=True, text=True, check=False)
            if mount_process.returncode:
                sys.stderr.write(f"chaos: NO FULL DISKS, mount failed: {mount_process.stderr.strip()}\n")
                return
            self._mounted.append(folder)
        self.is_mounted = True

    def unmount(self) -> None:
        """Unmount the mounted file systems."""
        while self._mounted:
            subprocess.run(["umount", "--lazy", str(self._mounted.pop())], check=False)

    @contextmanager
    def full(self, folder: Path) -> Iterator[None]:
        """Fill the file system of a folder for the duration of the block."""
        ballast = fill_disk(folder)
        try:
            yield
        finally:
            ballast.unlink()
