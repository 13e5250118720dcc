#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "equilibration/equilibration.hpp"
#include "equilibration/reference_cell.hpp"
#include "latin/common/error.hpp"
#include "threads.hpp"

namespace latin::equilibration {
namespace {

/// Compliance of E = 1, nu = 0 by components: shear strains are engineering ones.
Matrix soft(int dim) {
  Vector diagonal = Vector::Ones(dim * (dim + 1) / 2);
  diagonal.tail(diagonal.size() - dim).setConstant(2.0);
  return diagonal.asDiagonal();
}

/// One askew cell, all tractions given, which balance a body force.
struct OneCell {
  OneCell(int dim, int degree, unsigned seed)
      : dim(dim), reference(ReferenceCell::of(dim, degree)) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> any(-1.0, 1.0);
    cells.vertices = Matrix::Zero(dim, dim + 1);
    cells.vertices.rightCols(dim).setIdentity();
    cells.vertices += 0.2 * Matrix::NullaryExpr(dim, dim + 1, [&] { return any(random); });
    for (Index k = 0; k <= dim; ++k) {
      cells.corners.push_back(k);
    }
    cells.stress =
        Matrix::NullaryExpr(reference.components(), dim + 1, [&] { return any(random); });
    cells.force = Matrix::NullaryExpr(dim, 1, [&] { return any(random); });
    cells.compliance = {soft(dim)};
    cells.material = {0};
    const Index nodes = reference.facet_nodes();
    boundary.moments = Matrix::NullaryExpr(dim * nodes, dim + 1, [&] { return any(random); });
    boundary.held = Matrix::Zero(dim * dim, dim + 1);
    for (Index k = 0; k <= dim; ++k) {
      for (Index i = 0; i <= dim; ++i) {
        if (i != k) {
          boundary.corners.push_back(i);
        }
      }
    }
    balance();
  }

  Matrix corners_of(Index facet) const {
    Matrix out(dim, dim);
    Index next = 0;
    for (Index k = 0; k <= dim; ++k) {
      if (k != facet) {
        out.col(next++) = cells.vertices.col(k);
      }
    }
    return out;
  }

  Matrix nodes_of(Index facet) const {
    const Matrix corners = corners_of(facet);
    Matrix out(dim, reference.facet_nodes());
    out.leftCols(dim) = corners;
    Index next = dim;
    for (Index i = 0; reference.degree() > 1 && i < dim; ++i) {
      for (Index j = i + 1; j < dim; ++j) {
        out.col(next++) = 0.5 * (corners.col(i) + corners.col(j));
      }
    }
    return out;
  }

  double volume() const {
    const Matrix edges = cells.vertices.rightCols(dim).colwise() - cells.vertices.col(0);
    return std::abs(edges.determinant()) / (dim == 2 ? 2.0 : 6.0);
  }

  /// The least change of the moments after which force and moment are nothing.
  void balance() {
    const Index motions = dim == 2 ? 3 : 6;
    const Index count = boundary.moments.size();
    Matrix sums = Matrix::Zero(motions, count);
    Vector whole = Vector::Zero(motions);
    const auto add = [&](const Vector& place, auto&& set) {
      for (Index i = 0; i < dim; ++i) {
        set(i, i, 1.0);
      }
      Index turn = dim;
      for (Index a = 0; a < dim; ++a) {
        for (Index b = a + 1; b < dim; ++b, ++turn) {
          set(turn, a, -place(b));
          set(turn, b, place(a));
        }
      }
    };
    for (Index facet = 0; facet <= dim; ++facet) {
      const Matrix places = nodes_of(facet);
      for (Index node = 0; node < places.cols(); ++node) {
        const Index at = (facet * places.cols() + node) * dim;
        add(places.col(node), [&](Index row, Index i, double value) { sums(row, at + i) = value; });
      }
    }
    add(cells.vertices.rowwise().mean(), [&](Index row, Index i, double value) {
      whole(row) += value * volume() * cells.force(i, 0);
    });
    const Vector off = sums * boundary.moments.reshaped() + whole;
    boundary.moments.reshaped() -= sums.transpose() * (sums * sums.transpose()).ldlt().solve(off);
  }

  int dim;
  const ReferenceCell& reference;
  Cells cells;
  Boundary boundary;
};

Matrix tensor(const ReferenceCell& reference, const Vector& components) {
  Matrix out(reference.dim(), reference.dim());
  for (Index a = 0; a < components.size(); ++a) {
    const auto [i, j] = reference.component(a);
    out(i, j) = out(j, i) = components(a);
  }
  return out;
}

class EquilibrationOf : public ::testing::TestWithParam<std::pair<int, int>> {};

/// What is left of the coefficients by the equations of balance: counted by a prototype of other hands.
TEST_P(EquilibrationOf, SelfStressesAreCounted) {
  const auto [dim, degree] = GetParam();
  const Index wanted = degree == 1 ? 0 : dim == 2 ? 3 : 18;
  EXPECT_EQ(ReferenceCell::of(dim, degree).self_stresses(), wanted);
}

/// Tractions on each facet are those that were given, and the divergence is the body force: at random points.
TEST_P(EquilibrationOf, StressOfACellIsInBalance) {
  const auto [dim, degree] = GetParam();
  const OneCell one(dim, degree, 7);
  const Equilibration made(one.cells, one.boundary);
  const ReferenceCell& reference = one.reference;
  const Rule rule = simplex_rule(dim - 1, 4);
  Matrix bary(dim, rule.points.cols());
  bary.row(0) = 1.0 - rule.points.colwise().sum().array();
  bary.bottomRows(dim - 1) = rule.points;
  const Matrix shapes = lagrange(degree, bary);
  const Matrix edges = one.cells.vertices.rightCols(dim).colwise() - one.cells.vertices.col(0);
  for (Index facet = 0; facet <= dim; ++facet) {
    const Matrix corners = one.corners_of(facet);
    const Matrix places = corners * bary;
    const Matrix local = edges.inverse() * (places.colwise() - one.cells.vertices.col(0));
    // a point a little inside belongs to the piece of the facet
    const Vector middle = Vector::Constant(dim, 1.0 / (dim + 1.0));
    const Matrix inside =
        (1.0 - 1e-12) * local + 1e-12 * middle * Vector::Ones(local.cols()).transpose();
    const Matrix stress = made.stress(0, inside);
    const Matrix along = corners.rightCols(dim - 1).colwise() - corners.col(0);
    Vector normal(dim);
    if (dim == 2) {
      normal << along(1, 0), -along(0, 0);
    } else {
      normal = Eigen::Vector3d(along.col(0)).cross(Eigen::Vector3d(along.col(1)));
    }
    if (normal.dot(corners.col(0) - one.cells.vertices.col(facet)) < 0.0) {
      normal = -normal;
    }
    Matrix moments = Matrix::Zero(dim, shapes.rows());
    for (Index m = 0; m < places.cols(); ++m) {
      const Vector traction = tensor(reference, stress.col(m)) * normal;  // times the area
      moments += rule.weights(m) * traction * shapes.col(m).transpose();
    }
    const Matrix given = one.boundary.moments.col(facet).reshaped(dim, shapes.rows());
    EXPECT_LT((moments - given).cwiseAbs().maxCoeff(), 1e-10) << "facet " << facet;
  }
  const double step = 1e-4;
  const Vector place = Eigen::Vector3d(0.25, 0.4, 0.15).head(dim);  // inside of one piece
  Vector divergence = Vector::Zero(dim);
  for (Index axis = 0; axis < dim; ++axis) {
    const Vector moved = edges.inverse() * Vector::Unit(dim, axis) * step;
    const Matrix up = tensor(reference, made.stress(0, place + moved).col(0));
    const Matrix down = tensor(reference, made.stress(0, place - moved).col(0));
    divergence += (up - down).col(axis) / (2.0 * step);
  }
  EXPECT_LT((divergence + one.cells.force.col(0)).cwiseAbs().maxCoeff(), 1e-8);
}

/// By quadrature over the pieces, of a solution whose stress is not linear.
TEST_P(EquilibrationOf, EnergyIsThatOfTheDistance) {
  const auto [dim, degree] = GetParam();
  OneCell one(dim, degree, 11);
  const ReferenceCell& reference = one.reference;
  const Index terms = reference.terms();
  std::mt19937 random(5);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  one.cells.rest = Matrix::NullaryExpr(reference.components() * (dim + 1) * terms, 1,
                                       [&] { return any(random); });
  Equilibration made(one.cells, one.boundary);
  const double energy = made.relax(0, 0.0)(0);
  const Rule rule = simplex_rule(dim, degree + 2);
  const Matrix edges = one.cells.vertices.rightCols(dim).colwise() - one.cells.vertices.col(0);
  Matrix unit = Matrix::Zero(dim, dim + 1);
  unit.rightCols(dim).setIdentity();
  double sum = 0.0;
  for (Index piece = 0; piece <= dim; ++piece) {
    Matrix corners = unit;
    corners.col(piece) = unit.rowwise().mean();
    const Matrix along = corners.rightCols(dim).colwise() - corners.col(0);
    const Matrix points = (along * rule.points).colwise() + corners.col(0);
    Matrix bary(dim + 1, points.cols());
    bary.row(0) = 1.0 - points.colwise().sum().array();
    bary.bottomRows(dim) = points;
    Matrix off = made.stress(0, points) - one.cells.stress * bary;
    const Matrix values = reference.values(piece, points);
    for (Index a = 0; a < reference.components(); ++a) {
      off.row(a) -=
          one.cells.rest.col(0).segment((a * (dim + 1) + piece) * terms, terms).transpose() *
          values;
    }
    const double size = std::abs(along.determinant() * edges.determinant());
    for (Index m = 0; m < points.cols(); ++m) {
      sum += rule.weights(m) * size * off.col(m).dot(soft(dim) * off.col(m));
    }
  }
  EXPECT_NEAR(energy, sum, 1e-10 * sum);
}

INSTANTIATE_TEST_SUITE_P(All, EquilibrationOf,
                         ::testing::Values(std::pair{2, 1}, std::pair{2, 2}, std::pair{3, 1},
                                           std::pair{3, 2}));

/// Two triangles under one constant stress, one side on a support: the distance is nothing, whatever the sweeps.
TEST(Equilibration, ConstantStressIsItsOwn) {
  Cells cells;
  cells.vertices = (Matrix(2, 4) << 0, 1, 0, 1, 0, 0, 1, 1).finished();
  cells.corners = {0, 1, 2, 1, 2, 3};
  const Eigen::Vector3d stress(2.0, 0.0, 0.0);
  cells.stress = stress * Vector::Ones(6).transpose();
  cells.force = Matrix::Zero(2, 2);
  cells.compliance = {soft(2)};
  cells.material = {0, 0};
  Boundary boundary;
  boundary.corners = {0, 2, 1, 3};  // x = 0 and x = 1
  boundary.moments = Matrix::Zero(4, 2);
  boundary.moments.col(1) << 1.0, 0.0, 1.0, 0.0;
  boundary.held = Matrix::Zero(4, 2);
  boundary.held.col(0) << 1.0, 0.0, 0.0, 1.0;
  Equilibration made(cells, boundary);
  EXPECT_LT(made.defect(), 1e-14);
  EXPECT_LT(made.relax(2, 0.0).cwiseAbs().maxCoeff(), 1e-26);
}

/// Stars of one colour have no cell in common: the same bits on any number of threads.
TEST(Equilibration, ThreadsDoNotChangeAnything) {
  constexpr Index n = 24;
  Cells cells;
  cells.vertices.resize(2, (n + 1) * (n + 1));
  for (Index i = 0; i <= n; ++i) {
    for (Index j = 0; j <= n; ++j) {
      const Index at = i * (n + 1) + j;
      cells.vertices.col(at) << static_cast<double>(i), static_cast<double>(j);
      if (i < n && j < n) {
        for (const Index corner : {at, at + 1, at + n + 2, at, at + n + 1, at + n + 2}) {
          cells.corners.push_back(corner);
        }
      }
    }
  }
  const Index count = 2 * n * n;
  cells.stress = Matrix::NullaryExpr(
      3, 3 * count, [](Index i, Index j) { return std::sin(static_cast<double>(7 * i + j)); });
  cells.force = Matrix::Zero(2, count);
  cells.compliance = {soft(2)};
  cells.material.assign(count, 0);
  Boundary boundary;
  boundary.moments = Matrix::Zero(6, 0);
  boundary.held = Matrix::Zero(4, 0);
  const auto energies = [&](int threads) {
    const Threads some(threads);
    return Vector(Equilibration(cells, boundary).relax(3, 0.0));
  };
  const Vector one = energies(1);
  EXPECT_EQ(one, energies(2));
  EXPECT_EQ(one, energies(3));
}

TEST(Equilibration, BadInputIsRefused) {
  OneCell one(2, 1, 3);
  Boundary other = one.boundary;
  other.corners[0] = 5;
  EXPECT_THROW(Equilibration(one.cells, other), InputError);
  Cells turned = one.cells;
  std::swap(turned.corners[0], turned.corners[1]);
  EXPECT_THROW(Equilibration(turned, one.boundary), InputError);
  Cells longer = one.cells;
  longer.shift = Matrix::Zero(2, 7);
  EXPECT_THROW(Equilibration(longer, one.boundary), InputError);
  EXPECT_THROW(ReferenceCell::of(3, 3), InputError);
  EXPECT_THROW(ReferenceCell::of(1, 1), InputError);
}

}  // namespace
}  // namespace latin::equilibration
