#include "latin/petsc/handle.hpp"

#include <cmath>
#include <string>
#include <vector>

#include "latin/common/error.hpp"

namespace latin::petsc {

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

SparseRows to_sparse(Mat matrix, std::string_view name) {
  PetscMPIInt ranks = 0;
  if (MPI_Comm_size(PetscObjectComm(reinterpret_cast<PetscObject>(matrix)), &ranks) !=
          MPI_SUCCESS ||
      ranks != 1) {
    throw InputError(
        "matrix of '" + std::string(name) +
        "' is spread over several ranks: a substructure belongs to one rank, build its "
        "mesh on MPI.COMM_SELF");
  }
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
      throw InputError("matrix of '" + std::string(name) + "' holds a NaN or infinity in row " +
                       std::to_string(row) +
                       ": check the material, the mesh (inverted cells) and the UFL form");
    }
  }
  copy.resizeNonZeros(filled);
  return copy;
}

}  // namespace latin::petsc
