# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The last line of ``cdff doctor``."""

from __future__ import annotations

from cdff_dev.doctor.checks import Finding
from cdff_dev.doctor.commands import conclusion


def test_the_last_line_states_whether_the_system_can_run() -> None:
    ok, warning, error = Finding("a", "ok", ""), Finding("b", "warning", ""), Finding("c", "error", "")
    assert conclusion([ok]) == "this machine can run the system"
    assert conclusion([ok, warning]) == "this machine can run the system; warnings: b"
    assert conclusion([ok, warning, error]) == "this machine cannot run the system: c; warnings: b"
