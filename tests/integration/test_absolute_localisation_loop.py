# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Absolute localisation in a closed loop with the position manager.

The position manager takes each fix; the patches that lead to the next fix are placed with its poses.
"""

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
from evaluation.scenes.orbital import (
    DRIFT,
    DRIFT_RAD_PER_M,
    PATCH_M,
    PRIOR_DEG,
    PRIOR_M,
    Ground,
    PatchRun,
    patch,
)

SEED, DATUM_M, PATH_LENGTH_M = 2, 40.0, 140.0
#: Poses between two patches; a patch every 10 s.
STEPS, STEP_NS = 20, 500_000_000


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground.make(SEED)


@dataclass
class Loop:
    """A drive through both DFPCs; ``port`` is the position manager's input for fixes, "" for an open loop."""

    ground: Ground
    drive: PatchRun
    port: str
    odometry: bool
    manager: PositionManager = field(default_factory=PositionManager)
    localisation: AbsoluteLocalisation = field(default_factory=AbsoluteLocalisation)
    fixes: list[Output] = field(default_factory=list)
    errors: list[np.ndarray] = field(default_factory=list)
    last_pose: Output | None = None

    def run(self) -> Loop:
        poses = self.drive.estimated_poses
        variances = [PRIOR_M**2 / 3.0, PRIOR_M**2 / 3.0, DATUM_M**2, 1e-6, 1e-6, np.radians(PRIOR_DEG) ** 2]
        frames = FrameGraph()
        frames.set_static("site", "mana/odom", UncertainTransform(poses[0], np.diag(variances)))
        frames.set_static("mana/base", "mana/navcam_left", UncertainTransform.identity())
        self.manager.configure({"start": {"tilt_sigma_rad": 1e-3}}, DfpcContext("mana", frames))
        self.localisation.configure({}, DfpcContext("mana"))
        list(
            self.localisation.step(Sample("orbital", 0, 0, self.ground.orbital(SEED, DATUM_M), id="orbital"))
        )
        rng = np.random.default_rng([SEED, 10])
        self._odometry(0, np.eye(4), 0.0)
        for i in range(1, len(poses)):
            step = se3.log_se3(se3.inverse(poses[i - 1]) @ poses[i]) / STEPS
            for k in range(1, STEPS + 1):
                count = (i - 1) * STEPS + k
                T = se3.inverse(poses[0]) @ poses[i - 1] @ se3.exp_se3(step * k)
                self._odometry(count * STEP_NS, T, count * PATCH_M / STEPS)
            assert self.last_pose is not None
            stamp_ns, T_site_base = self.last_pose.t1_ns, self.last_pose.value.transform.matrix
            dem = patch(self.ground, self.drive.true_poses[i], T_site_base, stamp_ns, rng)
            self._forward_patch(Sample("dem", stamp_ns, i, dem, id=f"patch {i}"))
            self._record_error(self.drive.true_poses[i])
        return self

    def _odometry(self, stamp_ns: int, T: np.ndarray, path_length_m: float) -> None:
        """Feed the drive's poses as wheel odometry and as visual odometry."""
        wheels = TransformWithCovariance.from_transform(
            UncertainTransform(T), parent="mana/odom", child="mana/base", stamp_ns=stamp_ns
        )
        if self.odometry:
            list(self.localisation.step(Sample("odometry", stamp_ns, 0, wheels)))
        sigma = np.array([*[DRIFT * PATCH_M] * 2, 0.01, 2e-4, 2e-4, DRIFT_RAD_PER_M * PATCH_M])
        covariance = np.diag(1e-6 + path_length_m / PATCH_M * sigma**2)
        visual = TransformWithCovariance.from_transform(
            UncertainTransform(T, covariance), parent="mana/vo", child="mana/navcam_left", stamp_ns=stamp_ns
        )
        self._forward_poses(list(self.manager.step(Sample("visual_odometry", stamp_ns, 0, visual))))

    def _forward_poses(self, outputs: list[Output]) -> None:
        for output in (o for o in outputs if o.port == "pose"):
            self.last_pose = output
            list(self.localisation.step(Sample("poses", output.t1_ns, 0, output.value)))

    def _forward_patch(self, dem: Sample) -> None:
        for fix in self.localisation.step(dem):
            self.fixes.append(fix)
            if self.port and fix.value is not None:
                sample = Sample(self.port, fix.t1_ns, 0, fix.value, "fix", quality=replace(fix.quality))
                self._forward_poses(list(self.manager.step(sample)))

    def _record_error(self, true: np.ndarray) -> None:
        """Record the error of the position manager's newest pose."""
        T = self.manager.get_pose("site", "mana/base", -1).transform
        true_in_orbital_datum = true.copy()
        true_in_orbital_datum[2, 3] += DATUM_M
        self.errors.append(pose_error(T.matrix, true_in_orbital_datum))

    def horizontal_error_m(self, k: int) -> float:
        """Return the horizontal error of the pose at patch ``k``."""
        return float(np.hypot(*self.errors[k][:2]))

    @property
    def successful_fixes(self) -> list[Output]:
        """Return the fixes that did not fail."""
        return [fix for fix in self.fixes if fix.quality.status is not Status.FAILED]


@pytest.fixture(scope="module")
def drive(ground: Ground) -> PatchRun:
    return PatchRun.make(ground, SEED, PATH_LENGTH_M)


@pytest.mark.req("CDFF-CORE-088")
@pytest.mark.parametrize(
    ("port", "odometry"),
    [pytest.param("fix", True, marks=pytest.mark.slow), ("absolute_fix", False)],
    ids=["pose jumps known from wheel odometry", "poses only"],
)
def test_fixes_that_correct_the_poses_do_not_prevent_further_fixes(
    ground: Ground, drive: PatchRun, port: str, odometry: bool
) -> None:
    loop = Loop(ground, drive, port, odometry).run()
    assert len(loop.fixes) == len(loop.successful_fixes) == 4
    first = next(k for k in range(len(loop.errors)) if loop.horizontal_error_m(k) < 1.0)
    assert loop.horizontal_error_m(first - 1) > 10.0
    assert (
        max(loop.horizontal_error_m(k) for k in range(first, len(loop.errors))) < 3.0
    )  # drift until the next fix
    assert loop.horizontal_error_m(-1) < 1.0
    assert abs(loop.errors[-1][2]) < 0.2
    lengths_m = np.diff([fix.quality.metrics["path_length_m"] for fix in loop.fixes])
    assert max(lengths_m) < 40.0  # no jump counts as distance travelled
    if odometry:
        assert [fix.quality.metrics["matches"] for fix in loop.fixes] == [1.0, 2.0, 3.0, 4.0]
        correction = loop.localisation.call("get_correction", {}).transform.matrix
        assert (
            np.hypot(*correction[:2, 3]) < 1.5
        )  # relative to the corrected poses; the first correction was 15 m
