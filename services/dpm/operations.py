# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the DPM does, whoever asks: Zenoh handlers and HTTP routes are thin covers of these."""

from __future__ import annotations

from dpm_store import Store
from dpm_store.events import CHANGES
from services.dpm.accounts import Accounts
from services.dpm.delivering import Delivering
from services.dpm.placing import Placing
from services.dpm.tiles import Tiles
from services.dpm.writing import Writing

#: Events that this process makes and publishes; others it only keeps.
OWN_EVENTS = frozenset(CHANGES)


class Dpm(Writing, Delivering, Placing, Accounts):
    """Operations on a store.

    Parameters
    ----------
    store : Store
    max_payload_bytes : int
        Larger insertions are refused.
    """

    def __init__(self, store: Store, max_payload_bytes: int = 256 << 20) -> None:
        super().__init__(store, max_payload_bytes)
        self.tiles = Tiles(store)
