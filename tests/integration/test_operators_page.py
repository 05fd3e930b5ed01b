# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The operators' page in a real browser, steered over its debugging pipe: what is shown, clicked and kept out."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cdff_common.clock import ManualClock
from cdff_common.geodesy import Anchor, body
from cdff_common.interfaces.profile import Profile, Retention
from cdff_common.interfaces.profile import Robot as RobotProfile
from dpm_store import open_store
from services.dpm.http.context import Context
from services.dpm.http.server import HttpServer
from services.dpm.operations import Dpm
from services.dpm.settings import Settings
from tests.unit.services.dpm.conftest import S, cloud, elevation, parcel, pose

pytestmark = pytest.mark.integration

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


#: The protocol is spoken on descriptors 3 and 4.
_AT_3_AND_4 = """
import fcntl, os, sys
for given, wanted in [(fcntl.fcntl(int(text), fcntl.F_DUPFD, 10), n) for text, n in zip(sys.argv[1:3], (3, 4))]:
    os.dup2(given, wanted)
os.execvp(sys.argv[3], sys.argv[3:])
"""


class LoadedAnewError(Exception):
    """The page was loaded anew while it was asked."""


class Browser:
    """A headless browser of the Chromium family; one JSON message each way ends with a NUL (DevTools protocol)."""

    def __init__(self, program: str, folder: Path) -> None:
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()

        command = [
            program, "--headless=new", "--remote-debugging-pipe", "--no-sandbox", "--disable-gpu", "--no-first-run",
            "--disable-dev-shm-usage", "--disable-background-networking", f"--user-data-dir={folder}", "about:blank",
        ]  # fmt: skip
        at_3_and_4 = [sys.executable, "-c", _AT_3_AND_4, str(to_browser), str(from_browser), *command]
        self._process = subprocess.Popen(
            at_3_and_4, pass_fds=(to_browser, from_browser), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.close(to_browser)
        os.close(from_browser)
        self._number, self._rest, self.told = 0, b"", []  # type: int, bytes, list[dict[str, Any]]
        self._session: str | None = None
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its result; what the page tells meanwhile is kept in ``told``."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                if "navigated" in answer.get("error", {}).get("message", ""):
                    raise LoadedAnewError(answer)
                assert "error" not in answer, answer
                result: dict[str, Any] = answer["result"]
                return result
            self.told.append(answer)

    def value(self, expression: str) -> Any:
        """Value of a JavaScript expression in the page."""
        answer = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def eventually(self, expression: str, timeout_s: float = 30.0) -> None:
        """Return once an expression holds in the page; a page that is loaded anew meanwhile is asked again."""
        deadline = time.monotonic() + timeout_s
        while not self._holds(expression):
            assert time.monotonic() < deadline, f"{expression}\n{self.value('document.body.innerText')}"
            time.sleep(0.05)

    def _holds(self, expression: str) -> bool:
        try:
            return bool(self.value(expression))
        except LoadedAnewError:
            return False

    def close(self) -> None:
        """End the browser."""
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._out)
        os.close(self._in)

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            part = os.read(self._in, 1 << 16)
            assert part, "the browser has ended"
            self._rest += part
        message, self._rest = self._rest.split(b"\0", 1)
        data: dict[str, Any] = json.loads(message)
        return data


@pytest.fixture(scope="module")
def dpm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dpm]:
    """A store with maps, a cloud made from one, and poses, on Mars."""
    with open_store(f"sqlite:///{tmp_path_factory.mktemp('page')}", ManualClock(100 * S)) as store:
        made = Dpm(store)
        store.places.anchor("site", Anchor(body("mars"), 77.45, 18.44))
        _, patch = made.put(*parcel(elevation(0.0), "dem", 1, resolution_m=0.1))
        made.put(*parcel(elevation(50.0), "dem", 2, resolution_m=0.1))
        made.put(*parcel(cloud(), "pointcloud", 3, inputs=(patch.id,)))
        for second in range(3):
            made.put(*parcel(pose(second, float(second)), "pose", second + 4, child="mana/base"))
        store.annotations.update(patch.id, {"tags": ["crater"], "notes": "rim"}, if_match=0, author="anna")
        yield made


@contextlib.contextmanager
def opened(port: int, folder: Path) -> Iterator[Browser]:
    """A browser that was sent to the page; skips where there is none."""
    program = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if program is None:
        pytest.skip(f"no browser of the Chromium family is installed: none of {', '.join(BROWSERS)} was found")
    browser = Browser(program, folder)
    try:
        browser.send("Page.navigate", url=f"http://127.0.0.1:{port}/")
        yield browser
    finally:
        browser.close()


@pytest.fixture(scope="module")
def page(dpm: Dpm, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """The page, loaded."""
    profile = Profile(
        name="page", robots=(RobotProfile(id="mana"),), retention=(Retention(product="dem", max_age_s=1.0),)
    )  # fmt: skip
    context = Context(dpm, Settings(dpm.store.directory, port=0), profile=profile)
    with HttpServer(context) as server, opened(server.port, tmp_path_factory.mktemp("browser")) as browser:
        browser.eventually("document.querySelectorAll('.card').length === 3")
        yield browser


def test_the_page_shows_what_there_is(page: Browser) -> None:
    page.eventually("document.getElementById('live').dataset.state === 'live'")
    assert "mana" in page.value("document.getElementById('robots').innerText")
    assert "x 2.00" in page.value("document.getElementById('robots').innerText")
    page.eventually("[...document.images].filter((i) => i.complete && i.naturalWidth > 1).length >= 3")
    page.eventually("document.getElementById('frames').innerText.includes('mana/base')")
    page.eventually("document.getElementById('place').innerText.includes('mars at 77.45000° east, 18.44000° north')")


def test_searching_by_region_narrows_the_list_and_a_bad_region_says_why(page: Browser) -> None:
    search = "document.getElementById('filter').requestSubmit()"
    page.value(f"document.querySelector('[name=region]').value = 'circle:51,1,2'; {search}")
    page.eventually("document.querySelectorAll('.card').length === 1")
    page.value(f"document.querySelector('[name=region]').value = 'circle:1'; {search}")
    page.eventually("document.getElementById('filter-error').innerText.includes('expected')")
    page.value(f"document.querySelector('[name=region]').value = ''; {search}")
    page.eventually("document.querySelectorAll('.card').length === 3")
    assert page.value("document.getElementById('filter-error').innerText") == ""


def test_searching_by_tag_and_time(page: Browser) -> None:
    search = "document.getElementById('filter').requestSubmit()"
    page.value(f"document.querySelector('[name=tag]').value = 'crater'; {search}")
    page.eventually("document.querySelectorAll('.card').length === 1")
    page.value("document.querySelector('[name=tag]').value = ''")
    page.value(f"document.querySelector('[name=t0]').value = '2000000000'; {search}")
    page.eventually("document.querySelectorAll('.card').length === 2")
    page.value(f"document.querySelector('[name=t0]').value = ''; {search}")
    page.eventually("document.querySelectorAll('.card').length === 3")


#: Share of a tile's pixels that are drawn, of the tile that most of is.
DRAWN = """(async () => {
  const shares = await Promise.all([...document.querySelectorAll('#map img')].filter((i) => i.src).map(async (i) => {
    await i.decode();
    const canvas = document.createElement('canvas');
    canvas.width = canvas.height = 256;
    const context = canvas.getContext('2d');
    context.drawImage(i, 0, 0);
    return context.getImageData(0, 0, 256, 256).data.filter((v, n) => n % 4 === 3 && v > 0).length / 65536;
  }));
  return Math.max(0, ...shares);
})()"""


@pytest.mark.req("CDFF-SUP-166")
def test_the_map_shows_tiles_is_moved_and_measures(page: Browser) -> None:
    page.eventually("document.querySelectorAll('#map img').length >= 2")
    page.eventually(f"(async () => await {DRAWN} > 0)()")
    page.value("look(1, 1, 17)")  # the patch of 2 m lies in the middle, 20 cells wide
    page.eventually("document.getElementById('map-scale').innerText.includes('10 cm')")
    page.eventually(f"(async () => Math.abs(await {DRAWN} - 400 / 65536) < 1e-3)()")
    page.value("document.getElementById('map-in').click()")
    page.eventually("document.getElementById('map-scale').innerText.includes('5 cm')")
    page.eventually(f"(async () => await {DRAWN} === 0)()")  # finer than what is held
    page.value("document.getElementById('map-out').click(); identify(1, 1)")
    page.eventually("document.getElementById('map-note').innerText.includes('height 0.00 m ± 0.10 m, 2 measurements')")
    page.value("identify(500, 500)")
    page.eventually("/Nothing was measured|no dem patch/.test(document.getElementById('map-note').innerText)")
    page.value("document.getElementById('map-fit').click()")
    page.eventually("Math.abs(map.x - 26) < 0.5")


@pytest.mark.req("CDFF-SUP-166")
def test_details_show_provenance_that_one_can_walk(page: Browser) -> None:
    card = "[...document.querySelectorAll('.card')].find((c) => c.innerText.includes('pointcloud'))"
    page.value(f"{card}.querySelector('.details').click()")
    page.eventually(
        "document.getElementById('detail').open && document.getElementById('detail').innerText.includes('Made from')"
    )
    assert "dem of mana" in page.value("document.getElementById('detail').innerText")
    page.value("document.querySelector('#detail ul a').click()")
    page.eventually("document.getElementById('detail').innerText.includes('crater')")
    text = page.value("document.getElementById('detail').innerText")
    assert "rim" in text
    assert "pointcloud of mana" in text
    page.value("document.querySelector('#detail .close button').click()")
    page.eventually("!document.getElementById('detail').open")


@pytest.mark.req("CDFF-SUP-166")
def test_retention_is_explained_and_nothing_goes(page: Browser, dpm: Dpm) -> None:
    before = dpm.store.statistics().count
    page.value("document.getElementById('plan').click()")
    page.eventually("document.getElementById('plan-sum').innerText.includes('would go')")
    assert page.value("document.querySelectorAll('#verdicts tbody tr').length") >= 1
    assert dpm.store.statistics().count == before


def test_a_new_product_appears_by_itself(page: Browser, dpm: Dpm) -> None:
    page.value("look(1, 1, 17)")
    page.eventually(f"(async () => Math.abs(await {DRAWN} - 400 / 65536) < 1e-3)()")
    dpm.put(*parcel(elevation(9.0), "dem", 20, resolution_m=0.1))
    page.eventually("document.querySelectorAll('.card').length === 4")
    page.eventually(f"(async () => Math.abs(await {DRAWN} - 800 / 65536) < 1e-3)()")


@pytest.mark.req("CDFF-SUP-166")
def test_nothing_failed_on_the_page_and_nothing_came_from_elsewhere(page: Browser) -> None:
    page.value("1")
    errors = [t for t in page.told if t.get("method") == "Runtime.exceptionThrown"]
    assert errors == []
    asked = [t["params"]["request"]["url"] for t in page.told if t.get("method") == "Network.requestWillBeSent"]
    assert asked
    assert all(url.startswith(("http://127.0.0.1:", "data:", "blob:http://127.0.0.1:")) for url in asked)


def test_with_keys_the_page_asks_for_one_and_shows_everything_with_it(dpm: Dpm, tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    keys.write_text(f"{hashlib.sha256(b'sesame').hexdigest()} reader anna\n")
    context = Context(dpm, Settings(dpm.store.directory, port=0, keys_file=keys))
    with HttpServer(context) as server, opened(server.port, tmp_path / "browser") as page:
        page.eventually("document.getElementById('key')?.open")
        assert page.value("document.querySelectorAll('.card').length") == 0
        page.value(
            "document.querySelector('#key input').value = 'sesame'; document.querySelector('#key button').click()"
        )
        page.eventually("document.querySelectorAll('.card').length >= 3")
        page.eventually("[...document.images].filter((i) => i.naturalWidth > 1).length >= 3")
        page.eventually("document.getElementById('live')?.dataset.state === 'live'")
        assert "sesame" not in page.value("document.documentElement.outerHTML")
