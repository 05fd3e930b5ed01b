# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import pytest

from cdff_common import cli


@pytest.mark.parametrize("item", ["mana", "=tcp/127.0.0.1:7448", "mana="])
def test_a_via_option_without_robot_or_endpoint_is_refused(
    item: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["play", "log", "--via", item]) == 1
    assert "expected ID=ENDPOINT" in capsys.readouterr().err
