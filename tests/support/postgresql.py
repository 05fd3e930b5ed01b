# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A cluster of PostgreSQL with PostGIS of its own: socket in a temporary folder, not as root."""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

#: Engines of the tests of the store; a module or a test that depends on files of SQLite uses only that.
ENGINES = (
    "sqlite",
    pytest.param("postgresql", marks=pytest.mark.soak),
    pytest.param("postgresql+s3", marks=pytest.mark.soak),
)
WITH_FILES = ENGINES[:2]
ONLY_FILES = pytest.mark.parametrize("engine", WITH_FILES)
ONLY_EMBEDDED = pytest.mark.parametrize("engine", ["sqlite"])
#: Database user of the tests.
USER = "cdff"
_START_S = 60.0


def missing() -> str:
    """Return the reason why there is no cluster here; empty if there can be one."""
    if _programs() is None:
        return "PostgreSQL with PostGIS is not installed; run `make peers`"
    if find_spec("psycopg") is None:
        return "psycopg is not installed; run `make peers`"
    return (
        "" if _account() is not None else "PostgreSQL does not run as root, and there is no user `postgres`"
    )


def _programs() -> Path | None:
    """Return the folder of the programs of the newest version that has PostGIS."""
    controls = Path("/usr/share/postgresql").glob("*/extension/postgis.control")
    folders = [Path("/usr/lib/postgresql") / path.parts[-3] / "bin" for path in controls]
    found = [folder for folder in folders if (folder / "initdb").exists()]
    return max(found, key=lambda folder: int(folder.parent.name), default=None)


def _account() -> pwd.struct_passwd | None:
    """Return the account that runs the server."""
    try:
        return pwd.getpwuid(os.getuid()) if os.getuid() else pwd.getpwnam("postgres")
    except KeyError:
        return None


class Cluster:
    """A running server.

    Attributes
    ----------
    folder : Path
        Folder of the data and of the socket.
    """

    def __init__(self, *settings: str) -> None:
        programs, account = _programs(), _account()
        assert programs is not None
        assert account is not None
        self._programs, self._settings = programs, settings
        self._as: dict[str, Any] = (
            {} if os.getuid() else {"user": account.pw_uid, "group": account.pw_gid, "extra_groups": []}
        )
        self.folder = Path(tempfile.mkdtemp(prefix="cdff-pg-"))
        os.chown(self.folder, account.pw_uid, account.pw_gid)
        self._process: subprocess.Popen[bytes] | None = None
        self.run("initdb", "-D", "data", "-U", USER, "-A", "trust", "--locale=C", "-E", "UTF8", "--no-sync")
        self.start()

    def run(self, program: str, *arguments: str, **options: Any) -> subprocess.CompletedProcess[bytes]:
        """Run a program of PostgreSQL in the folder, as the user of the server."""
        command = [str(self._programs / program), *arguments]
        return subprocess.run(
            command, cwd=self.folder, check=True, capture_output=True, **self._as, **options
        )

    def start(self) -> None:
        """Start the server and wait until it answers."""
        import psycopg

        settings = [v for setting in ("listen_addresses=", *self._settings) for v in ("-c", setting)]
        command = [str(self._programs / "postgres"), "-D", "data", "-k", str(self.folder), *settings]
        with (self.folder / "log").open("ab") as log:
            self._process = subprocess.Popen(command, cwd=self.folder, stderr=log, **self._as)
        deadline = time.monotonic() + _START_S
        while True:
            try:
                self.execute("SELECT 1")
                return
            except psycopg.OperationalError:
                if time.monotonic() > deadline or self._process.poll() is not None:
                    raise
                time.sleep(0.02)

    def kill(self) -> None:
        """Stop the server at once, as a crash of its machine would, except that its files are not lost."""
        if self._process is not None:
            self.run("pg_ctl", "stop", "-D", "data", "-m", "immediate")
            self._process.wait()
            self._process = None

    def close(self) -> None:
        """Stop the server and remove its folder."""
        self.kill()
        shutil.rmtree(self.folder)

    def execute(self, statement: str, database: str = "postgres") -> None:
        """Run a statement outside a transaction."""
        import psycopg

        with psycopg.connect(
            host=str(self.folder), user=USER, dbname=database, autocommit=True
        ) as connection:
            connection.execute(statement.encode())

    def url(self, database: str, directory: Path, payloads: str = "") -> str:
        """Return the URL of a store in a database."""
        options = f"host={self.folder}&directory={directory}" + (payloads and f"&payloads={payloads}")
        return f"postgresql+psycopg://{USER}@/{database}?{options}"


@contextmanager
def cluster(*settings: str) -> Iterator[Cluster]:
    """Run a cluster for the block."""
    running = Cluster(*settings)
    try:
        yield running
    finally:
        running.close()
