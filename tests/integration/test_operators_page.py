# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The operators' page in a real browser, controlled over the DevTools pipe: content and interaction."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.clock import ManualClock
from cdff_common.geodesy import Anchor, body
from cdff_common.interfaces.profile import DfpcEntry, Profile, Retention
from cdff_common.interfaces.profile import Robot as RobotProfile
from cdff_dev.ports import free_port
from dpm_store import open_store
from services.alarms import Severity
from services.dpm.bus.service_monitor import ServiceMonitor
from services.dpm.http.context import Context
from services.dpm.http.server import HttpServer
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings
from tests.integration.conftest import wait_until
from tests.support.dpm_products import S, bearing_track, cloud, elevation, pose, pose_track, put_arguments

pytestmark = pytest.mark.integration

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


#: Program that starts the browser with its protocol pipes on file descriptors 3 and 4.
_EXEC_ON_3_AND_4 = """
import fcntl, os, sys
for pipe, target in [(fcntl.fcntl(int(arg), fcntl.F_DUPFD, 10), n) for arg, n in zip(sys.argv[1:3], (3, 4))]:
    os.dup2(pipe, target)
os.execvp(sys.argv[3], sys.argv[3:])
"""


class ReloadedError(Exception):
    """The page was reloaded during a query."""


class Browser:
    """A headless Chromium-like browser; messages in both directions are JSON with a final NUL (DevTools
    protocol).
    """

    def __init__(self, program: str, folder: Path) -> None:
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()

        command = [
            program,
            "--headless=new",
            "--remote-debugging-pipe",
            "--no-sandbox",
            "--disable-gpu",
            "--no-first-run",
            "--disable-dev-shm-usage",
            "--disable-background-networking",
            f"--user-data-dir={folder}",
            "about:blank",
        ]
        exec_command = [sys.executable, "-c", _EXEC_ON_3_AND_4, str(to_browser), str(from_browser), *command]
        self._process = subprocess.Popen(
            exec_command,
            pass_fds=(to_browser, from_browser),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._number, self._buffer, self.events = 0, b"", []  # type: int, bytes, list[dict[str, Any]]
        self._session: str | None = None
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its result; events of the page are kept in ``self.events``."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                if "navigated" in answer.get("error", {}).get("message", ""):
                    raise ReloadedError(answer)
                assert "error" not in answer, answer
                result: dict[str, Any] = answer["result"]
                return result
            self.events.append(answer)

    def value(self, expression: str) -> Any:
        """Return the value of a JavaScript expression in the page."""
        answer = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def eventually(self, expression: str, timeout_s: float = 30.0) -> None:
        """Wait until a JavaScript expression is true in the page, also across a reload."""
        deadline = time.monotonic() + timeout_s
        while not self._is_true(expression):
            assert time.monotonic() < deadline, f"{expression}\n{self.value('document.body.innerText')}"
            time.sleep(0.05)

    def _is_true(self, expression: str) -> bool:
        try:
            return bool(self.value(expression))
        except ReloadedError:
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
        while b"\0" not in self._buffer:
            chunk = os.read(self._in, 1 << 16)
            assert chunk, "the browser has ended"
            self._buffer += chunk
        message, self._buffer = self._buffer.split(b"\0", 1)
        data: dict[str, Any] = json.loads(message)
        return data


@pytest.fixture(scope="module")
def dpm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dpm]:
    """A store on Mars with two maps, a cloud derived from one of them, and poses."""
    with open_store(f"sqlite:///{tmp_path_factory.mktemp('page')}", ManualClock(100 * S)) as store:
        result = Dpm(store)
        store.anchors.anchor("site", Anchor(body("mars"), 77.45, 18.44))
        _, patch = result.writer.put(*put_arguments(elevation(0.0), "dem", 1, resolution_m=0.1))
        result.writer.put(*put_arguments(elevation(50.0), "dem", 2, resolution_m=0.1))
        result.writer.put(*put_arguments(cloud(), "pointcloud", 3, inputs=(patch.id,)))
        for second in range(3):
            result.writer.put(
                *put_arguments(pose(second, float(second)), "pose", second + 4, child="mana/base")
            )
        store.annotations.update(patch.id, {"tags": ["crater"], "notes": "rim"}, if_match=0, author="anna")
        yield result


@contextlib.contextmanager
def open_page(port: int, folder: Path) -> Iterator[Browser]:
    """Open the page in a browser; skip the test if no browser is installed."""
    program = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if program is None:
        reason = f"no browser of the Chromium family is installed: none of {', '.join(BROWSERS)} was found"
        pytest.skip(reason)
    browser = Browser(program, folder)
    try:
        browser.send("Page.navigate", url=f"http://127.0.0.1:{port}/")
        yield browser
    finally:
        browser.close()


@pytest.fixture(scope="module")
def page(dpm: Dpm, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """The loaded page."""
    profile = Profile(
        name="page", robots=(RobotProfile(id="mana"),), retention=(Retention(product="dem", max_age_s=1.0),)
    )
    context = Context(dpm, Settings(dpm.store.directory, port=0), profile=profile)
    with HttpServer(context) as server, open_page(server.port, tmp_path_factory.mktemp("browser")) as browser:
        browser.eventually("document.querySelectorAll('.card').length === 3")
        yield browser


def test_the_page_shows_the_stored_products(page: Browser) -> None:
    page.eventually("document.getElementById('live').dataset.state === 'live'")
    assert "mana" in page.value("document.getElementById('robots').innerText")
    assert "x 2.00" in page.value("document.getElementById('robots').innerText")
    page.eventually("[...document.images].filter((i) => i.complete && i.naturalWidth > 1).length >= 3")
    page.eventually("document.getElementById('frames').innerText.includes('mana/base')")
    page.eventually(
        "document.getElementById('place').innerText.includes('mars at 77.45000° east, 18.44000° north')"
    )


def test_searching_by_region_filters_the_list_and_a_bad_region_shows_the_reason(page: Browser) -> None:
    search = "document.getElementById('filter').requestSubmit()"
    page.value(f"document.querySelector('#filter [name=region]').value = 'circle:51,1,2'; {search}")
    page.eventually("document.querySelectorAll('.card').length === 1")
    page.value(f"document.querySelector('#filter [name=region]').value = 'circle:1'; {search}")
    page.eventually("document.getElementById('filter-error').innerText.includes('expected')")
    page.value(f"document.querySelector('#filter [name=region]').value = ''; {search}")
    page.eventually("document.querySelectorAll('.card').length === 3")
    assert page.value("document.getElementById('filter-error').innerText") == ""


def test_searching_by_tag_and_time(page: Browser) -> None:
    search = "document.getElementById('filter').requestSubmit()"
    page.value(f"document.querySelector('#filter [name=tag]').value = 'crater'; {search}")
    page.eventually("document.querySelectorAll('.card').length === 1")
    page.value("document.querySelector('#filter [name=tag]').value = ''")
    page.value(f"document.querySelector('#filter [name=t0]').value = '2000000000'; {search}")
    page.eventually("document.querySelectorAll('.card').length === 2")
    page.value(f"document.querySelector('#filter [name=t0]').value = ''; {search}")
    page.eventually("document.querySelectorAll('.card').length === 3")


#: Fraction of non-transparent pixels of the map tile that has most of them.
DRAWN_FRACTION = """(async () => {
  const images = [...document.querySelectorAll('#map img')].filter((i) => i.src);
  const shares = await Promise.all(images.map(async (i) => {
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
def test_the_map_shows_tiles_pans_and_measures(page: Browser) -> None:
    page.eventually("document.querySelectorAll('#map img').length >= 2")
    page.eventually(f"(async () => await {DRAWN_FRACTION} > 0)()")
    page.value("look(1, 1, 17)")  # the patch of 2 m is in the middle: 20 × 20 pixels of 10 cm
    page.eventually("document.getElementById('map-scale').innerText.includes('10 cm')")
    page.eventually(f"(async () => Math.abs(await {DRAWN_FRACTION} - 400 / 65536) < 1e-3)()")
    page.value("document.getElementById('map-in').click()")
    page.eventually("document.getElementById('map-scale').innerText.includes('5 cm')")
    # Beyond the finest data its tiles are enlarged.
    page.eventually("document.getElementById('map-scale').innerText.includes('data of 10 cm enlarged')")
    page.eventually("document.querySelector('#map img').style.width === '512px'")
    page.eventually(f"(async () => Math.abs(await {DRAWN_FRACTION} - 400 / 65536) < 1e-3)()")
    page.value("document.getElementById('map-out').click(); identify(1, 1)")
    page.eventually(
        "document.getElementById('map-note').innerText.includes('height 0.00 m ± 0.10 m, 2 measurements')"
    )
    page.value("identify(500, 500)")
    page.eventually("/Nothing was measured|no dem patch/.test(document.getElementById('map-note').innerText)")
    page.value("document.getElementById('map-fit').click()")
    page.eventually("Math.abs(map.x - 26) < 0.5")


def test_the_map_has_robots_with_errors_outlines_scale_north_and_colours(page: Browser) -> None:
    page.eventually("document.querySelectorAll('#map .robot-mark').length === 1")
    page.value("look(1, 1, 17)")
    path = "document.querySelector('#map .path').getAttribute('points')"
    assert page.value(f"{path}.split(' ').length") == 3
    # 3 σ of a variance of 0.01 m² are 0.3 m, in pixels of 10 cm
    assert page.value("+document.querySelector('#map .error-ellipse').getAttribute('rx')") == pytest.approx(
        3.0
    )
    mark = "document.querySelector('#map .robot-mark').getAttribute('transform')"
    (x_px,) = page.value(f"[{mark}.match(/\\(([-\\d.]+)/)[1] * 1]")
    assert x_px == pytest.approx(page.value("view().clientWidth / 2") + 10.0)
    assert page.value("document.querySelectorAll('#map .outline').length") == 0
    page.value("document.getElementById('map-outlines').click()")
    page.eventually("document.querySelectorAll('#map .outline').length === 2")
    page.value("document.getElementById('map-outlines').click()")
    assert page.value("document.querySelectorAll('#map .scale-bar').length") == 1
    assert page.value("document.querySelector('#map .north') !== null")
    legend = "document.getElementById('map-legend').innerText"
    assert "-8 m" in page.value(legend)
    assert "8 m" in page.value(legend)


def test_the_time_of_the_map_is_chosen_with_a_slider(page: Browser) -> None:
    page.value("look(51, 1, 17)")
    page.eventually(f"(async () => await {DRAWN_FRACTION} > 0)()")
    move = (
        "(v) => { const s = document.getElementById('map-time'); "
        "s.value = v; s.dispatchEvent(new Event('input')); }"
    )
    page.value(f"({move})(500)")  # the second map was captured at the end of the interval
    assert "captures until 1970-01-01" in page.value("document.getElementById('map-time-text').innerText")
    page.eventually(f"(async () => await {DRAWN_FRACTION} === 0)()")
    page.value("look(1, 1, 17)")
    page.eventually(f"(async () => await {DRAWN_FRACTION} > 0)()")
    page.value(f"({move})(1000)")
    assert page.value("document.getElementById('map-time-text').innerText") == "all captures"
    page.value("look(51, 1, 17)")
    page.eventually(f"(async () => await {DRAWN_FRACTION} > 0)()")
    page.value("document.getElementById('map-fit').click()")
    page.eventually("Math.abs(map.x - 26) < 0.5")


def test_a_product_is_requested_with_a_form(page: Browser) -> None:
    form = "document.getElementById('request-form')"
    page.eventually(f"[...{form}.elements.type.options].some((o) => o.value === 'dem')")
    page.value(f"{form}.elements.type.value = 'dem'; {form}.elements.region.value = 'circle:0,0,5'")
    status = "document.getElementById('request-status').innerText"
    page.value(f"{form}.requestSubmit()")  # this server has no bus
    page.eventually(f"{status}.includes('without the bus')")
    page.value("""(() => {
      window.realFetch = window.fetch;
      window.fetch = async (path, options) => {
        if (path !== 'api/v1/requests' || !options || options.method !== 'POST') return window.realFetch(path, options);
        window.requested = JSON.parse(options.body);
        return new Response(JSON.stringify({ kind: 'reference', id: 'abc', coverage: 0.5 }), { status: 200 });
      };
    })()""")
    page.value(f"{form}.elements.resolution_m.value = '0.05'; {form}.requestSubmit()")
    page.eventually(f"{status}.includes('50 % of the region')")
    page.value("window.fetch = window.realFetch")
    requested = page.value("window.requested")
    assert requested == {
        "type": "dem",
        "robot": "any",
        "region": "circle:0,0,5",
        "resolution_m": "0.05",
        "deadline_ms": 60000,
    }


#: Neighbouring tiles whose common edge has a gap or an overlap.
SEAMS = """(() => {
  const boxes = [...document.querySelectorAll('#map img')].map((i) => i.getBoundingClientRect());
  const rights = new Set(boxes.map((b) => b.right));
  const lefts = [...new Set(boxes.map((b) => b.left))].sort((a, b) => a - b);
  return lefts.slice(1).filter((left) => !rights.has(left)).length;
})()"""


def test_neighbouring_tiles_share_their_edge_at_any_place_and_level(page: Browser) -> None:
    for x, z in ((0.0499999, 17), (12.825, 17), (0.35, 18), (1.0 / 3.0, 16), (-0.05, 19)):
        page.value(f"look({x}, {x}, {z})")
        page.eventually("document.querySelectorAll('#map img').length >= 2")
        assert page.value(SEAMS) == 0
    page.value("document.getElementById('map-fit').click()")
    page.eventually("Math.abs(map.x - 26) < 0.5")


def test_two_fingers_zoom_around_the_point_between_them(page: Browser) -> None:
    page.value("""(() => {
      look(0, 0, 17);
      const box = view().getBoundingClientRect();
      const send = (type, id, x) => view().dispatchEvent(new PointerEvent(type, { pointerId: id, bubbles: true,
        clientX: box.left + box.width / 2 + x, clientY: box.top + box.height / 2 }));
      send('pointerdown', 11, -40);
      send('pointerdown', 12, 40);
      for (let px = 40; px <= 80; px += 5) { send('pointermove', 11, -px); send('pointermove', 12, px); }
      send('pointerup', 11, -80);
      send('pointerup', 12, 80);
    })()""")
    assert page.value("map.z") == 18
    assert abs(page.value("map.x")) < 0.6
    page.value("document.getElementById('map-fit').click()")
    page.eventually("Math.abs(map.x - 26) < 0.5")


def test_the_map_is_moved_by_keys_and_the_page_is_dark_in_a_dark_room(page: Browser) -> None:
    page.value("look(0, 0, 17); view().focus()")
    for key in ("ArrowRight", "ArrowUp"):
        page.send("Input.dispatchKeyEvent", type="keyDown", key=key)
        page.send("Input.dispatchKeyEvent", type="keyUp", key=key)
    assert page.value("[map.x, map.y]") == pytest.approx([6.4, 6.4])
    page.value("document.getElementById('map-fit').click()")
    page.eventually("Math.abs(map.x - 26) < 0.5")
    scheme = {"name": "prefers-color-scheme", "value": "dark"}
    page.send("Emulation.setEmulatedMedia", features=[scheme])
    try:
        background = "getComputedStyle(document.body).backgroundColor.match(/[0-9]+/g).map(Number)"
        assert max(page.value(background)) < 40
    finally:
        page.send("Emulation.setEmulatedMedia", features=[])


@pytest.mark.parametrize("width", [360, 390, 2560])
def test_the_page_is_not_wider_than_the_screen(page: Browser, width: int) -> None:
    page.send(
        "Emulation.setDeviceMetricsOverride", width=width, height=800, deviceScaleFactor=1, mobile=False
    )
    try:
        page.eventually(f"innerWidth === {width}")
        boxes = "[...document.querySelectorAll('body *')]"
        wide = f"{boxes}.filter((e) => e.getBoundingClientRect().right > innerWidth + 1)"
        names = (
            f"{wide}.filter((e) => !e.closest('.scroll, .map')).map((e) => e.tagName + '#' + e.id).join(' ')"
        )
        assert page.value(names) == ""
        assert page.value("document.documentElement.scrollWidth") <= width
        if width < 640:
            tables = "[...document.querySelectorAll('.scroll')]"
            assert page.value(f"{tables}.every(table => table.scrollWidth <= table.clientWidth)")
            assert page.value("getComputedStyle(document.querySelector('#frames td'), '::before').content")
    finally:
        page.send("Emulation.clearDeviceMetricsOverride")


@pytest.mark.req("CDFF-SUP-166")
def test_details_show_provenance_with_links(page: Browser) -> None:
    card = "[...document.querySelectorAll('.card')].find((c) => c.innerText.includes('pointcloud'))"
    page.value(f"{card}.querySelector('.details').click()")
    page.eventually(
        "document.getElementById('detail').open && "
        "document.getElementById('detail').innerText.includes('Inputs')"
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
def test_retention_is_explained_without_deleting(page: Browser, dpm: Dpm) -> None:
    before = dpm.store.statistics().count
    page.value("document.getElementById('plan').click()")
    page.eventually("document.getElementById('plan-sum').innerText.includes('would be deleted')")
    assert page.value("document.querySelectorAll('#decisions tbody tr').length") >= 1
    assert dpm.store.statistics().count == before


def test_an_alarm_appears_and_is_acknowledged(page: Browser, dpm: Dpm) -> None:
    assert page.value("document.getElementById('alarms-section').hidden")
    dpm.alarms.set("clock", "dpm", Severity.WARNING, "the mission clock is lost", "restart its publisher")
    page.value("showAlarms()")
    page.eventually("document.getElementById('alarms').innerText.includes('the mission clock is lost')")
    page.value("document.querySelector('#alarms button').click()")
    page.eventually("document.getElementById('alarms').innerText.includes('http/admin/local')")
    assert dpm.alarm_board.active()[0]["acknowledged_by"] == "http/admin/local"
    dpm.alarms.clear("clock", "dpm")
    page.value("showAlarms()")
    page.eventually("document.getElementById('alarms-section').hidden")


def test_goals_and_outlines_are_those_of_the_time_of_the_slider(page: Browser) -> None:
    """The maps were captured at 1 s and 2 s; the slider is moved to 1.5 s."""
    times = {"before": ("1000000000", "1200000000"), "during": ("1000000000", "1700000000")}
    times |= {"after": ("1600000000", None), "standing": ("1400000000", None)}
    jobs = [
        {"job": name, "state": "done" if ended else "waiting", "opened_ns": opened, "ended_ns": ended}
        | {"request": {"type": "dem", "robot": "mana", "region": "circle:1,1,1", "frame": "site"}}
        for name, (opened, ended) in times.items()
    ]
    page.value(f"""(() => {{
      window.realFetch = window.fetch;
      window.fetch = async (path, options) => path === 'api/v1/requests'
        ? new Response(JSON.stringify({{jobs: {json.dumps(jobs)}}}), {{ status: 200 }})
        : window.realFetch(path, options);
      look(26, 1, 17);
      readOverlay();
    }})()""")
    states = "[...document.querySelectorAll('#map .goal')].map((g) => g.dataset.state).sort().join()"
    outlines = "document.querySelectorAll('#map .outline').length"
    move = (
        "(v) => { const s = document.getElementById('map-time'); "
        "s.value = v; s.dispatchEvent(new Event('input')); }"
    )
    try:
        page.value("document.getElementById('map-outlines').click()")
        page.eventually(f"{states} === 'done,done,waiting,waiting' && {outlines} === 2")
        page.value(f"({move})(500)")
        page.eventually(f"{states} === 'done,open,waiting' && {outlines} === 1")
        page.value(f"({move})(1000)")
        page.eventually(f"{states} === 'done,done,waiting,waiting' && {outlines} === 2")
    finally:
        page.value(
            "document.getElementById('map-outlines').click(); window.fetch = window.realFetch; readOverlay()"
        )
    page.eventually("document.querySelectorAll('#map .goal').length === 0")


def test_health_of_services_and_ages_of_data_are_shown(dpm: Dpm, tmp_path: Path) -> None:
    """Services announce themselves on a real bus; mission time is 100 s, the last pose is of 2 s."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    newest = {"pose": {"product": "pose", "t1_ns": 97 * S, "status": "DEGRADED", "reasons": ["few_points"]}}
    status = {"name": "lidar_slam", "robot": "mana", "state": "active", "newest_outputs": newest}
    with (
        Bus.open_router(endpoint),
        Bus.open(endpoint, name="dpm") as bus,
        Bus.open(endpoint, name="host") as host,
    ):
        profile = Profile(
            name="page", robots=(RobotProfile(id="mana", dfpcs=[DfpcEntry(name="visual_slam", inputs={})]),)
        )
        monitor = ServiceMonitor(bus, dpm, profile.robots)
        context = Context(dpm, Settings(dpm.store.directory, port=0), watch=monitor, profile=profile)
        host.declare_alive("mana", "icu")
        host.declare_alive("mana", "lidar_slam")
        with HttpServer(context) as server, open_page(server.port, tmp_path / "browser") as browser:
            rows = (
                "[...document.querySelectorAll('#services tbody tr')].map((r) => "
                "[...r.cells].map((c) => c.textContent).join('|')).join('\\n')"
            )
            expected = [
                "good|icu|mana|–|runs",
                "degraded|lidar slam|mana|3.0 s old|is active, with problems: pose degraded (few_points)",
                "failed|visual slam|mana|–|has not started",
            ]

            def is_listed() -> bool:  # as a host does, which repeats its status
                host.publish_map(keys.dfpc_status("mana", "lidar_slam"), status | {"last_error": ""})
                return bool(browser.value(rows) == "\n".join(expected))

            wait_until(is_listed, 30.0, "the table of services")
            summary = "document.getElementById('summary').innerText"
            assert "t = 100.00 s" in browser.value(summary)
            assert "94 s old" in browser.value(summary)
            browser.eventually("/ 98 s old/.test(document.getElementById('robots').innerText)")
            host.withdraw_token(keys.alive("mana", "icu"))
            browser.eventually(f"{rows}.includes('failed|icu|mana|–|does not run; it ended 0 s ago')")


def test_a_new_product_appears_without_reloading(page: Browser, dpm: Dpm) -> None:
    page.value("look(1, 1, 17)")
    page.eventually(f"(async () => Math.abs(await {DRAWN_FRACTION} - 400 / 65536) < 1e-3)()")
    dpm.writer.put(*put_arguments(elevation(9.0), "dem", 20, resolution_m=0.1))
    page.eventually("document.querySelectorAll('.card').length === 4")
    page.eventually(f"(async () => Math.abs(await {DRAWN_FRACTION} - 800 / 65536) < 1e-3)()")


@pytest.mark.req("CDFF-SUP-166")
def test_the_page_has_no_errors_and_loads_nothing_from_other_hosts(page: Browser) -> None:
    page.value("1")
    errors = [t for t in page.events if t.get("method") == "Runtime.exceptionThrown"]
    assert errors == []
    urls = [
        t["params"]["request"]["url"] for t in page.events if t.get("method") == "Network.requestWillBeSent"
    ]
    assert urls
    assert all(url.startswith(("http://127.0.0.1:", "data:", "blob:http://127.0.0.1:")) for url in urls)


def test_the_map_opens_in_a_frame_with_data_and_operations_can_be_tried(tmp_path: Path) -> None:
    with open_store(f"sqlite:///{tmp_path / 'store'}", ManualClock(100 * S)) as store:
        dpm = Dpm(store)
        value = elevation(0.0, frame="mana/map")
        dpm.writer.put(*put_arguments(value, "dem", 1, frame="mana/map", resolution_m=0.1))
        context = Context(dpm, Settings(store.directory, port=0))
        with HttpServer(context) as server, open_page(server.port, tmp_path / "browser") as page:
            page.eventually("document.getElementById('map-frame')?.value === 'mana/map'")
            page.eventually(f"(async () => await {DRAWN_FRACTION} > 0)()")
            page.send("Page.navigate", url=f"http://127.0.0.1:{server.port}/docs")
            page.eventually("document.querySelectorAll('details').length > 20")
            operation = (
                "[...document.querySelectorAll('details')].find((d) => "
                "d.innerText.includes('/api/v1/products'))"
            )
            page.value(f"{operation}.open = true")
            page.eventually(f"{operation}.querySelector('form') !== null")
            page.value(f"{operation}.querySelector('[name=limit]').value = '1'")
            page.value(f"{operation}.querySelector('form').requestSubmit()")
            page.eventually(
                f"/limit=1\\n200[^]*mana.map/.test({operation}.querySelector('.answer').textContent)"
            )


def test_with_access_keys_configured_the_page_asks_for_a_key_and_works_with_it(
    dpm: Dpm, tmp_path: Path
) -> None:
    keys = tmp_path / "keys"
    keys.write_text(f"{hashlib.sha256(b'sesame').hexdigest()} reader anna\n")
    context = Context(dpm, Settings(dpm.store.directory, port=0, keys_file=keys))
    with HttpServer(context) as server, open_page(server.port, tmp_path / "browser") as page:
        page.eventually("document.getElementById('key')?.open")
        assert page.value("document.querySelectorAll('.card').length") == 0
        page.value(
            "document.querySelector('#key input').value = 'sesame'; document.querySelector('#key "
            "button').click()"
        )
        page.eventually("document.querySelectorAll('.card').length >= 3")
        page.eventually("[...document.images].filter((i) => i.naturalWidth > 1).length >= 3")
        page.eventually("document.getElementById('live')?.dataset.state === 'live'")
        assert "sesame" not in page.value("document.documentElement.outerHTML")


def test_tracked_objects_are_drawn_as_plots_and_the_range_from_when_it_is_known(tmp_path: Path) -> None:
    with open_store(f"sqlite:///{tmp_path / 'store'}", ManualClock(100 * S)) as store:
        dpm = Dpm(store)

        def put(second: int, range_m: float) -> None:
            track = bearing_track(second, 6.27 + 0.01 * second, range_m)
            dpm.writer.put(*put_arguments(track, "track", second, frame="inertial"))

        for second in range(4):
            put(second, float("nan"))
        context = Context(dpm, Settings(store.directory, port=0))
        with HttpServer(context) as server, open_page(server.port, tmp_path / "browser") as browser:
            browser.eventually("document.querySelectorAll('.plot svg').length === 2")
            quantities = "[...document.querySelectorAll('.plot svg')].map((s) => s.dataset.quantity).join()"
            assert browser.value(quantities) == "azimuth,elevation"
            assert "target (1) of mana" in browser.value("document.getElementById('tracks').innerText")
            for second in range(4, 8):
                put(second, 300.0 - second)
            browser.eventually(f"{quantities} === 'azimuth,elevation,range'")
            label = "document.querySelector('[data-quantity=\"range\"]').getAttribute('aria-label')"
            browser.eventually(f"{label} === 'range from 296 to 293 m'")
            # A circle per state; the azimuth passes a full circle without a step.
            circles = "document.querySelectorAll('[data-quantity=\"azimuth\"] circle').length"
            assert browser.value(circles) == 8
            azimuth = "document.querySelector('[data-quantity=\"azimuth\"]').getAttribute('aria-label')"
            first, last = (float(word) for word in browser.value(azimuth).split() if word[0].isdigit())
            assert 3.8 < last - first < 4.2
            assert browser.value("document.documentElement.scrollWidth <= window.innerWidth")


#: A job of each state and form of region, as the orchestrator lists them.
JOBS = {
    "jobs": [
        {"state": "waiting", "region": "circle:3,1,2", "type": "dem"},
        {"state": "waiting", "region": "box:0,0,-1,2,1,1", "type": "pointcloud"},
        {"state": "planning", "region": "path:0.5,0,0,4,0,4,3", "type": "dem"},
        {"state": "waiting", "region": "near:mana/base,5", "type": "dem"},
        {"state": "waiting", "region": "bbox:0,0,1,1", "region_frame": "mana/base", "type": "dem"},
        {"state": "done", "region": "polygon:0,0,1,0,1,1", "type": "navigation_map"},
        {"state": "waiting", "region": "circle:0,0,1", "region_frame": "elsewhere", "type": "dem"},
        {"state": "waiting", "region": None, "type": "pose"},
    ],
    "scheduled": [{"state": "scheduled", "region": "circle:-3,-1,1", "type": "dem"}],
}


def test_goals_of_requests_are_drawn_with_their_state_in_the_frame_of_the_map(page: Browser) -> None:
    """The region of a request in the frame of the robot is drawn at the robot, which is at x = 2 m."""
    jobs = {
        name: [
            {
                "job": str(i),
                "state": job["state"],
                "accepted_ns": "0",
                "opened_ns": None,
                "ended_ns": None,
                "request": {"robot": "mana", "frame": "site", "region_frame": None} | job,
            }
            for i, job in enumerate(listed)
        ]
        for name, listed in JOBS.items()
    }
    page.value(f"""(() => {{
      window.realFetch = window.fetch;
      window.fetch = async (path, options) => path === 'api/v1/requests'
        ? new Response(JSON.stringify({json.dumps(jobs)}), {{ status: 200 }})
        : window.realFetch(path, options);
      look(1, 1, 17);
      readOverlay();
    }})()""")
    try:
        page.eventually("document.querySelectorAll('#map .goal').length === 7")
        assert page.value("document.querySelectorAll('#map .goal.open').length") == 6
        assert page.value("document.querySelectorAll('#map .goal.open .goal-mark').length") == 6
        assert page.value("document.querySelector('#map .goal.ended').dataset.state") == "done"
        assert page.value("document.querySelectorAll('#map .goal.ended .goal-mark').length") == 0
        texts = page.value("[...document.querySelectorAll('#map .goal text')].map((t) => t.textContent)")
        assert sorted(texts) == [
            "dem of mana, planning",
            "dem of mana, scheduled",
            "dem of mana, waiting",
            "dem of mana, waiting",
            "dem of mana, waiting",
            "pointcloud of mana, waiting",
        ]
        circles = page.value(
            "[...document.querySelectorAll('#map .goal circle')].map((c) => "
            "[+c.getAttribute('cx') - view().clientWidth / 2, "
            "view().clientHeight / 2 - c.getAttribute('cy'), "
            "+c.getAttribute('r')].map((px) => +(px * cell()).toFixed(3)))"
        )
        # Middle relative to that of the map, and radius, metres
        assert sorted(circles) == [[-4.0, -2.0, 1.0], [1.0, -1.0, 5.0], [2.0, 0.0, 2.0]]
        corridor = "document.querySelector('#map .request-corridor')"
        assert page.value(f"+{corridor}.getAttribute('stroke-width')") == pytest.approx(10.0)
        moved = "[...document.querySelectorAll('#map .goal polygon')].map((p) => p.getAttribute('points'))"
        (corner,) = page.value("[[2, 0]].map((p) => pixel(p).map((v) => v.toFixed(1)).join(','))")
        assert [corner in points.split(" ")[:1] for points in page.value(moved)].count(True) == 1
    finally:
        page.value("window.fetch = window.realFetch; readOverlay()")
    page.eventually("document.querySelectorAll('#map .goal').length === 0")


def test_tracked_objects_are_on_the_map_and_in_the_list_with_the_errors_of_their_positions(
    tmp_path: Path,
) -> None:
    """The track is in the frame of the robot, which moves from x = 2 m to x = 3 m."""
    with open_store(f"sqlite:///{tmp_path / 'store'}", ManualClock(100 * S)) as store:
        dpm = Dpm(store)
        dpm.writer.put(*put_arguments(elevation(0.0), "dem", 1, resolution_m=0.1))
        for second in (2, 3):
            dpm.writer.put(*put_arguments(pose(second, float(second)), "pose", second, child="mana/base"))
            track = pose_track([second], [[1.0, 1.0, 0.0]], frame="mana/base")
            dpm.writer.put(*put_arguments(track, "track", second, frame="mana/base"))
        context = Context(dpm, Settings(store.directory, port=0))
        with HttpServer(context) as server, open_page(server.port, tmp_path / "browser") as browser:
            browser.eventually("document.querySelectorAll('#map .track').length === 1")
            browser.value("look(4, 1, 17)")
            browser.eventually("document.getElementById('map-scale').innerText.includes('10 cm')")
            path = "document.querySelector('#map .track .path').getAttribute('points').split(' ')"
            xs = browser.value(f"{path}.map((p) => +p.split(',')[0] - view().clientWidth / 2)")
            assert xs == pytest.approx([-10.0, 0.0], abs=0.1)
            assert (
                browser.value("document.querySelector('#map .track text').textContent")
                == "boulder, confirmed"
            )
            # Variances in site: x 0.04 + 0.01 + 0.01, y 0.09 + 0.01 + 0.01, covariance -0.01 m²
            ellipse = "document.querySelector('#map .track .error-ellipse')"
            axes = browser.value(
                f"['rx', 'ry'].map((name) => +{ellipse}.getAttribute(name) * cell() / SIGMAS)"
            )
            assert axes == pytest.approx([0.3343, 0.2413], abs=1e-3)
            # In the list, positions are in the frame of the track.
            text = browser.value("document.querySelector('.plot .numbers').innerText")
            assert text == "x 1.00 ± 0.20 y 1.00 ± 0.30 z 0.00 ± 0.20 m in mana/base"
            quantities = "[...document.querySelectorAll('.plot svg')].map((s) => s.dataset.quantity).join()"
            assert browser.value(quantities) == "x,y,z"
            # A time between the two states shows the first.
            browser.value("map.timeMs = 2500; drawOverlay()")
            assert browser.value(f"{path}.length") == 1
            for width in (360, 2560):
                browser.send(
                    "Emulation.setDeviceMetricsOverride",
                    width=width,
                    height=800,
                    deviceScaleFactor=1,
                    mobile=False,
                )
                browser.eventually(f"innerWidth === {width}")
                assert browser.value("document.documentElement.scrollWidth") <= width


def test_the_scripts_of_the_page_are_small_and_run_under_a_policy_without_exceptions(page: Browser) -> None:
    answer = page.value("fetch('/').then((a) => a.headers.get('Content-Security-Policy'))")
    assert "unsafe" not in answer
    assert "default-src 'none'" in answer or "default-src 'self'" in answer
    files = Path(__file__).parents[2] / "services" / "dpm" / "http" / "static"
    sizes = [len(zlib.compress(file.read_bytes(), 6)) for file in files.iterdir()]
    assert sum(sizes) < 250_000
