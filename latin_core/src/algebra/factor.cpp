#include "algebra/factor.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <memory>
#include <mutex>
#include <new>
#include <numeric>
#include <optional>
#include <random>
#include <unordered_map>
#include <vector>

#include "algebra/elimination.hpp"
#include "algebra/handle.hpp"
#include "algebra/supernodes.hpp"
#include "latin/common/error.hpp"

#ifdef LATIN_HAVE_CHOLMOD
#include <cholmod.h>
#endif

namespace latin::algebra {
namespace {

std::string not_definite(const std::string& name, const std::string& where) {
  return "the stiffness of '" + name + "' is not positive definite" + where +
         ": the part can move rigidly, its material is not stable, a stiffness is negative, or "
         "moduli of parts "
         "that are joined differ by more than rounding bears (keep the joint active: active=[...])";
}

[[noreturn]] void refuse_out_of_memory(const std::string& name, Index size) {
  throw OutOfMemoryError(
      "not enough memory to factorise '" + name + "' (" + std::to_string(size) +
      " unknowns): use a coarser mesh, backend 'multigrid', or a larger machine");
}

#ifdef LATIN_HAVE_CHOLMOD

/// The graph of a matrix with unknowns of equal neighbours (the components of a node) as one vertex.
struct Compressed {
  SparseColumns pattern;  ///< upper triangle, values without meaning
  std::vector<std::vector<int>> members;
};

/// Orders of the compressed graph are as good, and cost a ninth of the edges in 3D. Neighbourhoods are compared
/// by a sum of random numbers: a false match could only make an order worse, never wrong.
Compressed compress(const SparseRows& lower, Index size) {
  std::vector<std::uint64_t> key(static_cast<std::size_t>(size));
  std::mt19937_64 random(1);
  std::ranges::generate(key, std::ref(random));
  std::vector<std::uint64_t> sum(key);
  for (int row = 0; row < size; ++row) {
    const auto i = static_cast<std::size_t>(row);
    for (SparseRows::InnerIterator it(lower, row); it; ++it) {
      const auto j = static_cast<std::size_t>(it.col());
      if (i != j) {
        sum[i] += key[j];
        sum[j] += key[i];
      }
    }
  }
  Compressed graph;
  std::unordered_map<std::uint64_t, int> of_sum;
  std::vector<int> vertex(key.size(), -1);  // of the first member of each group, else -1
  for (std::size_t i = 0; i < key.size(); ++i) {
    const auto [found, fresh] = of_sum.try_emplace(sum[i], static_cast<int>(graph.members.size()));
    if (fresh) {
      vertex[i] = found->second;
      graph.members.emplace_back();
    }
    graph.members[static_cast<std::size_t>(found->second)].push_back(static_cast<int>(i));
  }
  const auto groups = static_cast<Index>(graph.members.size());
  graph.pattern.resize(groups, groups);
  std::vector<int> neighbours;
  for (int row = 0; row < size; ++row) {
    const int at = vertex[static_cast<std::size_t>(row)];
    if (at < 0) {
      continue;
    }
    neighbours.clear();
    for (SparseRows::InnerIterator it(lower, row); it; ++it) {
      const int other = vertex[static_cast<std::size_t>(it.col())];
      if (other >= 0) {
        neighbours.push_back(other);
      }
    }
    std::ranges::sort(neighbours);
    graph.pattern.startVec(at);
    for (const int other : neighbours) {
      graph.pattern.insertBack(other, at) = 1.0;
    }
  }
  graph.pattern.finalize();
  return graph;
}

/// CHOLMOD with indices of 32 bits: half the memory of its indices, and at most 2^31 numbers in a factor.
struct Narrow {
  using Int = std::int32_t;
  static constexpr int type = CHOLMOD_INT;
  static constexpr const char* backend = "cholmod";
  static constexpr auto start = cholmod_start;
  static constexpr auto finish = cholmod_finish;
  static constexpr auto analyze = cholmod_analyze;
  static constexpr auto change_factor = cholmod_change_factor;
  static constexpr auto solve = cholmod_solve;
  static constexpr auto free_factor = cholmod_free_factor;
  static constexpr auto free_dense = cholmod_free_dense;
};

/// The same with indices of 64 bits.
struct Wide {
  using Int = std::int64_t;
  static constexpr int type = CHOLMOD_LONG;
  static constexpr const char* backend = "cholmod64";
  static constexpr auto start = cholmod_l_start;
  static constexpr auto finish = cholmod_l_finish;
  static constexpr auto analyze = cholmod_l_analyze;
  static constexpr auto change_factor = cholmod_l_change_factor;
  static constexpr auto solve = cholmod_l_solve;
  static constexpr auto free_factor = cholmod_l_free_factor;
  static constexpr auto free_dense = cholmod_l_free_dense;
};

/// A factor has more numbers than its indices can count.
class TooLarge {};

/// CHOLMOD's settings and memory of one thread, given back with it.
template <class Api>
class Common {
 public:
  Common() {
    Api::start(&common_);
    common_.print = 0;
    common_.error_handler = nullptr;
  }
  Common(const Common&) = delete;
  Common& operator=(const Common&) = delete;
  Common(Common&&) = delete;
  Common& operator=(Common&&) = delete;
  ~Common() { Api::finish(&common_); }

  [[nodiscard]] cholmod_common* get() { return &common_; }
  [[nodiscard]] cholmod_common* operator->() { return &common_; }
  /// An owner of a factor, which must go before this does.
  [[nodiscard]] auto own(cholmod_factor* factor) {
    const auto free = [this](cholmod_factor* owned) { Api::free_factor(&owned, &common_); };
    return std::unique_ptr<cholmod_factor, std::function<void(cholmod_factor*)>>(factor, free);
  }

 private:
  cholmod_common common_{};
};

[[noreturn]] void refuse(const std::string& name, Index size, int status) {
  if (status == CHOLMOD_OUT_OF_MEMORY) {
    refuse_out_of_memory(name, size);
  }
  throw NumericalError("CHOLMOD could not factorise '" + name + "' (status " +
                       std::to_string(status) + ")");
}

/// A square matrix for CHOLMOD, without its arrays.
cholmod_sparse square(Index size, std::size_t nonzeros, int type) {
  cholmod_sparse matrix{};
  matrix.nrow = static_cast<std::size_t>(size);
  matrix.ncol = static_cast<std::size_t>(size);
  matrix.nzmax = nonzeros;
  matrix.itype = type;
  matrix.dtype = CHOLMOD_DOUBLE;
  matrix.packed = 1;
  return matrix;
}

cholmod_sparse view(SparseColumns& upper) {
  cholmod_sparse matrix =
      square(upper.rows(), static_cast<std::size_t>(upper.nonZeros()), CHOLMOD_INT);
  matrix.p = upper.outerIndexPtr();
  matrix.i = upper.innerIndexPtr();
  matrix.stype = 1;
  matrix.xtype = CHOLMOD_PATTERN;
  matrix.sorted = 1;
  return matrix;
}

/// METIS takes SIGTERM for a failure of its own, and it would be lost: it waits for the end of this.
class TerminationWaits {
 public:
  TerminationWaits() {
    sigset_t one;
    sigemptyset(&one);
    sigaddset(&one, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &one, &before_);
  }
  ~TerminationWaits() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
  TerminationWaits(const TerminationWaits&) = delete;
  TerminationWaits& operator=(const TerminationWaits&) = delete;
  TerminationWaits(TerminationWaits&&) = delete;
  TerminationWaits& operator=(TerminationWaits&&) = delete;

 private:
  sigset_t before_{};
};

/// The interior unknowns in order of minimum degree, or of nested dissection where that must save more
/// than it costs, then the trailing ones in their given order.
std::vector<int> interior_first(const SparseRows& lower, Index trailing, const std::string& name) {
  const Index size = lower.rows();
  std::vector<int> order(static_cast<std::size_t>(size));
  std::iota(order.begin(), order.end(), 0);
  const Index interior = size - trailing;
  if (interior < 2) {
    return order;
  }
  const auto place = [&](const Compressed& graph, const int* groups) {
    auto next = order.begin();
    for (Index i = 0; i < graph.pattern.cols(); ++i) {
      for (const int unknown : graph.members[static_cast<std::size_t>(groups[i])]) {
        if (unknown < interior) {
          *next++ = unknown;
        }
      }
    }
  };
  Common<Narrow> common;
  const auto fail = [&] { refuse(name, size, common->status); };
  // degrees count the trailing neighbours, which fill in, too: a third fewer operations on the vessel
  Compressed graph = compress(lower, size);
  std::vector<int> last;
  last.reserve(graph.members.size());
  for (const std::vector<int>& members : graph.members) {
    last.push_back(members.front() < interior ? 0 : 1);
  }
  std::vector<int> groups(last.size());
  cholmod_sparse pattern = view(graph.pattern);
  if (cholmod_camd(&pattern, nullptr, 0, last.data(), groups.data(), common.get()) == 0) {
    fail();
  }
  place(graph, groups.data());

  // nested dissection takes as long as some 8 000 operations of the factorisation an entry of the graph,
  // and saves about a third of these (the vessel at 24 000 to 185 000 unknowns)
  const double members = static_cast<double>(size) / static_cast<double>(graph.pattern.cols());
  const double operations = common->fl * members * members * members;
  if (operations / 3.0 > 8e3 * static_cast<double>(graph.pattern.nonZeros())) {
    Compressed inner = compress(lower, interior);
    cholmod_sparse of_inner = view(inner.pattern);
    common->supernodal = CHOLMOD_SIMPLICIAL;  // only the order is wanted
    common->nmethods = 1;
    common->method[0].ordering = CHOLMOD_METIS;
    static std::mutex metis;  // it draws from the C library's one random number generator
    std::unique_lock lock(metis);
    std::optional<TerminationWaits> waits(std::in_place);
    const auto analysis = common.own(cholmod_analyze(&of_inner, common.get()));
    waits.reset();
    lock.unlock();
    if (analysis != nullptr) {
      place(inner, static_cast<const int*>(analysis->Perm));
    } else if (common->status != CHOLMOD_NOT_INSTALLED) {  // METIS is optional
      fail();
    }
  }
  return order;
}

/// The lower triangle of a matrix in another order, by columns, each in no order of its own.
template <class Int>
struct Ordered {
  /// @param order the unknown at every place
  Ordered(const SparseRows& lower, const std::vector<int>& order)
      : first(order.size() + 1, 0),
        rows(static_cast<std::size_t>(lower.nonZeros())),
        values(rows.size()),
        diagonal(order.size(), 0.0) {
    std::vector<int> place(order.size());
    for (std::size_t i = 0; i < order.size(); ++i) {
      place[static_cast<std::size_t>(order[i])] = static_cast<int>(i);
    }
    const auto each = [&](const auto& visit) {
      for (int row = 0; row < lower.outerSize(); ++row) {
        const int i = place[static_cast<std::size_t>(row)];
        for (SparseRows::InnerIterator it(lower, row); it; ++it) {
          const int j = place[static_cast<std::size_t>(it.col())];
          visit(std::max(i, j), static_cast<std::size_t>(std::min(i, j)), it.value());
        }
      }
    };
    each([&](int, std::size_t column, double) { ++first[column + 1]; });
    std::partial_sum(first.begin(), first.end(), first.begin());
    std::vector<Int> next(first.begin(), first.end() - 1);
    each([&](int row, std::size_t column, double value) {
      const auto at = static_cast<std::size_t>(next[column]++);
      rows[at] = row;
      values[at] = value;
      if (static_cast<std::size_t>(row) == column) {
        diagonal[column] = value;
      }
    });
  }

  std::vector<Int> first;  ///< of every column, and one past the last
  std::vector<Int> rows;
  std::vector<double> values;
  std::vector<double> diagonal;
};

/// Supernodal Cholesky of SuiteSparse. The module is GPL: a binary with it is, too.
template <class Api>
class CholmodFactor final : public Factor {
  using Int = typename Api::Int;

 public:
  /// @param order the unknown at every place
  /// @param schur where the lower triangle of the Schur complement goes if the trailing unknowns are not to be
  ///   eliminated: their block of the factor is the identity then; null: they are
  /// @throws TooLarge
  CholmodFactor(const SparseRows& lower, const std::vector<int>& order, Index trailing,
                const std::string& name, Matrix* schur)
      : size_(lower.rows()), trailing_(trailing) {
    common_->supernodal = CHOLMOD_SUPERNODAL;
    common_->final_ll = 1;

    Ordered<Int> ordered(lower, order);
    // of a lower triangle in its natural order CHOLMOD makes no copies
    cholmod_sparse matrix = view(ordered);
    common_->nmethods = 1;
    common_->method[0].ordering = CHOLMOD_NATURAL;
    // the order is postordered already, and a new postorder would mix the trailing unknowns in
    common_->postorder = 0;
    factor_ = common_.own(Api::analyze(&matrix, common_.get()));
    if (factor_ == nullptr) {
      fail(name);
    }
    // the numbers of the factor are to be had, the analysis has their places
    if (Api::change_factor(CHOLMOD_REAL, 1, 1, 1, 1, factor_.get(), common_.get()) == 0) {
      fail(name);
    }
    try {
      const Supernodes<Int> nodes{factor_->n,
                                  factor_->nsuper,
                                  static_cast<const Int*>(factor_->super),
                                  static_cast<const Int*>(factor_->pi),
                                  static_cast<const Int*>(factor_->px),
                                  static_cast<const Int*>(factor_->s),
                                  static_cast<double*>(factor_->x)};
      factorise_supernodes(nodes,
                           {ordered.first.data(), ordered.rows.data(), ordered.values.data()},
                           static_cast<std::size_t>(schur != nullptr ? size_ - trailing_ : size_));
    } catch (const NotPositive& pivot) {
      throw NumericalError(not_definite(
          name, " (pivot " + std::to_string(pivot.column) + " of " + std::to_string(size_) + ")"));
    }
    std::ranges::copy(order, static_cast<Int*>(factor_->Perm));  // for solve(), from here on
    factor_->ordering = CHOLMOD_GIVEN;
    if (schur != nullptr) {
      *schur = copied_trailing();
      make_trailing_identity();
    } else {
      find_trailing();
    }
    refuse_singular(ordered, name, schur != nullptr ? size_ - trailing_ : size_);
  }
  CholmodFactor(const CholmodFactor&) = delete;
  CholmodFactor& operator=(const CholmodFactor&) = delete;
  CholmodFactor(CholmodFactor&&) = delete;
  CholmodFactor& operator=(CholmodFactor&&) = delete;
  ~CholmodFactor() override = default;

  [[nodiscard]] Index size() const override { return size_; }
  [[nodiscard]] bool condenses() const override { return trailing_ > 0; }
  [[nodiscard]] double nonzeros() const override { return static_cast<double>(factor_->xsize); }
  [[nodiscard]] double least_pivot() const override { return least_pivot_; }
  [[nodiscard]] std::string backend() const override { return Api::backend; }

  [[nodiscard]] Matrix solve(ConstMatrixRef rhs) const override {
    return solve_with({CHOLMOD_A}, rhs);
  }
  [[nodiscard]] Matrix forward(ConstMatrixRef rhs) const override {
    return solve_with({CHOLMOD_P, CHOLMOD_L}, rhs);
  }
  [[nodiscard]] Matrix backward(ConstMatrixRef rhs) const override {
    return solve_with({CHOLMOD_Lt, CHOLMOD_Pt}, rhs);
  }

  [[nodiscard]] MatrixView trailing_factor() const override {
    return {trailing_values_, trailing_, trailing_, Eigen::OuterStride<>(trailing_stride_)};
  }

 private:
  [[nodiscard]] Matrix copied_trailing() const {
    Matrix dense = Matrix::Zero(trailing_, trailing_);
    const auto first = static_cast<Int>(size_ - trailing_);
    each_trailing([&](Int row, Int column, const double& value) {
      dense(row - first, column - first) = value;
    });
    return dense;
  }

  /// Where the factor of the trailing unknowns is: in the last supernode. Several have those of a body whose faces
  /// are not all coupled, and only then are its numbers kept twice.
  void find_trailing() {
    if (trailing_ == 0) {
      return;
    }
    const auto* super = static_cast<const Int*>(factor_->super);
    const std::size_t last = factor_->nsuper - 1;
    const std::ptrdiff_t before = size_ - trailing_ - super[last];
    if (before < 0) {
      trailing_copy_ = copied_trailing();
      trailing_values_ = trailing_copy_.data();
      trailing_stride_ = trailing_;
      return;
    }
    trailing_stride_ = size_ - super[last];
    trailing_values_ = static_cast<const double*>(factor_->x) +
                       static_cast<const Int*>(factor_->px)[last] + before * (trailing_stride_ + 1);
  }

  /// Call `visit` of the numbers in the block of the trailing unknowns.
  template <class Visit>
  void each_trailing(const Visit& visit) const {
    const auto* super = static_cast<const Int*>(factor_->super);
    const auto* row_start = static_cast<const Int*>(factor_->pi);
    const auto* value_start = static_cast<const Int*>(factor_->px);
    const auto* rows = static_cast<const Int*>(factor_->s);
    auto* values = static_cast<double*>(factor_->x);
    const auto first = static_cast<Int>(size_ - trailing_);
    for (std::size_t node = 0; node < factor_->nsuper; ++node) {
      const Int height = row_start[node + 1] - row_start[node];
      for (Int column = std::max(super[node], first); column < super[node + 1]; ++column) {
        double* of_column = values + value_start[node] +
                            static_cast<std::ptrdiff_t>(height) * (column - super[node]);
        for (Int i = column - super[node]; i < height; ++i) {
          visit(rows[row_start[node] + i], column, of_column[i]);
        }
      }
    }
  }

  void make_trailing_identity() {
    each_trailing([](Int row, Int column, double& value) { value = row == column ? 1.0 : 0.0; });
  }

  /// One system after the other.
  [[nodiscard]] Matrix solve_with(std::initializer_list<int> systems, ConstMatrixRef rhs) const {
    Matrix block = rhs;  // contiguous, with the leading dimension that CHOLMOD is told
    cholmod_dense input{};
    input.nrow = static_cast<std::size_t>(block.rows());
    input.ncol = static_cast<std::size_t>(block.cols());
    input.nzmax = input.nrow * input.ncol;
    input.d = input.nrow;
    input.x = block.data();
    input.xtype = CHOLMOD_REAL;
    input.dtype = CHOLMOD_DOUBLE;
    Common<Api> own;  // the factor is only read: what is written is of this call
    for (const int system : systems) {
      cholmod_dense* output = Api::solve(system, factor_.get(), &input, own.get());
      if (output != nullptr) {
        block = Eigen::Map<const Matrix>(static_cast<const double*>(output->x), block.rows(),
                                         block.cols());
        Api::free_dense(&output, own.get());
      }
    }
    if (own->status < CHOLMOD_OK) {
      throw NumericalError("CHOLMOD could not solve with " + std::to_string(block.cols()) +
                           " columns (status " + std::to_string(own->status) + ")");
    }
    return block;
  }

  /// A rigid motion that nothing holds leaves a last pivot that is rounding: with luck a positive one.
  /// @param eliminated the columns that may not
  void refuse_singular(const Ordered<Int>& matrix, const std::string& name, Index eliminated) {
    const auto* super = static_cast<const Int*>(factor_->super);
    const auto* row_start = static_cast<const Int*>(factor_->pi);
    const auto* value_start = static_cast<const Int*>(factor_->px);
    const auto* values = static_cast<const double*>(factor_->x);
    for (std::size_t node = 0; node < factor_->nsuper; ++node) {
      const std::ptrdiff_t height = row_start[node + 1] - row_start[node];
      const Int end = std::min(super[node + 1], static_cast<Int>(eliminated));
      for (Int column = super[node]; column < end; ++column) {
        const double root = values[value_start[node] + (height + 1) * (column - super[node])];
        const double diagonal = matrix.diagonal[static_cast<std::size_t>(column)];
        least_pivot_ = std::min(least_pivot_, root * root / diagonal);
        if (!(root * root >= least_relative_pivot * diagonal)) {  // nor is one that is no number
          throw NumericalError(not_definite(name, " beyond rounding (pivot " +
                                                      std::to_string(column) + " of " +
                                                      std::to_string(size_) + " is all but zero)"));
        }
      }
    }
  }

  static cholmod_sparse view(Ordered<Int>& lower) {
    cholmod_sparse matrix =
        square(static_cast<Index>(lower.diagonal.size()), lower.rows.size(), Api::type);
    matrix.p = lower.first.data();
    matrix.i = lower.rows.data();
    matrix.x = lower.values.data();
    matrix.stype = -1;
    matrix.xtype = CHOLMOD_REAL;
    matrix.sorted = 0;
    return matrix;
  }
  [[noreturn]] void fail(const std::string& name) {
    if (common_->status == CHOLMOD_TOO_LARGE) {
      throw TooLarge();
    }
    refuse(name, size_, common_->status);
  }

  Index size_;
  Index trailing_;
  Common<Api> common_;
  std::unique_ptr<cholmod_factor, std::function<void(cholmod_factor*)>> factor_;
  double least_pivot_ = 1.0;
  const double* trailing_values_ = nullptr;  ///< of the trailing factor
  Index trailing_stride_ = 0;                ///< between its columns
  Matrix trailing_copy_;                     ///< empty: it is read where it is
};

/// With 64-bit indices where 32 bits cannot count the numbers of the factor, or where they are asked for.
std::unique_ptr<Factor> factorise_cholmod(const SparseRows& lower, Index trailing, bool wide,
                                          const std::string& name, Matrix* schur = nullptr) {
  try {
    const std::vector<int> order = interior_first(lower, trailing, name);
    if (!wide) {
      try {
        return std::make_unique<CholmodFactor<Narrow>>(lower, order, trailing, name, schur);
      } catch (const TooLarge&) {
        wide = true;  // the analysis says so, before anything is factorised
      }
    }
    return std::make_unique<CholmodFactor<Wide>>(lower, order, trailing, name, schur);
  } catch (const TooLarge&) {
    refuse(name, lower.rows(), CHOLMOD_TOO_LARGE);
  } catch (const std::bad_alloc&) {
    refuse_out_of_memory(name, lower.rows());
  }
}

#endif

/// MUMPS Cholesky through PETSc, for builds without CHOLMOD.
class MumpsFactor final : public Factor {
 public:
  MumpsFactor(const SparseRows& by_rows, const std::string& name) : size_(by_rows.rows()) {
    const PetscLock lock;
    SparseColumns lower = by_rows;  // sorts the rows of every column
    // PETSc's symmetric format keeps the upper triangle by rows: the lower one by columns, unchanged
    check(MatCreateSeqSBAIJWithArrays(PETSC_COMM_SELF, 1, static_cast<PetscInt>(size_),
                                      static_cast<PetscInt>(size_), lower.outerIndexPtr(),
                                      lower.innerIndexPtr(), lower.valuePtr(), matrix_.out()),
          "wrap a matrix");
    check(MatSetOption(matrix_.get(), MAT_SPD, PETSC_TRUE), "mark a matrix as definite");
    check(MatSetOptionsPrefix(matrix_.get(), "latin_substructure_"), "prefix a matrix");
    check(MatGetFactor(matrix_.get(), MATSOLVERMUMPS, MAT_FACTOR_CHOLESKY, factor_.out()),
          "get a MUMPS factor");
    MatFactorInfo info;
    check(MatFactorInfoInitialize(&info), "prepare a factorisation");
    bool done =
        MatCholeskyFactorSymbolic(factor_.get(), matrix_.get(), nullptr, &info) == PETSC_SUCCESS;
    done = done && succeeded() &&
           MatCholeskyFactorNumeric(factor_.get(), matrix_.get(), &info) == PETSC_SUCCESS;
    if (!done || !succeeded()) {
      if (is_out_of_memory()) {
        refuse_out_of_memory(name, size_);
      }
      throw NumericalError(not_definite(name, ""));
    }
    refuse_singular(lower, name);
    MatInfo facts{};
    check(MatGetInfo(factor_.get(), MAT_LOCAL, &facts), "ask a factor for its size");
    nonzeros_ = facts.nz_used;
  }

  [[nodiscard]] Index size() const override { return size_; }
  [[nodiscard]] bool condenses() const override { return false; }
  [[nodiscard]] double nonzeros() const override { return nonzeros_; }
  [[nodiscard]] std::string backend() const override { return "mumps"; }

  [[nodiscard]] Matrix solve(ConstMatrixRef rhs) const override {
    const PetscLock lock;
    Matrix input = rhs;
    Matrix output(input.rows(), input.cols());
    const auto dense = [](Matrix& block) {
      MatHandle handle;
      check(MatCreateSeqDense(PETSC_COMM_SELF, static_cast<PetscInt>(block.rows()),
                              static_cast<PetscInt>(block.cols()), block.data(), handle.out()),
            "wrap a block of columns");
      return handle;
    };
    const MatHandle b = dense(input);
    const MatHandle x = dense(output);
    check(MatMatSolve(factor_.get(), b.get(), x.get()), "solve with MUMPS");
    return output;
  }

  [[nodiscard]] MatrixView trailing_factor() const override { refuse_condensing(); }
  [[nodiscard]] Matrix forward(ConstMatrixRef /*rhs*/) const override { refuse_condensing(); }
  [[nodiscard]] Matrix backward(ConstMatrixRef /*rhs*/) const override { refuse_condensing(); }

 private:
  [[nodiscard]] bool succeeded() const {
    MatFactorError error{};
    check(MatFactorGetError(factor_.get(), &error), "ask a factor for its error");
    return error == MAT_FACTOR_NOERROR;
  }

  /// Whether its workspace could not be had: INFOG(1) of MUMPS, section 8 of its manual.
  [[nodiscard]] bool is_out_of_memory() const {
    MatFactorError error{};
    check(MatFactorGetError(factor_.get(), &error), "ask a factor for its error");
    PetscInt found = 0;
    check(MatMumpsGetInfog(factor_.get(), 1, &found), "ask MUMPS what happened");
    constexpr std::array<PetscInt, 9> memory{-7, -8, -9, -11, -13, -14, -15, -19, -20};
    return error == MAT_FACTOR_OUTMEMORY || std::ranges::find(memory, found) != memory.end();
  }

  [[noreturn]] static void refuse_condensing() {
    throw NumericalError("this build condenses with CHOLMOD only: use operator 'factored'");
  }

  /// MUMPS does not show its pivots: how much a solve enlarges a right-hand side without a pattern.
  void refuse_singular(const SparseColumns& lower, const std::string& name) const {
    Vector root(size_);
    Matrix rhs(size_, 1);
    for (Index i = 0; i < size_; ++i) {
      // the diagonal comes first in a column of a lower triangle
      root(i) = std::sqrt(lower.valuePtr()[lower.outerIndexPtr()[i]]);
      rhs(i, 0) = std::sin(1.0 + 1.234567 * static_cast<double>(i * i));
    }
    const double given = rhs.norm();
    rhs = root.asDiagonal() * rhs;
    const double enlarged = (root.asDiagonal() * solve(rhs)).norm();
    if (size_ > 0 &&
        !(enlarged * std::sqrt(static_cast<double>(size_)) < given / least_relative_pivot)) {
      throw NumericalError(not_definite(name, " beyond rounding"));
    }
  }

  Index size_;
  double nonzeros_ = 0.0;
  MatHandle matrix_;
  MatHandle factor_;
};

}  // namespace

std::unique_ptr<Factor> factorise(const SparseRows& lower, Index trailing, FactorBackend backend,
                                  const std::string& name) {
#ifdef LATIN_HAVE_CHOLMOD
  if (backend != FactorBackend::mumps) {
    return factorise_cholmod(lower, trailing, backend == FactorBackend::cholmod64, name);
  }
#else
  if (backend == FactorBackend::cholmod || backend == FactorBackend::cholmod64) {
    throw InputError("backend 'cholmod' is not in this build: use 'mumps' or 'automatic'");
  }
#endif
  static_cast<void>(trailing);
  return std::make_unique<MumpsFactor>(lower, name);
}

Elimination::Elimination(const SparseRows& lower, Index kept, FactorBackend backend,
                         const std::string& name)
    : size_(lower.rows()), kept_(kept) {
  const Index interior = size_ - kept;
  if (kept < 0 || interior < 0) {
    throw InputError("'" + name + "': " + std::to_string(kept) + " unknowns of " +
                     std::to_string(size_) + " are to be kept");
  }
  if (interior == 0) {
    schur_ = Matrix(lower);
    return;
  }
#ifdef LATIN_HAVE_CHOLMOD
  if (backend != FactorBackend::mumps && kept > 0) {
    condenses_ = true;
    interior_ = factorise_cholmod(lower, kept, backend == FactorBackend::cholmod64, name, &schur_);
    return;
  }
#endif
  interior_ = factorise(lower.topLeftCorner(interior, interior), 0, backend, name);
  coupling_ = lower.bottomLeftCorner(kept, interior);
  schur_ = Matrix(lower.bottomRightCorner(kept, kept));
  constexpr Index block = 64;
  for (Index column = 0; column < kept; column += block) {
    const Index some = std::min(block, kept - column);
    const Matrix right = Matrix(coupling_.middleRows(column, some)).transpose();
    schur_.middleCols(column, some) -= coupling_ * interior_->solve(right);
  }
}

Matrix Elimination::reduce(ConstMatrixRef forces, Matrix& partial) const {
  if (condenses_) {
    partial = interior_->forward(forces);
    return partial.bottomRows(kept_);
  }
  partial = forces;
  if (interior_ == nullptr) {
    return forces;
  }
  const Index interior = size_ - kept_;
  partial.topRows(interior) = interior_->solve(forces.topRows(interior));
  return forces.bottomRows(kept_) - coupling_ * partial.topRows(interior);
}

Matrix Elimination::expand(ConstMatrixRef kept, Matrix partial) const {
  partial.bottomRows(kept_) = kept;
  if (condenses_) {
    return interior_->backward(partial);
  }
  if (interior_ != nullptr) {
    partial.topRows(size_ - kept_) -= interior_->solve(coupling_.transpose() * kept);
  }
  return partial;
}

std::string available_backends() {
#ifdef LATIN_HAVE_CHOLMOD
  return "cholmod, cholmod64, mumps";
#else
  return "mumps";
#endif
}

}  // namespace latin::algebra
