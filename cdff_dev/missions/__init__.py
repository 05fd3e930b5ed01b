# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The paper's planetary scenarios: simulated rovers that drive to goals, and the assessment of their
missions.
"""
