# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The operations of the DPM, called by Zenoh handlers and HTTP routes."""

from __future__ import annotations

from cdff_common.clock import Clock
from dpm_store import Store
from dpm_store.history.events import CHANGES
from services.alarms import Alarms
from services.dpm.operations.checks import FrameNames
from services.dpm.operations.event_publisher import EventPublisher
from services.dpm.operations.frame_operations import FrameOperations
from services.dpm.operations.reports import Reports
from services.dpm.operations.retrieval import Retrieval
from services.dpm.operations.store_writer import StoreWriter
from services.dpm.operations.work_budget import WorkBudget
from services.dpm.rendering.tiles import Tiles

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
    budget : WorkBudget
        Memory of the requests of all interfaces.
    """

    def __init__(self, store: Store, max_payload_bytes: int = 256 << 20) -> None:
        self.store = store
        self.alarms = Alarms()
        self.budget = WorkBudget()
        frame_names = FrameNames(store)
        self.events = EventPublisher(store)
        self.writer = StoreWriter(
            store, self.events, frame_names, max_payload_bytes, self.alarms, self.budget
        )
        self.retrieval = Retrieval(store, self.events, frame_names, self.budget)
        self.frames = FrameOperations(store, self.events)
        self.reports = Reports(store, self.events, self.alarms)
        self.tiles = Tiles(store)

    @property
    def clock(self) -> Clock:
        """Mission clock."""
        return self.store.clock
