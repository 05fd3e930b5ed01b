# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The supervisor restarts ended processes, ends all on request and leaves none running."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from cdff_common.bus import Bus, keys
from tests.integration.conftest import ROOT, Eventually

pytestmark = pytest.mark.integration

DRIVER = """
import sys
from pathlib import Path
from cdff_common.process import run_service
from services.supervisor.plan import ProcessSpec
from services.supervisor.supervisor import Supervisor
endpoint, log_dir = sys.argv[1], Path(sys.argv[2])
STUBBORN = "import signal, time; signal.signal(15, signal.SIG_IGN); time.sleep(60)"
specs = [
    ProcessSpec("router", (sys.executable, "-m", "services.router", "--listen", endpoint), {}, (("ground", "router"),)),
    ProcessSpec("stubborn", (sys.executable, "-c", STUBBORN), {}, ()),
]
raise SystemExit(run_service("supervisor", Supervisor(specs, log_dir).run))
"""


@pytest.fixture
def supervisor(endpoint: str, tmp_path: Path) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        [sys.executable, "-c", DRIVER, endpoint, str(tmp_path)], cwd=ROOT, start_new_session=True
    )
    yield process
    for child in [*children(process), process]:
        try:
            os.kill(child.pid, signal.SIGKILL)
        except ProcessLookupError:
            continue
    process.wait()


def children(process: subprocess.Popen[bytes]) -> list[psutil.Process]:
    try:
        return psutil.Process(process.pid).children()
    except psutil.NoSuchProcess:
        return []


def is_running(process: psutil.Process) -> bool:
    return process.is_running() and process.status() != psutil.STATUS_ZOMBIE


def router_is_alive(endpoint: str) -> Callable[[], bool]:
    def token_exists() -> bool:
        with Bus.open(endpoint, name="probe", wait_s=0.1) as bus:
            return keys.alive("ground", "router") in bus.alive(keys.alive("ground", "*"))

    def check() -> bool:
        from cdff_common.errors import UnavailableError

        try:
            return token_exists()
        except UnavailableError:
            return False

    return check


@pytest.mark.req("CDFF-SUP-041")
def test_a_killed_service_is_back_within_five_seconds(
    supervisor: subprocess.Popen[bytes], endpoint: str, eventually: Eventually
) -> None:
    eventually(router_is_alive(endpoint), timeout_s=20)
    (router,) = [c for c in children(supervisor) if "services.router" in c.cmdline()]
    router.send_signal(signal.SIGKILL)
    eventually(lambda: not is_running(router))
    eventually(router_is_alive(endpoint), timeout_s=5)
    (new_router,) = [c for c in children(supervisor) if "services.router" in c.cmdline()]
    assert new_router.pid != router.pid


@pytest.mark.slow
def test_sigterm_to_the_supervisor_ends_every_process_even_one_that_ignores_sigterm(
    supervisor: subprocess.Popen[bytes], endpoint: str, eventually: Eventually
) -> None:
    eventually(lambda: len(children(supervisor)) == 2, timeout_s=20)
    eventually(router_is_alive(endpoint), timeout_s=20)
    processes = children(supervisor)
    supervisor.terminate()
    assert supervisor.wait(8) == 0
    assert not [c for c in processes if is_running(c)]


def test_a_killed_supervisor_leaves_no_service_behind(
    supervisor: subprocess.Popen[bytes], endpoint: str, eventually: Eventually
) -> None:
    eventually(router_is_alive(endpoint), timeout_s=20)
    (router,) = [c for c in children(supervisor) if "services.router" in c.cmdline()]
    supervisor.kill()
    supervisor.wait()
    eventually(lambda: not is_running(router), timeout_s=5)
