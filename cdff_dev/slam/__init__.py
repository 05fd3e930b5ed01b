# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From a log to a trajectory, a map and pictures in one command: ``cdff slam`` and ``cdff vo``."""
