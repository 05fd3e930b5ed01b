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
from services.dpm.operations.work_budget import WorkBudget


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
