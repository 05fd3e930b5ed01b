# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarm of a sensor whose data no longer agree with its calibration or its stated mount."""

from __future__ import annotations

from collections.abc import Iterable

from cdff_common.interfaces.product import Quality
from services.alarms import Alarms, Severity

_KIND = "calibration_drift"
#: Reasons of products: the rows of image pairs differ by more than those of rectified pairs do, or the
#: estimated mount of a sensor differs from the stated one by more than its stated sigma allows.
_REASONS = frozenset({"row_offset", "row_error", "camera_roll", "camera_yaw_change", "mount_error"})
#: Products in a row with such a reason, or without it, after which the alarm begins or ends.
PRODUCTS = 10


class CalibrationMonitor:
    """Count of products in a row that state a wrong calibration of their sensor.

    Attributes
    ----------
    reason : str
        The last of these reasons; empty if the calibration agrees.
    """

    def __init__(self) -> None:
        self.reason = ""
        self._count = 0

    def add(self, qualities: Iterable[Quality]) -> None:
        """Add the qualities of new products."""
        for quality in qualities:
            reason = next((r for r in quality.reasons if r.partition(":")[0] in _REASONS), "")
            if bool(reason) == bool(self.reason):
                self._count = 0
                self.reason = reason
                continue
            self._count += 1
            if self._count >= PRODUCTS:
                self._count, self.reason = 0, reason


def set_calibration_alarm(alarms: Alarms, source: str, monitor: CalibrationMonitor) -> None:
    """Begin or end the alarm of a DFPC, ``robot/dfpc``."""
    if not monitor.reason:
        alarms.clear(_KIND, source)
        return
    problem = f"the data of the last {PRODUCTS} products do not agree with the calibration: {monitor.reason}"
    remedy = "calibrate the sensor again and enter the result in the profile"
    alarms.set(_KIND, source, Severity.WARNING, problem, remedy)
