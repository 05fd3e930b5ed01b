# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Templates of drivers that run with a simulated device; ``cdff new driver KIND`` copies one."""
