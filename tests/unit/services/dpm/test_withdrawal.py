# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Withdrawal of bad maps: all maps change at once, and their history stays."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.contract.queries import WindowParameters, WithdrawalParameters
from cdff_common.errors import ConflictError, DeniedError, InputError, ProductNotFoundError
from cdff_common.raster.tiles import tiles_over
from dpm_store.history.events import Actor, acting
from services.dpm.operations.dpm import Dpm
from services.dpm.rendering.tiles import Tile, TileRequest

from .conftest import S, TestClient, elevation, navigation, put_arguments


def put(dpm: Dpm, height_m: float, second: int, robot: str = "mana") -> str:
    """Insert a flat patch; return its id."""
    value = elevation(0.0, height_m, t1_ns=second * S)
    arguments = put_arguments(value, "dem", second, robot, resolution_m=0.1)
    return dpm.writer.put(*arguments)[1].id


def withdraw(dpm: Dpm, **selection: object) -> dict[str, object]:
    """Withdraw products because of their height."""
    return dpm.withdrawal.run(WithdrawalParameters.parse({"reason": "1 m too high", **selection}))


def mean_m(dpm: Dpm, **parameters: object) -> float:
    """Return the mean height of a window of all maps."""
    window = dpm.retrieval.elevation(WindowParameters.parse({"choice": "pooled", **parameters}))
    return float(np.nanmean(window.map.layer("mean")))


def tile_m(dpm: Dpm) -> float:
    """Return the mean height of a tile."""
    columns, rows = tiles_over(17, (1.0, 1.0, 1.0, 1.0))
    tile = dpm.tiles.get(TileRequest("site", "elevation", Tile(17, columns[0], rows[0]), "bin"))
    return float(np.nanmean(np.frombuffer(tile.data, "<f4")))


def test_a_bad_robot_is_removed_from_all_maps_in_one_call(dpm: Dpm, clock: ManualClock) -> None:
    good = put(dpm, 0.0, 1)
    bad = [put(dpm, 1.0, second, "minnie") for second in (2, 3)]
    navigation_of_bad = put_arguments(navigation(), "navigation_map", 4, "minnie", inputs=(bad[0],))
    map_id = dpm.writer.put(*navigation_of_bad)[1].id
    assert (mean_m(dpm), tile_m(dpm)) == pytest.approx((2 / 3, 2 / 3))
    before_ns = clock.now_ns()
    clock.set_ns(before_ns + 10 * S)
    planned = withdraw(dpm, robot="minnie", dry_run=True)
    assert (planned["applied"], mean_m(dpm)) == (False, pytest.approx(2 / 3))
    result = withdraw(dpm, robot="minnie", reason="lost its localisation")
    assert sorted([*result["withdrawn"], *result["derived"]]) == sorted([*bad, map_id])  # type: ignore[misc]
    assert (mean_m(dpm), tile_m(dpm)) == pytest.approx((0.0, 0.0))
    assert mean_m(dpm, as_of=str(before_ns)) == pytest.approx(2 / 3)
    (entry,) = dpm.reports.history(0, 1000, ("withdrawn",))["items"]
    assert (entry["reason"], entry["scope"]) == ("lost its localisation", "minnie")
    assert sorted(entry["ids"]) == sorted(result["withdrawn"])  # type: ignore[call-overload]
    assert dpm.store.get(bad[0], deleted=True).header.t1_ns == 2 * S
    assert dpm.store.get(good).id == good
    with pytest.raises(ProductNotFoundError, match="no product is selected"):
        withdraw(dpm, robot="minnie")


def test_a_bad_patch_is_removed_with_the_windows_made_from_it(dpm: Dpm) -> None:
    put(dpm, 0.0, 1)
    bad = put(dpm, 1.0, 2)
    window = dpm.retrieval.window(WindowParameters.parse({}), form=_by_reference()).reference
    assert window is not None
    result = withdraw(dpm, id=bad)
    assert (result["withdrawn"], result["derived"]) == ([bad], [window])
    assert mean_m(dpm) == pytest.approx(0.0)


def _by_reference() -> object:
    from cdff_common.contract.queries import DeliveryParameters

    return DeliveryParameters.parse({"deliver": "reference"})


def test_maps_of_a_time_are_withdrawn(dpm: Dpm) -> None:
    ids = [put(dpm, float(second), second) for second in (1, 2, 3)]
    result = withdraw(dpm, robot="mana", t0=str(2 * S), t1=str(2 * S))
    assert result["withdrawn"] == [ids[1]]


def test_all_or_nothing_is_withdrawn(dpm: Dpm) -> None:
    ids = [put(dpm, 0.0, second) for second in (1, 2)]
    dpm.writer.update(ids[0], {"pinned": True}, 0)
    with pytest.raises(ConflictError, match="pinned"):
        withdraw(dpm, robot="mana")
    assert all(dpm.store.get(i) for i in ids)
    with acting(Actor("minnie", "robot", "zenoh")), pytest.raises(DeniedError):
        withdraw(dpm, id=ids[1])
    assert dpm.reports.history(0, 1000, ("withdrawn",))["items"] == []


def test_a_product_of_another_type_is_not_withdrawn_by_its_id(dpm: Dpm) -> None:
    bad = put(dpm, 1.0, 1)
    for types in ("navigation_map", "soil"):
        with pytest.raises(InputError, match=types):
            withdraw(dpm, id=bad, type=types)
    map_id = dpm.writer.put(*put_arguments(navigation(), "navigation_map", 2, inputs=(bad,)))[1].id
    result = withdraw(dpm, id=bad, type="dem")
    assert (result["withdrawn"], result["derived"]) == ([bad], [])
    assert dpm.store.get(map_id).id == map_id


def test_a_robot_does_not_withdraw_maps_of_others_that_were_made_from_its_own(dpm: Dpm) -> None:
    bad = put(dpm, 1.0, 1, "minnie")
    derived_arguments = put_arguments(navigation(), "navigation_map", 2, "mana", inputs=(bad,))
    dpm.writer.put(*derived_arguments)
    with acting(Actor("minnie", "robot", "zenoh")):
        for dry_run in (True, False):
            with pytest.raises(DeniedError, match="'mana'"):
                withdraw(dpm, id=bad, dry_run=dry_run)
        assert withdraw(dpm, id=bad, type="dem")["withdrawn"] == [bad]


@pytest.mark.parametrize(
    "selection",
    [
        {},
        {"robot": "any"},
        {"robot": "mana", "id": "x"},
        {"id": "x", "t0": "0"},
        {"robot": "mana", "type": "soil"},
    ],
)
def test_an_unclear_selection_is_refused(dpm: Dpm, selection: dict[str, str]) -> None:
    put(dpm, 0.0, 1)
    with pytest.raises(InputError):
        withdraw(dpm, **selection)
    with pytest.raises(InputError, match="reason"):
        WithdrawalParameters.parse({"robot": "mana"})


def test_a_withdrawal_over_http_is_for_operators(http: TestClient, dpm: Dpm) -> None:
    bad = put(dpm, 1.0, 1)
    answer = http.post("/api/v1/maps/withdrawals", json={"id": [bad], "reason": "too high"})
    assert answer.json() == {"withdrawn": [bad], "derived": [], "robots": ["mana"], "applied": True}
    assert http.post("/api/v1/maps/withdrawals", json={"reason": "x"}).status_code == 422
    assert http.post("/api/v1/maps/withdrawals", json={"id": ["gone"], "reason": "x"}).status_code == 404
