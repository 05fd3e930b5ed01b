# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion of directions on the sphere, shared by the DFNs that filter and associate them."""
