#include "iteration/tangent_system.hpp"

#include <algorithm>
#include <utility>

#include "common/numbers.hpp"
#include "common/threads.hpp"
#include "iteration/krylov.hpp"
#include "iteration/skeleton.hpp"

namespace latin::iteration {
namespace {

/// Tangents closer than this are the same: they come from differences.
constexpr double same_tangent = 1e-6;
constexpr double factor_with_mu = 1.0 + 2.0 * substructure::Flexibility::mu;
constexpr double modal = factor_with_mu / (1.0 + substructure::Flexibility::mu);
/// Share of the tangents that the LU leaves out.
constexpr double softening = 1e-5;
/// Unknowns of the closed zone for each product that costs as much as one of these in the factorisation: n^2 numbers
/// read twice against 2/3 n^3 operations in blocks.
constexpr Index unknowns_per_product = 60;
constexpr Index least_products = 3;
constexpr Index most_products = 60;
/// Residual of a step.
constexpr double krylov_tolerance = 1e-6;
/// Columns of the system that are filled together.
constexpr Index columns_of_piece = 128;

}  // namespace

TangentSystem::TangentSystem(const substructure::Flexibility& flexibility,
                             const substructure::InterfaceSystem::Layout& layout, Vector shift)
    : flexibility_(flexibility),
      layout_(layout),
      shift_(std::move(shift)),
      modal_stiffness_(flexibility.modal_stiffness()),
      energies_(Vector::Ones(shift_.size() + modal_stiffness_.size())) {
  energies_.head(shift_.size()) =
      flexibility.areas().cwiseProduct(shift_ - flexibility.direct()).cwiseSqrt();
}

void TangentSystem::hold(double spring) {
  modal_stiffness_ = flexibility_.modal_stiffness().array() + spring;
  tangent_.resize(0, 0);
}

Vector TangentSystem::moved(ConstVectorRef y, ConstVectorRef a) const {
  Vector result = shift_.cwiseProduct(y) - factor_with_mu * flexibility_.product(y);
  if (a.size() > 0) {
    result.noalias() -= modal * (flexibility_.modal_jumps() * a);
  }
  return result;
}

Vector TangentSystem::times(const Matrix& tangent, ConstVectorRef p) const {
  return iteration::times(tangent, layout_.first, layout_.components, p);
}

Vector TangentSystem::apply(const Matrix& tangent, const Vector& x) const {
  const auto z = x.head(tangent.rows());
  const auto a = x.tail(modes());
  Vector result(x.size());
  result << z - times(tangent, moved(z, a)),
      modal_stiffness_.cwiseProduct(a) -
          flexibility_.modal_jumps().transpose() * flexibility_.areas().cwiseProduct(z);
  return result;
}

Vector TangentSystem::solve(const Matrix& tangent, const Vector& right) {
  Vector answer;
  if (!fits(tangent)) {
    const auto closed = static_cast<Index>((tangent.array() != 0.0).rowwise().any().count());
    const Index affordable = std::min(closed / unknowns_per_product, most_products);
    if (tangent_.size() == tangent.size() && affordable >= least_products &&
        approach(tangent, right, affordable, answer)) {
      return answer;
    }
    factorise(tangent);
  }
  if (!approach(tangent, right, most_products, answer) && answer.isZero(0.0)) {
    return solve_factorised(right);  // of a singular system: not finite
  }
  return answer;  // or near it: the next step goes on from there
}

bool TangentSystem::fits(const Matrix& tangent) const {
  const auto largest = [this](const Matrix& slopes) {
    return (shift_.asDiagonal() * slopes).cwiseAbs().maxCoeff<keep_nan>();
  };
  return tangent_.size() == tangent.size() &&
         largest(tangent_ - tangent) <= same_tangent * largest(tangent);
}

bool TangentSystem::approach(const Matrix& tangent, const Vector& right, Index most,
                             Vector& answer) {
  // forces and amplitudes in units of the root of an energy
  const KrylovOutcome outcome =
      gmres([&](const Vector& x) { return Vector(energies_.cwiseProduct(apply(tangent, x))); },
            [&](const Vector& x) { return solve_factorised(x.cwiseQuotient(energies_)); },
            energies_.cwiseProduct(right), answer, krylov_tolerance, most);
  products_ += outcome.products;
  return outcome.solved;
}

/// With the tangent of the LU, whatever the right side is.
Vector TangentSystem::solve_factorised(const Vector& right) const {
  const Index n = tangent_.rows();
  const auto closed = static_cast<Index>(rows_.size());
  const Index count = modes();
  Vector open = right.head(n);
  open(rows_).setZero();
  Vector reduced(closed + count);
  reduced << right.head(n)(rows_), right.tail(count);
  if (!open.isZero(0.0)) {
    Vector response = shift_.cwiseProduct(open);
    for (Index row = 0; row < n; ++row) {
      if (open(row) != 0.0) {
        response.noalias() -= factor_with_mu * open(row) * flexibility_.matrix().col(row);
      }
    }
    reduced.head(closed) += (1.0 - softening) * times(tangent_, response)(rows_);
    reduced.tail(count) +=
        flexibility_.modal_jumps().transpose() * flexibility_.areas().cwiseProduct(open);
  }
  reduced = lu_.solve_transposed(reduced);
  Vector answer(right.size());
  answer << open, reduced.tail(count);
  answer(rows_) = reduced.head(closed);
  return answer;
}

void TangentSystem::factorise(const Matrix& tangent) {
  ++factorisations_;
  tangent_ = tangent;
  rows_.clear();
  for (Index unknown = 0; unknown < tangent.rows(); ++unknown) {
    if ((tangent.row(unknown).array() != 0.0).any()) {
      rows_.push_back(unknown);
    }
  }
  const auto closed = static_cast<Index>(rows_.size());
  const Index count = modes();
  const Matrix& matrix = flexibility_.matrix();
  const Vector& areas = flexibility_.areas();
  const Matrix& jumps = flexibility_.modal_jumps();
  // transposed, so that rows of the (symmetric but for the areas) flexibility are read as columns
  auto system = lu_.matrix(closed + count);
  const auto fill = [&](Index i) {
    system.col(i).setZero();
    const Index row = rows_[static_cast<std::size_t>(i)];
    const Index first = layout_.first[static_cast<std::size_t>(row)];
    for (Index c = 0; c < layout_.components[static_cast<std::size_t>(row)]; ++c) {
      const double slope = (1.0 - softening) * tangent(row, c);
      if (slope == 0.0) {
        continue;
      }
      const Index at = first + c;
      const double factor = slope * factor_with_mu / areas(at);
      for (Index j = 0; j < closed; ++j) {
        const Index other = rows_[static_cast<std::size_t>(j)];
        system(j, i) += factor * areas(other) * matrix(other, at);
        if (other == at) {
          system(j, i) -= slope * shift_(at);
        }
      }
      system.col(i).tail(count) += slope * modal * jumps.row(at).transpose();
    }
    system(i, i) += 1.0;
    // V^T W E
    system.row(i).tail(count) = -areas(row) * jumps.row(row);
  };
  in_pieces(closed, columns_of_piece, 2 * closed, [&](Index begin, Index length) {
    for (Index i = begin; i < begin + length; ++i) {
      fill(i);
    }
  });
  system.bottomRightCorner(count, count) = modal_stiffness_.asDiagonal();
  lu_.factorise();
}

}  // namespace latin::iteration
