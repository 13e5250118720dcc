#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace latin::program {

/// SHA-256 of a file, all but so many bytes at its beginning, as 64 hexadecimal digits.
/// @throws InputError naming the file if it cannot be read
std::string sha256_of_file(const std::filesystem::path& path, std::size_t skipped = 0);

}  // namespace latin::program
