# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What an implementer of a DFN or DFPC subclasses, and what describes one."""
