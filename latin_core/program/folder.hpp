#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "latin/common/communicator.hpp"
#include "latin/common/error.hpp"
#include "latin/study.hpp"
#include "substructure/laws.hpp"
#include "tree.hpp"

namespace latin::program {

/// Form of an exported problem, and the version that is read.
constexpr const char* folder_format = "latin-problem";
constexpr Index folder_version = 1;

/// A sweep as the folder, or the command line, describes it.
struct SweepRequest {
  Points points;
  Index count = 0;  ///< of points, with those that are not solved
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

  /// The factorised bodies of this rank with their laws and loads. Collective.
  [[nodiscard]] Study study() const;
  [[nodiscard]] iteration::Options options() const;
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
  /// (load patterns, columns)
  [[nodiscard]] Matrix amplitudes() const;
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
