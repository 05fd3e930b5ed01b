# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The memory budget of the requests of all interfaces."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest
from fastapi.testclient import TestClient

from cdff_common.errors import OverloadedError
from services.dpm.operations.dpm import Dpm
from services.dpm.operations.store_writer import _insertion_bytes
from services.dpm.operations.work_budget import WorkBudget
from tests.integration.conftest import wait_until


def test_a_request_is_refused_while_others_use_the_memory_and_admitted_afterwards() -> None:
    budget = WorkBudget(100, wait_s=0.05)
    with budget.request():
        budget.charge(60)
        with pytest.raises(OverloadedError) as refused, budget.request():
            budget.charge(60)
        assert refused.value.retry_after_s > 0
        with budget.request():
            budget.charge(40)
    with budget.request():
        budget.charge(60)
    assert budget.refused == 1


def test_a_waiting_request_continues_when_memory_is_released() -> None:
    budget = WorkBudget(100, wait_s=10.0)
    admitted = threading.Event()

    def wait() -> None:
        with budget.request():
            budget.charge(80)
            admitted.set()

    with budget.request():
        budget.charge(80)
        waiting = threading.Thread(target=wait)
        waiting.start()
        assert not admitted.wait(0.05)
        budget.keep(10)
        assert admitted.wait(10.0)
    waiting.join()


def test_requests_are_admitted_in_order_and_insertions_first() -> None:
    budget = WorkBudget(100, wait_s=30.0)
    order: list[str] = []

    def start(name: str, nbytes: int, *, is_insertion: bool = False) -> threading.Thread:
        def run() -> None:
            with budget.request():
                budget.charge(nbytes, is_insertion=is_insertion)
                order.append(name)

        waiting = sum(map(len, budget._queues.values()))
        thread = threading.Thread(target=run)
        thread.start()
        wait_until(lambda: sum(map(len, budget._queues.values())) > waiting, what=f"{name} waits")
        return thread

    with budget.request():
        budget.charge(70)
        threads = [start("read", 50), start("small read", 10), start("product", 60, is_insertion=True)]
        assert order == []  # the small read would fit, but the others came before it
    for thread in threads:
        thread.join(30.0)
    assert order[0] == "product"
    assert sorted(order[1:]) == ["read", "small read"]  # both fit at once


def test_an_insertion_waits_beside_the_most_waiting_reads_and_a_refused_request_lets_others_pass() -> None:
    budget = WorkBudget(100, max_waiting=1, wait_s=0.3)
    refused: list[str] = []
    admitted = threading.Event()

    def charge(name: str, nbytes: int, *, is_insertion: bool) -> None:
        with budget.request():
            try:
                budget.charge(nbytes, is_insertion=is_insertion)
                admitted.set()
            except OverloadedError:
                refused.append(name)

    with budget.request():
        budget.charge(70)
        read = threading.Thread(target=charge, args=("read", 80), kwargs={"is_insertion": False})
        read.start()
        wait_until(lambda: bool(budget._queues[False]), what="the read waits")
        charge("second read", 10, is_insertion=False)
        assert refused == ["second read"]
        charge("product", 20, is_insertion=True)
        assert admitted.is_set()
        read.join(30.0)
        assert refused == ["second read", "read"]
        charge("third read", 10, is_insertion=False)
    assert len(refused) == budget.refused == 2


def test_a_request_larger_than_the_budget_is_carried_out_alone() -> None:
    budget = WorkBudget(100, wait_s=0.05)
    with budget.request():
        budget.charge(1000)
        with pytest.raises(OverloadedError), budget.request():
            budget.charge(1)


def test_only_a_few_requests_wait() -> None:
    budget = WorkBudget(100, max_waiting=0, wait_s=60.0)
    with budget.request():
        budget.charge(100)
        with pytest.raises(OverloadedError), budget.request():
            budget.charge(1)


def test_http_answers_503_without_memory(
    http: TestClient, dpm: Dpm, inserted_id: Callable[[str], str]
) -> None:
    payload = f"/api/v1/products/{inserted_id('dem')}/payload"
    assert http.get(f"{payload}?format=tif").status_code == 200
    url = f"{payload}?format=npz"
    dpm.budget._total, dpm.budget._wait_s = 1, 0.05
    with dpm.budget.request():
        dpm.budget.charge(1)
        answer = http.get(url)
    assert (answer.status_code, answer.json()["code"]) == (503, "OVERLOADED")
    assert int(answer.headers["Retry-After"]) >= 1
    assert http.get(url).status_code == 200
    assert http.get(f"{payload}?format=tif").status_code == 200  # from the cache of converted files


@pytest.mark.parametrize("layer", ["dem", "pointcloud"])
def test_a_request_that_takes_too_long_ends_and_names_the_part_that_is_done(
    http: TestClient,
    inserted_id: Callable[[str], str],
    monkeypatch: pytest.MonkeyPatch,
    layer: str,
) -> None:
    inserted_id(layer)
    url = f"/api/v1/maps/{layer}/window?format=npz"
    with monkeypatch.context() as limit:
        limit.setattr("services.dpm.operations.work_budget.LONGEST_S", -1.0)
        answer = http.get(url)
    assert http.get(url).status_code == 200
    assert (answer.status_code, answer.json()["code"]) == (503, "OVERLOADED")
    assert "0 of 1" in answer.json()["detail"]
    assert "ask for a smaller region" in answer.json()["detail"]
    assert int(answer.headers["Retry-After"]) == 30


def test_the_memory_of_an_insertion_includes_the_decoded_value_of_payloads_up_to_16_mib() -> None:
    assert _insertion_bytes(1000) == 5000
    assert _insertion_bytes(16 * 2**20) == 80 * 2**20
    assert _insertion_bytes(16 * 2**20 + 1) == 16 * 2**20 + 1
