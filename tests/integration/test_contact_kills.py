# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Killed processes, closing windows, wrong clocks and full disks during an exchange over a lossy link."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cdff_dev.contact.seeded_run import seeded_run
from cdff_dev.contact.simulated_link import Direction
from cdff_dev.contact.two_stores import GROUND_SIDE, ROBOT_SIDE, TwoStores
from tests.integration.conftest import fill_disk

pytestmark = pytest.mark.slow
SEED = 1
CLOUD = 21
EVERYTHING = list(range(22))
_LIMIT_S = 90.0


def lossy(rate_bit_s: float = 2e6, loss: float = 0.02) -> dict[str, Any]:
    """Return both directions of a link with a delay of 50 ms."""
    return {"down": Direction(rate_bit_s, 0.05, loss), "up": Direction(rate_bit_s / 2.0, 0.05, loss)}


def received(both: TwoStores) -> int:
    """Return the bytes that the process of the ground has received."""
    count: int = both.call(GROUND_SIDE, "status")["bytes_received"]
    return count


def has_alarm(both: TwoStores, kind: str) -> bool:
    """Return whether an alarm of the process of the ground is active."""
    return kind in both.call(GROUND_SIDE, "alarms")


def assert_identical(both: TwoStores) -> None:
    """Assert that the ground has every product of the robot once, with the same payload."""
    expected = both.call(ROBOT_SIDE, "digests")
    assert both.call(GROUND_SIDE, "digests") == expected
    assert both.call(GROUND_SIDE, "insertions") == len(expected)


def wait_until_complete(both: TwoStores) -> None:
    """Wait until the ground has as many products as the robot, and the robot has their acknowledgements."""

    def is_complete() -> bool:
        insertions = [both.call(side, "insertions") for side in (ROBOT_SIDE, GROUND_SIDE)]
        return insertions[0] == insertions[1] and not both.call(ROBOT_SIDE, "status")["backlog"]

    both.wait_for(is_complete, _LIMIT_S, "the end of the exchange")


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_lost_wrong_or_stored_twice_with_kills_outages_and_loss(tmp_path: Path, seed: int) -> None:
    run = seeded_run(tmp_path, seed, cycles=2, window_s=10.0)
    assert (run.lost, run.wrong, run.twice) == (0, 0, 0)
    assert run.resent < 0.25, run


@pytest.mark.parametrize("side", [GROUND_SIDE, ROBOT_SIDE])
def test_after_kill_9_a_transfer_continues_at_the_offset(tmp_path: Path, side: str) -> None:
    with TwoStores(tmp_path, [(0.0, 300.0)], **lossy(1e6)) as both:
        both.start(ROBOT_SIDE, GROUND_SIDE)
        both.call(ROBOT_SIDE, "put", seed=SEED, numbers=[CLOUD])
        size = both.call(ROBOT_SIDE, "item_bytes")
        both.begin()
        both.wait_for(lambda: received(both) > size // 2, _LIMIT_S, "half of the transfer")
        before = received(both)
        both.kill(side)
        both.restart(side)
        wait_until_complete(both)
        assert_identical(both)
        after = both.call(side, "status")["bytes_received" if side == GROUND_SIDE else "bytes_sent"]
        assert after < 1.1 * (size - before) + 60_000


def test_a_product_that_was_stored_but_not_reported_before_kill_9_is_reported_afterwards(
    tmp_path: Path,
) -> None:
    # The link loses no packets, because the robot sends lost ones again only after a report.
    with TwoStores(tmp_path, [(0.0, 300.0)], **lossy(loss=0.0)) as both:
        both.start(ROBOT_SIDE, GROUND_SIDE)
        (cloud,) = both.call(ROBOT_SIDE, "put", seed=SEED, numbers=[CLOUD])
        size = both.call(ROBOT_SIDE, "item_bytes")
        both.begin()
        both.wait_for(lambda: received(both) > 0.9 * size, _LIMIT_S, "most of the transfer")
        both.link.cut_up()  # no report reaches the robot
        both.wait_for(lambda: cloud in both.call(GROUND_SIDE, "digests"), _LIMIT_S, "the arrival")
        both.kill(GROUND_SIDE)
        both.link.restore()
        both.restart(GROUND_SIDE)
        wait_until_complete(both)
        assert_identical(both)


def test_the_exchange_continues_if_the_ledger_of_the_ground_was_removed(tmp_path: Path) -> None:
    with TwoStores(tmp_path, [(0.0, 300.0)], **lossy()) as both:
        both.start(ROBOT_SIDE, GROUND_SIDE)
        both.call(ROBOT_SIDE, "put", seed=SEED, numbers=[CLOUD])
        both.begin()
        both.wait_for(lambda: received(both) > 50_000, _LIMIT_S, "the first packets")
        both.kill(GROUND_SIDE)
        for file in (tmp_path / GROUND_SIDE).glob("exchange.sqlite*"):
            file.unlink()
        both.restart(GROUND_SIDE)
        wait_until_complete(both)
        assert_identical(both)


def test_a_product_is_completed_in_the_second_window(tmp_path: Path) -> None:
    with TwoStores(tmp_path, [(0.0, 4.0), (8.0, 300.0)], **lossy(5e5)) as both:
        both.start(ROBOT_SIDE, GROUND_SIDE)
        (cloud,) = both.call(ROBOT_SIDE, "put", seed=SEED, numbers=[CLOUD])
        size = both.call(ROBOT_SIDE, "item_bytes")
        both.begin(1.0)
        both.wait_for(lambda: both.now_s > 5.0, _LIMIT_S, "the end of the window")
        in_first = received(both)
        assert 0 < in_first < size
        assert cloud not in both.call(GROUND_SIDE, "digests")
        wait_until_complete(both)
        assert both.now_s > 8.0
        assert_identical(both)
        assert both.call(ROBOT_SIDE, "status")["bytes_sent"] < 1.1 * size + 20_000


def test_a_robot_whose_clock_is_an_hour_off_loses_nothing_and_raises_an_alarm(tmp_path: Path) -> None:
    with TwoStores(tmp_path, [(0.0, 20.0), (3600.0, 3900.0)], **lossy()) as both:
        both.start(GROUND_SIDE)
        both.start(ROBOT_SIDE, options=["--clock-offset-s", "3630"])
        both.call(ROBOT_SIDE, "put", seed=SEED, numbers=EVERYTHING)
        both.begin()
        wait_until_complete(both)
        assert_identical(both)
        assert has_alarm(both, "contact_clock")


def test_a_window_without_a_packet_of_the_robot_raises_an_alarm_that_the_next_contact_ends(
    tmp_path: Path,
) -> None:
    with TwoStores(tmp_path, [(0.0, 2.0), (5.0, 300.0)], **lossy()) as both:
        both.start(GROUND_SIDE)
        both.begin(0.5)
        both.wait_for(lambda: has_alarm(both, "contact_missed"), _LIMIT_S, "the alarm")
        both.restart(ROBOT_SIDE)
        both.wait_for(lambda: not has_alarm(both, "contact_missed"), _LIMIT_S, "the end of the alarm")


def test_on_a_full_disk_of_the_ground_products_wait_and_arrive_when_there_is_space(
    tmp_path: Path, small_disk: Path
) -> None:
    (tmp_path / GROUND_SIDE).symlink_to(small_disk)
    with TwoStores(tmp_path, [(0.0, 300.0)], **lossy()) as both:
        both.start(ROBOT_SIDE, GROUND_SIDE)
        both.begin()
        ballast = fill_disk(small_disk)
        both.call(ROBOT_SIDE, "put", seed=SEED, numbers=EVERYTHING)
        both.wait_for(lambda: has_alarm(both, "contact_storage"), _LIMIT_S, "the alarm of the disk")
        both.wait_for(lambda: both.call(ROBOT_SIDE, "status")["backlog"], _LIMIT_S, "the backlog")
        assert both.call(GROUND_SIDE, "insertions") == 0
        ballast.unlink()
        wait_until_complete(both)
        assert_identical(both)
        both.wait_for(lambda: not has_alarm(both, "contact_storage"), _LIMIT_S, "the end of the alarm")
