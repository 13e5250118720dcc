#pragma once

#include <stdexcept>
#include <string>

/// Exceptions cross the border between the kernel and a compiled law of a user.
#define LATIN_SHARED __attribute__((visibility("default")))

namespace latin {

/// What a user gave cannot be used. The message names the thing, its value and the remedy.
class LATIN_SHARED InputError : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// What a user asked for takes more memory than it may.
class LATIN_SHARED MemoryLimitError : public InputError {
 public:
  using InputError::InputError;
};

/// A numerical operation could not be completed (a factorisation broke down, memory ran out, a NaN).
class LATIN_SHARED NumericalError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The memory for it could not be had.
class LATIN_SHARED OutOfMemoryError : public NumericalError {
 public:
  using NumericalError::NumericalError;
};

/// Throws an InputError that names the interface.
[[noreturn]] inline void refuse_interface(const std::string& name, const std::string& why) {
  throw InputError("interface '" + name + "': " + why);
}

}  // namespace latin
