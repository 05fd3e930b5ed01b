# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Full disks of the store and of the outboxes, with the alarms that they raise."""

from __future__ import annotations

import signal

from tests.chaos.disturbances.disturbance import Scene
from tests.chaos.mission import wait_until

_REPORTED_S = 30.0
#: Time in which the products in memory are written once the disk has space, seconds.
_WRITTEN_S = 15.0


def fill_store(scene: Scene) -> None:
    """Fill the disk of the DPM; products wait in the outboxes."""
    mission = scene.mission
    with mission.disks.full(mission.data):
        scene.oracle.expect_alarm(
            "disk_full", "dpm", lambda: mission.has_alarm("disk_full", "dpm"), _REPORTED_S
        )


def fill_spool(scene: Scene) -> None:
    """Fill the disk of the outboxes while the DPM is stopped, so that products wait in memory."""
    mission = scene.mission
    dpm = mission.process("dpm")
    with mission.disks.full(mission.disks.spool):
        if dpm is not None:
            dpm.send_signal(signal.SIGSTOP)
        try:
            scene.oracle.expect_alarm(
                "outbox_in_memory",
                "mana/understudy",
                lambda: mission.published_alarm("outbox_in_memory", "mana/understudy"),
                _REPORTED_S,
            )
        finally:
            if dpm is not None and dpm.is_running():
                dpm.send_signal(signal.SIGCONT)
    for robot, dfpc in (("mana", "understudy"), ("minnie", "troublemaker")):
        source = f"{robot}/{dfpc}"
        if not wait_until(lambda s=source: not mission.published_alarm("outbox_in_memory", s), _WRITTEN_S):
            scene.oracle.violate(
                f"{source}: products only in memory {_WRITTEN_S:g} s after the disk was free"
            )
