# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff eval``: comparison of trajectories, registrations and elevation maps with reference data."""
