# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Trajectories against truth: reading, association, alignment, errors, report and plot."""
