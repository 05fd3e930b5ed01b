// SPDX-FileCopyrightText: 2026 the CDFF contributors
// SPDX-License-Identifier: BSD-3-Clause
//
// The message of an IMU reading, without any package: payload and attachment in MessagePack.
//
//     node imu_sample.mjs attachment.bin payload.bin
//
// A driver passes both, and the encoding, to the put of its Zenoh client. With @eclipse-zenoh/zenoh-ts:
//     await session.put("cdff/@v1/mana/sensor/imu/sample", payload, {attachment, encoding: ENCODING});
import { randomUUID } from "node:crypto";
import { writeFileSync } from "node:fs";

export const ENCODING = "application/vnd.cdff+msgpack;IMUSensors/1";

/** A number that is packed as a double even if it is integral. */
class Real { constructor(value) { this.value = value; } }

/** Return data as MessagePack: objects, arrays of fewer than 16 items, texts, bigints (int64), reals. */
function pack(data) {
  if (typeof data === "bigint") { const b = Buffer.alloc(9, 0xd3); b.writeBigInt64BE(data, 1); return b; }
  if (data instanceof Real) { const b = Buffer.alloc(9, 0xcb); b.writeDoubleBE(data.value, 1); return b; }
  if (typeof data === "string") return Buffer.from([0xd9, Buffer.byteLength(data), ...Buffer.from(data)]);
  if (Array.isArray(data)) return Buffer.concat([Buffer.from([0x90 | data.length]), ...data.map(pack)]);
  const fields = Object.entries(data);
  return Buffer.concat([Buffer.from([0x80 | fields.length]), ...fields.flat().map(pack)]);
}

const vector = (...values) => values.map((value) => new Real(value));
const stampNs = 1700000000123456000n; // a multiple of 1000; a BigInt, since a Number is exact up to 2^53 only
const payload = pack({
  timestamp: { microseconds: stampNs / 1000n, usecPerSec: 1000000n },
  acc: vector(0, 0, 9.81), // m/s², specific force
  gyro: vector(0, 0, 0.1), // rad/s
  mag: vector(0, 0, 0),
});
const attachment = pack({
  v: 1n, id: randomUUID(), seq: 7n, t0_ns: stampNs, t1_ns: stampNs,
  frame: "mana/imu", producer: "imu", quality: { status: "OK" },
});
writeFileSync(process.argv[2], attachment);
writeFileSync(process.argv[3], payload);
