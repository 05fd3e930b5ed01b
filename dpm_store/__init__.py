# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The spatial product store as a library: the only SQL of the framework.

>>> from dpm_store import Query, open_store
>>> with open_store("sqlite:///data") as store:  # doctest: +SKIP
...     page = store.search(Query(types=("dem",), robot="mana"))
"""

from dpm_store.annotations import Annotation, StaleRevisionError
from dpm_store.events import Event
from dpm_store.frames import FrameRevision, Known
from dpm_store.poses import StampedPose, Track
from dpm_store.provenance import Lineage
from dpm_store.records import Insertion, MetricBound, Order, Page, Parcel, ProductRecord, Query
from dpm_store.retention import Plan, Verdict
from dpm_store.rules import Prefer, Rule
from dpm_store.store import Store, open_store
from dpm_store.transaction import Delete, Insert, Reanchor, Update

__all__ = [
    "Annotation", "Delete", "Event", "FrameRevision", "Insert", "Insertion", "Known", "Lineage", "MetricBound", "Order",
    "Page", "Parcel", "Plan", "Prefer", "ProductRecord", "Query", "Reanchor", "Rule", "StaleRevisionError",
    "StampedPose", "Store", "Track", "Update", "Verdict", "open_store",
]  # fmt: skip
