# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Eight processes write to one DPM over HTTP at once while a backup is made."""

import subprocess
import sys
from pathlib import Path

import pytest

from dpm_store import open_store
from dpm_store.history.backup import backup

from .test_dpm import System, cloud, system

__all__ = ["system"]
pytestmark = pytest.mark.integration
WRITERS, TIMES = 8, 10

WRITER = """
import json, sys, urllib.error, urllib.request
url, product, own, times = sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4])
def change(id, fields, etag):
    request = urllib.request.Request(url + id, json.dumps(fields).encode(), method="PATCH")
    request.add_header("Content-Type", "application/json")
    request.add_header("If-Match", etag)
    return urllib.request.urlopen(request, timeout=30).status
for i in range(times):
    while True:
        with urllib.request.urlopen(url + product, timeout=30) as answer:
            product_now, etag = json.load(answer), answer.headers["ETag"]
        try:
            change(product, {"notes": str(int(product_now["annotation"]["notes"] or 0) + 1)}, etag)
            break
        except urllib.error.HTTPError as error:
            if error.code != 412:
                raise
    change(own, {"notes": str(i + 1)}, "*")
"""


def notes(system: System, product_id: str) -> str:
    """Return the notes of a product."""
    return str(system.get(f"/api/v1/products/{product_id}")["annotation"]["notes"])


@pytest.mark.req("CDFF-SUP-173")
@pytest.mark.slow
def test_eight_processes_lose_no_update_over_http(system: System, tmp_path: Path) -> None:
    ids = [system.put(cloud(), "pointcloud", seq) for seq in range(WRITERS + 1)]
    command = [sys.executable, "-c", WRITER, f"{system.http}/api/v1/products/", ids[0]]
    writers = [subprocess.Popen([*command, product_id, str(TIMES)]) for product_id in ids[1:]]
    result = backup(tmp_path / "data", tmp_path / "copy")
    assert [writer.wait(120) for writer in writers] == [0] * WRITERS
    assert notes(system, ids[0]) == str(WRITERS * TIMES)
    assert [notes(system, product_id) for product_id in ids[1:]] == [str(TIMES)] * WRITERS
    assert result.products == WRITERS + 1
    backup(tmp_path / "copy", tmp_path / "restored")
    with open_store(f"sqlite:///{tmp_path}/restored") as restored:
        assert restored.verify() == ()
        assert int(restored.annotations.get(ids[0]).notes or 0) <= WRITERS * TIMES
