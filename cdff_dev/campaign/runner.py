# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Execution of the units of a campaign, and the table of their results."""

from __future__ import annotations

import json
import re
import shutil
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from cdff_common.errors import InputError, UnavailableError
from cdff_common.extras import import_extra
from cdff_dev.campaign.units import RESULT, Unit, run_unit

#: Number of workers that may end while they execute the same unit; one more is taken as a fault of the unit.
_ALLOWED_FAILURES = 3
#: Longest waiting times for the scheduler and for its first worker, seconds.
_CONNECT_S, _WORKERS_S = 20.0, 20.0
TABLE = "results.parquet"

OnResult = Callable[[dict[str, Any]], object]


def run_campaign(
    units: Sequence[Unit],
    folder: Path,
    *,
    dask: str | None = None,
    timeout_s: float = 3600.0,
    on_result: OnResult = lambda _: None,
) -> list[dict[str, Any]]:
    """Run units and return their results in order; units that succeeded in ``folder`` are not run again.

    Parameters
    ----------
    folder : Path
        Folder of the results; with Dask, a folder that all workers can access.
    dask : str, optional
        Address of the scheduler, such as ``tcp://10.0.0.1:8786``; by default the units run sequentially on
        this machine.
    timeout_s : float
        Largest duration of a unit, seconds.
    on_result : callable
        Called with each result when it is available.

    Raises
    ------
    InputError
        If two units have the same name, or the address is malformed.
    UnavailableError
        If the scheduler does not answer or has no workers, or several workers ended while they executed the
        same unit.
    """
    if len({unit.name for unit in units}) != len(units):
        raise InputError("campaign: two units have the same name")
    folder.mkdir(parents=True, exist_ok=True)
    for abandoned in folder.glob(".*.*"):
        shutil.rmtree(abandoned, ignore_errors=True)
    for unit in units:
        if _has_failed(folder / unit.name):
            shutil.rmtree(folder / unit.name)
    run = _in_order if dask is None else _on_dask
    results = {}
    for result in run(units, str(folder.resolve()), timeout_s, dask or ""):
        results[result["name"]] = result
        on_result(result)
    return [results[unit.name] for unit in units]


def write_table(results: Iterable[Mapping[str, Any]], path: Path) -> None:
    """Write a Parquet table with a row for each unit: labels, exit code, times, and ``summary`` as JSON."""
    pyarrow, parquet = import_extra("pyarrow"), import_extra("pyarrow.parquet")
    rows = [
        {
            "name": result["name"],
            **{f"label_{name}": str(value) for name, value in result["labels"].items()},
            **{name: result[name] for name in ("exit_code", "wall_s", "cpu_s", "error")},
            "summary": json.dumps(result["summary"]),
        }
        for result in results
    ]
    part = path.with_name(path.name + ".part")
    parquet.write_table(pyarrow.Table.from_pylist(rows), part)
    part.replace(path)


def _has_failed(folder: Path) -> bool:
    """Return whether the folder of a unit contains the result of a failure."""
    path = folder / RESULT
    return path.is_file() and json.loads(path.read_text(encoding="utf-8"))["exit_code"] != 0


def _in_order(units: Sequence[Unit], folder: str, timeout_s: float, _: str) -> Iterator[dict[str, Any]]:
    for unit in units:
        yield run_unit(unit, folder, timeout_s)


def _on_dask(units: Sequence[Unit], folder: str, timeout_s: float, address: str) -> Iterator[dict[str, Any]]:
    distributed = import_extra("distributed")
    if not re.fullmatch(r"(?:[a-z]+://)?[^\s/]+:\d{1,5}", address):
        raise InputError(f"{address!r}: expected the address of a scheduler of Dask, tcp://HOST:PORT")
    try:
        client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UnavailableError(f"{address}: no scheduler of Dask answers: {error}") from error
    campaign = uuid.uuid4().hex  # a scheduler takes tasks of two campaigns with the same key for one task
    with client:
        try:
            client.wait_for_workers(1, timeout=_WORKERS_S)
        except TimeoutError as error:
            raise UnavailableError(f"{address}: the scheduler of Dask has no workers; start one") from error
        futures = [
            client.submit(
                run_unit,
                unit,
                folder,
                timeout_s,
                key=f"cdff-{unit.name}-{campaign}",
                pure=False,
                retries=_ALLOWED_FAILURES,
            )
            for unit in units
        ]
        try:
            for future in distributed.as_completed(futures, loop=client.loop):
                yield future.result()
        except distributed.KilledWorker as error:
            raise UnavailableError(f"a unit ended its workers: {error}") from error
        finally:
            client.cancel(futures)
