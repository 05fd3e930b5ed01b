# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated missions: procedural terrain, ray-cast cameras and lidar, IMU, slipping wheels, ground truth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path


def cached_log(name: str, seed: int | None = None, progress: Callable[[str], None] | None = None) -> Path:
    """The folder of a scenario's log in the cache, simulated now where it is not there.

    Parameters
    ----------
    name : str
        A shipped scenario, or a scenario file.
    progress : callable, optional
        Told in words how far a simulation is, every tenth of the way.
    """
    from cdff_dev.simulate.scenario import load_scenario  # the command line asks for the name only
    from cdff_dev.simulate.store import simulated_log

    def tell(done: int, total: int) -> None:
        if progress is not None and (done == total or done * 10 // total != (done - 1) * 10 // total):
            progress(f"simulating {name}: {done} of {total} images and scans")

    return simulated_log(load_scenario(name, seed), progress=tell)
