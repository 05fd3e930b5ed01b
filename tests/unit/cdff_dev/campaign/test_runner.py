# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from cdff_common.errors import InputError, UnavailableError
from cdff_dev.campaign.runner import run_campaign, write_table
from cdff_dev.campaign.units import RESULT, Unit
from cdff_dev.ports import free_port

ROOT = Path(__file__).resolve().parents[4]
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


def test_names_are_unique_and_a_missing_scheduler_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="same name"):
        run_campaign([Unit("a", (), {}), Unit("a", (), {})], tmp_path)


@pytest.mark.slow
def test_two_workers_of_dask_one_of_them_killed_lose_and_repeat_no_result(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed: pip install 'cdff[campaign]'")
    address = f"tcp://127.0.0.1:{free_port()}"
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "10s"}

    def start(*arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{arguments[0]}", *arguments[1:]]
        return subprocess.Popen(command, env=environment, cwd=tmp_path, start_new_session=True)

    options = ("--nworkers", "1", "--nthreads", "1", "--no-dashboard", "--no-nanny")
    scheduler = start("dask_scheduler", "--port", address.rpartition(":")[2], "--no-dashboard")
    workers = [
        start("dask_worker", address, *options, "--local-directory", str(tmp_path / str(i))) for i in (0, 1)
    ]
    log, folder = tmp_path / "log", tmp_path / "out"
    results: list[dict[str, Any]] = []

    def on_result(result: dict[str, Any]) -> None:
        results.append(result)
        if len(results) == 4:
            os.killpg(workers[0].pid, signal.SIGKILL)

    try:
        campaign = units(log, 12, pause_s=0.5)
        deadline_s = time.monotonic() + 60.0
        while True:
            try:
                returned = run_campaign(campaign, folder, dask=address, on_result=on_result)
                break
            except UnavailableError:
                assert time.monotonic() < deadline_s
    finally:
        for process in (*workers, scheduler):
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
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
