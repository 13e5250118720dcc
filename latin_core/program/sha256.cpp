#include "sha256.hpp"

#include <openssl/evp.h>

#include <array>
#include <fstream>
#include <memory>
#include <vector>

#include "latin/common/error.hpp"

namespace latin::program {

std::string sha256_of_file(const std::filesystem::path& path, std::size_t skipped) {
  std::ifstream file(path, std::ios::binary);
  file.seekg(static_cast<std::streamoff>(skipped));
  const std::unique_ptr<EVP_MD_CTX, void (*)(EVP_MD_CTX*)> hash(EVP_MD_CTX_new(), EVP_MD_CTX_free);
  bool worked = hash && EVP_DigestInit_ex(hash.get(), EVP_sha256(), nullptr) == 1;
  std::vector<char> buffer(std::size_t{1} << 20U);
  while (file && worked) {
    file.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    worked =
        EVP_DigestUpdate(hash.get(), buffer.data(), static_cast<std::size_t>(file.gcount())) == 1;
  }
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned length = 0;
  if (!worked || !file.eof() || EVP_DigestFinal_ex(hash.get(), digest.data(), &length) != 1) {
    throw InputError(path.string() + " cannot be read");
  }
  std::string text;
  for (unsigned i = 0; i < length; ++i) {
    text += "0123456789abcdef"[digest.at(i) >> 4U];
    text += "0123456789abcdef"[digest.at(i) & 0xfU];
  }
  return text;
}

}  // namespace latin::program
