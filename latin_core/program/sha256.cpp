#include "sha256.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <fstream>
#include <vector>

#include "latin/common/error.hpp"

namespace latin::program {
namespace {

/// First 32 bits of the fractional parts of the cube roots of the first 64 primes.
std::array<std::uint32_t, 64> round_constants() {
  std::array<std::uint32_t, 64> constants{};
  std::size_t found = 0;
  for (std::uint32_t number = 2; found < constants.size(); ++number) {
    bool prime = true;
    for (std::uint32_t factor = 2; factor * factor <= number; ++factor) {
      prime = prime && number % factor != 0;
    }
    if (prime) {
      const long double root = std::cbrt(static_cast<long double>(number));
      constants.at(found++) = static_cast<std::uint32_t>((root - std::floor(root)) * 4294967296.0L);
    }
  }
  return constants;
}

std::uint32_t word_at(const std::byte* bytes) {
  std::uint32_t word = 0;
  for (int i = 0; i < 4; ++i) {
    word = (word << 8U) | std::to_integer<std::uint32_t>(bytes[i]);
  }
  return word;
}

}  // namespace

void Sha256::digest_block(const std::byte* block) {
  static const std::array<std::uint32_t, 64> constants = round_constants();
  std::array<std::uint32_t, 64> w{};
  for (std::size_t t = 0; t < 16; ++t) {
    w[t] = word_at(block + 4 * t);
  }
  for (std::size_t t = 16; t < 64; ++t) {
    const std::uint32_t a = w[t - 15];
    const std::uint32_t b = w[t - 2];
    w[t] = w[t - 16] + (std::rotr(a, 7) ^ std::rotr(a, 18) ^ (a >> 3U)) + w[t - 7] +
           (std::rotr(b, 17) ^ std::rotr(b, 19) ^ (b >> 10U));
  }
  auto [a, b, c, d, e, f, g, h] = state_;
  for (std::size_t t = 0; t < 64; ++t) {
    const std::uint32_t first = h + (std::rotr(e, 6) ^ std::rotr(e, 11) ^ std::rotr(e, 25)) +
                                ((e & f) ^ (~e & g)) + constants[t] + w[t];
    const std::uint32_t second =
        (std::rotr(a, 2) ^ std::rotr(a, 13) ^ std::rotr(a, 22)) + ((a & b) ^ (a & c) ^ (b & c));
    h = g;
    g = f;
    f = e;
    e = d + first;
    d = c;
    c = b;
    b = a;
    a = first + second;
  }
  const std::array<std::uint32_t, 8> added{a, b, c, d, e, f, g, h};
  for (std::size_t i = 0; i < state_.size(); ++i) {
    state_[i] += added[i];
  }
}

void Sha256::add(std::span<const std::byte> bytes) {
  length_ += bytes.size();
  while (!bytes.empty()) {
    if (filled_ == 0 && bytes.size() >= block_.size()) {
      digest_block(bytes.data());
      bytes = bytes.subspan(block_.size());
      continue;
    }
    const std::size_t taken = std::min(block_.size() - filled_, bytes.size());
    std::ranges::copy(bytes.first(taken), block_.begin() + static_cast<std::ptrdiff_t>(filled_));
    filled_ += taken;
    bytes = bytes.subspan(taken);
    if (filled_ == block_.size()) {
      digest_block(block_.data());
      filled_ = 0;
    }
  }
}

std::string Sha256::digest() {
  const std::uint64_t bits = 8 * length_;
  std::vector<std::byte> end{std::byte{0x80}};
  while ((length_ + end.size()) % block_.size() != 56) {
    end.push_back(std::byte{0});
  }
  for (unsigned shift = 64; shift > 0; shift -= 8) {
    end.push_back(static_cast<std::byte>(bits >> (shift - 8)));
  }
  add(end);
  std::string text;
  for (const std::uint32_t word : state_) {
    for (unsigned shift = 32; shift > 0; shift -= 4) {
      text += "0123456789abcdef"[(word >> (shift - 4)) & 0xfU];
    }
  }
  return text;
}

std::string sha256_of_file(const std::filesystem::path& path, std::size_t skipped) {
  std::ifstream file(path, std::ios::binary);
  file.seekg(static_cast<std::streamoff>(skipped));
  Sha256 hash;
  std::vector<char> buffer(std::size_t{1} << 20U);
  while (file) {
    file.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    hash.add(std::as_bytes(std::span(buffer).first(static_cast<std::size_t>(file.gcount()))));
  }
  if (!file.eof()) {
    throw InputError(path.string() + " cannot be read");
  }
  return hash.digest();
}

}  // namespace latin::program
