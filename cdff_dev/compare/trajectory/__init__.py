# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of trajectories with ground truth: reading, matching, alignment, errors, report, diagram."""
