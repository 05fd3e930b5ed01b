# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Readers and writers of common file formats: one module per format, bytes or a path in, bytes out.

Point clouds: ``ply``, ``pcd``, ``kitti_bin``, ``las`` (all to and from ``CloudArrays``). Pictures: ``image``
(png, pgm, ppm). Maps: ``geotiff``, ``hillshade``. Poses: ``tum``, ``pose``; graphs of them: ``g2o``. Arrays:
``npz``. ``format_detection`` identifies a format by content, never by name; ``payload`` lists and writes the
formats of a message type.
"""
