# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Host of any DFPC by name: ports on the bus, products into the DPM, life cycle and operations by RPC."""
