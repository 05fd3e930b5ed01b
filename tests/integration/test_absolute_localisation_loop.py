# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The loop closed: the fix goes into the position manager, whose poses place the patches that lead to the next fix."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.types import TransformWithCovariance
from cdff_core.dfpcs.absolute_localisation.compound import AbsoluteLocalisation
from cdff_core.dfpcs.position_manager.compound import PositionManager
from cdff_dev.evaluate._orbital import (
    DRIFT,
    DRIFT_RAD_PER_M,
    PATCH_M,
    PRIOR_DEG,
    PRIOR_M,
    Drive,
    Ground,
    patch,
)

SEED, DATUM_M, WAY_M = 2, 40.0, 140.0
#: Poses between two patches; a patch every 10 s.
STEPS, STEP_NS = 20, 500_000_000


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground.make(SEED)


@dataclass
class Loop:
    """A drive through both DFPCs; ``port`` is where the fix goes in, empty for an open loop."""

    ground: Ground
    drive: Drive
    port: str
    odometry: bool
    manager: PositionManager = field(default_factory=PositionManager)
    localisation: AbsoluteLocalisation = field(default_factory=AbsoluteLocalisation)
    fixes: list[Output] = field(default_factory=list)
    errors: list[np.ndarray] = field(default_factory=list)
    belief: Output | None = None

    def run(self) -> Loop:
        believed = self.drive.believed
        variances = [PRIOR_M**2 / 3.0, PRIOR_M**2 / 3.0, DATUM_M**2, 1e-6, 1e-6, np.radians(PRIOR_DEG) ** 2]
        frames = FrameGraph()
        frames.set_static("site", "mana/odom", UncertainTransform(believed[0], np.diag(variances)))
        frames.set_static("mana/base", "mana/navcam_left", UncertainTransform.identity())
        self.manager.configure({"start_tilt_sigma_rad": 1e-3}, DfpcContext("mana", frames))
        self.localisation.configure({}, DfpcContext("mana"))
        list(self.localisation.step(Sample("orbital", 0, 0, self.ground.orbital(SEED, DATUM_M), id="orbital")))
        rng = np.random.default_rng([SEED, 10])
        self._odometry(0, np.eye(4), 0.0)
        for i in range(1, len(believed)):
            step = se3.log_se3(se3.inverse(believed[i - 1]) @ believed[i]) / STEPS
            for k in range(1, STEPS + 1):
                count = (i - 1) * STEPS + k
                T = se3.inverse(believed[0]) @ believed[i - 1] @ se3.exp_se3(step * k)
                self._odometry(count * STEP_NS, T, count * PATCH_M / STEPS)
            assert self.belief is not None
            seen_ns = self.belief.t1_ns
            dem = patch(self.ground, self.drive.true[i], self.belief.value.transform.matrix, seen_ns, rng)
            self._locate(Sample("dem", seen_ns, i, dem, id=f"patch {i}"))
            self._judge(self.drive.true[i])
        return self

    def _odometry(self, stamp_ns: int, T: np.ndarray, way_m: float) -> None:
        """The drive's own poses, once as of wheels and once as of vision with the drift that the drive has."""
        wheels = TransformWithCovariance.from_transform(
            UncertainTransform(T), parent="mana/odom", child="mana/base", stamp_ns=stamp_ns
        )
        if self.odometry:
            list(self.localisation.step(Sample("odometry", stamp_ns, 0, wheels)))
        sigma = np.array([*[DRIFT * PATCH_M] * 2, 0.01, 2e-4, 2e-4, DRIFT_RAD_PER_M * PATCH_M])
        covariance = np.diag(1e-6 + way_m / PATCH_M * sigma**2)
        seen = TransformWithCovariance.from_transform(
            UncertainTransform(T, covariance), parent="mana/vo", child="mana/navcam_left", stamp_ns=stamp_ns
        )
        self._hear(list(self.manager.step(Sample("visual_odometry", stamp_ns, 0, seen))))

    def _hear(self, outputs: list[Output]) -> None:
        for output in (o for o in outputs if o.port == "pose"):
            self.belief = output
            list(self.localisation.step(Sample("poses", output.t1_ns, 0, output.value)))

    def _locate(self, dem: Sample) -> None:
        for fix in self.localisation.step(dem):
            self.fixes.append(fix)
            if self.port and fix.value is not None:
                taken = Sample(self.port, fix.t1_ns, 0, fix.value, "fix", quality=replace(fix.quality))
                self._hear(list(self.manager.step(taken)))

    def _judge(self, true: np.ndarray) -> None:
        """Error of the newest belief as the manager has it now, and of the newest fix at its time."""
        T = self.manager.get_pose("site", "mana/base", -1).transform
        lifted = true.copy()
        lifted[2, 3] += DATUM_M
        self.errors.append(pose_error(T.matrix, lifted))

    def off_m(self, k: int) -> float:
        """Horizontal error of the belief at patch ``k``."""
        return float(np.hypot(*self.errors[k][:2]))

    @property
    def answered(self) -> list[Output]:
        """Fixes that are no refusals."""
        return [fix for fix in self.fixes if fix.quality.status is not Status.FAILED]


@pytest.fixture(scope="module")
def drive(ground: Ground) -> Drive:
    return Drive.make(ground, SEED, WAY_M)


@pytest.mark.req("CDFF-CORE-088")
@pytest.mark.parametrize(
    ("port", "odometry"), [("fix", True), ("absolute_fix", False)], ids=["jumps told by wheels", "by poses alone"]
)
def test_fixes_that_correct_the_poses_are_followed_by_more_fixes(
    ground: Ground, drive: Drive, port: str, odometry: bool
) -> None:
    loop = Loop(ground, drive, port, odometry).run()
    assert len(loop.fixes) == len(loop.answered) == 4
    first = next(k for k in range(len(loop.errors)) if loop.off_m(k) < 1.0)
    assert loop.off_m(first - 1) > 10.0
    assert max(loop.off_m(k) for k in range(first, len(loop.errors))) < 3.0  # what drifts until the next fix
    assert loop.off_m(-1) < 1.0
    assert abs(loop.errors[-1][2]) < 0.2
    ways = np.diff([fix.quality.metrics["way_m"] for fix in loop.fixes])
    assert max(ways) < 40.0  # no jump is way driven
    if odometry:
        assert [fix.quality.metrics["matches"] for fix in loop.fixes] == [1.0, 2.0, 3.0, 4.0]
        correction = loop.localisation.call("get_correction", {}).transform.matrix
        assert np.hypot(*correction[:2, 3]) < 1.5  # in the frame of now, not the 15 m of the first
