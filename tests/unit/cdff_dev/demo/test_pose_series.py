# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""All poses of a robot come, however many pages they fill."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from urllib.parse import parse_qs, urlsplit

import pytest

from cdff_common.errors import CdffError
from cdff_dev.demo import sharing

STAMPS = [1000 * i for i in range(1, 26)]


class Handler(BaseHTTPRequestHandler):
    """Answers as ``/api/v1/poses`` does: those from ``t0`` on, oldest first, at most ``limit``."""

    def do_GET(self) -> None:
        asked = {key: values[0] for key, values in parse_qs(urlsplit(self.path).query).items()}
        found = [s for s in STAMPS if s >= int(asked.get("t0", 0))][: int(asked["limit"])]
        body = {"items": [{"stamp_ns": str(s)} for s in found]} if asked["robot"] == "mana" else {}
        self.send_response(200)
        self.end_headers()
        self.wfile.write(json.dumps(body).encode())

    def log_message(self, format: str, *args: object) -> None:
        """Keep quiet."""


@pytest.fixture
def http() -> Iterator[str]:
    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.mark.parametrize("page", [5, 10, 25, 100])
def test_every_pose_comes_once(http: str, monkeypatch: pytest.MonkeyPatch, page: int) -> None:
    monkeypatch.setattr(sharing, "_PAGE", page)
    assert [int(item["stamp_ns"]) for item in sharing.pose_series(http, "mana", "mana/base")] == STAMPS


def test_an_answer_without_items_is_an_error_that_names_the_robot(http: str) -> None:
    with pytest.raises(CdffError, match="poses of minnie over HTTP"):
        sharing.pose_series(http, "minnie", "minnie/base")
