# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures of all tests, and the hook that records which test verified which requirement."""

from __future__ import annotations

import fcntl
import json
import os
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).resolve().parent.parent
TRACEABILITY = ROOT / "build" / "traceability.json"
SEED = 20180717

# No time limit for a single example; every run tries the same examples.
settings.register_profile(
    "cdff", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("cdff")

_OUTCOMES = pytest.StashKey[dict[str, dict[str, object]]]()


@pytest.fixture(scope="session")
def real_data() -> Callable[[str], Path]:
    """``real_data("kitti_stereo/KITTI_sequence_1") -> Path``; skips the test if the data set is absent."""
    root = Path(os.environ.get("CDFF_DATA") or ROOT.parent / "shared" / "data")

    def find(relative: str) -> Path:
        path = root / relative
        if not path.exists():
            pytest.skip(f"real data {relative} not found; set CDFF_DATA to the folder that holds it")
        return path

    return find


@pytest.fixture
def rng() -> np.random.Generator:
    """A seeded random generator, new for each test."""
    return np.random.default_rng(SEED)


@pytest.fixture(autouse=True)
def _seeds() -> None:
    """Seed the global generators that third-party code draws from."""
    random.seed(SEED)
    np.random.seed(SEED)  # noqa: NPY002  for libraries that use the global generator


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_OUTCOMES] = {}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Pass the requirement ids to the reports: workers of pytest-xdist send properties, but no markers."""
    for item in items:
        for marker in item.iter_markers("req"):
            item.user_properties.extend(("req", requirement) for requirement in marker.args)


class _Recorder:
    """Collects the outcome of every test that names a requirement."""

    def __init__(self, config: pytest.Config) -> None:
        self._outcomes = config.stash[_OUTCOMES]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        requirements = [value for key, value in report.user_properties if key == "req"]
        if not requirements or (report.when != "call" and report.outcome == "passed"):
            return
        if self._outcomes.get(report.nodeid, {}).get("outcome") != "failed":
            self._outcomes[report.nodeid] = {"requirements": requirements, "outcome": report.outcome}


def pytest_sessionstart(session: pytest.Session) -> None:
    if not hasattr(session.config, "workerinput"):
        session.config.pluginmanager.register(_Recorder(session.config), "cdff-traceability")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Merge this run's outcomes with those of earlier runs of the same build."""
    outcomes = session.config.stash[_OUTCOMES]
    if hasattr(session.config, "workerinput") or not outcomes:
        return
    TRACEABILITY.parent.mkdir(exist_ok=True)
    with TRACEABILITY.with_suffix(".lock").open("w") as lock:  # two parts of a run may end at the same time
        fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            earlier = json.loads(TRACEABILITY.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            earlier = {}
        TRACEABILITY.write_text(json.dumps(earlier | outcomes, indent=1, sort_keys=True), encoding="utf-8")
