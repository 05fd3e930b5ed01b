# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Start of the viewer: without a display the alternatives are named at once; no usage statistics are sent."""

from __future__ import annotations

import sys
from typing import Any

import pytest

from cdff_common.errors import UnavailableError
from cdff_dev.view import outputs

pytest.importorskip("rerun")


class StartedError(Exception):
    """The viewer was started."""


def start(monkeypatch: pytest.MonkeyPatch, *, web: bool) -> dict[str, str]:
    """Return the environment of the viewer that ``rerun_viewer`` starts."""
    environments: list[dict[str, str]] = []

    def started(*_: Any, env: dict[str, str], **__: Any) -> None:
        environments.append(env)
        raise StartedError

    monkeypatch.setattr(outputs.subprocess, "Popen", started)
    with pytest.raises(StartedError):
        outputs.rerun_viewer(web=web)
    return environments[0]


@pytest.mark.skipif(sys.platform != "linux", reason="other systems name no display")
def test_without_a_display_the_window_is_refused_with_the_alternatives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(UnavailableError, match=r"no display.*use --web, or --save NAME\.rrd"):
        outputs.rerun_viewer()


def test_the_viewer_sends_no_usage_statistics_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RERUN_ANALYTICS", raising=False)
    assert start(monkeypatch, web=True)["RERUN_ANALYTICS"] == "0"
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setenv("RERUN_ANALYTICS", "1")
    assert start(monkeypatch, web=False)["RERUN_ANALYTICS"] == "1"
