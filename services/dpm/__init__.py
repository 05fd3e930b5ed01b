# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The Data Product Manager as a process: the store over Zenoh and over HTTP, and the operators' page."""
