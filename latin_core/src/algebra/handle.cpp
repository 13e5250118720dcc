#include "algebra/handle.hpp"

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "latin/common/error.hpp"

namespace latin::algebra {

std::recursive_mutex& PetscLock::mutex() {
  static std::recursive_mutex one;
  return one;
}

bool petsc_is_there() {
  PetscBool begun = PETSC_FALSE;
  PetscBool ended = PETSC_TRUE;
  return PetscInitialized(&begun) == PETSC_SUCCESS && PetscFinalized(&ended) == PETSC_SUCCESS &&
         begun == PETSC_TRUE && ended == PETSC_FALSE;
}

void check(PetscErrorCode code, std::string_view doing) {
  if (code == PETSC_SUCCESS) {
    return;
  }
  const char* text = nullptr;
  static_cast<void>(PetscErrorMessage(code, &text, nullptr));
  throw NumericalError("PETSc could not " + std::string(doing) + ": error " +
                       std::to_string(static_cast<int>(code)) + " (" +
                       (text != nullptr ? text : "unknown") + ")");
}

namespace {

void check_sequential(Mat matrix, std::string_view name) {
  PetscMPIInt ranks = 0;
  if (MPI_Comm_size(PetscObjectComm(reinterpret_cast<PetscObject>(matrix)), &ranks) !=
          MPI_SUCCESS ||
      ranks != 1) {
    throw InputError(
        "matrix of '" + std::string(name) +
        "' is spread over several ranks: a substructure belongs to one rank, build its "
        "mesh on MPI.COMM_SELF");
  }
}

[[noreturn]] void not_finite(std::string_view name, Index row) {
  throw InputError("matrix of '" + std::string(name) + "' holds a NaN or infinity in row " +
                   std::to_string(row) +
                   ": check the material, the mesh (inverted cells) and the UFL form");
}

/// PETSc's own arrays, held until the view goes.
class Borrowed {
 public:
  explicit Borrowed(Mat matrix) : matrix_(MatHandle::borrow(matrix)) {
    PetscBool known = PETSC_FALSE;
    check(MatGetRowIJ(matrix, 0, PETSC_FALSE, PETSC_FALSE, &rows_, &starts_, &columns_, &known),
          "read the structure of a matrix");
    if (known != PETSC_TRUE) {
      throw NumericalError("PETSc does not give the structure of a matrix");
    }
    check(MatSeqAIJGetArrayRead(matrix, &values_), "read the values of a matrix");
    view_ = std::make_unique<const SparseView>(rows_, rows_, starts_[rows_], starts_, columns_,
                                               values_);
  }
  Borrowed(const Borrowed&) = delete;
  Borrowed& operator=(const Borrowed&) = delete;
  Borrowed(Borrowed&&) = delete;
  Borrowed& operator=(Borrowed&&) = delete;
  ~Borrowed() {
    if (!petsc_is_there()) {
      return;
    }
    const PetscLock lock;
    // a destructor must not throw: error codes are dropped
    PetscBool known = PETSC_FALSE;
    static_cast<void>(MatSeqAIJRestoreArrayRead(matrix_.get(), &values_));
    static_cast<void>(MatRestoreRowIJ(matrix_.get(), 0, PETSC_FALSE, PETSC_FALSE, &rows_, &starts_,
                                      &columns_, &known));
  }
  [[nodiscard]] const SparseView& view() const { return *view_; }

 private:
  MatHandle matrix_;
  PetscInt rows_ = 0;
  const PetscInt* starts_ = nullptr;
  const PetscInt* columns_ = nullptr;
  const PetscScalar* values_ = nullptr;
  std::unique_ptr<const SparseView> view_;
};

}  // namespace

std::shared_ptr<const SparseView> view_sparse(Mat matrix, std::string_view name) {
  const PetscLock lock;
  check_sequential(matrix, name);
  PetscBool plain = PETSC_FALSE;
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(matrix), MATSEQAIJ, &plain),
        "ask for the type of a matrix");
  PetscBool assembled = PETSC_FALSE;
  check(MatAssembled(matrix, &assembled), "ask whether a matrix is assembled");
  PetscInt rows = 0;
  PetscInt cols = 0;
  check(MatGetSize(matrix, &rows, &cols), "read the size of a matrix");
  if (assembled != PETSC_TRUE) {
    throw InputError("matrix of '" + std::string(name) + "' is not assembled: call assemble()");
  }
  if (plain != PETSC_TRUE || rows != cols) {
    return owning_view(to_sparse(matrix, name));
  }
  const auto borrowed = std::make_shared<const Borrowed>(matrix);
  const SparseView& view = borrowed->view();
  for (Index row = 0; row < view.rows(); ++row) {
    for (SparseView::InnerIterator entry(view, row); entry; ++entry) {
      if (!std::isfinite(entry.value())) {
        not_finite(name, row);
      }
    }
  }
  return {borrowed, &view};
}

SparseRows to_sparse(Mat matrix, std::string_view name) {
  const PetscLock lock;
  check_sequential(matrix, name);
  PetscInt rows = 0;
  PetscInt cols = 0;
  check(MatGetSize(matrix, &rows, &cols), "read the size of a matrix");

  MatInfo facts{};
  check(MatGetInfo(matrix, MAT_LOCAL, &facts), "read the size of a matrix");
  SparseRows copy(rows, cols);
  copy.resizeNonZeros(static_cast<Index>(facts.nz_used));
  Index filled = 0;
  for (PetscInt row = 0; row < rows; ++row) {
    PetscInt count = 0;
    const PetscInt* where = nullptr;
    const PetscScalar* what = nullptr;
    check(MatGetRow(matrix, row, &count, &where, &what), "read a row of a matrix");
    if (filled + count > copy.data().allocatedSize()) {
      copy.resizeNonZeros(2 * (filled + count));
    }
    bool finite = true;
    for (PetscInt i = 0; i < count; ++i) {
      finite = finite && std::isfinite(what[i]);
      if (what[i] != 0.0) {
        copy.innerIndexPtr()[filled] = where[i];
        copy.valuePtr()[filled] = what[i];
        ++filled;
      }
    }
    copy.outerIndexPtr()[row + 1] = static_cast<int>(filled);
    check(MatRestoreRow(matrix, row, &count, &where, &what), "release a row of a matrix");
    if (!finite) {
      not_finite(name, row);
    }
  }
  copy.resizeNonZeros(filled);
  return copy;
}

}  // namespace latin::algebra
