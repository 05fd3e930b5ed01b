# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Missions in orbit: a guided servicer, its autonomy framework, and the comparison with the ground truth."""
