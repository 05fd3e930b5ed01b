# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The STAC Browser of Radiant Earth on another origin, in a real browser: from the catalog to an item."""

from __future__ import annotations

import functools
import http.server
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from cdff_common.clock import ManualClock
from cdff_common.geodesy import Anchor, body
from dpm_store import open_store
from services.dpm.http.context import Context
from services.dpm.http.server import HttpServer
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings
from tests.support.dpm_products import S, elevation, put_arguments

from .test_operators_page import BROWSERS, Browser

pytestmark = [pytest.mark.integration, pytest.mark.slow]

#: Where `scripts/peers --servers` builds the STAC Browser; npm has only its source.
BUILT = Path(__file__).parents[2] / "build/stac-browser/dist"


class Files(http.server.SimpleHTTPRequestHandler):
    """Files of the STAC Browser, without a log."""

    def log_message(self, format: str, *args: object) -> None:
        """Write nothing."""


@pytest.fixture
def origin() -> Iterator[str]:
    """The origin from which the STAC Browser is loaded."""
    if not (BUILT / "index.html").exists():
        pytest.skip("the STAC Browser is not built; scripts/peers --servers builds it")
    handler = functools.partial(Files, directory=str(BUILT))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


def test_the_stac_browser_shows_the_catalog_a_collection_and_an_item(origin: str, tmp_path: Path) -> None:
    program = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if program is None:
        pytest.skip("no browser of the Chromium family is installed; make peers installs it")
    with open_store(f"sqlite:///{tmp_path / 'store'}", ManualClock(100 * S)) as store:
        dpm = Dpm(store)
        store.anchors.anchor("site", Anchor(body("mars"), 77.45, 18.44))
        _, record = dpm.writer.put(*put_arguments(elevation(0.0), "dem", 1, resolution_m=0.1))
        context = Context(dpm, Settings(store.directory, port=0, cors_origins=(origin,)))
        with HttpServer(context) as server:
            browser = Browser(program, tmp_path / "browser")
            try:
                _walk(browser, origin, f"http://127.0.0.1:{server.port}", record.id)
            finally:
                browser.close()


def _walk(browser: Browser, origin: str, api: str, product: str) -> None:
    """Follow the links of the pages from the catalog to the item, and validate the text of each page."""
    address = f"{origin}/#/external/{api.replace('//', '/')}/stac"
    browser.send("Page.navigate", url=address)
    browser.eventually("document.title.includes('CDFF data products')", 60.0)
    _follow(browser, "Elevation patches")
    _has_text(browser, "Mars")
    _follow(browser, product)
    for text in ("dem of mana", "IAU_2015:49900", "As stored", "COG"):
        _has_text(browser, text)
    answers = [
        event["params"]["response"]
        for event in browser.events
        if event["method"] == "Network.responseReceived"
    ]
    ours = [answer for answer in answers if answer["url"].startswith(api)]
    assert {answer["url"].split("/")[3] for answer in ours} >= {"stac"}
    assert all(answer["status"] in (200, 304) for answer in ours), ours
    assert not any(event["method"] == "Runtime.exceptionThrown" for event in browser.events)


def _follow(browser: Browser, text: str) -> None:
    link = f"[...document.querySelectorAll('a')].find(a => a.innerText.trim() === '{text}')"
    browser.eventually(f"{link} !== undefined", 60.0)
    browser.value(f"{link}.click()")


def _has_text(browser: Browser, text: str) -> None:
    browser.eventually(f"document.body.innerText.includes('{text}')", 60.0)
