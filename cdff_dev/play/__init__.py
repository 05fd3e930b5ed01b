# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The player: it publishes the samples of a log at their times, and the mission clock."""
