# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Joint states by name."""

import pytest

from cdff_common.errors import InputError
from cdff_common.types import Joints, JointState


def test_positions_are_read_back_by_name() -> None:
    joints = Joints.from_positions({"pan": 0.6, "tilt": -0.2}, stamp_ns=5_000_000)
    assert joints.positions == {"pan": 0.6, "tilt": -0.2}
    assert joints.stamp_ns == 5_000_000


@pytest.mark.parametrize(("names", "count"), [(("pan",), 2), (("pan", "pan"), 2)])
def test_names_that_do_not_fit_the_states_are_refused(names: tuple[str, ...], count: int) -> None:
    with pytest.raises(InputError, match="one unique name per state"):
        _ = Joints(names=names, elements=(JointState(),) * count).positions
