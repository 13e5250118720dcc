#include "stochastic/galerkin_operator.hpp"

#include <exception>
#include <string>
#include <utility>

#include "latin/common/error.hpp"

namespace latin::stochastic {
namespace {

/// v += S u, row by row: the modes of a row are neighbours.
void add_product(const SparseRows& matrix, ConstModeRowsRef u, ModeRowsRef v) {
  for (Index row = 0; row < matrix.rows(); ++row) {
    auto sum = v.row(row);
    for (SparseRows::InnerIterator entry(matrix, row); entry; ++entry) {
      sum += entry.value() * u.row(entry.col());
    }
  }
}

using Owner = std::shared_ptr<const GalerkinOperator>;

/// The operator that a shell matrix owns.
Owner* owner_of(Mat matrix) {
  void* context = nullptr;
  return MatShellGetContext(matrix, static_cast<void*>(&context)) == PETSC_SUCCESS
             ? static_cast<Owner*>(context)
             : nullptr;
}

PetscErrorCode multiply(Mat matrix, Vec from, Vec to) {
  const Owner* const owner = owner_of(matrix);
  const PetscScalar* u = nullptr;
  PetscScalar* v = nullptr;
  PetscCall(VecGetArrayRead(from, &u));
  PetscCall(VecGetArrayWrite(to, &v));
  bool done = owner != nullptr;
  try {  // exceptions must not cross PETSc, which is C
    if (done) {
      const GalerkinOperator& applied = **owner;
      applied.apply(Eigen::Map<const ModeRows>(u, applied.size(), applied.modes()),
                    Eigen::Map<ModeRows>(v, applied.size(), applied.modes()));
    }
  } catch (const std::exception&) {
    done = false;
  }
  PetscCall(VecRestoreArrayWrite(to, &v));
  PetscCall(VecRestoreArrayRead(from, &u));
  return done ? PETSC_SUCCESS : PETSC_ERR_LIB;
}

PetscErrorCode destroy(Mat matrix) {
  delete owner_of(matrix);  // NOLINT(cppcoreguidelines-owning-memory): PETSc keeps a bare pointer
  return PETSC_SUCCESS;
}

using Untyped = void (*)();

}  // namespace

GalerkinOperator::GalerkinOperator(const SparseRows& fixed, std::vector<Term> terms, Index modes)
    : fixed_(fixed), terms_(std::move(terms)), modes_(modes) {
  const auto demand = [](bool holds, const std::string& text) {
    if (!holds) {
      throw InputError("Galerkin operator: " + text);
    }
  };
  demand(fixed_.rows() == fixed_.cols(), "the fixed part is not square");
  demand(modes >= 1, std::to_string(modes) + " modes");
  for (const Term& term : terms_) {
    const Index points = term.weights.size();
    demand(term.coupling != nullptr && term.coupling->modes() == modes,
           "a coupling has another number of modes");
    demand(points >= 1 && term.jump.cols() == size() && term.jump.rows() % points == 0 &&
               (term.coupling->points() == 1 || term.coupling->points() == points),
           "a jump of shape (" + std::to_string(term.jump.rows()) + ", " +
               std::to_string(term.jump.cols()) + ") does not fit " + std::to_string(points) +
               " points and " + std::to_string(size()) + " unknowns");
    const Index components = term.jump.rows() / points;
    const Vector weights = term.weights.transpose().replicate(components, 1).reshaped();
    back_.emplace_back((weights.asDiagonal() * term.jump).transpose());
  }
}

void GalerkinOperator::apply(ConstModeRowsRef u, ModeRowsRef v) const {
  if (u.rows() != size() || u.cols() != modes_ || v.rows() != size() || v.cols() != modes_) {
    throw InputError("Galerkin operator: a block of shape (" + std::to_string(u.rows()) + ", " +
                     std::to_string(u.cols()) + "), (" + std::to_string(size()) + ", " +
                     std::to_string(modes_) + ") is wanted");
  }
  v.setZero();
  add_product(fixed_, u, v);
  for (std::size_t t = 0; t < terms_.size(); ++t) {
    const Term& term = terms_[t];
    ModeRows jump = ModeRows::Zero(term.jump.rows(), modes_);
    add_product(term.jump, u, jump);
    ModeRows force(jump.rows(), modes_);
    term.coupling->apply(jump, jump.rows() / term.weights.size(), force);
    add_product(back_[t], force, v);
  }
}

algebra::MatHandle shell_matrix(std::shared_ptr<const GalerkinOperator> applied) {
  using algebra::check;
  const algebra::PetscLock lock;
  const auto size = static_cast<PetscInt>(applied->size() * applied->modes());
  auto owner = std::make_unique<Owner>(std::move(applied));
  algebra::MatHandle matrix;
  check(MatCreateShell(PETSC_COMM_SELF, size, size, size, size, nullptr, matrix.out()),
        "create a shell matrix");
  check(MatShellSetOperation(matrix.get(), MATOP_DESTROY, reinterpret_cast<Untyped>(&destroy)),
        "set up a shell matrix");
  // the matrix ends it
  check(MatShellSetContext(matrix.get(), owner.release()), "set up a shell matrix");
  check(MatShellSetOperation(matrix.get(), MATOP_MULT, reinterpret_cast<Untyped>(&multiply)),
        "set up a shell matrix");
  check(MatSetOption(matrix.get(), MAT_SYMMETRIC, PETSC_TRUE), "set up a shell matrix");
  return matrix;
}

}  // namespace latin::stochastic
