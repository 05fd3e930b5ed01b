// SPDX-FileCopyrightText: 2026 the CDFF contributors
// SPDX-License-Identifier: BSD-3-Clause
//
// cloud OUT: writes a LidarScan of three points in UPER. Its arrays are little-endian octets, copied from memory.
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <vector>

#include "LidarScan.h"

template <typename T>
static void put(OCTET_STRING_t &field, const std::vector<T> &values) {
    OCTET_STRING_fromBuf(&field, reinterpret_cast<const char *>(values.data()),
                         static_cast<int>(values.size() * sizeof(T)));
}

int main(int argc, char **argv) {
    if (argc != 2) {
        std::fprintf(stderr, "usage: cloud OUT\n");
        return 1;
    }
    LidarScan_t scan{};
    scan.metadata.msgVersion = 1;
    OCTET_STRING_fromString(&scan.metadata.sensorId, "vlp16");
    OCTET_STRING_fromString(&scan.metadata.frameId, "mana/lidar");
    asn_long2INTEGER(&scan.metadata.startTime.microseconds, 1600000000000000L);
    asn_long2INTEGER(&scan.metadata.endTime.microseconds, 1600000000100000L);
    scan.metadata.startTime.usecPerSec = scan.metadata.endTime.usecPerSec = 1000000;
    put<float>(scan.data.points, {1.0F, 2.0F, 3.0F, 4.0F, 5.0F, 6.0F, 7.0F, 8.0F, 9.0F});
    put<std::uint32_t>(scan.data.timeOffsets, {0, 50000, 100000});
    put<std::uint16_t>(scan.data.intensity, {10, 20, 30});
    put<std::uint16_t>(scan.data.ring, {});

    std::vector<char> buffer(1 << 16);
    const asn_enc_rval_t written = uper_encode_to_buffer(&asn_DEF_LidarScan, &scan, buffer.data(), buffer.size());
    if (written.encoded < 0) {
        std::fprintf(stderr, "%s cannot be written\n", written.failed_type ? written.failed_type->name : "it");
        return 1;
    }
    std::ofstream(argv[1], std::ios::binary).write(buffer.data(), (written.encoded + 7) / 8);
    return 0;
}
