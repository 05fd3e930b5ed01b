// SPDX-FileCopyrightText: 2026 the CDFF contributors
// SPDX-License-Identifier: BSD-3-Clause
//
// The message of an IMU reading, without any library: payload and attachment in MessagePack.
//
//     g++ -std=c++17 -o imu_sample imu_sample.cpp && ./imu_sample attachment.bin payload.bin
//
// A driver passes both to the put of its Zenoh client, with the key cdff/@v1/mana/sensor/imu/sample and the
// encoding application/vnd.cdff+msgpack;IMUSensors/1.
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

class Packer {  // the part of MessagePack that a sample needs; big-endian on every machine
 public:
  std::vector<char> bytes;
  void map(std::uint8_t fields) { bytes.push_back(char(0x80 | fields)); }    // fewer than 16 fields
  void array(std::uint8_t items) { bytes.push_back(char(0x90 | items)); }   // fewer than 16 items
  void text(const std::string& s) { bytes.push_back(char(0xd9)); bytes.push_back(char(s.size()));
                                    bytes.insert(bytes.end(), s.begin(), s.end()); }
  void integer(std::int64_t v) { bytes.push_back(char(0xd3)); big_endian(std::uint64_t(v)); }
  void real(double v) { std::uint64_t bits; std::memcpy(&bits, &v, 8);
                        bytes.push_back(char(0xcb)); big_endian(bits); }
  void vector(const double (&v)[3]) { array(3); for (double x : v) real(x); }

 private:
  void big_endian(std::uint64_t v) {
    for (int shift = 56; shift >= 0; shift -= 8) bytes.push_back(char(v >> shift));
  }
};

// Any id that is unique; this one has the form of a random UUID (version 4) and contains stamp and number.
std::string id_of(std::int64_t stamp_ns, std::uint32_t seq) {
  char text[37];
  std::snprintf(text, sizeof text, "%08x-%04x-4000-8000-%012llx", seq, unsigned(stamp_ns & 0xffff),
                static_cast<unsigned long long>((stamp_ns >> 16) & 0xffffffffffff));
  return text;
}

int main(int argc, char** argv) {
  if (argc != 3) return std::fprintf(stderr, "usage: imu_sample ATTACHMENT PAYLOAD\n"), 2;
  const std::int64_t stamp_ns = 1'700'000'000'123'456'000;  // a multiple of 1000
  const double acc_m_s2[3] = {0.0, 0.0, 9.81}, gyro_rad_s[3] = {0.0, 0.0, 0.1}, mag_ut[3] = {0.0, 0.0, 0.0};

  Packer payload;
  payload.map(4);
  payload.text("timestamp"), payload.map(2);
  payload.text("microseconds"), payload.integer(stamp_ns / 1000);
  payload.text("usecPerSec"), payload.integer(1'000'000);
  payload.text("acc"), payload.vector(acc_m_s2);
  payload.text("gyro"), payload.vector(gyro_rad_s);
  payload.text("mag"), payload.vector(mag_ut);

  Packer attachment;
  attachment.map(8);
  attachment.text("v"), attachment.integer(1);
  attachment.text("id"), attachment.text(id_of(stamp_ns, 7));
  attachment.text("seq"), attachment.integer(7);
  attachment.text("t0_ns"), attachment.integer(stamp_ns);
  attachment.text("t1_ns"), attachment.integer(stamp_ns);
  attachment.text("frame"), attachment.text("mana/imu");
  attachment.text("producer"), attachment.text("imu");
  attachment.text("quality"), attachment.map(1);
  attachment.text("status"), attachment.text("OK");

  std::ofstream(argv[1], std::ios::binary).write(attachment.bytes.data(), attachment.bytes.size());
  std::ofstream(argv[2], std::ios::binary).write(payload.bytes.data(), payload.bytes.size());
}
