# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarms of certificates that expire soon: their links close at that time."""

from __future__ import annotations

import json
import logging
from datetime import UTC, datetime
from pathlib import Path

from services.alarms import Alarms, Severity

logger = logging.getLogger(__name__)

_KIND = "certificate_expires"


def check_expiry(path: Path, alarms: Alarms, now: datetime | None = None) -> None:
    """Set an alarm for each identity in a file of `cdff keys` whose newest certificate expires soon."""
    try:
        identities = json.loads(path.read_text())
        times = {n: [datetime.fromisoformat(t) for t in pair] for n, pair in identities.items()}
    except (OSError, ValueError, TypeError, AttributeError) as error:
        logger.error("%s: %s; the expiry of certificates is not watched", path, error)
        return
    time = now or datetime.now(UTC)
    for alarm in alarms.active():
        if alarm.kind == _KIND and alarm.source not in times:  # revoked
            alarms.clear(_KIND, alarm.source)
    for name, (warned_from, expires) in times.items():
        if time < warned_from:
            alarms.clear(_KIND, name)
            continue
        alarms.set(
            _KIND,
            name,
            Severity.CRITICAL if time >= expires else Severity.WARNING,
            f"the certificate of {name} expires at {expires.isoformat()}",
            f"issue it again with `cdff keys`, and copy its folder to {name}",
        )
