# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Malformed messages, calls and clock ticks on the bus, from identities that may send them."""

from __future__ import annotations

import math
import time

from cdff_common.bus import keys
from cdff_common.errors import CdffError, NoAnswerError
from tests.chaos.disturbances.disturbance import Scene
from tests.chaos.mission import OPERATOR, PLAYER

_MESSAGES, _CALLS = 300, 60
_VERBS = ("put", "get", "search", "update", "delete", "pose", "frames", "transact", "put_all", "history")


def send_junk(scene: Scene) -> None:
    """Publish junk on the keys of sensors, and clock ticks that no clock has."""
    player, rng = scene.mission.bus(PLAYER), scene.rng
    for _ in range(_MESSAGES):
        robot = rng.choice(scene.mission.robots)
        player.publish(
            keys.sensor(robot, "wheels", "odometry"),
            rng.randbytes(rng.randrange(2000)),
            encoding=rng.choice(("", "application/vnd.cdff+uper;type=TransformWithCovariance", "x" * 200)),
            attachment=rng.randbytes(rng.randrange(100)),
        )
    for now_ns, rate in ((0, math.nan), (1 << 62, 1.0), (-1, math.inf), ("now", None)):
        player.publish_map(keys.CLOCK, {"now_ns": now_ns, "rate": rate})
    player.publish(keys.CLOCK, rng.randbytes(50))


def call_with_junk(scene: Scene) -> None:
    """Call the DPM and the orchestrator with random parameters and bodies; each call must be answered."""
    bus, rng = scene.mission.bus(OPERATOR), scene.rng
    for _ in range(_CALLS):
        verb = rng.choice(_VERBS)
        key = (
            keys.dpm_rpc("ground", verb) if rng.random() < 0.8 else keys.orchestrator_rpc("ground", "request")
        )
        names = rng.sample(
            ("type", "robot", "id", "t", "region", "limit", "frame", "since", "x"), rng.randrange(3)
        )
        parameters = {
            name: rng.choice(("", "1", "-1", "1e300", "nan", "[]", "mana", "dem", "\u2603", "a" * 5000))
            for name in names
        }
        request = scene.oracle.begin_request(f"junk for {verb}", 10.0)
        try:
            bus.call(key, parameters, payload=rng.randbytes(rng.randrange(200)), timeout_s=10)
        except NoAnswerError:  # during another disturbance
            scene.oracle.end_request(request, "junk: NoAnswerError")
            time.sleep(0.5)
        except CdffError as error:
            scene.oracle.end_request(request, f"junk: {type(error).__name__}")
            if str(error).startswith("internal error"):
                scene.oracle.violate(f"{verb} with {parameters!s:.300}: {error}, expected a typed error")
        else:
            scene.oracle.end_request(request, "junk: result")
