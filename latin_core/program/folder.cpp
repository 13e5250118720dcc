#include "folder.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <fstream>
#include <optional>
#include <set>
#include <utility>

#include "interface/interface.hpp"
#include "latin/common/error.hpp"
#include "sha256.hpp"
#include "study/implementation.hpp"

// The folder of an exported problem.
//
// `matrices/NNNN.petsc` are matrices in PETSc's binary format (AIJ, as `MatView` writes it). `problem.h5`
// has everything else. It is HDF5: texts and integers are attributes, numbers are attributes or contiguous
// datasets of float64, row-major; lists are groups "0", "1", ... The 512 bytes before the HDF5 part begin with the
// line `latin-problem sha256 HEX`, the checksum of everything after them; the checksums of the matrices are
// inside. `latin_run` compares them before HDF5 sees the files. It refuses links, and values that are stored in
// other files, and takes none of PETSc's options (`.petscrc`, `PETSC_OPTIONS`). l is the number of load
// patterns, c that of the columns of a run (time steps, or modes times time steps, the steps fastest), m that of
// the points of an interface, k that of its components.
//
// `format`, `version`
//     text, integer; `latin-problem`, 1
// `matrices/files`, `sha256`
//     texts; of every matrix its file below the folder and its checksum; others refer to matrices by their number
//     here
// `bodies/B/name`, `size`
//     text, integer; name for messages, number of unknowns q
// `bodies/B/members/M/name`
//     text; of the substructure
// `bodies/B/members/M/stiffness`, `prolongation`
//     integer; matrices K (n, n) and Z (n, size); a prolongation of -1 is the identity
// `bodies/B/members/M/load`, `offset`
//     (n, l); F, force; u0, length (may be missing: zero)
// `bodies/B/springs/S/name`
//     text; for messages
// `bodies/B/springs/S/members`, `traces`
//     (1 or 2) integers; position of the members in the body; matrices T (d m, n)
// `bodies/B/springs/S/frames`
//     (k m, d); orthonormal rows: normal, then tangents
// `bodies/B/springs/S/stiffness`, `jump`
//     (k m), (k m, l); stiffness per area times the areas; imposed jump
// `interfaces/I/name`, `law`
//     text; the law is `contact`, `coulomb`, `debonding`, `elastic`, `force`, `held`, `perfect` or `preload`
// `interfaces/I/weights`, `frames`
//     (m), (k m, d); areas; orthonormal rows
// `interfaces/I/paired`
//     integer; whether the step is solved for with both bodies
// `interfaces/I/basis`
//     (k m, moments); of the coarse problem; may be missing
// `interfaces/I/sides/S/member`, `trace`
//     text, integer; name of a member, matrix T (d m, n)
// `interfaces/I/sides/S/direction`, `scale`
//     (k m), number; k, force / length^3; modulus / length
// `laws/steps`, `modes`
//     integer; time steps in one history; chaos modes
// `laws/parameters/P/interface`, `parameter`
//     text; which
// `laws/parameters/P/values`
//     (m or k m or 1, c or 1); one row or column stands for all
// `laws/columns/C/interface`
//     text; whose columns are transformed (random stiffnesses, nonlinear laws of a chaos)
// `laws/columns/C/groups/G/begin`, `end`
//     integer; components of the group
// `laws/columns/C/groups/G/forward`, `backward`
//     (1 or m, modes, q), (1 or m, q, modes); into the columns in which the law is deterministic, and back;
//     missing: the identity, a missing `backward`: the transposes
// `laws/columns/C/groups/G/parameters/P/name`, `values`
//     text, (rows, q steps); parameters there
// `options/NAME`
//     the options of the iteration and of the factorisation, as `latin_core.Options`
// `amplitudes`
//     (l, c); factors of the load patterns
// `sweep/order`
//     integers; points in the order of solution; no such group: no sweep
// `sweep/parameters/P/interface`, `parameter`, `columns`
//     text, text, integer; what changes; columns of the field (time steps, or 1)
// `sweep/parameters/P/pattern`, `values`
//     (rows columns, r), (r, points); the field at a point is `pattern @ values[:, point]`
// `face`
//     group; what the frontend needs to read the answer; `latin_run` copies it. It may be missing

namespace latin::program {
namespace {

constexpr std::int32_t petsc_matrix = 1211216;  ///< what a file of a matrix begins with

/// Numbers of a file, which has the most significant byte first.
template <class Number>
std::vector<Number> numbers(std::ifstream& file, Index count) {
  std::vector<Number> found(static_cast<std::size_t>(count));
  file.read(reinterpret_cast<char*>(found.data()),
            static_cast<std::streamsize>(found.size() * sizeof(Number)));
  if constexpr (std::endian::native == std::endian::little) {
    for (Number& each : found) {
      auto bytes = std::bit_cast<std::array<std::byte, sizeof(Number)>>(each);
      std::ranges::reverse(bytes);
      each = std::bit_cast<Number>(bytes);
    }
  }
  return found;
}

/// A matrix as PETSc's binary viewer writes it. Read here, for PETSc takes the indices as they are, and gives names
/// with ".gz" in them to a shell.
SparseRows read_matrix(const std::filesystem::path& path) {
  const auto refuse = [&path](const std::string& why) {
    return InputError(path.string() + " is no matrix of PETSc: " + why +
                      ": it is damaged, export the problem again");
  };
  std::ifstream file(path, std::ios::binary);
  const std::vector<std::int32_t> head = numbers<std::int32_t>(file, 4);
  const Index rows = head[1];
  const Index columns = head[2];
  const Index entries = head[3];
  if (!file || head[0] != petsc_matrix || rows < 0 || columns < 0 || entries < 0) {
    throw refuse("it begins with other numbers");
  }
  constexpr Index of_head = 16;
  constexpr Index of_row = 4;
  constexpr Index of_entry = 4 + 8;
  if (static_cast<Index>(std::filesystem::file_size(path)) !=
      of_head + of_row * rows + of_entry * entries) {
    throw refuse("it has not the length of its " + std::to_string(entries) + " entries");
  }
  const std::vector<std::int32_t> lengths = numbers<std::int32_t>(file, rows);
  const std::vector<std::int32_t> indices = numbers<std::int32_t>(file, entries);
  const std::vector<double> values = numbers<double>(file, entries);
  SparseRows matrix(rows, columns);
  matrix.resizeNonZeros(entries);
  Index next = 0;
  for (Index row = 0; row < rows; ++row) {
    const Index first = next;
    const Index length = lengths[static_cast<std::size_t>(row)];
    if (length < 0 || length > entries - first) {
      throw refuse("its rows have other lengths");
    }
    for (; next < first + length; ++next) {
      const int column = indices[static_cast<std::size_t>(next)];
      const double value = values[static_cast<std::size_t>(next)];
      if (column < 0 || column >= columns ||
          (next > first && column <= matrix.innerIndexPtr()[next - 1])) {
        throw refuse("column indices of row " + std::to_string(row) +
                     " are no ascending numbers below " + std::to_string(columns));
      }
      if (!std::isfinite(value)) {
        throw refuse("row " + std::to_string(row) + " holds a NaN or infinity");
      }
      matrix.innerIndexPtr()[next] = column;
      matrix.valuePtr()[next] = value;
    }
    matrix.outerIndexPtr()[row + 1] = static_cast<int>(next);
  }
  if (!file || next != entries) {
    throw refuse("its rows have other lengths");
  }
  return matrix;
}

/// The root of the description, which rank 0 reads first: what all would say is said once.
Node open_root(const std::filesystem::path& folder, const Communicator& communicator) {
  const std::filesystem::path file = folder / "problem.h5";
  const auto read = [&file] {
    Node root = Node::root(file, folder_format);
    const Index version = root.integer("version");
    if (version != folder_version) {
      root.fail("it has version " + std::to_string(version) + ", this program reads version " +
                std::to_string(folder_version));
    }
    return root;
  };
  std::error_code failed;
  communicator.together([&] {
    if (communicator.rank() == 0) {
      if (!std::filesystem::is_directory(folder, failed)) {
        throw InputError(folder.string() + " is no folder: give one that problem.export has made");
      }
      static_cast<void>(read());
    }
  });
  std::optional<Node> root;
  communicator.together([&] { root = read(); });
  return std::move(*root);
}

template <class Value>
Value choice(const Node& node, const std::string& name,
             const std::vector<std::pair<std::string, Value>>& known) {
  const std::string found = node.text(name);
  for (const auto& [text, value] : known) {
    if (text == found) {
      return value;
    }
  }
  node.fail(name + " '" + found + "' is not known");
}

/// Directory that must not lead out of the folder.
bool is_plain(const std::string& name) {
  return !name.empty() && name.find("..") == std::string::npos && name.front() != '/';
}

}  // namespace

Folder::Folder(const std::filesystem::path& folder, const Communicator& communicator)
    : folder_(folder), communicator_(communicator), root_(open_root(folder, communicator)) {
  communicator_.together([this] {
    const Node matrices = root_.group("matrices");
    files_ = matrices.texts("files");
    checksums_ = matrices.texts("sha256");
    if (files_.size() != checksums_.size() || !std::ranges::all_of(files_, is_plain)) {
      matrices.fail("its files and checksums do not fit each other");
    }
    bodies_ = root_.list("bodies");
    if (bodies_.empty()) {
      root_.fail("there are no bodies in it");
    }
    if (static_cast<int>(bodies_.size()) < communicator_.size()) {
      throw InputError("the problem has " + std::to_string(bodies_.size()) +
                       " bodies, each on one rank: run it on so many ranks at most, not " +
                       std::to_string(communicator_.size()));
    }
    find_owners();
  });
}

void Folder::find_owners() {
  std::vector<double> sizes;
  double total = 0.0;
  for (const Node& body : bodies_) {
    const Index size = body.integer("size");
    if (size < 1) {
      body.fail("it has no unknowns");
    }
    sizes.push_back(static_cast<double>(size));
    total += sizes.back();
  }
  const int ranks = communicator_.size();
  int rank = 0;
  double before = 0.0;
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    // the next rank begins where its part of the unknowns does, and early enough to leave one for each
    const int left = static_cast<int>(bodies_.size() - b);
    const bool full = before + 0.5 * sizes[b] > total * (rank + 1) / ranks;
    if (b > 0 && rank + 1 < ranks && (full || left < ranks - rank) && rank_of_.back() == rank) {
      ++rank;
    }
    rank_of_.push_back(rank);
    before += sizes[b];
    for (const Node& member : bodies_[b].list("members")) {
      owner_.emplace(member.text("name"), rank);
    }
  }
}

SparseRows Folder::matrix(Index number) const {
  if (number < 0 || number >= static_cast<Index>(files_.size())) {
    root_.fail("there is no matrix " + std::to_string(number));
  }
  const auto place = static_cast<std::size_t>(number);
  const std::filesystem::path path = folder_ / files_[place];
  std::error_code failed;
  const std::filesystem::path real = std::filesystem::canonical(path, failed);
  if (failed || !std::filesystem::is_regular_file(real, failed) ||
      real != (std::filesystem::canonical(folder_) / files_[place]).lexically_normal()) {
    throw InputError(path.string() + " does not exist, is no file, or is a link");
  }
  if (sha256_of_file(path) != checksums_[place]) {
    throw InputError(path.string() + " is truncated or damaged: its checksum is another one");
  }
  return read_matrix(path);
}

void Folder::check_target(const std::filesystem::path& target) const {
  check_writable(target);
  std::vector<std::string> own = files_;
  own.emplace_back("problem.h5");
  for (const std::string& each : own) {
    std::error_code failed;
    if (std::filesystem::equivalent(target, folder_ / each, failed)) {
      throw InputError(target.string() + " is a file of the problem itself: give --output another");
    }
  }
}

SparseRows Folder::trace(Index number) const { return matrix(number).pruned(); }

substructure::Spring Folder::spring(const Node& node) const {
  substructure::Spring spring;
  spring.name = node.text("name");
  spring.members = node.integers("members");
  const Matrix frames = node.matrix("frames");
  for (const Index number : node.integers("traces")) {
    spring.traces.push_back(interface::to_local_frame(trace(number), frames, spring.name));
  }
  spring.stiffness = node.vector("stiffness");
  spring.jump = node.matrix("jump");
  return spring;
}

substructure::BodyDescription Folder::body(const Node& node) const {
  substructure::BodyDescription body{node.text("name"), node.integer("size"), {}, {}};
  for (const Node& each : node.list("members")) {
    const std::string name = each.text("name");
    const Index prolongation = each.integer("prolongation");
    body.members.push_back({name, owning_view(matrix(each.integer("stiffness"))),
                            prolongation < 0 ? SparseRows() : trace(prolongation),
                            each.matrix("load"),
                            each.has("offset") ? each.matrix("offset") : Matrix()});
  }
  for (const Node& each : node.list("springs")) {
    body.springs.push_back(spring(each));
  }
  return body;
}

substructure::InterfaceDescription Folder::interface(const Node& node) const {
  std::vector<substructure::SideDescription> sides;
  for (const Node& each : node.list("sides")) {
    const std::string member = each.text("member");
    const auto owner = owner_.find(member);
    if (owner == owner_.end()) {
      each.fail("there is no member '" + member + "'");
    }
    if (owner->second == communicator_.rank()) {
      sides.push_back({member, trace(each.integer("trace")), each.vector("direction"),
                       each.number("scale"),
                       each.has("motions") ? each.matrix("motions") : latin::Matrix(),
                       each.has("lever") ? each.number("lever") : 1.0});
    } else {
      sides.push_back({member, {}, {}, 0.0});
    }
  }
  return {node.text("name"),          node.text("law"),
          node.vector("weights"),     node.matrix("frames"),
          std::move(sides),           node.has("basis") ? node.matrix("basis") : Matrix(),
          node.integer("paired") != 0};
}

Study Folder::study() const {
  std::vector<substructure::BodyDescription> bodies;
  std::vector<substructure::InterfaceDescription> interfaces;
  substructure::OperatorOptions options;
  communicator_.together([&] {
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
      if (rank_of_[b] == communicator_.rank()) {
        bodies.push_back(body(bodies_[b]));
      }
    }
    for (const Node& each : root_.list("interfaces")) {
      const std::vector<Node> sides = each.list("sides");
      if (std::ranges::any_of(sides, [this](const Node& side) {
            const auto owner = owner_.find(side.text("member"));
            return owner == owner_.end() || owner->second == communicator_.rank();
          })) {
        interfaces.push_back(interface(each));
      }
    }
    using substructure::OperatorKind;
    using algebra::FactorBackend;
    const Node node = root_.group("options");
    options.kind = choice<OperatorKind>(node, "operator",
                                        {{"automatic", OperatorKind::automatic},
                                         {"condensed", OperatorKind::condensed},
                                         {"factored", OperatorKind::factored}});
    options.backend = choice<FactorBackend>(node, "backend",
                                            {{"automatic", FactorBackend::automatic},
                                             {"cholmod", FactorBackend::cholmod},
                                             {"cholmod64", FactorBackend::cholmod64},
                                             {"mumps", FactorBackend::mumps}});
    options.memory_limit = node.number("memory_limit");
    if (!(options.memory_limit >= 0.0)) {
      node.fail("memory_limit is negative");
    }
  });
  const auto structure = std::make_shared<const substructure::Structure>(
      std::move(bodies), std::move(interfaces), options, communicator_);
  substructure::Laws laws(structure);
  communicator_.together([&] { laws = with_values(std::move(laws)); });
  return Study(std::make_shared<const Study::Implementation>(laws, amplitudes()));
}

substructure::Laws Folder::with_values(substructure::Laws laws) const {
  const substructure::Structure& structure = laws.structure();
  const Node node = root_.group("laws");
  laws = laws.with_steps(node.integer("steps")).with_modes(node.integer("modes"));
  if (node.has("in_time")) {
    laws = laws.with_times(node.matrix("in_time"));
  }
  std::vector<substructure::LawParameter> parameters;
  std::set<std::string> names;
  for (const Node& each : root_.list("interfaces")) {
    names.insert(each.text("name"));
  }
  // of an interface that is on other ranks only nothing is to be set
  const auto here = [&](const Node& each) {
    const std::string name = each.text("interface");
    return structure.has_interface(name) || !names.contains(name);
  };
  for (const Node& each : node.list("parameters")) {
    if (here(each)) {
      parameters.push_back({each.text("interface"), each.text("parameter"), each.matrix("values")});
    }
  }
  laws = laws.with_parameters(parameters);
  for (const Node& each : node.list("columns")) {
    if (here(each)) {
      laws = laws.with_columns(each.text("interface"), columns(each));
    }
  }
  return laws;
}

std::vector<substructure::LawColumns> Folder::columns(const Node& node) const {
  std::vector<substructure::LawColumns> groups;
  for (const Node& each : node.list("groups")) {
    substructure::LawColumns& group = groups.emplace_back();
    group.begin = each.integer("begin");
    group.end = each.integer("end");
    if (each.has("forward")) {
      std::vector<Matrix> forward = each.matrices("forward");
      std::vector<Matrix> backward(forward.size());
      if (each.has("backward")) {
        backward = each.matrices("backward");
      }
      if (forward.size() != backward.size()) {
        each.fail("one backward matrix for each forward one is wanted");
      }
      for (std::size_t i = 0; i < forward.size(); ++i) {
        group.transforms.push_back({std::move(forward[i]), std::move(backward[i]), {}, {}, {}});
      }
    }
    for (const Node& given : each.list("parameters")) {
      group.parameters.emplace_back(given.text("name"),
                                    latin::interface::ParameterField(given.matrix("values")));
    }
  }
  return groups;
}

iteration::Options Folder::options() const {
  iteration::Options options;
  communicator_.together([&] {
    const Node node = root_.group("options");
    options.rtol = node.number("rtol");
    options.stop_on_indicator =
        choice<bool>(node, "criterion", {{"error", false}, {"indicator", true}});
    options.max_iterations = node.integer("max_iterations");
    if (node.has("max_seconds")) {
      options.max_seconds = node.number("max_seconds");
    }
    options.acceleration = node.integer("acceleration");
    options.relaxation = node.number("relaxation");
    options.stagnation_window = node.integer("stagnation_window");
    options.newton = node.integer("newton");
    options.snapshots = node.integer("snapshots");
    options.together = node.integer("together");
    options.scatter = node.integer("scatter") != 0;
    options.single_precision =
        choice<bool>(node, "precision", {{"double", false}, {"single", true}});
    options.check();
  });
  return options;
}

Matrix Folder::amplitudes() const {
  Matrix amplitudes;
  communicator_.together([&] {
    amplitudes = root_.matrix("amplitudes");
    if (amplitudes.cols() < 1 || !amplitudes.allFinite()) {
      root_.fail("'amplitudes' are no finite numbers with a column at least");
    }
  });
  return amplitudes;
}

SweepRequest Folder::sweep() const {
  SweepRequest request;
  communicator_.together([&] {
    const Node node = root_.group("sweep");
    request.points.order = node.integers("order");
    for (const Node& each : node.list("parameters")) {
      request.points.parameters.push_back({each.text("interface"), each.text("parameter"),
                                           each.matrix("pattern"), each.matrix("values"),
                                           each.integer("columns")});
    }
    if (request.points.parameters.empty()) {
      node.fail("no parameter changes");
    }
    const Matrix& values = request.points.parameters.front().values;
    request.count = values.cols();
    if (request.count < 1 || !values.allFinite()) {
      node.fail("it has no points");
    }
  });
  return request;
}

SweepRequest grid(const std::vector<std::string>& axes) {
  SweepRequest request;
  std::vector<Axis> of_laws;
  for (const std::string& axis : axes) {
    const std::size_t equals = axis.find('=');
    const std::size_t dot = axis.rfind('.', equals);
    const auto refuse = [&axis]() {
      return InputError("--sweep " + axis +
                        ": give INTERFACE.PARAMETER=VALUE,VALUE,... with finite numbers");
    };
    if (equals == std::string::npos || dot == std::string::npos || dot == 0 || dot + 1 == equals) {
      throw refuse();
    }
    std::vector<double> values;
    const char* at = axis.data() + equals;
    const char* const end = axis.data() + axis.size();
    while (at != end) {
      double value = 0.0;
      const auto [next, error] = std::from_chars(at + 1, end, value);
      if (error != std::errc() || !std::isfinite(value) || (next != end && *next != ',')) {
        throw refuse();
      }
      values.push_back(value);
      at = next;
    }
    of_laws.push_back({axis.substr(0, dot), axis.substr(dot + 1, equals - dot - 1), values});
    request.axes.emplace_back(axis.substr(0, equals), std::move(values));
  }
  request.points = latin::grid(of_laws);
  request.count = static_cast<Index>(request.points.order.size());
  return request;
}

}  // namespace latin::program
