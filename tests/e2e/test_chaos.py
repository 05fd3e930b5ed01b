# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A mission under random disturbances for two minutes keeps its promises."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.chaos.campaign import run

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(900)]


def test_nothing_is_lost_duplicated_or_unanswered_and_no_alarm_is_missed(tmp_path: Path) -> None:
    summary = run(tmp_path, minutes=2.0, seed=3)
    assert summary["violations"] == []
    assert summary["products"]["promised"] > 50
    assert summary["requests"]["outcomes"]["result"] > 10
    assert summary["alarms"]["refused_identity"]["expected"] > 0
