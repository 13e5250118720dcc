#include "algebra/general_factor.hpp"

#include "latin/common/error.hpp"

#ifdef LATIN_HAVE_UMFPACK
#include <Eigen/UmfPackSupport>
#else
#include <Eigen/SparseLU>
#endif

namespace latin::algebra {

struct GeneralFactor::Lu {
  explicit Lu(const SparseColumns& given) : matrix(given) { factor.compute(matrix); }

  SparseColumns matrix;  ///< UMFPACK refines with it
#ifdef LATIN_HAVE_UMFPACK
  Eigen::UmfPackLU<SparseColumns> factor;
#else
  Eigen::SparseLU<SparseColumns> factor;
#endif
};

GeneralFactor::GeneralFactor(const SparseColumns& matrix) : lu_(std::make_unique<Lu>(matrix)) {
  if (lu_->factor.info() != Eigen::Success) {
    throw NumericalError("a matrix without symmetry is singular");
  }
}

GeneralFactor::~GeneralFactor() = default;
GeneralFactor::GeneralFactor(GeneralFactor&&) noexcept = default;
GeneralFactor& GeneralFactor::operator=(GeneralFactor&&) noexcept = default;

Matrix GeneralFactor::solve(const Matrix& load) const { return lu_->factor.solve(load); }

}  // namespace latin::algebra
