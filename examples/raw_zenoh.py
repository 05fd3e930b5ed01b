# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Send requests without CDFF code, using its ASN.1 files, Zenoh, an ASN.1 compiler and MessagePack.

    python examples/raw_zenoh.py ASN1_FOLDER [ROBOT] [REGION]

The requests are the rover's pose as an InFuse ``RigidBodyState`` and the elevation of a region as an InFuse
``Map``. The address of the router is ``CDFF_CONNECT`` or ``tcp/127.0.0.1:7447``. See
``docs/og2-interface.md``.
"""

import json
import os
import struct
import sys
import uuid
from pathlib import Path

import asn1tools
import msgpack
import zenoh

SECONDS = 30


def ask(session, robot, **parameters):
    """Send one request, print its progress; return encoding, payload and attachment of the final reply."""
    parameters |= {"deadline_ms": SECONDS * 1000, "request": uuid.uuid4()}
    selector = f"cdff/@v1/{robot}/orchestrator/@rpc/request?" + ";".join(
        f"{k}={v}" for k, v in parameters.items()
    )
    # Without ConsolidationMode.NONE, Zenoh delivers the final reply only, without progress.
    for reply in session.get(selector, timeout=SECONDS + 1, consolidation=zenoh.ConsolidationMode.NONE):
        if reply.err is not None:
            sys.exit(f"refused: {msgpack.unpackb(reply.err.payload.to_bytes())}")
        sample = reply.ok
        about = msgpack.unpackb(sample.attachment.to_bytes())
        if about["final"]:
            return str(sample.encoding), sample.payload.to_bytes(), about
        progress = msgpack.unpackb(sample.payload.to_bytes())
        print(f"  {progress['state']}: {progress['reason']}")
    sys.exit("no answer: an empty answer is never a result")


def main(asn1_folder, robot="mana", region="circle:0,0,5"):
    """Send both requests and print the products."""
    schema = asn1tools.compile_files([str(f) for f in sorted(Path(asn1_folder).glob("*.asn"))], "uper")
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5(
        "connect/endpoints", json.dumps([os.environ.get("CDFF_CONNECT", "tcp/127.0.0.1:7447")])
    )
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        encoding, payload, about = ask(session, robot, type="pose", **{"as": "RigidBodyState"}, frame="site")
        assert encoding == "application/vnd.cdff+uper;RigidBodyState/1", encoding
        state = schema.decode("RigidBodyState", payload)
        target, source = state["targetFrame"].decode(), state["sourceFrame"].decode()
        print(f"{source} in {target}: position {state['pos']}, quaternion x y z w {state['orient']}")
        print(f"  {about['delivered']['age_s']} s old, quality {about['quality']['status']}")

        encoding, payload, about = ask(
            session, robot, type="dem", region=region, frame="site", deliver="inline"
        )
        assert encoding == "application/vnd.cdff+uper;Map/1", encoding
        dem = schema.decode("Map", payload)
        rows, cols = dem["data"]["rows"], dem["data"]["cols"]
        heights = struct.unpack(f"<{rows * cols}f", dem["data"]["data"])
        corner = dem["metadata"]["pose-fixedFrame-mapFrame"]["data"]["translation"]
        observed = [h for h in heights if h == h]  # unobserved cells are NaN
        print(
            f"DEM of {rows} x {cols} cells of {dem['metadata']['scale']} m, outer corner of cell (0, 0) "
            f"at {corner}"
        )
        print(
            f"  heights {min(observed)}..{max(observed)} m in {len(observed)} cells, coverage "
            f"{about['delivered']['coverage']}"
        )


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 4 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    main(*sys.argv[1:])
