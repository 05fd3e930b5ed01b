# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Operations of the DPM, shared by Zenoh handlers and HTTP routes."""
