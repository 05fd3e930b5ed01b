# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A Yamcs server with the configuration in ``deploy/ground_segment``, in a temporary folder, on loopback.

Yamcs is under the AGPL: it runs as a program of its own, and nothing of it is imported.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from cdff_dev.ports import free_port

_ROOT = Path(__file__).resolve().parents[2]
_CONFIGURATION = _ROOT / "deploy" / "ground_segment" / "yamcs"
_PACKAGES = _ROOT / "build" / "yamcs" / "fprime_yamcs_bundle" / "lib"
_START_S = 180.0


def missing() -> str:
    """Return the reason why there is no Yamcs here; empty if there is one."""
    if not _PACKAGES.is_dir():
        return "Yamcs is not installed; run `make peers`"
    return "" if shutil.which("java") else "Java is not installed; run `make peers`"


class Yamcs:
    """A running server.

    Attributes
    ----------
    tm, tc, cfdp_down, cfdp_up : int
        UDP ports: the first and the third are those of Yamcs.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "yamcs"
        shutil.copytree(_CONFIGURATION, self.folder)
        self._http, self.tm, self.tc, self.cfdp_down, self.cfdp_up = (free_port() for _ in range(5))
        ports = {8090: self._http, 10015: self.tm, 10025: self.tc, 10016: self.cfdp_down, 10026: self.cfdp_up}
        for path in (self.folder / "etc").glob("*.yaml"):
            text = path.read_text(encoding="utf-8")
            for old, new in ports.items():
                text = text.replace(f"port: {old}", f"port: {new}")
            path.write_text(text, encoding="utf-8")
        command = ["java", "-Xmx256m", "-cp", f"{_PACKAGES}/*", "org.yamcs.YamcsServer", "--etc-dir", "etc"]
        with (self.folder / "log").open("wb") as log:
            self._process = subprocess.Popen(command, cwd=self.folder, stdout=log, stderr=log)
        deadline_s = time.monotonic() + _START_S
        while not self._answers():
            if time.monotonic() > deadline_s or self._process.poll() is not None:
                self.close()
                raise RuntimeError((self.folder / "log").read_text(errors="replace")[-3000:])
            time.sleep(0.5)

    def close(self) -> None:
        """End the server."""
        self._process.kill()
        self._process.wait()

    def call(self, path: str, body: Any = None, method: str | None = None) -> Any:
        """Return the answer of ``/api/{path}`` as plain data."""
        data = None if body is None else json.dumps(body).encode()
        return json.loads(self._request(path, data, method, "application/json") or b"{}")

    def object(self, name: str) -> bytes | None:
        """Return a received file; None if there is none."""
        try:
            return self._request(f"storage/buckets/products/objects/{name}", None, None, "")
        except urllib.error.HTTPError as error:
            if error.code == 404:
                return None
            raise

    def objects(self) -> list[str]:
        """Return the names of the received files."""
        return [item["name"] for item in self.call("storage/buckets/products/objects").get("objects", [])]

    def parameter(self, name: str) -> Any:
        """Return the engineering value of a parameter; None if it was never received."""
        value = self.call(f"processors/cdff/realtime/parameters/cdff/{name}").get("engValue")
        return None if value is None else next(v for k, v in value.items() if k.endswith("Value"))

    def events(self) -> list[tuple[str, str]]:
        """Return severity and text of all events."""
        return [(e["severity"], e["message"]) for e in self.call("archive/cdff/events").get("events", [])]

    def perform(self, body: bytes) -> str:
        """Issue the command ``perform``; return its id."""
        path = "processors/cdff/realtime/commands/cdff/perform"
        return str(self.call(path, {"args": {"body": body.hex()}})["id"])

    def verifications(self, command: str) -> dict[str, str]:
        """Return the attributes ``Verifier_…`` of a command in the history."""
        entry = self.call(f"archive/cdff/commands/{command}")
        return {
            a["name"]: a["value"].get("stringValue", "") for a in entry["attr"] if "Verifier_" in a["name"]
        }

    def upload(self, name: str, content: bytes) -> None:
        """Send a file to the robot by CFDP class 2."""
        self.call("storage/buckets", {"name": "commands"})
        self._request(f"storage/buckets/commands/objects/{name}", content, "POST", "application/octet-stream")
        self.call(
            "filetransfer/cdff/cfdp/transfers",
            {
                "direction": "UPLOAD",
                "bucket": "commands",
                "objectName": name,
                "remotePath": name,
                "source": "ground",
                "destination": "mana",
                "options": {"reliable": True},
            },
        )

    def _answers(self) -> bool:
        try:
            links = self.call("links/cdff").get("links", [])
            return len(links) == 4 and all(link["status"] == "OK" for link in links)
        except (OSError, urllib.error.URLError):
            return False

    def _request(self, path: str, data: bytes | None, method: str | None, media_type: str) -> bytes:
        request = urllib.request.Request(f"http://127.0.0.1:{self._http}/api/{path}", data, method=method)
        if data is not None:
            request.add_header("Content-Type", media_type)
        with urllib.request.urlopen(request, timeout=30) as answer:
            content: bytes = answer.read()
        return content
