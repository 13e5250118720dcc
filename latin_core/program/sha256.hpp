#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

namespace latin::program {

/// SHA-256 (FIPS 180-4) of bytes that come piece by piece.
class Sha256 {
 public:
  void add(std::span<const std::byte> bytes);
  /// The digest as 64 hexadecimal digits; nothing can be added afterwards.
  [[nodiscard]] std::string digest();

 private:
  void digest_block(const std::byte* block);

  std::array<std::uint32_t, 8> state_{0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                      0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
  std::array<std::byte, 64> block_{};
  std::size_t filled_ = 0;
  std::uint64_t length_ = 0;  ///< bytes so far
};

/// Of a file, all but so many bytes at its beginning.
/// @throws InputError naming the file if it cannot be read
std::string sha256_of_file(const std::filesystem::path& path, std::size_t skipped = 0);

}  // namespace latin::program
