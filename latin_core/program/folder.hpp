#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "latin/common/communicator.hpp"
#include "latin/common/error.hpp"
#include "latin/iteration/options.hpp"
#include "latin/iteration/sweep.hpp"
#include "latin/substructure/laws.hpp"
#include "tree.hpp"

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
//     text; the law is `contact`, `coulomb`, `debonding`, `elastic`, `force`, `perfect` or `preload`
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

/// Form of an exported problem, and the version that is read.
constexpr const char* folder_format = "latin-problem";
constexpr Index folder_version = 1;

/// A sweep as the folder, or the command line, describes it.
struct SweepRequest {
  std::vector<iteration::SweptParameter> parameters;
  std::vector<Index> order;  ///< points in the order of solution
  Index points = 0;
  /// Axes of the grid: name and values; empty: the folder has them among what it has for the frontend.
  std::vector<std::pair<std::string, std::vector<double>>> axes;
};

/// An exported problem: what the kernel is to be given, on the ranks that share it.
///
/// The bodies are spread over the ranks in their order, about the same number of unknowns on each.
class Folder {
 public:
  /// Collective. @throws InputError on all ranks if the folder is damaged, or none
  Folder(const std::filesystem::path& folder, const Communicator& communicator);

  /// The factorised bodies of this rank with their laws. Collective.
  [[nodiscard]] substructure::Laws laws() const;
  [[nodiscard]] iteration::Options options() const;
  /// (load patterns, columns)
  [[nodiscard]] Matrix amplitudes() const;
  /// Whether a sweep was exported.
  [[nodiscard]] bool has_sweep() const { return root_.has("sweep"); }
  [[nodiscard]] SweepRequest sweep() const;
  [[nodiscard]] const Node& root() const { return root_; }
  /// @throws InputError if a file for the answer cannot be written, or is one of this folder
  void check_target(const std::filesystem::path& target) const;
  /// What a function returns; an InputError of it names the file.
  template <class Function>
  auto named(const Function& read) const {
    try {
      return read();
    } catch (const InputError& error) {
      const std::string text = error.what();
      if (text.find(root_.place()) != std::string::npos ||
          text.find((folder_ / "matrices").string()) != std::string::npos) {
        throw;
      }
      throw InputError(root_.place() + ": " + text);
    }
  }
  [[nodiscard]] const Communicator& communicator() const { return communicator_; }

 private:
  /// A matrix of PETSc from its file, once its checksum is known to be right.
  [[nodiscard]] SparseRows matrix(Index number) const;
  /// The same without explicit zeros.
  [[nodiscard]] SparseRows trace(Index number) const;
  [[nodiscard]] substructure::BodyDescription body(const Node& node) const;
  [[nodiscard]] substructure::Spring spring(const Node& node) const;
  [[nodiscard]] substructure::InterfaceDescription interface(const Node& node) const;
  [[nodiscard]] std::vector<substructure::LawColumns> columns(const Node& node) const;
  [[nodiscard]] substructure::Laws with_values(substructure::Laws laws) const;
  void find_owners();

  std::filesystem::path folder_;
  Communicator communicator_;
  Node root_;
  std::vector<std::string> files_;
  std::vector<std::string> checksums_;
  std::vector<Node> bodies_;          ///< of all ranks
  std::map<std::string, int> owner_;  ///< of every member, a rank
  std::vector<int> rank_of_;          ///< of every body
};

/// A grid given on the command line: "interface.parameter=1,2,3" for each axis.
/// @throws InputError on a text of another form
SweepRequest grid(const std::vector<std::string>& axes);

}  // namespace latin::program
