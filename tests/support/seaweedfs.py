# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An S3 object store of its own: SeaweedFS in a temporary folder, on loopback, with one key."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

_PROGRAM = Path(__file__).parents[2] / "build" / "seaweedfs" / "bin" / "weed"
KEY, SECRET, BUCKET = "cdff", "secret", "mission"
_START_S = 120.0


def missing() -> str:
    """Return the reason why there is no object store here; empty if there can be one."""
    if program() is None:
        return "SeaweedFS is not installed; run `make peers`"
    return "" if find_spec("obstore") is not None else "obstore is not installed; run `make peers`"


def program() -> str | None:
    """Return the path of ``weed``; None if it is not installed."""
    return str(_PROGRAM) if _PROGRAM.exists() else shutil.which("weed")


class ObjectServer:
    """A running server.

    Attributes
    ----------
    environment : dict of str to str
        Variables with which clients find it.
    """

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="cdff-s3-"))
        self._ports = dict(zip(("master", "volume", "filer", "s3"), _free_ports(8)[::2], strict=True))
        credentials = [{"accessKey": KEY, "secretKey": SECRET}]
        identity = {"name": "cdff", "credentials": credentials, "actions": ["Admin", "Read", "Write", "List"]}
        (self.folder / "s3.json").write_text(json.dumps({"identities": [identity]}))
        (self.folder / "data").mkdir()
        self.endpoint = f"http://127.0.0.1:{self._ports['s3']}"
        self.environment = {
            "AWS_ENDPOINT_URL": self.endpoint,
            "AWS_ACCESS_KEY_ID": KEY,
            "AWS_SECRET_ACCESS_KEY": SECRET,
            "AWS_REGION": "us-east-1",
        }
        self._process: subprocess.Popen[bytes] | None = None
        self.start()

    def start(self) -> None:
        """Start the server and wait until the bucket exists."""
        ports = [f"-{name}.port={port}" for name, port in self._ports.items()]
        grpc = [f"-{name}.port.grpc={port + 1}" for name, port in self._ports.items()]
        command = [
            str(program()),
            "server",
            f"-dir={self.folder / 'data'}",
            "-ip=127.0.0.1",
            "-ip.bind=127.0.0.1",
            "-master.volumeSizeLimitMB=64",
            "-volume.max=50",
            "-s3",
            f"-s3.config={self.folder / 's3.json'}",
            "-s3.port.iceberg=0",
            "-s3.port.lance=0",
            *ports,
            *grpc,
        ]
        with (self.folder / "log").open("ab") as log:
            self._process = subprocess.Popen(command, cwd=self.folder, stdout=log, stderr=log)
        deadline = time.monotonic() + _START_S
        while not self._has_bucket():
            if time.monotonic() > deadline or self._process.poll() is not None:
                raise RuntimeError((self.folder / "log").read_text(errors="replace")[-2000:])
            time.sleep(0.2)

    def _has_bucket(self) -> bool:
        """Try to create the bucket; return whether objects can be stored in it."""
        import obstore
        from obstore.exceptions import BaseError
        from obstore.store import S3Store

        config = {
            "endpoint": self.endpoint,
            "access_key_id": KEY,
            "secret_access_key": SECRET,
            "region": "us-east-1",
        }
        options = {"allow_http": True, "timeout": "5 s"}
        try:  # the bucket is created with its first object
            store = S3Store(BUCKET, config=config, client_options=options, retry_config={"max_retries": 0})
            obstore.put(store, "probe", b"1")
        except (BaseError, OSError):
            return False
        return True

    def kill(self) -> None:
        """End the server by SIGKILL: it does not end by other signals."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def close(self) -> None:
        """End the server and remove its data."""
        self.kill()
        shutil.rmtree(self.folder)


def _free_ports(count: int) -> list[int]:
    """Return free ports such that each second one is the next after the one before it."""
    ports: list[int] = []
    while len(ports) < count:
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port = first.getsockname()[1]
            try:
                second.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
        if port not in ports and port + 1 not in ports:
            ports += [port, port + 1]
    return ports


@contextmanager
def object_server() -> Iterator[ObjectServer]:
    """Run a server for the block, with its variables in the environment."""
    running = ObjectServer()
    before = {name: os.environ.get(name) for name in running.environment}
    os.environ.update(running.environment)
    try:
        yield running
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
        running.close()
