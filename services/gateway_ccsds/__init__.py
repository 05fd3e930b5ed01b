# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gateway to a ground segment: products by CFDP, telemetry and commands as PUS packets."""
