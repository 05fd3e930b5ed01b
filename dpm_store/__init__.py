# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The spatial product store as a library: the only SQL of the framework.

>>> from dpm_store import Query, open_store
>>> with open_store("sqlite:///data") as store:  # doctest: +SKIP
...     page = store.search(Query(types=("dem",), robot="mana"))
"""

from dpm_store.frames.frames import FrameRevision, HistoryView
from dpm_store.frames.poses import StampedPose, Track
from dpm_store.history.events import Event
from dpm_store.history.provenance import Lineage
from dpm_store.history.retention import RetentionDecision, RetentionPlan
from dpm_store.history.retention_rules import Rule
from dpm_store.products.annotations import Annotation, StaleRevisionError
from dpm_store.products.records import Insertion, MetricBound, NewProduct, Order, Page, ProductRecord, Query
from dpm_store.products.transaction import Delete, Reanchor, Update
from dpm_store.store import Store, open_store

__all__ = [
    "Annotation",
    "Delete",
    "Event",
    "FrameRevision",
    "HistoryView",
    "Insertion",
    "Lineage",
    "MetricBound",
    "NewProduct",
    "Order",
    "Page",
    "ProductRecord",
    "Query",
    "Reanchor",
    "RetentionDecision",
    "RetentionPlan",
    "Rule",
    "StaleRevisionError",
    "StampedPose",
    "Store",
    "Track",
    "Update",
    "open_store",
]
