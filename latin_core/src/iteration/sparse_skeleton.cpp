#include "iteration/sparse_skeleton.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "algebra/sparse_product.hpp"
#include "common/numbers.hpp"
#include "latin/common/error.hpp"

namespace latin::iteration {
namespace {

using substructure::Joined;

/// Laws are asked at so many times the flexibility of the nodes at a point alone: ten times less and ten times more do
/// as well.
constexpr double of_nodes = 10.0;
/// A closed point is a spring of 1 / bounded of the stiffness at which its law is asked. Forces that are more than so
/// many times what they correct are those of points whose jumps contradict each other: nothing corrects these. Where one
/// side is stiffer than the other, forces that deform that side alone correct less.
constexpr double bounded = 1e-4;
/// Springs that hold everything, relative to the search direction: the first, and how many times stiffer they are where
/// that is lost in rounding.
constexpr double least_held = 1e-9;
constexpr double stiffer = 100.0;
constexpr double most_held = 1e-4;
/// What is left of the residual of a step, and where steps have to be exact.
constexpr double forcing = 0.1;
constexpr double exact_forcing = 1e-4;
/// Solutions that cost half a factorisation or more, and those that a step may take.
constexpr Index worth_a_factor = 15;
constexpr Index most_solutions = 60;
/// What springs that are none carry of the forces where something hangs on more.
constexpr double held_by_nothing = 1e-3;
constexpr const char* entries_of = "the structure of Newton's method";

}  // namespace

Vector times(const Matrix& slopes, const std::vector<Index>& first, const std::vector<Index>& count,
             ConstVectorRef jump) {
  Vector result(jump.size());
  for (Index row = 0; row < jump.size(); ++row) {
    const auto at = static_cast<std::size_t>(row);
    result(row) = slopes.row(row).head(count[at]).dot(jump.segment(first[at], count[at]));
  }
  return result;
}

bool SparseSkeleton::possible(const substructure::Structure& structure) {
  return structure.communicator().everywhere(std::ranges::all_of(
      structure.bodies(),
      [](const substructure::Body& body) { return body.rows() == 0 || body.keeps_operator(); }));
}

SparseSkeleton::SparseSkeleton(const JoinedSystem& system)
    : system_(system), weights_(system.weights()) {
  springs_ = weights_.cwiseProduct(system.directions());
  Triplets sides;
  areas_.resize(system.unknowns());
  for (const Joined::JoinedInterface& interface : system.joined().interfaces()) {
    areas_.segment(interface.first_unknown, interface.size) = interface.weights;
    for (std::size_t s = 0; s < interface.rows.size(); ++s) {
      for (Index i = 0; i < interface.size; ++i) {
        sides.emplace_back(static_cast<int>(interface.first_unknown + i),
                           static_cast<int>(interface.rows[s] + i), s == 0 ? -1.0 : 1.0);
      }
    }
  }
  sides_ = algebra::sparse_of(sides, system.unknowns(), weights_.size(), entries_of);
  gather();
  jumps_ = sides_ * traces_;
  find_own();
}

/// The bodies of all ranks.
void SparseSkeleton::gather() {
  const substructure::Structure& structure = system_.laws().structure();
  const Communicator& communicator = structure.communicator();
  std::vector<double> mine;
  communicator.together([&] {
    for (std::size_t b = 0; b < structure.bodies().size(); ++b) {
      const substructure::Body& body = structure.bodies()[b];
      if (body.rows() > 0) {
        mine.push_back(
            static_cast<double>(system_.joined().first_row() + structure.body_rows()[b]));
        algebra::append(body.kept_operator(), mine);
        algebra::append(body.kept_traces(), mine);
      }
    }
  });
  std::vector<SparseRows> blocks;
  Triplets traces;
  Index nodes = 0;
  Index entries = 0;
  for (const std::vector<double>& numbers : communicator.gather(mine)) {
    const double* next = numbers.data();
    while (next != numbers.data() + numbers.size()) {
      const auto first = static_cast<Index>(*next++);
      blocks.push_back(algebra::take(next));
      const SparseRows own = algebra::take(next);
      for (Index row = 0; row < own.rows(); ++row) {
        for (SparseRows::InnerIterator it(own, row); it; ++it) {
          traces.emplace_back(static_cast<int>(first + row), static_cast<int>(nodes + it.col()),
                              it.value());
        }
      }
      nodes += blocks.back().rows();
      entries += blocks.back().nonZeros();
    }
  }
  traces_ = algebra::sparse_of(traces, weights_.size(), nodes, entries_of);
  const SparseRows robin = traces_.transpose() * SparseRows(springs_.asDiagonal() * traces_);
  count_of_entries(entries, entries_of);
  stiffness_.resize(nodes, nodes);
  stiffness_.reserve(entries);
  Index first = 0;
  for (const SparseRows& block : blocks) {
    for (Index row = 0; row < block.rows(); ++row) {
      stiffness_.startVec(first + row);
      for (SparseRows::InnerIterator it(block, row); it; ++it) {
        stiffness_.insertBack(first + row, first + it.col()) = it.value();
      }
    }
    first += block.rows();
  }
  stiffness_.finalize();
  stiffness_ -= SparseRows(robin.triangularView<Eigen::Lower>());
}

void SparseSkeleton::find_own() {
  diagonal_ = Vector::Constant(stiffness_.rows(), std::numeric_limits<double>::infinity());
  Vector of_rows = Vector::Zero(weights_.size());
  const Vector diagonal = stiffness_.diagonal();
  for (Index row = 0; row < traces_.rows(); ++row) {
    for (SparseRows::InnerIterator it(traces_, row); it; ++it) {
      diagonal_(it.col()) = diagonal(it.col());
      of_rows(row) += weights_(row) * it.value() * it.value() / diagonal(it.col());
    }
  }
  const Joined& joined = system_.joined();
  own_ = system_.law_flexibility(joined.of_points(of_nodes * (sides_.cwiseAbs() * of_rows)));
  metric_ = areas_.cwiseProduct(own_);
  // twice the share that the stiffer side has of both: 1 where they are alike
  Vector stiffer = Vector::Zero(own_.size());
  for (const Joined::JoinedInterface& interface : joined.interfaces()) {
    for (const Index row : interface.rows) {
      auto so_far = stiffer.segment(interface.first_unknown, interface.size);
      const Vector of_side = of_nodes * of_rows.segment(row, interface.size);
      const auto both = so_far.array() > 0.0 && of_side.array() > 0.0;
      so_far = both.select(so_far.cwiseMin(of_side), so_far.cwiseMax(of_side)).eval();
    }
  }
  least_corrected_ = bounded * (2.0 * joined.of_points(stiffer)).cwiseQuotient(own_).cwiseMin(1.0);
}

/// D of a point, bounded, symmetric and not negative.
Matrix SparseSkeleton::springs_of(const Matrix& tangent, Index first, Index count) const {
  Matrix slope = (1.0 - bounded) * tangent.block(first, 0, count, count);
  for (Index a = 0; a < count; ++a) {
    for (Index b = 0; b < a; ++b) {
      const double one = slope(a, b);
      const double other = slope(b, a);
      const double both =
          one * other > 0.0 ? std::copysign(std::min(std::abs(one), std::abs(other)), one) : 0.0;
      slope(a, b) = both;
      slope(b, a) = both;
    }
  }
  const Matrix open =
      Matrix::Identity(count, count) - slope * own_.segment(first, count).asDiagonal();
  const Matrix springs = open.partialPivLu().solve(slope);
  const Eigen::SelfAdjointEigenSolver<Matrix> modes(0.5 * (springs + springs.transpose()));
  return modes.eigenvectors() * modes.eigenvalues().cwiseMax(0.0).asDiagonal() *
         modes.eigenvectors().transpose();
}

void SparseSkeleton::factorise(const Matrix& tangent) {
  const auto& layout = system_.layout();
  d_ = Matrix::Zero(tangent.rows(), tangent.cols());
  Triplets entries;
  for (Index row = 0; row < tangent.rows();
       row += layout.components[static_cast<std::size_t>(row)]) {
    const Index count = layout.components[static_cast<std::size_t>(row)];
    const Matrix springs = springs_of(tangent, row, count);
    d_.block(row, 0, count, count) = springs;
    for (Index a = 0; a < count; ++a) {
      for (Index b = 0; b < count; ++b) {
        if (springs(a, b) != 0.0) {
          entries.emplace_back(static_cast<int>(row + a), static_cast<int>(row + b),
                               areas_(row + a) * springs(a, b));
        }
      }
    }
  }
  const SparseRows closed = algebra::sparse_of(entries, tangent.rows(), tangent.rows(), entries_of);
  const SparseRows joined = jumps_.transpose() * SparseRows(closed * jumps_);
  const SparseRows robin = traces_.transpose() * SparseRows(springs_.asDiagonal() * traces_);
  for (held_ = std::max(least_held, spring_);; held_ *= stiffer) {
    const SparseRows sum = joined + held_ * robin;
    const SparseRows lower = stiffness_ + SparseRows(sum.triangularView<Eigen::Lower>());
    try {
      factor_ = algebra::factorise(lower, 0, algebra::FactorBackend::automatic,
                                   "the structure of Newton's method");
      break;
    } catch (const NumericalError&) {
      if (held_ > std::max(most_held, spring_)) {
        throw;
      }
    }
  }
  ++factorisations_;
  stale_ = false;
}

Vector SparseSkeleton::sprung(const Vector& jump) const {
  return times(d_, system_.layout().first, system_.layout().components, jump);
}

SparseSkeleton::Pair SparseSkeleton::respond(const Vector& phi, const Vector& loads) {
  ++solutions_;
  const Vector own = own_.cwiseProduct(phi);
  const Vector driving = phi + sprung(own);
  const Vector between = sides_.transpose() * areas_.cwiseProduct(driving);
  const Vector nodal = traces_.transpose() * (weights_.cwiseProduct(loads) - between);
  Pair pair;
  pair.traces = traces_ * factor_->solve(nodal).col(0);
  pair.y = driving + sprung(sides_ * pair.traces);
  return pair;
}

bool SparseSkeleton::approach(const Matrix& tangent, const Vector& phi, const Vector& loads,
                              Pair& pair) {
  const auto& layout = system_.layout();
  const auto of_law = [&](const Pair& each) -> Vector {
    const Vector jump = sides_ * each.traces + own_.cwiseProduct(each.y);
    return each.y - times(tangent, layout.first, layout.components, jump);
  };
  pair = respond(phi, loads);
  Vector left = phi - of_law(pair);
  const double enough =
      (exact_ ? exact_forcing : forcing) * std::max(norm(phi), size_of_imbalance(loads));
  std::vector<Pair> pairs;
  std::vector<Vector> images;
  for (Index count = 1; norm(left) > enough && count < most_solutions; ++count) {
    Pair next = respond(left, Vector::Zero(loads.size()));
    Vector image = of_law(next);
    for (int twice = 0; twice < 2; ++twice) {
      for (std::size_t i = 0; i < images.size(); ++i) {
        const double share = images[i].dot(metric_.cwiseProduct(image));
        image -= share * images[i];
        next.y -= share * pairs[i].y;
        next.traces -= share * pairs[i].traces;
      }
    }
    const double size = norm(image);
    if (!(size > norm(least_corrected_.cwiseProduct(next.y))) || !std::isfinite(size)) {
      break;
    }
    image /= size;
    next.y /= size;
    next.traces /= size;
    const double share = image.dot(metric_.cwiseProduct(left));
    left -= share * image;
    pair.y += share * next.y;
    pair.traces += share * next.traces;
    images.push_back(std::move(image));
    pairs.push_back(std::move(next));
  }
  stale_ = static_cast<Index>(images.size()) >= worth_a_factor;
  return norm(left) <= enough;
}

bool SparseSkeleton::step(const Matrix& tangent, const Vector& phi, const Vector& imbalance,
                          Vector& dy, Vector& dm) {
  Pair pair;
  bool kept = !stale_ && factor_ != nullptr;
  if (!kept) {
    factorise(tangent);
  }
  if (!approach(tangent, phi, imbalance, pair) && kept) {
    factorise(tangent);
    static_cast<void>(approach(tangent, phi, imbalance, pair));
  }
  dy = pair.y;
  dm.resize(motions());
  dm << pair.traces, held_ * system_.directions().cwiseProduct(pair.traces) - imbalance;
  return dy.allFinite() && dm.allFinite();
}

Skeleton::Start SparseSkeleton::begin(const Vector& unbalanced, Vector& /*jump*/) const {
  return {Vector(), unbalanced};
}

Vector SparseSkeleton::imbalance(const Start& start, const Vector& /*y*/,
                                 const Vector& motion) const {
  return start.loads + motion.tail(start.loads.size()) - sprung_rows(motion);
}

Vector SparseSkeleton::moved(const Vector& y, const Vector& motion) const {
  return sides_ * motion.head(traces_.rows()) + own_.cwiseProduct(y);
}

/// Forces count by what the meshes see of them.
double SparseSkeleton::size_of(const Vector& force) const {
  return size_of_imbalance(sides_.transpose() * force);
}

double SparseSkeleton::size_of_imbalance(const Vector& imbalance) const {
  const Vector nodal = traces_.transpose() * weights_.cwiseProduct(imbalance);
  return std::sqrt(nodal.cwiseAbs2().cwiseQuotient(diagonal_).sum());
}

bool SparseSkeleton::loose(const Vector& motion, double force) const {
  const Vector springs = held_ * system_.directions().cwiseProduct(motion.head(traces_.rows()));
  return size_of_imbalance(springs) > held_by_nothing * force;
}

Vector SparseSkeleton::data(ConstVectorRef /*data*/, ConstVectorRef traces, const Start& /*start*/,
                            const Vector& force, const Vector& /*y*/, const Vector& motion) const {
  const Vector moved = traces + motion.head(traces_.rows());
  return system_.directions().cwiseProduct(moved) - sides_.transpose() * force;
}

}  // namespace latin::iteration
