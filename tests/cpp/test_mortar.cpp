#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>

#include "latin/common/error.hpp"
#include "mortar/blocks.hpp"
#include "mortar/box_tree.hpp"
#include "mortar/face.hpp"
#include "mortar/overlap.hpp"
#include "mortar/polygon.hpp"
#include "threads.hpp"

namespace latin::mortar {

namespace {

const Polygon unit_square{{0.0, 0.0}, {1.0, 0.0}, {1.0, 1.0}, {0.0, 1.0}};

Polygon moved(Polygon polygon, double factor, const Point2& shift) {
  for (Point2& p : polygon) {
    p = factor * p + shift;
  }
  return polygon;
}

double common_area(const Polygon& subject, const Polygon& window) {
  Polygon common;
  Polygon scratch;
  clip(subject, window, common, scratch);
  return area_of(common);
}

/// Linear shape functions of the triangle with its corners (0, 0), (1, 0), (0, 1): monomials 1, t, s.
const Functions& on_triangles() {
  static const Functions f{1, {(Matrix(3, 3) << 1, -1, -1, 0, 0, 1, 0, 1, 0).finished()}};
  return f;
}

/// Linear ones of the interval: monomials 1, s.
const Functions& on_intervals() {
  static const Functions f{1, {(Matrix(2, 2) << 1, -1, 0, 1).finished()}};
  return f;
}

/// Quadratic ones, with the nodes 0, 1, 1/2: monomials 1, s, s^2.
const Functions& quadratic() {
  static const Functions f{2, {(Matrix(3, 3) << 1, -3, 2, 0, -1, 2, 0, 4, -4).finished()}};
  return f;
}

/// The square (x0, x0 + 1) x (0, 1) at a height, in 2 n^2 triangles, looking up or down.
Face sheet(int n, double height, bool up, double x0 = 0.0, double slope = 0.0) {
  Matrix nodes(6 * n * n, 3);
  Index row = 0;
  const auto put = [&](int i, int j) {
    const double x = x0 + static_cast<double>(i) / n;
    nodes.row(row++) << x, static_cast<double>(j) / n, height + slope * x;
  };
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      put(i, j), put(i + 1, j), put(i, j + 1);
      put(i + 1, j + 1), put(i, j + 1), put(i + 1, j);
    }
  }
  const auto count = static_cast<std::size_t>(2 * n * n);
  return {FacetShape::triangle,
          1,
          nodes,
          std::vector<Index>(count, 0),
          std::vector<double>(count, up ? 1.0 : -1.0),
          on_triangles(),
          on_triangles()};
}

/// Exact for quadratic functions: the middles of the edges.
Rule on_middles() {
  return {(Matrix(3, 2) << 0.5, 0.0, 0.0, 0.5, 0.5, 0.5).finished(),
          Vector::Constant(3, 1.0 / 6.0)};
}

/// Gauss's rule of three points on (0, 1).
Rule gauss() {
  const double a = 0.5 * std::sqrt(0.6);
  return {(Matrix(3, 1) << 0.5 - a, 0.5, 0.5 + a).finished(),
          (Vector(3) << 5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0).finished()};
}

Nearness near(const Face& first, const Face& second, double distance) {
  return {Vector::Constant(first.facets(), distance), Vector::Constant(second.facets(), distance),
          -0.5};
}

double sum(const std::vector<double>& values) {
  double total = 0.0;
  for (const double v : values) {
    total += v;
  }
  return total;
}

}  // namespace

TEST(Mortar, ClippedPolygonsHaveKnownAreas) {
  EXPECT_NEAR(common_area(unit_square, unit_square), 1.0, 1e-15);
  EXPECT_NEAR(common_area({unit_square.rbegin(), unit_square.rend()}, unit_square), -1.0, 1e-15);
  EXPECT_NEAR(common_area(moved(unit_square, 1.0, {0.25, 0.5}), unit_square), 0.375, 1e-15);
  EXPECT_NEAR(common_area(moved(unit_square, 1.0, {1.0, 0.0}), unit_square), 0.0, 1e-15);
  EXPECT_NEAR(common_area(moved(unit_square, 1.0, {3.0, 0.0}), unit_square), 0.0, 1e-15);
  EXPECT_NEAR(common_area(moved(unit_square, 5.0, {-2.0, -2.0}), unit_square), 1.0, 1e-15);
  EXPECT_NEAR(common_area(moved(unit_square, 0.5, {0.25, 0.25}), unit_square), 0.25, 1e-15);
  const Polygon through_corners{{0.5, -0.5}, {1.5, 0.5}, {0.5, 1.5}, {-0.5, 0.5}};
  EXPECT_NEAR(common_area(through_corners, unit_square), 1.0, 1e-15);
  const Polygon diamond{{0.5, -0.25}, {1.25, 0.5}, {0.5, 1.25}, {-0.25, 0.5}};
  EXPECT_NEAR(common_area(diamond, unit_square), 0.875, 1e-15);
  Polygon common;
  clip_intervals({{0.7, 0.0}, {-1.0, 0.0}}, {{0.0, 0.0}, {1.0, 0.0}}, common);
  EXPECT_NEAR(area_of(common), 0.7, 1e-15);
  clip_intervals({{1.0, 0.0}, {2.0, 0.0}}, {{0.0, 0.0}, {1.0, 0.0}}, common);
  EXPECT_TRUE(common.empty());
}

TEST(Mortar, ClippedTrianglesAreSymmetricAndAgreeWithRandomPoints) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> number(0.0, 1.0);
  const auto triangle = [&] {
    Polygon t;
    for (int k = 0; k < 3; ++k) {
      t.emplace_back(number(random), number(random));
    }
    if (area_of(t) < 0.0) {
      std::swap(t[1], t[2]);
    }
    return t;
  };
  const auto inside = [](const Polygon& t, const Point2& p) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Point2 edge = t[(k + 1) % 3] - t[k];
      const Point2 arm = p - t[k];
      if (edge.x() * arm.y() - edge.y() * arm.x() < 0.0) {
        return false;
      }
    }
    return true;
  };
  for (int pair = 0; pair < 20; ++pair) {
    const Polygon a = triangle();
    const Polygon b = triangle();
    const double area = common_area(a, b);
    EXPECT_NEAR(area, common_area(b, a), 1e-14);
    constexpr int points = 20000;
    int hits = 0;
    for (int k = 0; k < points; ++k) {
      const Point2 p(number(random), number(random));
      hits += inside(a, p) && inside(b, p) ? 1 : 0;
    }
    const double share = static_cast<double>(hits) / points;
    EXPECT_NEAR(share, area, 4.5 * (std::sqrt(share * (1.0 - share) / points) + 1.0 / points));
  }
}

TEST(Mortar, TreeFindsWhatALookAtAllBoxesFinds) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> number(0.0, 1.0);
  const auto box = [&](double size) {
    const Eigen::Vector3d low(number(random), number(random), number(random));
    const Eigen::Vector3d extent(number(random), number(random), number(random));
    return Box(low, low + size * extent);
  };
  std::vector<Box> boxes;
  for (int k = 0; k < 500; ++k) {
    boxes.push_back(box(k % 50 == 0 ? 1.0 : 0.05));
  }
  boxes.resize(510, boxes.front());  // several at one place
  const BoxTree tree(boxes);
  std::vector<Index> found;
  for (int k = 0; k < 50; ++k) {
    const Box wanted = box(0.2);
    std::vector<Index> all;
    for (std::size_t i = 0; i < boxes.size(); ++i) {
      if (boxes[i].intersects(wanted)) {
        all.push_back(static_cast<Index>(i));
      }
    }
    tree.touching(wanted, found);
    EXPECT_EQ(found, all);
  }
  BoxTree({}).touching(boxes.front(), found);
  EXPECT_TRUE(found.empty());
}

TEST(Mortar, MonomialsHaveTheirDerivatives) {
  for (const FacetShape shape :
       {FacetShape::interval, FacetShape::triangle, FacetShape::quadrilateral}) {
    const Monomials m(shape, 3);
    EXPECT_EQ(m.size(), shape == FacetShape::interval   ? 4
                        : shape == FacetShape::triangle ? 10
                                                        : 16);
    for (Index k = 0; k < m.size(); ++k) {
      EXPECT_EQ(m.number(m.power(k).a, m.power(k).b), k);
    }
    // Horner's scheme against the sum of what the coefficients say
    const Eigen::Matrix4Xd map = Eigen::Matrix4Xd::Random(4, m.size());
    const Point2 s(0.3, 0.7);
    constexpr double h = 1e-6;
    const auto sum = [&](const Point2& at) {
      Vector values(m.size());
      m.values(at, values.data());
      return Eigen::Vector4d(map * values);
    };
    Eigen::Vector4d value;
    Eigen::Vector4d first;
    Eigen::Vector4d second;
    m.evaluate(map, s, value, first, second);
    EXPECT_LT((value - sum(s)).cwiseAbs().maxCoeff(), 1e-14);
    const Point2 x(h, 0.0);
    const Point2 y(0.0, h);
    EXPECT_LT((first - (sum(s + x) - sum(s - x)) / (2 * h)).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT((second - (sum(s + y) - sum(s - y)) / (2 * h)).cwiseAbs().maxCoeff(), 1e-9);
    m.evaluate(map, s, first);
    EXPECT_LT((value - first).cwiseAbs().maxCoeff(), 1e-15);
  }
}

TEST(Mortar, IntegralsOfNonMatchingSheetsAreExact) {
  const Face lower = sheet(3, 0.0, true);
  const Face upper = sheet(4, 0.1, false);
  const Overlap o = integrate(lower, upper, on_triangles(), on_middles(), near(lower, upper, 0.2));
  EXPECT_NEAR(sum(o.whole), 1.0, 1e-14);
  EXPECT_NEAR(sum(o.covered), 1.0, 1e-14);
  EXPECT_NEAR(sum(o.mean), 1.0, 1e-14);
  EXPECT_NEAR(sum(o.own), 1.0, 1e-14);
  EXPECT_NEAR(sum(o.other), 1.0, 1e-14);
  EXPECT_NEAR(sum(o.area), 1.0, 1e-14);
  EXPECT_EQ(o.farthest, 0.0);
  for (Index f = 0; f < lower.facets(); ++f) {
    for (Index c = 0; c < 3; ++c) {
      const double w = o.mean[3 * f + c];
      EXPECT_NEAR(w, 1.0 / 54.0, 1e-15);
      EXPECT_NEAR(o.offset[9 * f + 3 * c + 2], 0.1 * w, 1e-15);
      EXPECT_NEAR(o.normal[9 * f + 3 * c + 2], w, 1e-15);
      // the mass matrix of a triangle of area 1/18, in three places that must agree
      for (Index k = 0; k < 3; ++k) {
        const double exact = (c == k ? 2.0 : 1.0) / 12.0 / 18.0;
        EXPECT_NEAR(o.mass[9 * f + 3 * c + k], exact, 1e-15);
        EXPECT_NEAR(o.own[9 * f + 3 * c + k], exact, 1e-15);
      }
    }
  }
}

TEST(Mortar, PartsThatAreNotCoveredDoNotCount) {
  const Face lower = sheet(4, 0.0, true);
  const Face upper = sheet(3, 0.0, false, 0.37);
  const Overlap o = integrate(lower, upper, on_triangles(), on_middles(), near(lower, upper, 0.1));
  EXPECT_NEAR(sum(o.whole), 1.0, 1e-14);
  EXPECT_NEAR(sum(o.covered), 0.63, 1e-14);
  EXPECT_NEAR(sum(o.mean), 0.63, 1e-14);
  EXPECT_NEAR(sum(o.other), 0.63, 1e-14);
}

TEST(Mortar, FarAndAvertedFacetsDoNotCount) {
  const Face lower = sheet(2, 0.0, true);
  const Face averted = sheet(3, 0.1, true);
  EXPECT_TRUE(integrate(lower, averted, on_triangles(), on_middles(), near(lower, averted, 1.0))
                  .first.empty());
  const Face inclined = sheet(4, 0.0, false, 0.0, 0.4);
  const Overlap o =
      integrate(lower, inclined, on_triangles(), on_middles(), near(lower, inclined, 0.2));
  EXPECT_GT(o.farthest, 0.2);
  EXPECT_LT(o.farthest, 0.4 + 1e-12);
  EXPECT_LT(sum(o.covered), 0.8);
  for (const double d : o.distance) {
    EXPECT_LE(d, 0.2);
  }
}

TEST(Mortar, CurvedIntervalsConverge) {
  // a quarter of a circle in n quadratic pieces, looking out of or into it
  const auto arc = [](int n, bool out) {
    Matrix nodes(3 * n, 2);
    const double step = 0.5 * 3.14159265358979323846 / n;
    for (int k = 0; k < n; ++k) {
      const std::array<double, 3> angles{k * step, (k + 1) * step, (k + 0.5) * step};
      for (Index i = 0; i < 3; ++i) {
        nodes.row(3 * k + i) << std::cos(angles[i]), std::sin(angles[i]);
      }
    }
    const auto count = static_cast<std::size_t>(n);
    // the tangent turned by 90 degrees points to the centre
    return Face(FacetShape::interval, 2, nodes, std::vector<Index>(count, 0),
                std::vector<double>(count, out ? -1.0 : 1.0), quadratic(), quadratic());
  };
  double before = 0.0;
  for (const int n : {4, 8, 16}) {
    const Face inner = arc(3 * n / 2, true);
    const Face outer = arc(n, false);
    const Overlap o = integrate(inner, outer, on_intervals(), gauss(), near(inner, outer, 0.1));
    EXPECT_NEAR(sum(o.mean), 0.5 * 3.14159265358979323846, 1.0 / (n * n * n));
    EXPECT_NEAR(sum(o.other), sum(o.mean), 1e-13);
    double largest = 0.0;
    for (const double x : o.offset) {
      largest = std::max(largest, std::abs(x) / sum(o.mean) * n);
    }
    if (before > 0.0) {
      EXPECT_GT(std::log2(before / largest), 2.9);
    }
    before = largest;
  }
}

TEST(Mortar, TheNumberOfThreadsDoesNotMatter) {
  const Face lower = sheet(7, 0.0, true);
  const Face upper = sheet(5, 0.0, false);
  const Nearness reach = near(lower, upper, 0.2);
  const auto on_threads = [&](int count) {
    const Threads threads(count);
    return integrate(lower, upper, on_triangles(), on_middles(), reach);
  };
  const Overlap one = on_threads(1);
  for (const int threads : {2, 3}) {
    const Overlap o = on_threads(threads);
    EXPECT_EQ(o.first, one.first);
    EXPECT_EQ(o.second, one.second);
    EXPECT_EQ(o.mass, one.mass);
    EXPECT_EQ(o.other, one.other);
    EXPECT_EQ(o.covered, one.covered);
  }
}

TEST(Mortar, WhereNoThreadIsToBeHadTheCallerDoesItAll) {
  const Face lower = sheet(7, 0.0, true);
  const Face upper = sheet(5, 0.0, false);
  const Nearness reach = near(lower, upper, 0.2);
  const Overlap one = integrate(lower, upper, on_triangles(), on_middles(), reach);
  const Threads threads(40);  // more than any other test has made
  const NoMoreThreads none;
  const Overlap o = integrate(lower, upper, on_triangles(), on_middles(), reach);
  EXPECT_EQ(o.other, one.other);
  EXPECT_EQ(o.covered, one.covered);
}

TEST(Mortar, NormalsOfPlaneFacesAreLeftOut) {
  const Face lower = sheet(2, 0.0, true);
  const Face upper = sheet(3, 0.0, false);
  const Overlap o = integrate(lower, upper, on_triangles(), on_middles(), near(lower, upper, 0.2));
  EXPECT_TRUE(o.own_normal.empty());
  EXPECT_TRUE(o.other_normal.empty());
}

TEST(Mortar, SumOfBlocks) {
  // two blocks (2, 3) that overlap in the entry (1, 2), and one entry that cancels but for rounding
  const std::vector<double> values = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, -4.0, 0.5, 0.25};
  const std::vector<Index> rows = {0, 1, 1, 3};
  const std::vector<Index> columns = {0, 1, 2, 2, 4, 0};
  const CompressedRows sum = sum_of({2, 3, values, rows, columns}, 4, 5);
  EXPECT_EQ(sum.starts, (std::vector<Index>{0, 3, 7, 7, 10}));
  EXPECT_EQ(sum.columns, (std::vector<Index>{0, 1, 2, 0, 1, 2, 4, 0, 2, 4}));
  EXPECT_EQ(sum.values,
            (std::vector<double>{1.0, 2.0, 3.0, 13.0, 5.0, 13.0, 8.0, 0.25, -4.0, 0.5}));

  const std::vector<double> cancel = {1.0, 3.0, -1.0 + 1e-16, 2.0};
  const std::vector<Index> one_row = {0, 0};
  const std::vector<Index> twice = {0, 1, 0, 1};
  const CompressedRows rest = sum_of({1, 2, cancel, one_row, twice}, 1, 2);
  EXPECT_EQ(rest.columns, (std::vector<Index>{1}));
  EXPECT_THROW(static_cast<void>(sum_of({2, 3, values, rows, columns}, 3, 5)), InputError);
  EXPECT_THROW(static_cast<void>(sum_of({2, 3, values, rows, one_row}, 4, 5)), InputError);
}

TEST(Mortar, WrongInputIsRefused) {
  EXPECT_THROW(static_cast<void>(facet_shape("pentagon")), InputError);
  EXPECT_THROW(Monomials(FacetShape::triangle, 40), InputError);
  const Face lower = sheet(2, 0.0, true);
  const Face upper = sheet(3, 0.0, false);
  Rule rule = on_middles();
  rule.points = Matrix::Zero(3, 1);
  EXPECT_THROW(
      static_cast<void>(integrate(lower, upper, on_triangles(), rule, near(lower, upper, 1.0))),
      InputError);
  EXPECT_THROW(static_cast<void>(
                   integrate(lower, upper, on_intervals(), on_middles(), near(lower, upper, 1.0))),
               InputError);
  EXPECT_THROW(static_cast<void>(
                   integrate(lower, upper, on_triangles(), on_middles(), near(upper, lower, 1.0))),
               InputError);
  EXPECT_THROW(
      Face(FacetShape::triangle, 1, Matrix::Zero(3, 2), {0}, {1.0}, on_triangles(), on_triangles()),
      InputError);
  EXPECT_THROW(
      Face(FacetShape::triangle, 1, Matrix::Zero(3, 3), {2}, {1.0}, on_triangles(), on_triangles()),
      InputError);
}

}  // namespace latin::mortar
