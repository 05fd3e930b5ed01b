# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``python -m services.dpm --data-dir DIR --http 127.0.0.1:8080 [--profile FILE]``: the DPM process."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Sequence

from cdff_common.bus import Bus, keys
from cdff_common.errors import StorageError
from cdff_common.geodesy import Anchor, Body, body
from cdff_common.heartbeat import add_check
from cdff_common.interfaces.profile import Profile, load_profile
from cdff_common.process import run_service
from dpm_store import Store, open_store
from dpm_store.engine.disk_space import RESERVE_BYTES
from services.alarm_reporter import AlarmReporter
from services.dpm.bus.recorder import Recorder, rules_of_history
from services.dpm.bus.retention import rules_of
from services.dpm.bus.service import serve
from services.dpm.bus.service_monitor import ServiceMonitor
from services.dpm.operations.condition_monitor import ConditionMonitor
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings, parse_settings
from services.memory_budget import memory_budget_mb, memory_check

logger = logging.getLogger(__name__)


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until SIGTERM."""
    return run_service("dpm", lambda stop: run(arguments, stop))


def run(arguments: Sequence[str] | None, stop: threading.Event) -> None:
    """Wait for the router, open the store, serve HTTP and the bus until stopped."""
    from services.dpm.http.context import Context
    from services.dpm.http.server import HttpServer

    settings = parse_settings(arguments)
    for noisy in ("alembic", "uvicorn", "uvicorn.error"):
        logging.getLogger(noisy).setLevel(logging.WARNING)
    profile = load_profile(settings.profile) if settings.profile is not None else None
    with Bus.open(settings.connect, name="dpm", wait_s=None, stop=stop) as bus:
        clock = bus.mission_clock
        with open_store(settings.store_url, clock, reserve_bytes=RESERVE_BYTES, new=settings.new) as store:
            dpm = Dpm(store, settings.max_body_bytes)
            add_check(lambda: "; ".join(filter(None, (dpm.loops.problem(), bus.loops.problem()))))
            check = memory_check(dpm.alarms, "dpm", memory_budget_mb())
            reporter = AlarmReporter(bus, keys.GROUND, "dpm", dpm.alarms, dpm.loops.add("alarms"), (check,))
            if profile is not None:
                enter_profile(store, profile)
            watch = ServiceMonitor(bus, dpm)
            with HttpServer(Context(dpm, settings, bus, watch, profile)):
                serve(bus, dpm, served_robots(profile, store), rules_of(profile) + rules_of_history(profile))
                recorder = None if profile is None else Recorder(bus, dpm, profile)
                logger.info("serving", extra=_addresses(settings, store))
                warming = threading.Thread(target=_warm, name="warm", daemon=True)
                warming.start()
                conditions = ConditionMonitor(dpm)
                stop.wait()
                conditions.close()
            reporter.close()
            bus.close()  # before the store is closed
            if recorder is not None:
                recorder.flush()
    if warming.is_alive():  # a compiler cannot be interrupted
        logging.shutdown()
        os._exit(0)


def served_robots(profile: Profile | None, store: Store) -> tuple[str, ...]:
    """Return the robots for which the DPM answers calls: those of the profile, else those with products."""
    if profile is not None:
        return profile.robot_ids
    return tuple(sorted({robot for robot, _ in store.statistics().products} - {"ground"}))


def enter_profile(store: Store, profile: Profile) -> None:
    """Add a profile like ``anchor``; on a full disk the store is served as it is."""
    try:
        anchor(store, profile)
    except StorageError as error:
        logger.error("the profile is not entered in the store: %s", error)


def anchor(store: Store, profile: Profile) -> None:
    """Add a profile's robots, fixed frames and anchored sites; frames that the store already has are
    not changed.
    """
    known = {revision.frame for revision in store.frames.current()}
    for frame, site in profile.body.anchors.items():
        if frame not in known:
            location = Anchor(body_of(profile), site.lon_deg, site.lat_deg, site.height_m, site.azimuth_deg)
            store.anchors.anchor(
                frame,
                location,
                sigma_m=site.sigma_m,
                sigma_deg=site.sigma_deg,
                producer=f"profile/{profile.name}",
            )
    for robot in profile.robots:
        description = robot.model_dump(mode="json", include={"sensors", "limits"})
        description["dfpcs"] = [entry.name for entry in robot.dfpcs]
        store.robots.describe(robot.id, robot.doc, description)
        graph = robot.frame_graph()
        for frame in graph.frames:
            parent = graph.parent_of(frame)
            if parent is not None and frame not in known:
                store.frames.set(
                    frame, parent, graph.lookup(parent, frame, 0), producer=f"profile/{profile.name}"
                )


def body_of(profile: Profile) -> Body:
    """Return the body of a profile: from the registry, unless the profile defines it."""
    b = profile.body
    if b.crs is None and b.radii_m is None:
        return body(b.name)
    radii = None if b.radii_m is None else list(b.radii_m)
    return Body.from_dict(
        {"name": b.name, "kind": b.kind, "crs": b.crs, "radii_m": radii, "source": profile.name}
    )


def _warm() -> None:
    """Load the codecs before the first product arrives."""
    from cdff_common.codecs.warm import warm_wire

    warm_wire()


def _addresses(settings: Settings, store: Store) -> dict[str, object]:
    return {"http": f"{settings.host}:{settings.port}", "data_dir": str(store.directory)}


if __name__ == "__main__":
    raise SystemExit(main())
