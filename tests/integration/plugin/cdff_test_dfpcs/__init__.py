# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""DFPCs outside the tree, found by entry point: for tests of the host."""
