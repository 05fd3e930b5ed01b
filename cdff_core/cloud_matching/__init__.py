# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registration of two point clouds without a guess, shared by the DFPCs that match clouds."""
