# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""PostgreSQL as a product store: a server with its own data folder, and the same tables in SQL."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cdff_common.errors import StorageError
from dpm_store import NewProduct

#: Folders in which Debian installs the programs of each version.
_INSTALLED = Path("/usr/lib/postgresql")
#: User of the server if this process runs as root, which PostgreSQL refuses.
_USER = "postgres"
#: The columns that the DPM searches by, the header, the payload, and the history.
_TABLES = """
CREATE TABLE products (
    ordinal bigserial PRIMARY KEY, id text UNIQUE NOT NULL, robot text, dfpc text, port text, product text,
    type_name text, seq bigint, t0_ns bigint, t1_ns bigint, frame text, extent box, header bytea,
    payload bytea, deleted bool NOT NULL DEFAULT false);
CREATE INDEX by_extent ON products USING gist (extent);
CREATE INDEX by_time ON products (product, t1_ns);
CREATE TABLE events (ordinal bigserial PRIMARY KEY, kind text, id text);
"""
_COLUMNS = "id, robot, dfpc, port, product, type_name, seq, t0_ns, t1_ns, frame, extent, header, payload"


def binaries() -> Path | None:
    """Return the folder of the newest server, if one and psycopg are installed."""
    servers = sorted(_INSTALLED.glob("*/bin/initdb"), key=lambda path: int(path.parents[1].name))
    return servers[-1].parent if servers and importlib.util.find_spec("psycopg") else None


class PostgreSQL:
    """A server with default settings, in a folder of its own, on a Unix socket."""

    def __init__(self, folder: Path) -> None:
        server_folder = binaries()
        assert server_folder is not None, "no PostgreSQL server or psycopg"
        self._binaries, self._folder, self._data = server_folder, folder, folder / "data"
        folder.mkdir(mode=0o755)
        for parent in (folder, *folder.parents[:-2]):
            parent.chmod(parent.stat().st_mode | 0o711)
        if os.geteuid() == 0:
            shutil.chown(folder, _USER, _USER)
        self._call("initdb", "--auth=trust", "--username=cdff")
        with (self._data / "postgresql.conf").open("a") as configuration:
            configuration.write(f"listen_addresses = ''\nunix_socket_directories = '{folder}'\n")
        self.dsn = f"host={folder} user=cdff dbname=postgres"

    @property
    def version(self) -> str:
        """Version of the server."""
        text = subprocess.run(
            [self._binaries / "postgres", "--version"], capture_output=True, text=True, check=True
        ).stdout
        return re.sub(r"^postgres \(PostgreSQL\) ", "", text.strip())

    def start(self) -> None:
        """Start the server and wait until it accepts connections."""
        self._call("pg_ctl", "start", "--wait", "--silent", f"--log={self._folder}/log")

    def stop(self, mode: str) -> None:
        """Stop the server: ``fast`` in order; ``immediate`` without a checkpoint, as after a crash."""
        self._call("pg_ctl", "stop", "--silent", f"--mode={mode}")

    def _call(self, program: str, *arguments: str) -> None:
        user = ("runuser", "-u", _USER, "--") if os.geteuid() == 0 else ()
        command = [*user, str(self._binaries / program), "--pgdata", str(self._data), *arguments]
        result = subprocess.run(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False, cwd="/"
        )
        if result.returncode:
            raise StorageError(f"{program} ended with code {result.returncode}: {result.stderr.strip()}")


class PostgresProducts:
    """Insertion, deletion and retrieval of products; each change is one transaction."""

    def __init__(self, dsn: str) -> None:
        import psycopg

        self._connection = psycopg.connect(dsn)

    def create_tables(self) -> None:
        """Create the tables."""
        with self._connection.transaction():
            self._connection.execute(_TABLES)

    def put_all(self, products: Sequence[NewProduct]) -> None:
        """Insert products in one transaction."""
        values = ", ".join(["%s"] * len(_COLUMNS.split(",")))
        with self._connection.transaction(), self._connection.cursor() as cursor:
            cursor.executemany(
                f"INSERT INTO products ({_COLUMNS}) VALUES ({values})", [_row(p) for p in products]
            )
            cursor.executemany(
                "INSERT INTO events (kind, id) VALUES ('inserted', %s)", [(p.header.id,) for p in products]
            )

    def delete(self, product: str) -> None:
        """Mark a product as deleted and remove its payload."""
        with self._connection.transaction():
            self._connection.execute(
                "UPDATE products SET deleted = true, payload = NULL WHERE id = %s", (product,)
            )
            self._connection.execute("INSERT INTO events (kind, id) VALUES ('deleted', %s)", (product,))

    def payload(self, product: str) -> bytes | None:
        """Return the payload; None if the product is missing or deleted."""
        row = self._connection.execute(
            "SELECT payload FROM products WHERE id = %s AND NOT deleted", (product,)
        ).fetchone()
        self._connection.commit()
        return None if row is None else bytes(row[0])

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()


def _row(product: NewProduct) -> tuple[Any, ...]:
    header = product.header
    box = header.box_m or (0.0,) * 6
    extent = f"(({box[0]},{box[1]}),({box[3]},{box[4]}))"
    times = header.seq, header.t0_ns, header.t1_ns, header.frame, extent
    names = product.robot, product.dfpc, product.port, product.product, product.type_name
    return (header.id, *names, *times, header.to_attachment(), product.payload)


def seconds_until_first_answer(server: PostgreSQL, product: str) -> float:
    """Start the server after an immediate stop; return the time until it has answered a query."""
    start_s = time.monotonic()
    server.start()
    products = PostgresProducts(server.dsn)
    products.payload(product)
    elapsed_s = time.monotonic() - start_s
    products.close()
    return elapsed_s
