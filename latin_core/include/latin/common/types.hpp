#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

namespace latin {

using Index = Eigen::Index;
using Vector = Eigen::VectorXd;
/// Column-major block: a field of `rows` values for each of `cols` columns (time steps, chaos modes).
using Matrix = Eigen::MatrixXd;
using ConstMatrixRef = Eigen::Ref<const Matrix>;
using MatrixRef = Eigen::Ref<Matrix>;
/// A block inside of a matrix by columns that somebody else keeps.
using MatrixView = Eigen::Map<const Matrix, Eigen::Unaligned, Eigen::OuterStride<>>;
using ConstVectorRef = Eigen::Ref<const Vector>;

/// 32-bit indices, as PETSc's and CHOLMOD's default builds.
using SparseRows = Eigen::SparseMatrix<double, Eigen::RowMajor, int>;
using SparseColumns = Eigen::SparseMatrix<double, Eigen::ColMajor, int>;
using Triplets = std::vector<Eigen::Triplet<double, int>>;

/// All rows or columns in an index expression: Eigen 3.4 and 5 keep their own in different places.
inline const Eigen::internal::all_t every{};

}  // namespace latin
