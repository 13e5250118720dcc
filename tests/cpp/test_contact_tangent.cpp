#include "latin/substructure/contact_tangent.hpp"

#include <gtest/gtest.h>

#include "pushed.hpp"

namespace latin::substructure {
namespace {

std::vector<Index> nonlinear_of(const Laws& laws) {
  std::vector<Index> unknowns;
  const auto& interfaces = laws.structure().interfaces();
  for (std::size_t i = 0; i < interfaces.size(); ++i) {
    for (Index k = 0; k < interfaces[i].size(); ++k) {
      if (!laws.of(i).law->linear()) {
        unknowns.push_back(interfaces[i].first_unknown + k);
      }
    }
  }
  return unknowns;
}

/// What the whole structure says with the same tangents.
Vector whole(const Laws& laws, const Matrix& stiffness, const Vector& load) {
  Tangent tangent(laws.structure());
  tangent.factorise_stiffness(stiffness, Tangent::least_hold);
  return tangent.solve(load);
}

}  // namespace

/// Open on a spring, closed, and as good as rigid, one after the other on the same A and G.
TEST(ContactTangent, SaysWhatTheWholeStructureSays) {
  const Laws laws = chain::Pushed{}.build();
  Tangent tangent(laws.structure());
  ASSERT_TRUE(ContactTangent::pays(tangent, nonlinear_of(laws)));
  EXPECT_FALSE(ContactTangent::pays(tangent, {0, 1, 2}));
  ContactTangent contacts(tangent, nonlinear_of(laws));
  const Vector load = Vector::LinSpaced(tangent.joined().active(), -1.0, 2.0);
  for (const double contact : {0.0, 2.0, 1e6, 2.0}) {
    Matrix stiffness = Matrix::Constant(3, 1, 5.0);
    stiffness(laws.structure().interface(1).first_unknown, 0) = contact;
    const Vector springs = Vector::Constant(3, 1e-3);
    contacts.factorise(stiffness, springs);
    Matrix with_springs = stiffness;
    for (const Index unknown : contacts.varying()) {
      with_springs(unknown, 0) += springs(unknown);
    }
    const Vector exact = whole(laws, with_springs, load);
    // the open contact leaves a bar on a spring of 1e-3
    EXPECT_LT((contacts.solve(load) - exact).norm(), 1e-9 * exact.norm()) << contact;
  }
}

/// Friction that follows the pressing, in two points: rows of a tangent that are not its columns.
TEST(ContactTangent, TakesTangentsThatAreNotSymmetric) {
  const Laws laws = chain::Sliding{.count = 2}.build();
  Tangent tangent(laws.structure());
  ContactTangent contacts(tangent, nonlinear_of(laws));
  Matrix stiffness = Matrix::Zero(8, 2);
  for (std::size_t i = 0; i < 4; ++i) {
    const Index first = laws.structure().interface(i).first_unknown;
    const bool floor = !laws.of(i).law->linear();
    stiffness.middleRows(first, 2) = floor ? (Matrix(2, 2) << 40.0, 0.0, -12.0, 0.1).finished()
                                           : Matrix(2.0 * Matrix::Identity(2, 2));
  }
  const Vector none = Vector::Zero(8);
  contacts.factorise(stiffness, none);
  const Vector load = Vector::LinSpaced(tangent.joined().active(), -1.0, 2.0);
  const Vector exact = whole(laws, stiffness, load);
  EXPECT_LT((contacts.solve(load) - exact).norm(), 1e-10 * exact.norm());
}

/// Other tangents of what does not change are seen.
TEST(ContactTangent, FollowsTheOthersWhereTheyChange) {
  const Laws laws = chain::Pushed{}.build();
  Tangent tangent(laws.structure());
  ContactTangent contacts(tangent, nonlinear_of(laws));
  const Vector load = Vector::Ones(tangent.joined().active());
  for (const double wall : {5.0, 7.0}) {
    const Matrix stiffness = Matrix::Constant(3, 1, wall);
    contacts.factorise(stiffness, Vector::Zero(3));
    const Vector exact = whole(laws, stiffness, load);
    EXPECT_LT((contacts.solve(load) - exact).norm(), 1e-10 * exact.norm()) << wall;
  }
}

}  // namespace latin::substructure
