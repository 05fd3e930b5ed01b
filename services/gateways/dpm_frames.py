# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixed frames of the DPM, with which the transforms of a robot are compared."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

import numpy as np

from cdff_common.bus import Bus, keys
from cdff_common.errors import CdffError
from cdff_common.geometry import UncertainTransform
from services.gateways.frames import FixedFrame, FrameTree

#: Interval of the queries after the first answer and before it, time of one, and time after which the thread
#: counts as hung, seconds.
_PERIOD_S, _FIRST_PERIOD_S, _CALL_S, _BUSY_S = 5.0, 0.5, 5.0, 60.0


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
            return None if stop.wait(period_s) else True

        def update(_: bool) -> None:
            nonlocal period_s
            is_known = self.update() or period_s == _PERIOD_S
            period_s = _PERIOD_S if is_known else _FIRST_PERIOD_S

        thread = threading.Thread(target=loop.run, args=(wait, update), name=loop.name, daemon=True)
        thread.start()

    def update(self) -> bool:
        """Ask once, and return whether the DPM has answered; without an answer the tree keeps its frames."""
        try:
            frames = self._bus.call(self._key, {}, timeout_s=_CALL_S).body()["frames"]
        except CdffError:  # no DPM answers
            return False
        else:
            self._tree.update_dpm({entry["frame"]: _fixed_frame(entry) for entry in frames})
            return True


def _fixed_frame(entry: Mapping[str, Any]) -> FixedFrame:
    """Return a frame of the answer of the DPM."""
    covariance = entry["covariance"]
    return FixedFrame(
        entry["parent"],
        UncertainTransform(np.array(entry["T"]), None if covariance is None else np.array(covariance)),
    )
