# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Hosts any DFPC by name: ports on the bus, products into the DPM, life cycle and operations by remote call."""
