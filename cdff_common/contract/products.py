# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Product types: the ASN.1 type that carries each, its title, formats and uses.

``CONTRACT_PRODUCTS`` holds the public names. Other product types, and the ASN.1 type if none is stated there,
are defined by the output ports of installed compounds (``product:`` in ``dfpc.yaml``).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache

from cdff_common.codecs import CODECS
from cdff_common.errors import InputError
from cdff_common.formats.payload import FORMATS
from cdff_common.interfaces.description import DfpcDescription
from cdff_common.interfaces.registry import Registry


@dataclass(frozen=True, slots=True)
class ProductType:
    """A type of product.

    Attributes
    ----------
    name : str
        Name in requests and searches.
    title : str
        Plural name for users.
    type_name : str or None
        ASN.1 type of its payload; None if any type is accepted.
    other_types : tuple of str
        InFuse types that it can be delivered ``as``.
    is_spatial : bool
        Whether a request can name a region, a resolution and a coverage.
    is_requestable : bool
        Whether the orchestrator accepts requests for it.
    sample_type : str or None
        ASN.1 type of the sensor samples that the DPM records as this product.
    """

    name: str
    title: str
    type_name: str | None = None
    other_types: tuple[str, ...] = ()
    is_spatial: bool = False
    is_requestable: bool = True
    sample_type: str | None = None

    @property
    def types(self) -> tuple[str, ...]:
        """ASN.1 types it can be delivered as, its own first."""
        return (self.type_name or "", *self.other_types)

    @property
    def file_formats(self) -> tuple[str, ...]:
        """File formats it can be delivered in, the preferred one first."""
        return FORMATS.get(self.type_name or "", ())

    @property
    def formats(self) -> tuple[str, ...]:
        """Codecs and file formats it can be delivered in."""
        return (*CODECS, *self.file_formats)


CONTRACT_PRODUCTS = {
    product.name: product
    for product in (
        ProductType("pose", "Poses", "TransformWithCovariance", ("RigidBodyState",)),
        ProductType("trajectory", "Trajectories", "PoseTrajectory"),
        ProductType("pointcloud", "Point clouds", "Pointcloud", is_spatial=True, sample_type="Pointcloud"),
        ProductType("dem", "Elevation patches", "ElevationMap", ("Map",), is_spatial=True),
        ProductType("navigation_map", "Navigation maps", "NavigationMap", is_spatial=True),
        ProductType("image", "Images", "Frame", sample_type="Frame"),
        ProductType("disparity", "Disparities", "Frame", is_requestable=False),
        ProductType("pose_graph", "Pose graphs", "PoseGraph"),
        ProductType("detections", "Detections"),
        ProductType("track", "Object tracks"),
        ProductType("mesh", "Meshes"),
        ProductType("feature_matches", "Feature matches", "CorrespondenceMap2D"),
        ProductType("landmarks", "Landmark maps", "LandmarkMap"),
        ProductType("scan", "Lidar scans", "LidarScan", is_requestable=False, sample_type="LidarScan"),
        ProductType("image_pair", "Image pairs", "FramePair", is_requestable=False, sample_type="FramePair"),
        ProductType("imu_span", "Inertial spans", "ImuSpan", is_requestable=False, sample_type="IMUSensors"),
        ProductType("sample", "Sensor samples", is_requestable=False),
        ProductType("delivery", "Deliveries", is_requestable=False),
    )
}
#: File suffixes that are read as another format.
_SUFFIXES = {"bin": "ply", "pgm": "png", "ppm": "png"}


@cache
def product_types() -> Mapping[str, ProductType]:
    """Return every product type of this installation by name."""
    return with_compounds(installed.description for installed in Registry.default().dfpcs.values())


def with_compounds(descriptions: Iterable[DfpcDescription]) -> Mapping[str, ProductType]:
    """Return the product types of the contract and of the output ports of compounds, by name."""
    products = dict(CONTRACT_PRODUCTS)
    for port in (port for description in descriptions for port in description.output_ports):
        if port.product is None:
            continue
        product_type = products.get(port.product)
        if product_type is None:
            title = port.product.replace("_", " ").capitalize()
            products[port.product] = ProductType(port.product, title, port.type_name)
        elif product_type.type_name is None:
            products[port.product] = replace(product_type, type_name=port.type_name)
    return products


def product_type(name: str, parameter: str = "type") -> ProductType:
    """Return a product type by name; raises InputError naming ``parameter``."""
    known = CONTRACT_PRODUCTS.get(name)
    if known is not None and known.type_name is not None:
        return known
    try:
        return product_types()[name]
    except KeyError:
        raise InputError(f"{parameter}={name[:80]!r}: expected one of {', '.join(product_types())}") from None


def requestable_products() -> Mapping[str, ProductType]:
    """Return the product types that the orchestrator accepts requests for, by name."""
    return {
        name: product
        for name, product in product_types().items()
        if product.is_requestable and product.type_name is not None
    }


def product_of_suffix(suffix: str) -> str | None:
    """Return the product that a file of a suffix holds; None for an unknown suffix.

    A product that prefers this file format comes first, else the first product that supports it.
    """
    suffix = _SUFFIXES.get(suffix, suffix)
    preferred = (p.name for p in CONTRACT_PRODUCTS.values() if p.file_formats[:1] == (suffix,))
    others = (p.name for p in CONTRACT_PRODUCTS.values() if suffix in p.file_formats)
    return next(preferred, None) or next(others, None)


def product_of_sample(type_name: str) -> str:
    """Return the product that sensor samples of an ASN.1 type are recorded as."""
    return next((p.name for p in CONTRACT_PRODUCTS.values() if p.sample_type == type_name), "sample")
