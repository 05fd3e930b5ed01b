# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Exchange between the DPM of a robot and that of the ground, over a link that is often interrupted."""
