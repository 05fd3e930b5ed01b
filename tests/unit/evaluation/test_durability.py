# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The oracle of the evaluation of crashes finds lost, resurrected, corrupt and partly stored products."""

from __future__ import annotations

import json

from evaluation.durability import Reports, findings
from evaluation.runs.durability_load import StoreProducts, payload, product


class Memory:
    """Products in memory."""

    def __init__(self, seqs: list[int]) -> None:
        self.payloads = {product(seq).header.id: payload(seq) for seq in seqs}

    def payload(self, product_id: str) -> bytes | None:
        return self.payloads.get(product_id)


def reports() -> Reports:
    """Two batches and one product are acknowledged, a batch only began; product 5 was deleted."""
    lines = [
        {"what": "put", "seqs": [1, 2, 3]},
        {"what": "stored", "seqs": [1, 2, 3]},
        {"what": "put", "seqs": [5]},
        {"what": "stored", "seqs": [5]},
        {"what": "delete", "seqs": [5]},
        {"what": "deleted", "seqs": [5]},
        {"what": "put", "seqs": [6, 7]},
    ]
    result = Reports()
    result.add([json.dumps(line) + "\n" for line in lines] + ['{"what": "stored", "seqs": [6'])
    return result


def counts(memory: Memory) -> list[int]:
    return list(findings(memory, reports()).values())  # type: ignore[arg-type]


def test_a_store_that_kept_all_acknowledged_changes_has_no_findings() -> None:
    assert counts(Memory([1, 2, 3])) == [0, 0, 0, 0]
    assert counts(Memory([1, 2, 3, 6, 7])) == [0, 0, 0, 0]


def test_each_kind_of_loss_is_found() -> None:
    assert counts(Memory([])) == [3, 0, 0, 0]
    assert counts(Memory([1, 2])) == [1, 0, 0, 1]
    assert counts(Memory([1, 2, 3, 5])) == [0, 1, 0, 0]
    assert counts(Memory([1, 2, 3, 7])) == [0, 0, 0, 1]
    damaged = Memory([1, 2, 3])
    damaged.payloads[product(2).header.id] = b"other"
    assert counts(damaged) == [0, 0, 1, 0]


def test_the_store_of_the_dpm_is_a_store_under_test(tmp_path) -> None:
    products = StoreProducts(str(tmp_path / "store"))
    products.put_all([product(1), product(2)])
    products.delete(product(2).header.id)
    assert products.payload(product(1).header.id) == payload(1)
    assert products.payload(product(2).header.id) is None
    products.close()
