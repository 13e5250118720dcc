#pragma once

#include <bit>
#include <cstdint>

#include "latin/common/types.hpp"

namespace latin {

/// 128 bits that tell two sequences of numbers apart, bit for bit; not against somebody who wants them to be alike.
class Fingerprint {
 public:
  void add(std::uint64_t word) {
    constexpr std::uint64_t first_factor = 0x9E3779B97F4A7C15ULL;
    constexpr std::uint64_t second_factor = 0xC2B2AE3D27D4EB4FULL;
    first_ = std::rotl((first_ ^ word) * first_factor, 29);
    second_ = std::rotl((second_ + word) * second_factor, 31) ^ first_;
  }
  void add(const Vector& values) {
    add(static_cast<std::uint64_t>(values.size()));
    add_values(values.data(), values.size());
  }
  /// @param matrix compressed
  template <class Sparse>
  void add_matrix(const Sparse& matrix) {
    add(static_cast<std::uint64_t>(matrix.rows()));
    add(static_cast<std::uint64_t>(matrix.cols()));
    for (Index row = 0; row <= matrix.outerSize(); ++row) {
      add(static_cast<std::uint64_t>(matrix.outerIndexPtr()[row]));
    }
    for (Index k = 0; k < matrix.nonZeros(); ++k) {
      add(static_cast<std::uint64_t>(matrix.innerIndexPtr()[k]));
    }
    add_values(matrix.valuePtr(), matrix.nonZeros());
  }
  [[nodiscard]] bool operator==(const Fingerprint&) const = default;

 private:
  void add_values(const double* values, Index count) {
    for (Index k = 0; k < count; ++k) {
      add(std::bit_cast<std::uint64_t>(values[k]));
    }
  }

  std::uint64_t first_ = 1;
  std::uint64_t second_ = 2;
};

}  // namespace latin
