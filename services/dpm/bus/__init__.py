# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The DPM on the bus: its remote calls, sensor recorder and service monitor."""
