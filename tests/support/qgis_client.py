# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/usr/bin/python3 qgis_client.py URL PRODUCT WEST SOUTH EAST NORTH``: what QGIS reads from a DPM, as JSON.

Runs in the Python of Debian's QGIS, which has none of the packages of CDFF. The box is in metres of
the CRS of the WMTS.
"""

import json
import os
import sys
import urllib.parse

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from qgis.core import (
    Qgis,
    QgsApplication,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsRasterLayer,
    QgsRectangle,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtGui import QColor

url, product, *box = sys.argv[1:]
application = QgsApplication([], False)
application.initQgis()
result = {"version": Qgis.QGIS_VERSION}

capabilities = urllib.parse.quote(f"{url}/wmts?SERVICE=WMTS&REQUEST=GetCapabilities", safe="")


def layer_at(time):
    """Return the layer of tiles with a value of the dimension Time."""
    dimensions = urllib.parse.quote(f"Time={time}", safe="")
    source = (
        f"crs=IAU_2015:49910&format=image/png&layers=hillshade&styles=default&tileMatrixSet=IAU_2015_49910"
        f"&tileDimensions={dimensions}&url={capabilities}"
    )
    return QgsRasterLayer(source, "hillshade", "wms")


def drawn_fraction(layer):
    """Return the fraction of the box in which a layer draws gray over the red background."""
    settings = QgsMapSettings()
    settings.setLayers([layer])
    settings.setDestinationCrs(layer.crs())
    settings.setBackgroundColor(QColor(255, 0, 0))
    settings.setOutputSize(QSize(256, 256))
    settings.setExtent(QgsRectangle(*map(float, box)))
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    image = job.renderedImage()
    colors = [QColor(image.pixel(x, y)) for x in range(0, 256, 4) for y in range(0, 256, 4)]
    return sum(c.red() == c.green() == c.blue() for c in colors) / len(colors)


tiles = layer_at("current")
result["wmts"] = {
    "valid": tiles.isValid(),
    "crs": tiles.crs().authid(),
    "extent": [f(tiles.extent()) for f in (QgsRectangle.xMinimum, QgsRectangle.yMinimum)],
    "error": tiles.error().message(),
    "drawn": drawn_fraction(tiles),
    "drawn_at_the_start": drawn_fraction(layer_at("1970-01-01T00:00:00Z")),
}

cog = QgsRasterLayer(f"/vsicurl/{url}/api/v1/products/{product}/payload?format=tif", "dem")
result["cog"] = {"valid": cog.isValid(), "bands": cog.bandCount(), "crs": cog.crs().toWkt()[:200]}

features = QgsVectorLayer(f"pageSize='10' typename='dem' url='{url}/ogc'", "dem", "OAPIF")
result["features"] = {"valid": features.isValid(), "count": sum(1 for _ in features.getFeatures())}
print(json.dumps(result), flush=True)
os._exit(0)  # the libraries of QGIS 3.22 end with a segmentation fault while layers exist
