# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The planetary scenarios of the InFuse paper: rovers that drive to goals in simulation, and their scores."""
