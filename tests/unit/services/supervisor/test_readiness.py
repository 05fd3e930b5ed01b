# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The supervisor announces once that all services are ready."""

from __future__ import annotations

from services.supervisor.plan import ProcessSpec
from services.supervisor.readiness import Readiness, expected_tokens, ready_line

SPECS = (
    ProcessSpec("router", (), {}, (("ground", "router"),)),
    ProcessSpec("dpm", (), {}, (("ground", "dpm"),)),
    ProcessSpec("mapping", (), {}, (("mana", "mapping"), ("mana", "stereo"))),
)


def test_readiness_is_announced_once_when_the_last_service_is_alive() -> None:
    announced: list[None] = []
    tokens = sorted(expected_tokens(SPECS))
    readiness = Readiness(tokens, lambda: announced.append(None))
    for token in ("cdff/@v1/other/@alive/x", *tokens[:-1]):
        readiness(token, True)
    assert not announced
    readiness(tokens[-1], True)
    readiness(tokens[-1], False)
    readiness(tokens[-1], True)
    assert len(announced) == 1


def test_the_line_has_the_url_of_the_dpm_and_the_router() -> None:
    line = ready_line(SPECS, "tcp/127.0.0.1:7447", "0.0.0.0:8080", is_secure=False)
    assert line.startswith("ready: 4 services, http://127.0.0.1:8080/, router tcp/127.0.0.1:7447")
    assert "http" not in ready_line(SPECS[2:], "tcp/127.0.0.1:7447", "127.0.0.1:8080", is_secure=True)
