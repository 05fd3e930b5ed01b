// SPDX-FileCopyrightText: 2026 the CDFF contributors
// SPDX-License-Identifier: BSD-3-Clause
//
// node transform.mjs FILE.ber|FILE.msgpack: prints a TransformWithCovariance.
import { readFileSync } from "node:fs";
import { decode } from "@msgpack/msgpack";
import { fromBER } from "asn1js";

// The modules have AUTOMATIC TAGS: field number i of a SEQUENCE has the context tag [i], a list has universal tags.
const field = (sequence, ...path) => path.reduce((node, i) => node.valueBlock.value[i], sequence);
const octets = (node) => new Uint8Array(node.valueBlock.valueHexView ?? node.valueBlock.valueHex);
const text = (node) => new TextDecoder().decode(octets(node)).replace(/\0+$/, "");

// Contents octets of a REAL, X.690 8.5: base 2 with its exponent, or a special value.
function real(node) {
  const bytes = octets(node);
  if (bytes.length === 0) return 0;
  const head = bytes[0];
  if (!(head & 0x80)) return { 0x40: Infinity, 0x41: -Infinity, 0x42: NaN, 0x43: -0 }[head];
  if (head & 0x3c) throw new Error("a REAL of base 8 or 16: the codecs of this project write base 2");
  const size = (head & 3) + 1;
  let exponent = 0;
  for (const byte of bytes.subarray(1, 1 + size)) exponent = exponent * 256 + byte;
  if (bytes[1] & 0x80) exponent -= 256 ** size;
  let mantissa = 0n;
  for (const byte of bytes.subarray(1 + size)) mantissa = mantissa * 256n + BigInt(byte);
  // Two factors, because 2 ** -1074 is the smallest number of a double.
  const half = Math.trunc(exponent / 2);
  return (head & 0x40 ? -1 : 1) * Number(mantissa) * 2 ** half * 2 ** (exponent - half);
}

function fromBer(bytes) {
  const { offset, result } = fromBER(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength));
  if (offset === -1) throw new Error(`no BER: ${result.error}`);
  return {
    parent: text(field(result, 0, 3)),
    child: text(field(result, 0, 5)),
    translation: field(result, 1, 0).valueBlock.value.map(real),
    orientation: field(result, 1, 1).valueBlock.value.map(real),
  };
}

function fromMessagePack(bytes) {
  const message = decode(bytes);
  return {
    parent: message.metadata.parentFrameId,
    child: message.metadata.childFrameId,
    translation: message.data.translation,
    orientation: message.data.orientation,
  };
}

const path = process.argv[2];
const bytes = readFileSync(path);
console.log(JSON.stringify(path.endsWith(".ber") ? fromBer(bytes) : fromMessagePack(bytes)));
