# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""DFPCs of a separate package, found through its entry point; used by tests of the host."""
