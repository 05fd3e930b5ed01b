# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
import threading
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from cdff_common.errors import InputError, UnavailableError
from cdff_dev.campaign import runner
from cdff_dev.campaign.runner import run_campaign, write_table
from cdff_dev.campaign.units import RESULT, Unit
from tests.support.dask_cluster import DaskCluster

#: Writes its number into a log that all units share, and into its summary.
PROGRAM = (
    "import json, pathlib, sys, time; number, log, out, pause = sys.argv[1:];"
    "open(log, 'a').write(f'start {number}\\n'); time.sleep(float(pause));"
    "pathlib.Path(out, 'summary.json').write_text(json.dumps({'number': int(number)}));"
    "open(log, 'a').write(f'end {number}\\n')"
)


def units(log: Path, count: int, pause_s: float = 0.0) -> list[Unit]:
    path = log.with_name("program.py")
    path.write_text(PROGRAM)
    return [
        Unit(f"unit_{i}", (str(path), str(i), str(log), "{out}", str(pause_s)), {"seed": i})
        for i in range(count)
    ]


def numbers(results: list[dict[str, Any]]) -> list[int]:
    return [result["summary"]["number"] for result in results]


def test_units_with_a_result_do_not_run_again(tmp_path: Path) -> None:
    log, folder = tmp_path / "log", tmp_path / "out"
    assert numbers(run_campaign(units(log, 2), folder)) == [0, 1]
    (folder / ".unit_2.abandoned").mkdir()
    assert numbers(run_campaign(units(log, 3), folder)) == [0, 1, 2]
    assert Counter(log.read_text().splitlines())["start 0"] == 1
    assert sorted(path.name for path in folder.iterdir()) == ["unit_0", "unit_1", "unit_2"]


def test_a_failed_and_an_endless_unit_do_not_end_the_campaign(tmp_path: Path) -> None:
    (tmp_path / "sleep.py").write_text("import time; time.sleep(60)")
    failing = Unit("failing", ("-m", "no_such_module"), {})
    endless = Unit("endless", (str(tmp_path / "sleep.py"),), {})
    first, second = run_campaign([failing, endless], tmp_path / "out", timeout_s=3.0)
    assert first["exit_code"] == 1
    assert "no_such_module" in first["error"]
    assert second["exit_code"] == -1


def test_only_the_failed_units_of_a_campaign_run_again(tmp_path: Path) -> None:
    log, folder = tmp_path / "log", tmp_path / "out"
    good, bad = units(log, 2)
    failing = Unit(bad.name, ("-m", "no_such_module"), bad.labels)
    assert [result["exit_code"] for result in run_campaign([good, failing], folder)] == [0, 1]
    assert numbers(run_campaign([good, bad], folder)) == [0, 1]
    assert Counter(log.read_text().splitlines()) == {"start 0": 1, "end 0": 1, "start 1": 1, "end 1": 1}


def test_two_units_with_the_same_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="same name"):
        run_campaign([Unit("a", (), {}), Unit("a", (), {})], tmp_path)


@pytest.mark.parametrize("address", ["nonsense", "tcp://host", "tcp://a b:1", ":8786/x"])
def test_a_malformed_address_of_a_scheduler_is_refused_at_once(tmp_path: Path, address: str) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed: pip install 'cdff[campaign]'")
    with pytest.raises(InputError, match="tcp://HOST:PORT"):
        run_campaign([Unit("a", (), {})], tmp_path, dask=address)


@pytest.mark.slow
def test_a_missing_scheduler_and_one_without_workers_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed: pip install 'cdff[campaign]'")
    monkeypatch.setattr(runner, "_WORKERS_S", 1.0)
    cluster = DaskCluster(tmp_path, workers=0)
    try:
        with pytest.raises(UnavailableError, match="has no workers; start one"):
            run_campaign([Unit("a", (), {})], tmp_path, dask=cluster.address)
    finally:
        cluster.close()
    monkeypatch.setattr(runner, "_CONNECT_S", 2.0)
    with pytest.raises(UnavailableError, match="no scheduler of Dask answers"):
        run_campaign([Unit("a", (), {})], tmp_path, dask=cluster.address)


@pytest.mark.slow
def test_two_campaigns_with_units_of_the_same_names_have_their_own_results_on_one_scheduler(
    cluster: DaskCluster, tmp_path: Path
) -> None:
    folders, results = [tmp_path / "a", tmp_path / "b"], {}

    def run(folder: Path) -> None:
        folder.mkdir()
        campaign = units(folder / "log", 4, pause_s=0.3)
        results[folder] = run_campaign(campaign, folder / "out", dask=cluster.address)

    threads = [threading.Thread(target=run, args=(folder,)) for folder in folders]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for folder in folders:
        assert numbers(results[folder]) == [0, 1, 2, 3]
        assert Counter(folder.joinpath("log").read_text().splitlines()).keys() >= {"start 0", "end 3"}
        assert len(list(folder.glob(f"out/*/{RESULT}"))) == 4


@pytest.mark.slow
def test_two_workers_of_dask_one_of_them_killed_lose_and_repeat_no_result(
    cluster: DaskCluster, tmp_path: Path
) -> None:
    log, folder = tmp_path / "log", tmp_path / "out"
    results: list[dict[str, Any]] = []

    def on_result(result: dict[str, Any]) -> None:
        results.append(result)
        if len(results) == 4:
            cluster.kill_worker()

    campaign = units(log, 12, pause_s=0.5)
    returned = run_campaign(campaign, folder, dask=cluster.address, on_result=on_result)
    assert numbers(returned) == list(range(12))
    assert Counter(result["name"] for result in results) == {unit.name: 1 for unit in campaign}
    assert len({result["pid"] for result in results}) == 2
    stored = [json.loads((folder / unit.name / RESULT).read_text()) for unit in campaign]
    assert stored == returned
    ends = Counter(line for line in log.read_text().splitlines() if line.startswith("end"))
    assert set(ends.values()) == {1}


def test_the_table_has_a_row_for_each_unit(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    results = run_campaign(units(tmp_path / "log", 2), tmp_path / "out")
    write_table(results, tmp_path / "results.parquet")
    table = parquet.read_table(tmp_path / "results.parquet").to_pylist()
    assert [(row["name"], row["label_seed"], row["exit_code"]) for row in table] == [
        ("unit_0", "0", 0),
        ("unit_1", "1", 0),
    ]
    assert json.loads(table[1]["summary"]) == {"number": 1}
