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

  std::vector<int> start(static_cast<std::size_t>(rows) + 1, 0);
  std::vector<int> column;
  std::vector<double> value;
  for (PetscInt row = 0; row < rows; ++row) {
    PetscInt count = 0;
    const PetscInt* where = nullptr;
    const PetscScalar* what = nullptr;
    check(MatGetRow(matrix, row, &count, &where, &what), "read a row of a matrix");
    for (PetscInt i = 0; i < count; ++i) {
      if (!std::isfinite(what[i])) {
        check(MatRestoreRow(matrix, row, &count, &where, &what), "release a row of a matrix");
        throw InputError("matrix of '" + std::string(name) + "' holds a NaN or infinity in row " +
                         std::to_string(row) +
                         ": check the material, the mesh (inverted cells) and the UFL form");
      }
      if (what[i] != 0.0) {
        column.push_back(where[i]);
        value.push_back(what[i]);
      }
    }
    start[static_cast<std::size_t>(row) + 1] = static_cast<int>(column.size());
    check(MatRestoreRow(matrix, row, &count, &where, &what), "release a row of a matrix");
  }
  return Eigen::Map<const SparseRows>(rows, cols, static_cast<Index>(value.size()), start.data(),
                                      column.data(), value.data());
}

}  // namespace latin::petsc
