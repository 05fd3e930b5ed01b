# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

from cdff_common.bus.identity import EXPIRY
from services.alarms import Alarms, Severity
from services.keys.access_control import Kind
from services.keys.mission_keys import MissionKeys
from services.router.expiry import check_expiry
from tests.support.identities import PROFILE


def test_a_certificate_in_the_last_part_of_its_validity_is_an_alarm_until_it_is_issued_again(
    tmp_path: Path,
) -> None:
    keys = MissionKeys.create(tmp_path, PROFILE, ())
    keys.issue("alice", Kind.OPERATOR, days=10)
    path, alarms = tmp_path / "ground" / EXPIRY, Alarms()
    now = datetime.now(UTC)
    check_expiry(path, alarms, now + timedelta(days=7))
    assert not alarms.active()
    check_expiry(path, alarms, now + timedelta(days=9))
    (alarm,) = alarms.active()
    assert (alarm.kind, alarm.source, alarm.severity) == ("certificate_expires", "alice", Severity.WARNING)
    keys.issue("alice", Kind.OPERATOR)
    check_expiry(path, alarms, now + timedelta(days=9))
    assert not alarms.active()
    check_expiry(path, alarms, now + timedelta(days=400))
    assert {alarm.severity for alarm in alarms.active()} == {Severity.CRITICAL}
    keys.revoke("alice")
    check_expiry(path, alarms, now)
    assert not alarms.active()


def test_an_unreadable_file_is_logged(tmp_path: Path) -> None:
    alarms = Alarms()
    check_expiry(tmp_path / EXPIRY, alarms)
    (tmp_path / EXPIRY).write_text('{"alice": 1}')
    check_expiry(tmp_path / EXPIRY, alarms)
    assert not alarms.active()
