# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A running DFPC is adjusted without the loss of a sample, and has the configuration of the profile
afterwards.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pytest

from cdff_common.errors import InputError, UnavailableError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Product
from cdff_common.interfaces.profile import DfpcEntry, Robot
from cdff_common.types import Pointcloud
from services.dfpc_host.lifecycle import Adjustment, DfpcLifeCycle, DfpcState


class Mapper(DfpcLifeCycle):
    """Elevation mapping that keeps its products."""

    def __init__(self) -> None:
        entry = DfpcEntry(
            name="digital_elevation_mapping",
            inputs={"cloud": "sensor/lidar/cloud"},
            parameters={"max_range_m": 10.0},
        )
        super().__init__(Robot(id="mana"), entry)
        self.products: list[Product] = []
        self.failures = 0

    def on_failure(self) -> None:
        self.failures += 1

    def publish(self, products: Sequence[Product]) -> None:
        self.products += products

    def take(self, stamp_s: float) -> None:
        """Queue a flat cloud and step it."""
        x, y = np.meshgrid(np.arange(-2.0, 2.0, 0.02), np.arange(-2.0, 2.0, 0.02))
        points = np.column_stack([x.ravel() + 3.0, y.ravel(), np.zeros(x.size)])
        stamp_ns = int(stamp_s * 1e9)
        cloud = Pointcloud.from_points(points, frame="site", stamp_ns=stamp_ns)
        assert self.runner is not None
        assert self.runner.push(Sample("cloud", stamp_ns, 0, cloud, frame="site"))

    def patches(self) -> list[float]:
        """Return the cell sizes of the published patches."""
        return [p.value.geometry.resolution_m for p in self.products if p.product == "dem" and p.value]


def active_mapper() -> Mapper:
    mapper = Mapper()
    mapper.configure()
    mapper.activate()
    return mapper


def test_queued_samples_are_mapped_in_the_old_cells_and_later_ones_in_the_new_cells() -> None:
    mapper = active_mapper()
    mapper.take(1.0)
    mapper.activate({}, Adjustment(None, {"resolution_m": 0.1}))
    assert mapper.patches() == [0.05]
    assert mapper.status()["adjusted"] == {"resolution_m": 0.1}
    mapper.take(2.0)
    mapper.activate({}, Adjustment(None, {"resolution_m": 0.1}))
    assert mapper.patches() == [0.05], "an equal adjustment changes nothing"
    mapper.deactivate()
    assert mapper.patches() == [0.05, 0.1]
    assert mapper.state is DfpcState.INACTIVE
    assert mapper.status()["adjusted"] == {}
    assert mapper.dfpc.config.resolution_m == 0.05
    assert mapper.status()["samples"] == 2
    ids = [p.header.id for p in mapper.products]
    assert len(set(ids)) == len(ids)


def test_a_live_parameter_changes_without_the_end_of_a_patch() -> None:
    mapper = active_mapper()
    mapper.take(1.0)
    dfpc = mapper.dfpc
    assert mapper.adjust(Adjustment(None, {"patch_period_s": 0.5})) is False
    assert mapper.dfpc is dfpc
    assert mapper.patches() == []
    assert dfpc.config.patch_period_s == 0.5
    assert mapper.runner is not None
    assert mapper.runner.pending == 1


@pytest.mark.parametrize(
    ("adjustment", "fault"),
    [
        (Adjustment("Radar"), "the profile admits Lidar"),
        (Adjustment("Stereo"), "the profile admits Lidar"),
        (Adjustment(None, {"align": 1.0}), "align is not adjustable; adjustable are resolution_m"),
        (Adjustment(None, {"resolution_m": 0.001}), r"resolution_m=0\.001: expected 0\.02 to 1"),
    ],
)
def test_an_adjustment_that_is_not_admitted_is_refused(adjustment: Adjustment, fault: str) -> None:
    mapper = active_mapper()
    with pytest.raises(InputError, match=fault):
        mapper.activate({}, adjustment)
    assert mapper.status()["adjusted"] == {}


def failing_mapper(monkeypatch: pytest.MonkeyPatch) -> Mapper:
    """Return a mapper with two queued samples; it makes a patch of the first one, and fails at the second."""
    mapper = active_mapper()
    step, stamps_ns = mapper.dfpc.step, []

    def step_or_fail(sample: Sample) -> Iterable[Output]:
        stamps_ns.append(sample.stamp_ns)
        if len(stamps_ns) == 2:
            raise ZeroDivisionError("a bug")
        return [*step(sample), *mapper.dfpc.finish()]

    monkeypatch.setattr(mapper.dfpc, "step", step_or_fail)
    for stamp_s in (1.0, 2.0):
        mapper.take(stamp_s)
    return mapper


def test_a_failure_at_a_queued_sample_is_an_error_state_after_the_products_before_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mapper = failing_mapper(monkeypatch)
    with pytest.raises(UnavailableError, match="digital_elevation_mapping: internal error"):
        mapper.activate({}, Adjustment(None, {"resolution_m": 0.1}))
    assert mapper.state is DfpcState.ERROR
    assert mapper.failures == 1
    assert mapper.patches() == [0.05]
    assert mapper.adjusted == {}


def test_a_failure_at_the_deactivation_is_an_error_state(monkeypatch: pytest.MonkeyPatch) -> None:
    mapper = failing_mapper(monkeypatch)
    mapper.deactivate()
    assert mapper.state is DfpcState.ERROR
    assert mapper.patches() == [0.05]


def test_an_inactive_dfpc_is_adjusted_without_products(monkeypatch: pytest.MonkeyPatch) -> None:
    mapper = Mapper()
    mapper.configure()
    monkeypatch.setattr(mapper.dfpc, "finish", lambda: pytest.fail("it is not active"))
    assert mapper.adjust(Adjustment(None, {"resolution_m": 0.1}))
    assert mapper.dfpc.config.resolution_m == 0.1


def test_a_dfpc_that_cannot_continue_the_state_starts_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    mapper = active_mapper()
    monkeypatch.setattr(mapper.dfpc, "state", lambda: "strange")
    reset, resets = type(mapper.dfpc).reset, list[object]()

    def count_and_reset(dfpc: Dfpc) -> None:
        resets.append(dfpc)
        reset(dfpc)

    monkeypatch.setattr(type(mapper.dfpc), "reset", count_and_reset)
    assert mapper.adjust(Adjustment(None, {"resolution_m": 0.1}))
    assert resets == [mapper.dfpc]
