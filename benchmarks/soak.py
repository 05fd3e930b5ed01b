# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run a looped mission with requests, and report the memory, descriptors and threads of each service.

    python benchmarks/soak.py [--minutes 10] [--profile rover_traverse] [--log FILE] [--out FILE]
    python benchmarks/soak.py --read FILE

The rovers of the profile drive the same circles again and again (simulated data). The clock is held while a
DFPC lags, so that other load on the machine makes the mission slower, not different. Four clients send
requests to the orchestrator and read the DPM over HTTP.

For each service the report has the resident memory when it was ready, at the end of the first lap, at its
highest, as mean of the last tenth of the samples, and after the load. Slopes per hour are those of straight
lines through the second half of the samples of its last process. ``--log FILE`` also writes each sample as a
line of JSON, from which ``--read FILE`` makes a report. Ctrl-C ends the load early; the report follows.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import signal
import tempfile
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from _report import write_report
from _services import descriptors, fetch, memory_mb, threads

from cdff_common.bus import Bus
from cdff_common.client import Client
from cdff_common.errors import CdffError
from cdff_common.interfaces.profile import load_profile
from cdff_common.resources import resolve
from cdff_dev.logs import open_log
from cdff_dev.missions.stage import PATIENCE_S, Stage
from cdff_dev.play.looped_log import LoopedLog
from cdff_dev.play.player import Player
from cdff_dev.ports import free_port
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.store import simulated_log

#: Duration of a lap, seconds. Each rover rests at its start and at its end.
LAP_S = 42.0
#: Sampling period of the services, seconds, and pause of a client between two requests.
_PERIOD_S, _PAUSE_S = 5.0, 2.0
#: Time between the end of the load and the last measurement, seconds.
_SETTLE_S = 15.0
#: Longest time until all services are ready, seconds: the machine may have other load.
_READY_S = 900.0
_COLUMNS = ("memory_mb", "descriptors", "threads")


@dataclass(frozen=True, slots=True)
class Sample:
    """State of a service at a time since the start of the mission, seconds, after some laps."""

    t_s: float
    service: str
    pid: int
    memory_mb: float
    descriptors: int
    threads: int
    laps: float = 0.0


def services_of(supervisor_pid: int) -> Iterator[tuple[str, int]]:
    """Yield name and process id of each service."""
    for child in psutil.Process(supervisor_pid).children():
        try:
            line = child.cmdline()
        except psutil.Error:  # it has ended since it was listed
            continue
        if "-m" in line:
            yield line[line.index("--process" if "--process" in line else "-m") + 1], child.pid


def sample_all(supervisor_pid: int, t_s: float, laps: float) -> list[Sample]:
    """Return the state of all services."""
    samples = []
    for name, pid in services_of(supervisor_pid):
        try:
            values = memory_mb(pid), descriptors(pid), threads(pid)
        except FileNotFoundError:  # it has ended since it was listed
            continue
        samples.append(Sample(round(t_s, 1), name.removeprefix("services."), pid, *values, round(laps, 2)))
    return samples


def summary(samples: list[Sample]) -> dict[str, Any]:
    """Return the memory of a service at several times, its slopes per hour and the number of its restarts."""
    lap_end_s = next((s.t_s for s in samples if s.laps >= 1.0), samples[-1].t_s)
    rows = np.array([[s.t_s, s.memory_mb, s.descriptors, s.threads] for s in samples])
    memory = rows[:, 1]
    last = rows[[s.pid == samples[-1].pid for s in samples]]
    half = last[len(last) // 2 :]
    slopes = np.polyfit(half[:, 0] / 3600.0, half[:, 1:], 1)[0] if len(half) > 2 else np.full(3, np.nan)
    first_lap_mb = float(memory[np.searchsorted(rows[:, 0], lap_end_s).clip(max=len(rows) - 1)])
    last_mb = float(memory[-max(len(rows) // 10, 1) :].mean())
    return {
        "ready_mb": float(memory[0]),
        "first_lap_mb": first_lap_mb,
        "highest_mb": float(memory.max()),
        "last_mb": round(last_mb, 1),
        "last_to_first_lap": round(last_mb / first_lap_mb, 2),
        "slopes_per_hour": {n: round(float(v), 2) for n, v in zip(_COLUMNS, slopes, strict=True)},
        "restarts": len({s.pid for s in samples}) - 1,
    }


def requester(connect: str, robot: str, seed: int, stop: threading.Event, counts: Counter[str]) -> None:
    """Request products of a robot from the orchestrator until ``stop``."""
    rng, region = random.Random(seed), f"near:{robot}/base,5"
    with Client(connect) as client:
        while not stop.wait(_PAUSE_S):
            product, options = rng.choice(
                (
                    ("pose", {}),
                    ("trajectory", {}),
                    ("pointcloud", {"region": region}),
                    ("dem", {"region": region, "resolution_m": 0.05}),
                    ("navigation_map", {"region": region}),
                )
            )
            try:
                client.request(product, robot=robot, max_age_s=60.0, deadline_s=30.0, **options)
                counts[f"{product} answered"] += 1
            except CdffError as error:
                counts[f"{product} {type(error).__name__}"] += 1


def reader(http: str, seed: int, stop: threading.Event, counts: Counter[str]) -> None:
    """Read windows, tiles, lists and payloads of the DPM until ``stop``."""
    rng = random.Random(seed)
    while not stop.wait(_PAUSE_S / 2.0):
        x, y, side_m = rng.uniform(-14.0, 0.0), rng.uniform(-6.0, 8.0), rng.choice((5.0, 10.0, 20.0))
        box = f"bbox:{x:.2f},{y:.2f},{x + side_m:.2f},{y + side_m:.2f}"
        path = rng.choice(
            (
                f"api/v1/maps/dem/window?region={box}&resolution_m=0.05&format={rng.choice(('tif', 'png'))}",
                f"api/v1/maps/slope/window?region={box}",
                f"api/v1/maps/pointcloud/window?region=circle:{x:.2f},{y:.2f},10&points=200000",
                "api/v1/products?type=dem&limit=100",
                f"tiles/dem/12/{rng.randrange(2046, 2050)}/{rng.randrange(2046, 2050)}.png",
            )
        )
        try:
            counts[f"HTTP {fetch(f'{http}/{path}', 60.0)[0]}"] += 1
        except OSError as error:
            counts[f"HTTP {type(error).__name__}"] += 1


def circle_log(base: str) -> Path:
    """Return the log of one lap of the rovers of a scenario, each on a circle; simulate it if necessary."""
    scenario = load_scenario(base)
    robots = {}
    for name, path in scenario.robots.items():
        driven_s = LAP_S - path.rest_before_s - path.rest_after_s - path.ramp_s
        curvature = 2.0 * math.pi / (path.speed_m_s * driven_s)
        robots[name] = path.model_copy(update={"curvature_1pm": ((0.0, curvature), (1e4, curvature))})
    circles = {"name": f"{base}_laps", "robots": robots, "duration_s": LAP_S}
    return simulated_log(scenario.model_copy(update=circles))


@contextmanager
def load(stage: Stage, log: LoopedLog, robots: tuple[str, ...]) -> Iterator[tuple[Player, Counter[str]]]:
    """Play the log, send requests and read over HTTP while the context is open."""
    stop, counts = threading.Event(), Counter[str]()
    with Bus.open(stage.connect, name="player", wait_s=60.0) as bus:
        player = Player(bus, log, patience_s=PATIENCE_S)
        workers: list[Callable[[], object]] = [lambda: player.run(stop)]
        for number, robot in enumerate(robots):
            workers.append(lambda n=number, r=robot: requester(stage.connect, r, n, stop, counts))
            workers.append(lambda n=number: reader(f"http://{stage.http}", n, stop, counts))
        running = [threading.Thread(target=work, daemon=True) for work in workers]
        for thread in running:
            thread.start()
        try:
            yield player, counts
        finally:
            stop.set()
            for thread in running:
                thread.join(60.0)


def soak(name: str, minutes: float, folder: Path, on_sample: Callable[[Sample], None]) -> dict[str, Any]:
    """Run the mission for some minutes and return the report."""
    path = resolve("profiles", name)
    profile = load_profile(path)
    log = LoopedLog(open_log(circle_log(name)))
    stage = Stage(profile, path, f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}", data_dir=folder)
    samples: dict[str, list[Sample]] = defaultdict(list)
    interrupted, t_s, laps = threading.Event(), 0.0, 0.0
    signal.signal(signal.SIGINT, lambda *_: interrupted.set())
    with stage:
        with Bus.open(stage.connect, name="soak", wait_s=90.0) as bus:
            stage.wait_ready(bus, timeout_s=_READY_S)
        with load(stage, log, profile.robot_ids) as (player, counts):
            start_s = time.monotonic()
            while not interrupted.is_set() and (t_s := time.monotonic() - start_s) < 60.0 * minutes:
                laps = (player.now_ns() - player.start_ns) / 1e9 / LAP_S
                for sample in sample_all(stage.supervisor_pid, t_s, laps):
                    samples[sample.service].append(sample)
                    on_sample(sample)
                stage.check_running()
                interrupted.wait(_PERIOD_S)
            published, gated = player.progress.published, player.progress.gated
        time.sleep(_SETTLE_S)
        after_mb = {s.service: s.memory_mb for s in sample_all(stage.supervisor_pid, t_s, laps)}
    size_mb = {
        f.name: round(sum(p.stat().st_size for p in (f, *f.rglob("*")) if p.is_file()) / 1e6, 1)
        for f in sorted(folder.iterdir())
    }
    return {
        "profile": profile.name,
        "minutes": round(t_s / 60.0, 1),
        "laps": round(laps, 1),
        "samples_published": published,
        "samples_withheld": gated,
        "calls": dict(sorted(counts.items())),
        "services": {
            service: summary(rows) | {"after_mb": after_mb.get(service)} for service, rows in samples.items()
        },
        "data_folder_mb": size_mb,
    }


def read(log: Path) -> dict[str, Any]:
    """Return the report of the samples in a log."""
    samples: dict[str, list[Sample]] = defaultdict(list)
    for line in log.read_text(encoding="utf-8").splitlines():
        sample = Sample(**json.loads(line))
        samples[sample.service].append(sample)
    last = max((rows[-1] for rows in samples.values()), key=lambda sample: sample.t_s)
    services = {service: summary(rows) for service, rows in samples.items()}
    return {"minutes": round(last.t_s / 60.0, 1), "laps": last.laps, "services": services}


def main() -> None:
    """Run the mission and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--profile", default="rover_traverse", help="profile with a simulated scenario")
    parser.add_argument("--log", type=Path, help="file of all samples")
    parser.add_argument("--read", type=Path, help="report of the samples in this file; nothing is run")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    if args.read is not None:
        write_report(read(args.read), args.out)
        return

    def on_sample(sample: Sample) -> None:
        if args.log is not None:
            with args.log.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(sample)) + "\n")

    with tempfile.TemporaryDirectory(prefix="cdff-soak-") as folder:
        write_report(soak(args.profile, args.minutes, Path(folder), on_sample), args.out)


if __name__ == "__main__":
    main()
