# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Addresses of object stores, and refusals of a bucket or a key."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from cdff_common.errors import ConfigurationError, StorageError
from cdff_dev.ports import free_port
from dpm_store.payloads.object_store import ObjectStore


@pytest.fixture
def answer_with(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[int, str], None]]:
    """Start an object store that answers all calls with one error of the S3 protocol."""
    pytest.importorskip("obstore", reason="install the extra scale: `make peers`")
    servers: list[HTTPServer] = []

    def start(status: int, code: str) -> None:
        class Handler(BaseHTTPRequestHandler):
            def do_PUT(self) -> None:
                self.rfile.read(int(self.headers.get("Content-Length", "0")))
                body = f"<Error><Code>{code}</Code><Message>{code}</Message></Error>".encode()
                self.send_response(status)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_: object) -> None: ...

        servers.append(HTTPServer(("127.0.0.1", 0), Handler))
        threading.Thread(target=servers[-1].serve_forever, daemon=True).start()
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{servers[-1].server_port}")

    for name, value in (("AWS_ACCESS_KEY_ID", "key"), ("AWS_SECRET_ACCESS_KEY", "hidden")):
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("AWS_REGION", "us-east-1")
    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


@pytest.mark.parametrize("url", ["https://bucket/prefix", "bucket", "s3://", "s3:/bucket"])
def test_an_address_without_a_bucket_is_refused(url: str) -> None:
    with pytest.raises(ConfigurationError, match="expected s3://bucket"):
        ObjectStore(url)


@pytest.mark.parametrize(
    ("status", "code"), [(404, "NoSuchBucket"), (403, "InvalidAccessKeyId"), (403, "ExpiredToken")]
)
def test_a_missing_bucket_and_a_refused_key_are_reported_without_the_secret(
    answer_with: Callable[[int, str], None], status: int, code: str
) -> None:
    answer_with(status, code)
    with pytest.raises(ConfigurationError, match=r"payloads s3://mission/a: .*create the bucket") as refused:
        ObjectStore("s3://mission/a")
    assert "AWS_ACCESS_KEY_ID" in str(refused.value)
    assert "hidden" not in str(refused.value)


def test_an_object_store_that_does_not_run_is_reported(
    answer_with: Callable[[int, str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{free_port()}")
    with pytest.raises(StorageError, match="check AWS_ENDPOINT_URL and that the object store runs"):
        ObjectStore("s3://mission/a")
