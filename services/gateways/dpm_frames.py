# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixed frames of the DPM, with which the transforms of a robot are compared."""

from __future__ import annotations

import threading
from contextlib import suppress

from cdff_common.bus import Bus, keys
from cdff_common.errors import CdffError
from services.gateways.frames import FrameTree

#: Interval of the queries, time of one, and time after which the thread counts as hung, seconds.
_PERIOD_S, _CALL_S, _BUSY_S = 5.0, 5.0, 60.0


class DpmFrames:
    """Thread that takes the fixed frames of the DPM into a tree, while a DPM answers.

    Parameters
    ----------
    bus : Bus
    robot : str
        Scope under which the DPM is asked.
    tree : FrameTree
    """

    def __init__(self, bus: Bus, robot: str, tree: FrameTree) -> None:
        self._bus, self._key, self._tree = bus, keys.dpm_rpc(robot, "frames"), tree

    def start(self, stop: threading.Event) -> None:
        """Ask at once, then periodically, until ``stop`` is set."""
        loop = self._bus.loops.add("frames of the DPM", _BUSY_S)
        period_s = 0.0

        def wait() -> bool | None:
            nonlocal period_s
            is_stopped, period_s = stop.wait(period_s), _PERIOD_S
            return None if is_stopped else True

        thread = threading.Thread(
            target=loop.run, args=(wait, lambda _: self.update()), name=loop.name, daemon=True
        )
        thread.start()

    def update(self) -> None:
        """Ask once; without an answer the tree keeps the last frames."""
        with suppress(CdffError):  # no DPM answers
            frames = self._bus.call(self._key, {}, timeout_s=_CALL_S).body()["frames"]
            self._tree.update_dpm({entry["frame"]: entry["parent"] for entry in frames})
