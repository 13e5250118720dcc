#pragma once

#include <hdf5.h>

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "latin/common/types.hpp"

/// Trees of values in HDF5 files that are sealed: the 512 bytes before the HDF5 data begin with "FORMAT sha256
/// DIGEST" of all that follows them (docs/kernel.md).
namespace latin::program {

/// Owner of one identifier of the HDF5 library.
class Identifier {
 public:
  Identifier() = default;
  Identifier(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  Identifier(const Identifier&) = delete;
  Identifier& operator=(const Identifier&) = delete;
  Identifier(Identifier&& other) noexcept { swap(other); }
  Identifier& operator=(Identifier&& other) noexcept {
    swap(other);
    return *this;
  }
  ~Identifier() {
    if (id_ >= 0) {
      close_(id_);
    }
  }
  [[nodiscard]] hid_t get() const { return id_; }

 private:
  void swap(Identifier& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
  }
  hid_t id_ = -1;
  herr_t (*close_)(hid_t) = nullptr;
};

constexpr Index any = -1;

/// A group of a file that is read. Every function throws an InputError that names file and place where something
/// is missing or of another kind.
class Node {
 public:
  /// The root of a file. @param format its seal must name  @throws InputError if the file is damaged or another
  static Node root(const std::filesystem::path& path, const std::string& format);

  /// In words, for messages.
  [[nodiscard]] const std::string& place() const { return place_; }
  [[nodiscard]] hid_t id() const { return group_->get(); }
  [[nodiscard]] bool has(const std::string& name) const;
  /// @throws InputError if it is a link, which may lead to another file
  void refuse_link(const std::string& name) const;
  /// @throws InputError if another name leads to it as well
  void refuse_shared(hid_t object, const std::string& name) const;
  [[nodiscard]] Node group(const std::string& name) const;
  /// The groups "0", "1", ... in a group; none if there is no such group.
  [[nodiscard]] std::vector<Node> list(const std::string& name) const;
  /// Names of the groups and datasets in it.
  [[nodiscard]] std::vector<std::string> names() const;

  // attributes
  [[nodiscard]] std::string text(const std::string& name) const;
  [[nodiscard]] Index integer(const std::string& name) const;
  [[nodiscard]] double number(const std::string& name) const;

  // datasets
  /// (n, m), or (n) as one column; finite or infinite numbers.
  [[nodiscard]] Matrix matrix(const std::string& name, Index rows = any, Index cols = any) const;
  [[nodiscard]] Vector vector(const std::string& name) const;
  /// (k, n, m) as k matrices.
  [[nodiscard]] std::vector<Matrix> matrices(const std::string& name) const;
  [[nodiscard]] std::vector<Index> integers(const std::string& name) const;
  [[nodiscard]] std::vector<std::string> texts(const std::string& name) const;

  /// @throws InputError at this place
  [[noreturn]] void fail(const std::string& what) const;

 private:
  Node() = default;
  [[nodiscard]] Identifier dataset(const std::string& name, std::vector<Index>& shape,
                                   H5T_class_t wanted, const char* kind) const;
  std::shared_ptr<const Identifier> group_;
  std::string place_;
  std::size_t file_size_ = 0;
};

/// @throws InputError if what is there is no file or link, or is write-protected
void check_writable(const std::filesystem::path& target);

/// A file that is written: beside its place, and moved there by finish().
class Writer {
 public:
  /// @throws InputError if it cannot be written
  Writer(std::filesystem::path target, std::string format, Index version);
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
  Writer(Writer&&) = delete;
  Writer& operator=(Writer&&) = delete;
  ~Writer();

  // `where`: a path of groups, which are made as they are needed
  void text(const std::string& where, const std::string& name, const std::string& value);
  void integer(const std::string& where, const std::string& name, Index value);
  void number(const std::string& where, const std::string& name, double value);
  /// @param shape row-major  @param values product of the shape
  void numbers(const std::string& where, const std::string& name, const std::vector<Index>& shape,
               const std::vector<double>& values);
  void matrix(const std::string& where, const std::string& name, ConstMatrixRef values);
  void integers(const std::string& where, const std::string& name,
                const std::vector<Index>& values);
  void texts(const std::string& where, const std::string& name,
             const std::vector<std::string>& values);
  /// Copy an object of another file into the root.
  void copy(const Node& from, const std::string& name);
  /// Seal it, and put it into its place.
  void finish();

 private:
  [[nodiscard]] Identifier at(const std::string& where) const;
  void check(bool good, const std::string& what) const;
  std::filesystem::path target_;
  std::filesystem::path temporary_;
  std::string format_;
  Identifier file_;
  Identifier root_;
};

}  // namespace latin::program
