# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The installed plug-in runs through the registry of CDFF."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import TransformWithCovariance
from cdff_core.runtime import Runner


def test_installed_dfpc_smooths_positions() -> None:
    dfpc = Registry.default().make_dfpc("pose_smoother")
    dfpc.configure({"smooth": {"weight": 0.5}}, DfpcContext("mana"))
    runner = Runner(dfpc)
    for second, x_m in enumerate([0.0, 1.0], start=1):
        T = UncertainTransform(se3.transform(np.eye(3), [x_m, 0.0, 0.0]), np.eye(6) * 1e-4)
        stamp_ns = second * 1_000_000_000
        value = TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=stamp_ns)
        runner.push(
            Sample("poses", stamp_ns, second, value, id=f"in{second}", frame="site", child="mana/base")
        )
    products = [*runner.drain(), *runner.finish()]
    assert [p.value.transform.matrix[0, 3] for p in products] == [0.0, 0.5]
