#include "tree.hpp"

#include <unistd.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <limits>
#include <numeric>
#include <random>
#include <sstream>
#include <system_error>

#include "latin/common/error.hpp"
#include "sha256.hpp"

namespace latin::program {
namespace {

constexpr std::size_t user_block = 512;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// The library prints what it does not like: here it is said by exceptions.
void be_quiet() { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); }

std::string seal_of(const std::filesystem::path& path, const std::string& format) {
  return format + " sha256 " + sha256_of_file(path, user_block) + "\n";
}

/// Type of texts of any length.
Identifier text_type() {
  Identifier type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type.get(), H5T_VARIABLE);
  H5Tset_cset(type.get(), H5T_CSET_UTF8);
  return type;
}

/// Texts that the library has allocated.
class Borrowed {
 public:
  Borrowed(hid_t type, Identifier space, std::size_t count)
      : type_(type), space_(std::move(space)), texts_(count, nullptr) {}
  Borrowed(const Borrowed&) = delete;
  Borrowed& operator=(const Borrowed&) = delete;
  Borrowed(Borrowed&&) = delete;
  Borrowed& operator=(Borrowed&&) = delete;
  ~Borrowed() { H5Dvlen_reclaim(type_, space_.get(), H5P_DEFAULT, data()); }
  [[nodiscard]] void* data() { return static_cast<void*>(texts_.data()); }
  [[nodiscard]] std::vector<std::string> copy() const {
    std::vector<std::string> copied;
    copied.reserve(texts_.size());
    for (const char* each : texts_) {
      copied.emplace_back(each != nullptr ? each : "");
    }
    return copied;
  }

 private:
  hid_t type_;
  Identifier space_;
  std::vector<char*> texts_;
};

bool is_variable_text(hid_t type) {
  return H5Tget_class(type) == H5T_STRING && H5Tis_variable_str(type) > 0;
}

}  // namespace

// --- reading -----------------------------------------------------------------------------------------

void Node::fail(const std::string& what) const { throw InputError(place_ + ": " + what); }

Node Node::root(const std::filesystem::path& path, const std::string& format) {
  be_quiet();
  std::error_code failed;
  // what the system makes up has no size, and some of it waits for ever
  if (!std::filesystem::is_regular_file(path, failed) ||
      std::filesystem::file_size(path, failed) == 0) {
    throw InputError(path.string() + " does not exist, is no file or is empty");
  }
  constexpr std::streamsize of_seal = 128;
  std::string found(of_seal, '\0');
  std::ifstream(path, std::ios::binary).read(found.data(), of_seal);
  if (found.rfind(format + " ", 0) != 0) {
    throw InputError(path.string() + " is no " + format + " file");
  }
  // before the library sees the file: on some damaged ones it never returns
  if (found.rfind(seal_of(path, format), 0) != 0) {
    throw InputError(path.string() +
                     " is truncated or damaged: its first line is not the checksum of the rest");
  }
  const Identifier file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  if (file.get() < 0) {
    throw InputError(path.string() + " is no HDF5 file");
  }
  Node node;
  node.group_ =
      std::make_shared<const Identifier>(H5Gopen2(file.get(), "/", H5P_DEFAULT), H5Gclose);
  node.place_ = path.string();
  node.file_size_ = std::filesystem::file_size(path);
  if (node.id() < 0) {
    node.fail("it has no content");
  }
  return node;
}

bool Node::has(const std::string& name) const {
  return H5Lexists(id(), name.c_str(), H5P_DEFAULT) > 0;
}

/// An object that many names lead to would be read once for each: the file says nothing of how much that is.
void Node::refuse_shared(hid_t object, const std::string& name) const {
#if H5_VERSION_GE(1, 12, 0)
  H5O_info2_t info{};
  const herr_t failed = H5Oget_info3(object, &info, H5O_INFO_BASIC);
#else
  H5O_info_t info{};
  const herr_t failed = H5Oget_info2(object, &info, H5O_INFO_BASIC);
#endif
  if (failed < 0 || info.rc > 1) {
    fail("two links lead to '" + name + "': store the values for each");
  }
}

void Node::refuse_link(const std::string& name) const {
  H5L_info_t info{};
  if (has(name) &&
      (H5Lget_info(id(), name.c_str(), &info, H5P_DEFAULT) < 0 || info.type != H5L_TYPE_HARD)) {
    fail("'" + name + "' is a link, which is not followed: store the values themselves");
  }
}

Node Node::group(const std::string& name) const {
  refuse_link(name);
  Node node;
  node.group_ =
      std::make_shared<const Identifier>(H5Gopen2(id(), name.c_str(), H5P_DEFAULT), H5Gclose);
  node.place_ = place_ + "/" + name;
  node.file_size_ = file_size_;
  if (node.id() < 0) {
    fail("group '" + name + "' is missing");
  }
  refuse_shared(node.id(), name);
  return node;
}

std::vector<Node> Node::list(const std::string& name) const {
  std::vector<Node> nodes;
  if (!has(name)) {
    return nodes;
  }
  const Node parent = group(name);
  H5G_info_t info{};
  if (H5Gget_info(parent.id(), &info) < 0) {
    parent.fail("it cannot be read");
  }
  for (hsize_t i = 0; i < info.nlinks; ++i) {
    nodes.push_back(parent.group(std::to_string(i)));
  }
  return nodes;
}

std::vector<std::string> Node::names() const {
  std::vector<std::string> found;
  H5G_info_t info{};
  H5Gget_info(id(), &info);
  for (hsize_t i = 0; i < info.nlinks; ++i) {
    const ssize_t length =
        H5Lget_name_by_idx(id(), ".", H5_INDEX_NAME, H5_ITER_INC, i, nullptr, 0, H5P_DEFAULT);
    if (length < 0) {
      fail("its entries cannot be read");
    }
    std::string name(static_cast<std::size_t>(length) + 1, '\0');
    H5Lget_name_by_idx(id(), ".", H5_INDEX_NAME, H5_ITER_INC, i, name.data(), name.size(),
                       H5P_DEFAULT);
    name.pop_back();
    found.push_back(std::move(name));
  }
  return found;
}

std::string Node::text(const std::string& name) const {
  const Identifier attribute(H5Aopen(id(), name.c_str(), H5P_DEFAULT), H5Aclose);
  const Identifier type(H5Aget_type(attribute.get()), H5Tclose);
  Identifier space(H5Aget_space(attribute.get()), H5Sclose);
  if (attribute.get() < 0 || !is_variable_text(type.get()) ||
      H5Sget_simple_extent_npoints(space.get()) != 1) {
    fail("text '" + name + "' is missing");
  }
  Borrowed texts(type.get(), std::move(space), 1);
  if (H5Aread(attribute.get(), type.get(), texts.data()) < 0) {
    fail("text '" + name + "' cannot be read");
  }
  return texts.copy().front();
}

namespace {

template <class Value>
Value attribute_of(const Node& node, const std::string& name, H5T_class_t wanted, hid_t memory,
                   const char* kind) {
  const Identifier attribute(H5Aopen(node.id(), name.c_str(), H5P_DEFAULT), H5Aclose);
  const Identifier type(H5Aget_type(attribute.get()), H5Tclose);
  const Identifier space(H5Aget_space(attribute.get()), H5Sclose);
  Value value{};
  const H5T_class_t found = attribute.get() < 0 ? H5T_NO_CLASS : H5Tget_class(type.get());
  if ((found != wanted && !(wanted == H5T_FLOAT && found == H5T_INTEGER)) ||
      H5Sget_simple_extent_npoints(space.get()) != 1 ||
      H5Aread(attribute.get(), memory, &value) < 0) {
    node.fail(std::string(kind) + " '" + name + "' is missing");
  }
  return value;
}

}  // namespace

Index Node::integer(const std::string& name) const {
  return attribute_of<long long>(*this, name, H5T_INTEGER, H5T_NATIVE_LLONG, "integer");
}

double Node::number(const std::string& name) const {
  return attribute_of<double>(*this, name, H5T_FLOAT, H5T_NATIVE_DOUBLE, "number");
}

Identifier Node::dataset(const std::string& name, std::vector<Index>& shape, H5T_class_t wanted,
                         const char* kind) const {
  refuse_link(name);
  Identifier data(H5Dopen2(id(), name.c_str(), H5P_DEFAULT), H5Dclose);
  const Identifier creation(H5Dget_create_plist(data.get()), H5Pclose);
  if (data.get() >= 0 && (H5Pget_external_count(creation.get()) != 0 ||
                          H5Pget_layout(creation.get()) == H5D_VIRTUAL)) {
    fail("'" + name + "' is stored in another file, which is not read");
  }
  const Identifier type(H5Dget_type(data.get()), H5Tclose);
  const Identifier space(H5Dget_space(data.get()), H5Sclose);
  const int dimensions = data.get() < 0 ? -1 : H5Sget_simple_extent_ndims(space.get());
  if (dimensions < 0 || H5Tget_class(type.get()) != wanted ||
      (wanted == H5T_STRING && !is_variable_text(type.get()))) {
    fail(std::string(kind) + " '" + name + "' are missing");
  }
  refuse_shared(data.get(), name);
  std::vector<hsize_t> extents(static_cast<std::size_t>(dimensions));
  H5Sget_simple_extent_dims(space.get(), extents.data(), nullptr);
  double bytes = static_cast<double>(H5Tget_size(type.get()));
  for (const hsize_t extent : extents) {
    bytes *= static_cast<double>(extent);
    shape.push_back(static_cast<Index>(extent));
  }
  if (bytes > static_cast<double>(file_size_)) {
    fail(std::string(kind) + " '" + name + "' are more than the file can hold");
  }
  return data;
}

namespace {

std::string shape_text(const std::vector<Index>& shape) {
  std::string text;
  for (const Index extent : shape) {
    text += (text.empty() ? "" : ", ") + std::to_string(extent);
  }
  return "(" + text + ")";
}

Index product(const std::vector<Index>& shape) {
  return std::accumulate(shape.begin(), shape.end(), Index{1}, std::multiplies<>());
}

}  // namespace

Matrix Node::matrix(const std::string& name, Index rows, Index cols) const {
  std::vector<Index> shape;
  const Identifier data = dataset(name, shape, H5T_FLOAT, "numbers");
  if (shape.size() == 1) {
    shape.push_back(1);
  }
  if (shape.size() != 2 || (rows != any && shape[0] != rows) || (cols != any && shape[1] != cols)) {
    fail("numbers '" + name + "' have shape " + shape_text(shape) + ", (" +
         (rows == any ? "any" : std::to_string(rows)) + ", " +
         (cols == any ? "any" : std::to_string(cols)) + ") is wanted");
  }
  RowMajor values(shape[0], shape[1]);
  if (values.size() > 0 &&
      H5Dread(data.get(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0) {
    fail("numbers '" + name + "' cannot be read");
  }
  if (values.hasNaN()) {
    fail("numbers '" + name + "' hold a NaN");
  }
  return values;
}

Vector Node::vector(const std::string& name) const { return matrix(name, any, 1).col(0); }

std::vector<Matrix> Node::matrices(const std::string& name) const {
  std::vector<Index> shape;
  const Identifier data = dataset(name, shape, H5T_FLOAT, "numbers");
  if (shape.size() != 3) {
    fail("numbers '" + name + "' have shape " + shape_text(shape) + ", three axes are wanted");
  }
  std::vector<double> values(static_cast<std::size_t>(product(shape)));
  if (!values.empty() &&
      H5Dread(data.get(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0) {
    fail("numbers '" + name + "' cannot be read");
  }
  std::vector<Matrix> found;
  for (Index i = 0; i < shape[0]; ++i) {
    found.emplace_back(
        Eigen::Map<const RowMajor>(values.data() + i * shape[1] * shape[2], shape[1], shape[2]));
    if (!found.back().allFinite()) {
      fail("numbers '" + name + "' are not all finite");
    }
  }
  return found;
}

std::vector<Index> Node::integers(const std::string& name) const {
  std::vector<Index> shape;
  const Identifier data = dataset(name, shape, H5T_INTEGER, "integers");
  if (shape.size() != 1) {
    fail("integers '" + name + "' have shape " + shape_text(shape) + ", one axis is wanted");
  }
  std::vector<long long> values(static_cast<std::size_t>(shape[0]));
  if (!values.empty() &&
      H5Dread(data.get(), H5T_NATIVE_LLONG, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0) {
    fail("integers '" + name + "' cannot be read");
  }
  return {values.begin(), values.end()};
}

std::vector<std::string> Node::texts(const std::string& name) const {
  std::vector<Index> shape;
  const Identifier data = dataset(name, shape, H5T_STRING, "texts");
  if (shape.size() != 1) {
    fail("texts '" + name + "' have shape " + shape_text(shape) + ", one axis is wanted");
  }
  if (shape[0] == 0) {
    return {};
  }
  const Identifier type(H5Dget_type(data.get()), H5Tclose);
  Borrowed found(type.get(), Identifier(H5Dget_space(data.get()), H5Sclose),
                 static_cast<std::size_t>(shape[0]));
  if (H5Dread(data.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, found.data()) < 0) {
    fail("texts '" + name + "' cannot be read");
  }
  return found.copy();
}

// --- writing -----------------------------------------------------------------------------------------

void check_writable(const std::filesystem::path& target) {
  const auto refuse = [&target](const std::string& why) {
    return InputError(target.string() + " cannot be written: " + why + ": give another file");
  };
  std::error_code failed;
  const std::filesystem::file_status before = std::filesystem::symlink_status(target, failed);
  if (std::filesystem::is_directory(before)) {
    throw refuse("it is a folder");
  }
  if (!std::filesystem::is_regular_file(before)) {
    if (std::filesystem::exists(before) && !std::filesystem::is_symlink(before)) {
      throw refuse("it is a pipe, a socket or a device, not a file");
    }
  } else if (access(target.c_str(), W_OK) != 0) {
    throw refuse("it is write-protected");
  }
}

Writer::Writer(std::filesystem::path target, std::string format, Index version)
    : target_(std::move(target)), format_(std::move(format)) {
  be_quiet();
  const Identifier creation(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
  H5Pset_userblock(creation.get(), user_block);
  const Identifier access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_libver_bounds(access.get(), H5F_LIBVER_V18, H5F_LIBVER_V18);
  // a name that nobody knows before, of a file that is not there: what has it, may be a link to another one
  std::random_device random;
  const std::uint64_t number = (std::uint64_t{random()} << 32U) | random();
  const std::filesystem::path fresh = target_.string() + "." + std::to_string(number) + ".part";
  file_ =
      Identifier(H5Fcreate(fresh.c_str(), H5F_ACC_EXCL, creation.get(), access.get()), H5Fclose);
  check(file_.get() >= 0, "choose a folder that exists, is writable and has room");
  temporary_ = fresh;
  root_ = Identifier(H5Gopen2(file_.get(), "/", H5P_DEFAULT), H5Gclose);
  text("", "format", format_);
  integer("", "version", version);
}

Writer::~Writer() {
  std::error_code ignored;  // a destructor must not throw
  std::filesystem::remove(temporary_, ignored);
}

void Writer::check(bool good, const std::string& what) const {
  if (!good) {
    throw InputError(target_.string() + " cannot be written: " + what);
  }
}

Identifier Writer::at(const std::string& where) const {
  Identifier group(H5Gopen2(file_.get(), "/", H5P_DEFAULT), H5Gclose);
  std::istringstream names(where);
  for (std::string name; std::getline(names, name, '/');) {
    if (H5Lexists(group.get(), name.c_str(), H5P_DEFAULT) > 0) {
      group = Identifier(H5Gopen2(group.get(), name.c_str(), H5P_DEFAULT), H5Gclose);
    } else {
      group = Identifier(
          H5Gcreate2(group.get(), name.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose);
    }
    check(group.get() >= 0, "group '" + where + "'");
  }
  return group;
}

namespace {

bool write_attribute(hid_t group, const std::string& name, hid_t type, hid_t memory,
                     const void* value) {
  const Identifier space(H5Screate(H5S_SCALAR), H5Sclose);
  const Identifier attribute(
      H5Acreate2(group, name.c_str(), type, space.get(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  return attribute.get() >= 0 && H5Awrite(attribute.get(), memory, value) >= 0;
}

bool write_dataset(hid_t group, const std::string& name, const std::vector<Index>& shape,
                   hid_t type, hid_t memory, const void* values) {
  const std::vector<hsize_t> extents(shape.begin(), shape.end());
  const Identifier space(
      H5Screate_simple(static_cast<int>(extents.size()), extents.data(), nullptr), H5Sclose);
  const Identifier data(
      H5Dcreate2(group, name.c_str(), type, space.get(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
      H5Dclose);
  return data.get() >= 0 && (product(shape) == 0 || H5Dwrite(data.get(), memory, H5S_ALL, H5S_ALL,
                                                             H5P_DEFAULT, values) >= 0);
}

}  // namespace

void Writer::text(const std::string& where, const std::string& name, const std::string& value) {
  const Identifier type = text_type();
  const char* data = value.c_str();
  check(write_attribute(at(where).get(), name, type.get(), type.get(),
                        static_cast<const void*>(&data)),
        name);
}

void Writer::integer(const std::string& where, const std::string& name, Index value) {
  const long long given = value;
  check(write_attribute(at(where).get(), name, H5T_STD_I64LE, H5T_NATIVE_LLONG, &given), name);
}

void Writer::number(const std::string& where, const std::string& name, double value) {
  check(write_attribute(at(where).get(), name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &value), name);
}

void Writer::numbers(const std::string& where, const std::string& name,
                     const std::vector<Index>& shape, const std::vector<double>& values) {
  check(product(shape) == static_cast<Index>(values.size()) &&
            write_dataset(at(where).get(), name, shape, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE,
                          values.data()),
        name);
}

void Writer::matrix(const std::string& where, const std::string& name, ConstMatrixRef values) {
  const RowMajor rows = values;
  check(write_dataset(at(where).get(), name, {rows.rows(), rows.cols()}, H5T_IEEE_F64LE,
                      H5T_NATIVE_DOUBLE, rows.data()),
        name);
}

void Writer::integers(const std::string& where, const std::string& name,
                      const std::vector<Index>& values) {
  const std::vector<long long> given(values.begin(), values.end());
  check(write_dataset(at(where).get(), name, {static_cast<Index>(given.size())}, H5T_STD_I64LE,
                      H5T_NATIVE_LLONG, given.data()),
        name);
}

void Writer::texts(const std::string& where, const std::string& name,
                   const std::vector<std::string>& values) {
  const Identifier type = text_type();
  std::vector<const char*> data;
  data.reserve(values.size());
  for (const std::string& each : values) {
    data.push_back(each.c_str());
  }
  check(write_dataset(at(where).get(), name, {static_cast<Index>(data.size())}, type.get(),
                      type.get(), static_cast<const void*>(data.data())),
        name);
}

void Writer::copy(const Node& from, const std::string& name) {
  from.refuse_link(name);
  check(H5Ocopy(from.id(), name.c_str(), root_.get(), name.c_str(), H5P_DEFAULT, H5P_DEFAULT) >= 0,
        name);
}

void Writer::finish() {
  check(H5Fflush(file_.get(), H5F_SCOPE_GLOBAL) >= 0, "is the disk full?");
  root_ = Identifier();
  file_ = Identifier();
  const std::string seal = seal_of(temporary_, format_);
  std::fstream file(temporary_, std::ios::binary | std::ios::in | std::ios::out);
  file.write(seal.data(), static_cast<std::streamsize>(seal.size()));
  file.close();
  check(file.good(), "is the disk full?");
  std::error_code failed;
  std::filesystem::rename(temporary_, target_, failed);
  check(!failed, failed.message());
}

}  // namespace latin::program
