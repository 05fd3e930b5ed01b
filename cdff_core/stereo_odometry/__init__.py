# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parts that visual odometry compounds of stereo cameras share: views, prediction, path, gaps, covariance."""
