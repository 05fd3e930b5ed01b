# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The operations of the DPM, called by Zenoh handlers and HTTP routes."""

from __future__ import annotations

from typing import Any

from cdff_common.clock import Clock
from cdff_common.contract.names import GROUND
from cdff_common.loops import Loops
from dpm_store import Store
from dpm_store.history.events import CHANGES, check_robot
from services.alarms import Alarms
from services.dpm.operations.alarm_board import AlarmBoard
from services.dpm.operations.checks import FrameNames
from services.dpm.operations.event_publisher import EventPublisher
from services.dpm.operations.frame_operations import FrameOperations
from services.dpm.operations.reports import Reports
from services.dpm.operations.retrieval import Retrieval
from services.dpm.operations.store_writer import StoreWriter
from services.dpm.operations.terrain import Terrain
from services.dpm.operations.withdrawal import Withdrawal
from services.dpm.operations.work_budget import WorkBudget
from services.dpm.rendering.conversion_cache import ConversionCache
from services.dpm.rendering.tiles import Tiles
from services.identity_alarm import IdentityAlarm

#: Kinds of events that this process publishes on the bus; others are only stored.
OWN_EVENTS = frozenset(CHANGES)


class Dpm:
    """Operations on a store, by group.

    Parameters
    ----------
    store : Store
    max_payload_bytes : int
        Larger insertions are refused.

    Attributes
    ----------
    alarms : Alarms
        Active alarms of the DPM.
    alarm_board : AlarmBoard
        Active alarms of all services.
    identity_alarm : IdentityAlarm
        Alarm of callers over HTTP without a known key.
    loops : Loops
        Threads of this process; one that does not work ends it.
    budget : WorkBudget
        Memory of the requests of all interfaces.
    conversions : ConversionCache
        Payloads in file formats.
    """

    def __init__(self, store: Store, max_payload_bytes: int = 256 << 20) -> None:
        self.store = store
        self.alarms = Alarms()
        self.alarm_board = AlarmBoard(self.alarms, store)
        self.loops = Loops()
        self.identity_alarm = IdentityAlarm(self.alarms, "http")
        self.budget = WorkBudget()
        frame_names = FrameNames(store)
        self.events = EventPublisher(store)
        self.writer = StoreWriter(
            store, self.events, frame_names, max_payload_bytes, self.alarms, self.budget
        )
        self.retrieval = Retrieval(store, self.events, frame_names, self.budget)
        self.terrain = Terrain(store, self.retrieval)
        self.withdrawal = Withdrawal(store, self.events)
        self.frames = FrameOperations(store, self.events)
        self.reports = Reports(store, self.events, self.alarm_board, self.loops)
        self.tiles = Tiles(store)
        self.conversions = ConversionCache(store.directory)

    def acknowledge(self, kind: str, source: str) -> dict[str, Any]:
        """Acknowledge an active alarm and return it; see ``AlarmBoard.acknowledge``."""
        check_robot(GROUND)
        alarm = self.alarm_board.acknowledge(kind, source)
        self.writer.record(GROUND, "alarm", alarm | {"alarm": kind, "active": True})
        return alarm

    @property
    def clock(self) -> Clock:
        """Mission clock."""
        return self.store.clock
