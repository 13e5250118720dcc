#include "equilibration/reference_cell.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <string>
#include <utility>

#include "common/threads.hpp"
#include "latin/common/error.hpp"
#include "stochastic/germ.hpp"

namespace latin::equilibration {
namespace {

/// Singular values below this share of the largest are zero.
constexpr double dependent = 1e-10;

/// All exponents of monomials of `dim` variables up to a degree.
std::vector<std::vector<int>> monomials(int dim, int degree) {
  std::vector<std::vector<int>> found{{}};
  for (int axis = 0; axis < dim; ++axis) {
    std::vector<std::vector<int>> longer;
    for (const auto& each : found) {
      int used = 0;
      for (const int e : each) {
        used += e;
      }
      for (int e = 0; used + e <= degree; ++e) {
        longer.push_back(each);
        longer.back().push_back(e);
      }
    }
    found = std::move(longer);
  }
  return found;
}

/// (monomials, m) at points (d, m).
Matrix powers(const std::vector<std::vector<int>>& exponents, ConstMatrixRef points) {
  Matrix out = Matrix::Ones(static_cast<Index>(exponents.size()), points.cols());
  for (std::size_t k = 0; k < exponents.size(); ++k) {
    for (Index axis = 0; axis < points.rows(); ++axis) {
      for (int e = 0; e < exponents[k][axis]; ++e) {
        out.row(static_cast<Index>(k)).array() *= points.row(axis).array();
      }
    }
  }
  return out;
}

Matrix with_first(ConstMatrixRef points) {
  Matrix out(points.rows() + 1, points.cols());
  out.row(0) = 1.0 - points.colwise().sum().array();
  out.bottomRows(points.rows()) = points;
  return out;
}

/// A facet, its corners in columns: points (d, m) of a rule on it, and its normal with the length that makes weights
/// areas.
struct Surface {
  Matrix points;
  Vector normal;
};
Surface surface(const Matrix& corners, const Rule& rule) {
  const Index d = corners.rows();
  const Matrix edges = corners.rightCols(d - 1).colwise() - corners.col(0);
  Surface out{edges * rule.points, Vector(d)};
  out.points.colwise() += corners.col(0);
  if (d == 2) {
    out.normal << edges(1, 0), -edges(0, 0);
  } else {
    const Eigen::Vector3d one = edges.col(0);
    const Eigen::Vector3d other = edges.col(1);
    out.normal = one.cross(other);
  }
  return out;
}

/// Columns of a matrix but some.
Matrix without(const Matrix& columns, const std::vector<Index>& left_out) {
  Matrix out(columns.rows(), columns.cols() - static_cast<Index>(left_out.size()));
  Index next = 0;
  for (Index k = 0; k < columns.cols(); ++k) {
    if (std::find(left_out.begin(), left_out.end(), k) == left_out.end()) {
      out.col(next++) = columns.col(k);
    }
  }
  return out;
}

}  // namespace

Rule simplex_rule(int dim, int points) {
  const stochastic::Rule line =
      stochastic::Germ::family("legendre", {}).gauss(points);  // on [-1, 1]
  const Vector at = 0.5 * (line.points.col(0).array() + 1.0);
  Rule rule{Matrix::Zero(0, 1), Vector::Ones(1)};
  for (int axis = 0; axis < dim; ++axis) {  // a cone over the simplex of one dimension less
    const Index before = rule.points.cols();
    Rule next{Matrix(axis + 1, before * points), Vector(before * points)};
    for (Index k = 0; k < points; ++k) {
      const double left = 1.0 - at(k);
      next.points.block(0, k * before, axis, before) = left * rule.points;
      next.points.block(axis, k * before, 1, before).setConstant(at(k));
      next.weights.segment(k * before, before) =
          line.weights(k) * std::pow(left, axis) * rule.weights;
    }
    rule = std::move(next);
  }
  return rule;
}

Matrix lagrange(int degree, ConstMatrixRef barycentric) {
  if (degree == 1) {
    return barycentric;
  }
  const Index corners = barycentric.rows();
  Matrix out(corners * (corners + 1) / 2, barycentric.cols());
  out.topRows(corners) = barycentric.cwiseProduct(2.0 * barycentric) - barycentric;
  Index next = corners;
  for (Index i = 0; i < corners; ++i) {
    for (Index j = i + 1; j < corners; ++j) {
      out.row(next++) = 4.0 * barycentric.row(i).cwiseProduct(barycentric.row(j));
    }
  }
  return out;
}

ReferenceCell::ReferenceCell(int dim, int degree) : dim_(dim), degree_(degree) {
  if ((dim != 2 && dim != 3) || (degree != 1 && degree != 2)) {
    throw InputError("equilibrated stresses: dimension " + std::to_string(dim) + ", degree " +
                     std::to_string(degree) +
                     "; there are those of 2 and 3 dimensions, degree 1 and 2");
  }
  const SerialAlgebra serial;  // small
  vertices_ = Matrix::Zero(dim, dim + 1);
  vertices_.rightCols(dim).setIdentity();
  exponents_ = monomials(dim, degree);
  const Rule rule = simplex_rule(dim, degree + 2);
  const Matrix values = powers(exponents_, rule.points);
  const Matrix gram = values * rule.weights.asDiagonal() * values.transpose();
  orthonormal_ = gram.llt().matrixL().solve(Matrix::Identity(gram.rows(), gram.cols())).transpose();
  const Vector centre = vertices_.rowwise().mean();
  for (Index s = 0; s <= dim; ++s) {
    Matrix corners = vertices_;
    corners.col(s) = centre;
    const Matrix edges = corners.rightCols(dim).colwise() - corners.col(0);
    pieces_.push_back({edges.inverse(), corners.col(0), std::abs(edges.determinant())});
  }
  for (Index k = 0; k <= dim; ++k) {
    std::vector<Index> on;
    for (Index i = 0; i <= dim; ++i) {
      if (i != k) {
        on.push_back(i);
      }
    }
    Index next = dim + 1;
    for (Index i = 0; degree > 1 && i <= dim; ++i) {
      for (Index j = i + 1; j <= dim; ++j, ++next) {
        if (i != k && j != k) {
          on.push_back(next);
        }
      }
    }
    facet_.push_back(std::move(on));
  }
  solve();
  const Index pairs = components() * (components() + 1) / 2;
  const Index each = (dim + 1) * terms();
  const Index columns = basis_.cols();
  products_.resize(columns * columns, pairs);
  Index pair = 0;
  for (Index a = 0; a < components(); ++a) {
    for (Index b = a; b < components(); ++b, ++pair) {
      Matrix product =
          basis_.middleRows(a * each, each).transpose() * basis_.middleRows(b * each, each);
      if (a != b) {
        product += product.transpose().eval();
      }
      products_.col(pair) = product.reshaped();
    }
  }
}

const ReferenceCell& ReferenceCell::of(int dim, int degree) {
  static const ReferenceCell cells[2][2] = {{{2, 1}, {2, 2}}, {{3, 1}, {3, 2}}};
  if (dim < 2 || dim > 3 || degree < 1 || degree > 2) {
    throw InputError("equilibrated stresses: dimension " + std::to_string(dim) + ", degree " +
                     std::to_string(degree) +
                     "; there are those of 2 and 3 dimensions, degree 1 and 2");
  }
  return cells[dim - 2][degree - 1];
}

std::pair<int, int> ReferenceCell::component(Index k) const {
  if (k < dim_) {
    return {static_cast<int>(k), static_cast<int>(k)};
  }
  if (dim_ == 2) {
    return {0, 1};
  }
  return k == 3 ? std::pair{1, 2} : k == 4 ? std::pair{0, 2} : std::pair{0, 1};
}

Index ReferenceCell::nodes() const { return degree_ == 1 ? dim_ + 1 : (dim_ + 1) * (dim_ + 2) / 2; }

Matrix ReferenceCell::values(Index piece, ConstMatrixRef points) const {
  const Piece& own = pieces_[piece];
  const Matrix local = own.inverse * (points.colwise() - own.origin);
  return orthonormal_.transpose() * powers(exponents_, local) / std::sqrt(own.size);
}

/// Gradients (d, terms) at a point (d, 1).
Matrix ReferenceCell::slopes(Index piece, ConstMatrixRef point) const {
  const Piece& own = pieces_[piece];
  const Matrix local = own.inverse * (point - own.origin);
  Matrix gradient(dim_, static_cast<Index>(exponents_.size()));
  for (int axis = 0; axis < dim_; ++axis) {
    auto lower = exponents_;
    for (auto& each : lower) {
      each[axis] = std::max(each[axis] - 1, 0);
    }
    gradient.row(axis) = powers(lower, local).transpose();
    for (std::size_t k = 0; k < exponents_.size(); ++k) {
      gradient(axis, static_cast<Index>(k)) *= exponents_[k][axis];
    }
  }
  return own.inverse.transpose() * gradient * orthonormal_ / std::sqrt(own.size);
}

/// The equations of balance of the coefficients, and their right sides for every number of data.
struct ReferenceCell::Equations {
  explicit Equations(const ReferenceCell& cell)
      : of(cell),
        each((cell.dim_ + 1) * cell.terms()),
        of_data((cell.dim_ + 1) * cell.facet_nodes() * cell.dim_ + cell.dim_),
        rule(simplex_rule(cell.dim_ - 1, cell.degree_ + 2)),
        tests(powers(monomials(cell.dim_ - 1, cell.degree_), rule.points)),
        centre(cell.vertices_.rowwise().mean()) {}

  [[nodiscard]] Index pieces() const { return of.dim_ + 1; }

  void begin(Index count) {
    rows.emplace_back(Matrix::Zero(count, of.components() * each));
    right.emplace_back(Matrix::Zero(count, of_data));
  }

  /// Add the moments of the tractions of a piece with the tests.
  void add(Index piece, const Surface& on, double sign) {
    const Matrix moments =
        tests * rule.weights.asDiagonal() * of.values(piece, on.points).transpose();
    for (Index a = 0; a < of.components(); ++a) {
      const auto [i, j] = of.component(a);
      const Index at = a * each + piece * of.terms();
      rows.back().block(i * tests.rows(), at, tests.rows(), of.terms()) +=
          sign * on.normal(j) * moments;
      if (i != j) {
        rows.back().block(j * tests.rows(), at, tests.rows(), of.terms()) +=
            sign * on.normal(i) * moments;
      }
    }
  }

  /// On facets they are those with given moments.
  void on_facets() {
    const Matrix shapes = lagrange(of.degree_, with_first(rule.points));
    const Matrix mass = shapes * rule.weights.asDiagonal() * shapes.transpose();
    const Matrix by_moments =
        mass.llt().solve(shapes * rule.weights.asDiagonal() * tests.transpose()).transpose();
    for (Index k = 0; k < pieces(); ++k) {
      const Matrix corners = without(of.vertices_, {k});
      Surface on = surface(corners, rule);
      if (on.normal.dot(corners.rowwise().mean() - centre) < 0.0) {
        on.normal = -on.normal;
      }
      begin(of.dim_ * tests.rows());
      add(k, on, 1.0);
      for (Index j = 0; j < of.facet_nodes(); ++j) {
        for (Index i = 0; i < of.dim_; ++i) {
          right.back().block(i * tests.rows(), (k * of.facet_nodes() + j) * of.dim_ + i,
                             tests.rows(), 1) = by_moments.col(j);
        }
      }
    }
  }

  /// Between pieces they are the same on both sides.
  void between_pieces() {
    for (Index one = 0; one < pieces(); ++one) {
      for (Index other = one + 1; other < pieces(); ++other) {
        Matrix corners(of.dim_, of.dim_);
        corners << centre, without(of.vertices_, {one, other});
        const Surface on = surface(corners, rule);
        begin(of.dim_ * tests.rows());
        add(one, on, 1.0);
        add(other, on, -1.0);
      }
    }
  }

  /// In pieces the divergence is given: at the corners, as it is linear.
  void in_pieces() {
    for (Index piece = 0; piece < pieces(); ++piece) {
      Matrix corners = of.vertices_;
      corners.col(piece) = centre;
      for (Index corner = 0; corner < (of.degree_ > 1 ? pieces() : 1); ++corner) {
        const Matrix gradient = of.slopes(piece, corners.col(corner));
        begin(of.dim_);
        for (Index a = 0; a < of.components(); ++a) {
          const auto [i, j] = of.component(a);
          const Index at = a * each + piece * of.terms();
          rows.back().block(i, at, 1, of.terms()) += gradient.row(j);
          if (i != j) {
            rows.back().block(j, at, 1, of.terms()) += gradient.row(i);
          }
        }
        right.back().rightCols(of.dim_).setIdentity();
      }
    }
  }

  const ReferenceCell& of;
  Index each;
  Index of_data;
  Rule rule;
  Matrix tests;
  Vector centre;
  std::vector<Matrix> rows;
  std::vector<Matrix> right;
};

void ReferenceCell::solve() {
  Equations equations(*this);
  equations.on_facets();
  equations.between_pieces();
  equations.in_pieces();
  const auto stacked = [](const std::vector<Matrix>& blocks) {
    Index count = 0;
    for (const Matrix& block : blocks) {
      count += block.rows();
    }
    Matrix out(count, blocks.front().cols());
    Index next = 0;
    for (const Matrix& block : blocks) {
      out.middleRows(next, block.rows()) = block;
      next += block.rows();
    }
    return out;
  };
  const Eigen::BDCSVD<Matrix> svd(stacked(equations.rows),
                                  Eigen::ComputeThinU | Eigen::ComputeFullV);
  const Vector& singular = svd.singularValues();
  const Index rank = (singular.array() > dependent * singular(0)).count();
  self_stresses_ = svd.matrixV().rows() - rank;
  basis_.resize(svd.matrixV().rows(), self_stresses_ + equations.of_data);
  basis_.leftCols(self_stresses_) = svd.matrixV().rightCols(self_stresses_);
  basis_.rightCols(equations.of_data) =
      svd.matrixV().leftCols(rank) * singular.head(rank).cwiseInverse().asDiagonal() *
      (svd.matrixU().leftCols(rank).transpose() * stacked(equations.right));
}

}  // namespace latin::equilibration
