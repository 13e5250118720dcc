#include "substructure/body.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "algebra/eigenvectors.hpp"
#include "algebra/inverse.hpp"
#include "algebra/sparse_product.hpp"
#include "algebra/trailing.hpp"
#include "algebra/triangle.hpp"
#include "common/numbers.hpp"
#include "latin/common/error.hpp"
#include "latin/common/interrupt.hpp"

namespace latin::substructure {
namespace {

using algebra::multiply_sparse;

/// A factor of n numbers takes about n^1.4 operations (grids, in three dimensions).
constexpr double operations_of_numbers = 1.4;
/// Columns of a product with a triangle that are made together.
constexpr Index columns_of_product = 64;

/// Seconds since the last time it was asked.
class Watch {
 public:
  double lap() {
    const auto before = std::exchange(last_, std::chrono::steady_clock::now());
    return std::chrono::duration<double>(last_ - before).count();
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

SparseRows identity(Index size) {
  SparseRows matrix(size, size);
  matrix.setIdentity();
  return matrix;
}

/// Columns renumbered: column j becomes position(j).
SparseRows renumber_columns(const SparseRows& matrix, const std::vector<int>& position) {
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(static_cast<std::size_t>(matrix.nonZeros()));
  for (Index row = 0; row < matrix.outerSize(); ++row) {
    for (SparseRows::InnerIterator it(matrix, row); it; ++it) {
      entries.emplace_back(static_cast<int>(row), position[static_cast<std::size_t>(it.col())],
                           it.value());
    }
  }
  SparseRows result(matrix.rows(), matrix.cols());
  result.setFromTriplets(entries.begin(), entries.end());
  return result;
}

SparseRows stack_rows(const std::vector<SparseRows>& blocks, Index cols) {
  Index rows = 0;
  std::vector<Eigen::Triplet<double>> entries;
  for (const auto& block : blocks) {
    for (Index row = 0; row < block.outerSize(); ++row) {
      for (SparseRows::InnerIterator it(block, row); it; ++it) {
        entries.emplace_back(static_cast<int>(rows + row), static_cast<int>(it.col()), it.value());
      }
    }
    rows += block.rows();
  }
  count_of_entries(static_cast<Index>(entries.size()), "the traces of a body");
  SparseRows result(rows, cols);
  result.setFromTriplets(entries.begin(), entries.end());
  return result;
}

/// Lower triangle of sum_e B_e^T M_e B_e, with M_e symmetric.
///
/// Gathered row by row of the sum, so that no list of entries is ever stored or sorted: a row collects its
/// entries in a dense workspace.
class LowerSum {
 public:
  explicit LowerSum(Index size) : size_(size) {}

  /// What they look at must outlive build().
  void add(const SparseView& middle, const SparseRows& b) {
    terms_.push_back({middle, &b, SparseColumns(b)});
  }

  /// The columns of a row are in no order.
  [[nodiscard]] SparseRows build() const {
    SparseRows lower(size_, size_);
    std::vector<double> sum(static_cast<std::size_t>(size_), 0.0);
    std::vector<int> last(static_cast<std::size_t>(size_), -1);  // row that last touched a column
    std::vector<int> touched;
    Index expected = size_;
    for (const Term& term : terms_) {
      expected += term.middle.nonZeros() / 2;
    }
    lower.reserve(expected);
    for (int row = 0; row < size_; ++row) {
      touched.clear();
      const auto collect = [&](Index column, double value) {
        const auto at = static_cast<std::size_t>(column);
        if (last[at] != row) {
          last[at] = row;
          sum[at] = 0.0;
          touched.push_back(static_cast<int>(column));
        }
        sum[at] += value;
      };
      collect(row, 0.0);  // the diagonal exists, even if nothing is held
      for (const Term& term : terms_) {
        for (SparseColumns::InnerIterator left(term.columns, row); left; ++left) {
          for (SparseView::InnerIterator m(term.middle, left.row()); m; ++m) {
            const double value = left.value() * m.value();
            for (SparseRows::InnerIterator right(*term.rows, m.col()); right; ++right) {
              if (right.col() <= row) {
                collect(right.col(), value * right.value());
              }
            }
          }
        }
      }
      count_of_entries(lower.nonZeros() + static_cast<Index>(touched.size()),
                       "the stiffness of a body");
      lower.startVec(row);
      for (const int column : touched) {
        const double value = sum[static_cast<std::size_t>(column)];
        if (column == row || value != 0.0) {
          lower.insertBackByOuterInnerUnordered(row, column) = value;
        }
      }
    }
    lower.finalize();
    return lower;
  }

 private:
  struct Term {
    SparseView middle;
    const SparseRows* rows;
    SparseColumns columns;
  };
  Index size_;
  std::vector<Term> terms_;
};

SparseRows diagonal(const Vector& values) {
  SparseRows matrix = identity(values.size());  // compressed, also where it is empty
  matrix.coeffs() = values;
  return matrix;
}

/// Whether dense triangular solves on the active unknowns beat sparse ones on all of them. A sparse factor
/// of a 3D part holds about 12 n^(4/3) numbers (the vessel's two bodies of 1e4 unknowns); a number in it is
/// taken to cost about four in a dense block.
bool dense_is_cheaper(Index size, Index active) {
  const double dense = static_cast<double>(active) * static_cast<double>(active);
  return dense <= 50.0 * std::pow(static_cast<double>(size), 4.0 / 3.0);
}

/// Whether a product with the inverse is as good as two solutions with a triangular factor.
bool well_scaled(const MatrixView& factor) {
  constexpr double least =
      1e-4;  // of the pivots, which bounds the condition number from below by 1e8
  const auto pivots = factor.diagonal();
  return pivots.size() > 0 && pivots.minCoeff() > least * pivots.maxCoeff();
}

/// out = a * x with a symmetric. With few columns it is memory that costs: the lower triangle is read once, in
/// panels that stay in the cache for both of their products.
void multiply_symmetric(const Matrix& a, const ConstMatrixRef& x, MatrixRef out) {
  constexpr Index few = 8;
  constexpr Index panel = 32;
  if (x.cols() > few) {
    out.noalias() = a * x;
    return;
  }
  out.setZero();
  const Index size = a.cols();
  for (Index j = 0; j < size; j += panel) {
    const Index width = std::min(panel, size - j);
    const Index rest = size - j - width;
    const auto below = a.block(j + width, j, rest, width);
    for (Index c = 0; c < x.cols(); ++c) {
      auto here = out.col(c).segment(j, width);
      here.noalias() += a.block(j, j, width, width) * x.col(c).segment(j, width);
      here.noalias() += below.transpose() * x.col(c).tail(rest);
      out.col(c).tail(rest).noalias() += below * x.col(c).segment(j, width);
    }
  }
}

std::string shape_of(Index rows, Index cols) {
  return std::to_string(rows) + " x " + std::to_string(cols);
}

/// Only the lower triangle of a stiffness is used: another matrix would be solved in silence.
void check_symmetry(const Member& member) {
  /// Difference of the sums over a row and over a column, relative to the sum of magnitudes in the row.
  constexpr double unequal = 1e-8;
  const SparseView& matrix = *member.stiffness;
  const Index n = matrix.rows();
  Vector x(n);  // numbers without a pattern, so that nothing cancels
  for (Index row = 0; row < n; ++row) {
    x(row) = 1.0 + std::fmod(0.7548776662 * static_cast<double>(row), 1.0);
  }
  Vector difference = Vector::Zero(n);  // K x - K^T x
  Vector size(n);
  for (Index row = 0; row < n; ++row) {
    const double own = x(row);
    double sum = 0.0;
    double of_row = 0.0;
    for (SparseView::InnerIterator it(matrix, row); it; ++it) {
      sum += it.value() * x(it.col());
      difference(it.col()) -= it.value() * own;
      of_row += std::abs(it.value());
    }
    difference(row) += sum;
    size(row) = of_row;
  }
  for (Index row = 0; row < n; ++row) {
    if (std::abs(difference(row)) > unequal * size(row)) {
      throw InputError("substructure '" + member.name + "': its stiffness is not symmetric (row " +
                       std::to_string(row) + " differs from column " + std::to_string(row) +
                       "): give a symmetric form");
    }
  }
}

void check_members(const BodyDescription& body) {
  if (body.size < 0) {
    throw InputError("body '" + body.name + "' has " + std::to_string(body.size) + " unknowns");
  }
  for (const Member& member : body.members) {
    if (member.stiffness == nullptr) {
      throw InputError("substructure '" + member.name + "' has no stiffness");
    }
    const Index n = member.stiffness->rows();
    const Index loads = body.members.front().load.cols();
    if (member.stiffness->cols() != n || member.load.rows() != n || member.load.cols() != loads ||
        (member.offset.size() > 0 &&
         (member.offset.rows() != n || member.offset.cols() != loads)) ||
        (member.of_stiffness.size() > 0 &&
         (member.of_stiffness.rows() != n || member.of_stiffness.cols() != loads)) ||
        (member.prolongation.size() > 0
             ? (member.prolongation.rows() != n || member.prolongation.cols() != body.size)
             : n != body.size)) {
      throw InputError("substructure '" + member.name + "': stiffness " +
                       shape_of(n, member.stiffness->cols()) + ", load " +
                       shape_of(member.load.rows(), member.load.cols()) + ", offset " +
                       shape_of(member.offset.rows(), member.offset.cols()) + " and prolongation " +
                       shape_of(member.prolongation.rows(), member.prolongation.cols()) +
                       " do not fit a body of " + std::to_string(body.size) + " unknowns with " +
                       std::to_string(loads) + " load patterns");
    }
    const Index rows = member.stretch.rows();
    if (member.stretch_points < 0 || (member.stretch_points == 0 && rows > 0) ||
        (member.stretch_points > 0 &&
         (rows % member.stretch_points != 0 || rows == 0 || member.stretch.cols() != n)) ||
        (member.initial_stretch.size() > 0 &&
         (member.initial_stretch.rows() != rows || member.initial_stretch.cols() != loads))) {
      throw InputError("substructure '" + member.name + "': stretches " +
                       shape_of(rows, member.stretch.cols()) + " do not fit " +
                       std::to_string(member.stretch_points) + " points and " + std::to_string(n) +
                       " unknowns");
    }
    if (!member.load.allFinite() || !member.offset.allFinite()) {
      throw InputError("substructure '" + member.name + "': its load or offset is not finite");
    }
    check_symmetry(member);
  }
}

void check_springs(const BodyDescription& body) {
  const auto members = static_cast<Index>(body.members.size());
  for (const Spring& spring : body.springs) {
    const auto fail = [&spring](const std::string& text) {
      throw InputError("spring '" + spring.name + "': " + text);
    };
    if (spring.members.empty() || spring.members.size() > 2 ||
        spring.members.size() != spring.traces.size()) {
      fail(std::to_string(spring.members.size()) + " members and " +
           std::to_string(spring.traces.size()) + " traces: give one of each (ground) or two");
    }
    for (std::size_t s = 0; s < spring.members.size(); ++s) {
      const Index member = spring.members[s];
      if (member < 0 || member >= members) {
        fail("member " + std::to_string(member) + " of a body of " + std::to_string(members));
      }
      const Index n = body.members[static_cast<std::size_t>(member)].stiffness->rows();
      if (spring.traces[s].rows() != spring.stiffness.size() || spring.traces[s].cols() != n) {
        fail("a trace " + shape_of(spring.traces[s].rows(), spring.traces[s].cols()) +
             ", expected " + shape_of(spring.stiffness.size(), n));
      }
    }
    const Index loads = body.members.front().load.cols();
    if (spring.jump.rows() != spring.stiffness.size() || spring.jump.cols() != loads) {
      fail("jump " + shape_of(spring.jump.rows(), spring.jump.cols()) + ", expected " +
           std::to_string(spring.stiffness.size()) + " rows and " + std::to_string(loads) +
           " load patterns");
    }
    if (!spring.stiffness.allFinite() || !spring.jump.allFinite()) {
      fail("its stiffness or jump is not finite");
    }
  }
}

void check_sides(const BodyDescription& body, const std::vector<BodySide>& sides) {
  for (const BodySide& side : sides) {
    const Member& member = body.members.at(static_cast<std::size_t>(side.member));
    if (side.trace.cols() != member.stiffness->rows() || side.trace.rows() != side.weights.size() ||
        side.trace.rows() != side.direction.size()) {
      throw InputError("substructure '" + member.name + "': a trace " +
                       shape_of(side.trace.rows(), side.trace.cols()) + ", expected " +
                       shape_of(side.weights.size(), member.stiffness->rows()));
    }
  }
}

void check_shapes(const BodyDescription& body, const std::vector<BodySide>& sides) {
  check_members(body);
  check_springs(body);
  check_sides(body, sides);
}

/// The jumps of springs in the unknowns of the body, B = T2 Z2 - T1 Z1.
std::vector<SparseRows> spring_jumps(const std::vector<Spring>& springs,
                                     const std::vector<SparseRows>& prolongations, Index size) {
  std::vector<SparseRows> jumps;
  for (const Spring& spring : springs) {
    SparseRows& jump = jumps.emplace_back(spring.stiffness.size(), size);
    for (std::size_t s = 0; s < spring.members.size(); ++s) {
      const SparseRows of_side =
          spring.traces[s] * prolongations[static_cast<std::size_t>(spring.members[s])];
      jump += (s == 0 ? -1.0 : 1.0) * of_side;
    }
  }
  return jumps;
}

/// The largest entry of its members and springs (of the jumps given); 0 of a single member without springs.
double stiffest_of(const BodyDescription& description, const std::vector<SparseRows>& jumps) {
  double largest = 0.0;
  if (description.members.size() > 1 || !description.springs.empty()) {
    for (const Member& member : description.members) {
      const Eigen::Map<const Vector> entries(member.stiffness->valuePtr(),
                                             member.stiffness->nonZeros());
      largest = entries.size() > 0 ? std::max(largest, entries.cwiseAbs().maxCoeff()) : largest;
    }
    for (std::size_t i = 0; i < jumps.size(); ++i) {
      for (Index row = 0; row < jumps[i].rows(); ++row) {
        for (SparseRows::InnerIterator it(jumps[i], row); it; ++it) {
          const double entry = description.springs[i].stiffness(row) * it.value() * it.value();
          largest = std::max(largest, entry);
        }
      }
    }
  }
  return largest;
}

/// Bodies whose displacements rounding may leave wrong by more are measured.
constexpr double well_conditioned = 1e-12;
/// So are those in which this much stiffer ones than their faces are joined: a bound is far too large for them.
constexpr double uneven = 1e4;

using Longer = Eigen::Matrix<long double, Eigen::Dynamic, 1>;

/// out += sign * a x
template <class Sparse>
void add_product(const Sparse& a, const Longer& x, Longer& out, long double sign = 1.0L) {
  for (int row = 0; row < a.outerSize(); ++row) {
    long double sum = 0.0L;
    for (typename Sparse::InnerIterator it(a, row); it; ++it) {
      sum += static_cast<long double>(it.value()) * x(it.col());
    }
    out(row) += sign * sum;
  }
}

/// out += sign * a^T x
void add_transposed(const SparseRows& a, const Longer& x, Longer& out, long double sign = 1.0L) {
  for (int row = 0; row < a.outerSize(); ++row) {
    for (SparseRows::InnerIterator it(a, row); it; ++it) {
      out(it.col()) += sign * static_cast<long double>(it.value()) * x(row);
    }
  }
}

}  // namespace

Body::Body(BodyDescription description, const std::vector<BodySide>& sides,
           const OperatorOptions& options, const Body* before)
    : name_(std::move(description.name)), size_(description.size) {
  Watch watch;
  check_shapes(description, sides);
  for (Member& member : description.members) {
    if (member.prolongation.size() == 0) {
      member.prolongation = identity(size_);
    }
    prolongations_.emplace_back().swap(member.prolongation);  // Eigen moves no sparse matrix
  }
  order_active_last(sides);
  stack_sides(sides);
  std::vector<SparseRows> jumps =
      spring_jumps(description.springs, prolongations_, description.size);
  const Loads loads = assemble_loads(description, jumps);
  const bool condense = wants_condensation(options);
  const bool sparse = options.kind == OperatorKind::factored;
  const double most = std::numeric_limits<double>::infinity();
  dense_limit_ = sparse ? 0.0 : options.memory_limit > 0.0 ? options.memory_limit : most;
  const bool varies = std::ranges::any_of(
      description.members, [](const Member& member) { return member.stretch_points > 0; });
  if (condense && !varies) {
    const Vector robin = weights_.cwiseProduct(direction_);
    origin_ = std::make_shared<const Origin>(
        Origin{without_sides(description, jumps),
               active_traces_.transpose() * (robin.asDiagonal() * active_traces_), nullptr});
    kept_ = before != nullptr && take_over(*before);
  }
  const bool keeps = options.keep_operator && active_ > 0;
  const SparseRows lower = kept_ && !keeps ? SparseRows() : assemble_operator(description, jumps);
  active_stiffness_ = stiffness_of_active(description.members);
  sprung_ = !description.springs.empty();
  for (std::size_t e = 0; e < description.members.size(); ++e) {
    if (description.members[e].of_stiffness.size() > 0) {
      if (of_stiffness_.size() == 0) {
        of_stiffness_ = Matrix::Zero(size_, description.members[e].load.cols());
      }
      of_stiffness_ += prolongations_[e].transpose() * description.members[e].of_stiffness;
    }
  }
  stiffest_ = stiffest_of(description, jumps);
  keep_stretches(description, lower, options);
  for (Member& member : description.members) {
    offsets_.push_back(std::move(member.offset));
  }
  cost_.assemble_s = watch.lap();

  if (!kept_) {
    factorise(lower, condense, options);
  }
  const double softest = active_stiffness_.size() > 0 ? active_stiffness_.minCoeff() : stiffest_;
  if (rounding() > well_conditioned || stiffest_ > uneven * softest) {
    keep_terms(description, std::move(jumps));
  }
  description = {};
  cost_.factorise_s = watch.lap();
  if (condense && factor_->condenses()) {
    condensed_ = true;
    cost_.dense_numbers = static_cast<double>(active_) * static_cast<double>(active_);
    if (origin_ != nullptr && !kept_) {
      origin_ = std::make_shared<const Origin>(Origin{origin_->of, origin_->robin, factor_});
    }
  } else {
    origin_ = nullptr;
  }
  keep_loads(loads, sides);
  if (keeps && lower_.size() == 0 && !condensed_is_less()) {
    lower_ = SparseColumns(lower);  // which sorts the columns of every row
  }
  response_ = respond({});
  cost_.condense_s = watch.lap();
}

void Body::keep_stretches(BodyDescription& description, const SparseRows& lower,
                          const OperatorOptions& options) {
  for (std::size_t e = 0; e < description.members.size(); ++e) {
    Member& member = description.members[e];
    if (member.stretch_points == 0) {
      continue;
    }
    Stretch& stretch = stretches_.emplace_back();
    stretch.member = member.name;
    stretch.points = member.stretch_points;
    stretch.of_unknowns = member.stretch * prolongations_[e];
    stretch.back = stretch.of_unknowns.transpose();
    const Index loads = member.load.cols();
    stretch.offset = member.offset.size() > 0 ? Matrix(member.stretch * member.offset)
                                              : Matrix::Zero(member.stretch.rows(), loads);
    stretch.initial = member.initial_stretch.size() > 0
                          ? std::move(member.initial_stretch)
                          : Matrix::Zero(member.stretch.rows(), loads);
  }
  if (stretches_.empty()) {
    return;
  }
  options_ = options;
  lower_ = SparseColumns(lower);  // which sorts the columns of every row
}

const Body::Spread& Body::spread() const {
  return spread_.get([this] {
    Spread spread;
    // every entry that factors may change: where the sum of all points vanishes, too
    using Entry = Eigen::Triplet<double>;
    using Entries = std::vector<Entry>;
    const auto place_of = [](const Entry& entry) { return std::pair(entry.row(), entry.col()); };
    std::vector<std::vector<Entries>> of_points;
    Entries all;
    Entries terms;
    for (const Stretch& stretch : stretches_) {
      std::vector<Entries>& own = of_points.emplace_back();
      const Index components = stretch.components();
      for (Index point = 0; point < stretch.points; ++point) {
        terms.clear();
        for (Index row = point * components; row < (point + 1) * components; ++row) {
          for (SparseRows::InnerIterator i(stretch.of_unknowns, row); i; ++i) {
            for (SparseRows::InnerIterator j(stretch.of_unknowns, row); j && j.col() <= i.col();
                 ++j) {
              terms.emplace_back(static_cast<int>(i.col()), static_cast<int>(j.col()),
                                 i.value() * j.value());
            }
          }
        }
        std::ranges::sort(terms, {}, place_of);
        Entries& entries = own.emplace_back();
        for (const Entry& term : terms) {
          if (!entries.empty() && place_of(entries.back()) == place_of(term)) {
            entries.back() = {term.row(), term.col(), entries.back().value() + term.value()};
          } else {
            entries.push_back(term);
            all.emplace_back(term.row(), term.col(), 0.0);
          }
        }
      }
    }
    for (Index row = 0; row < lower_.outerSize(); ++row) {
      for (SparseRows::InnerIterator it(lower_, row); it; ++it) {
        all.emplace_back(static_cast<int>(row), static_cast<int>(it.col()), it.value());
      }
    }
    count_of_entries(static_cast<Index>(all.size()), "the field of body '" + name_ + "'");
    spread.lower.resize(size_, size_);
    spread.lower.setFromTriplets(all.begin(), all.end());
    for (std::size_t s = 0; s < stretches_.size(); ++s) {
      Entries found;
      for (std::size_t point = 0; point < of_points[s].size(); ++point) {
        for (const Entry& entry : of_points[s][point]) {
          const int* const begin =
              spread.lower.innerIndexPtr() + spread.lower.outerIndexPtr()[entry.row()];
          const int* const end =
              spread.lower.innerIndexPtr() + spread.lower.outerIndexPtr()[entry.row() + 1];
          const auto at = std::lower_bound(begin, end, entry.col()) - spread.lower.innerIndexPtr();
          found.emplace_back(static_cast<int>(at), static_cast<int>(point), entry.value());
        }
      }
      count_of_entries(static_cast<Index>(found.size()), "the field of body '" + name_ + "'");
      spread.slopes.emplace_back(spread.lower.nonZeros(), stretches_[s].points);
      spread.slopes.back().setFromTriplets(found.begin(), found.end());
    }
    return spread;
  });
}

std::shared_ptr<const Body> Body::with_factors(const std::vector<Vector>& factors) const {
  const std::shared_ptr<Body> body(new Body());
  body->name_ = name_;
  body->size_ = size_;
  body->sprung_ = sprung_;
  body->active_ = active_;
  body->stiffest_ = stiffest_;
  body->prolongations_ = prolongations_;
  body->offsets_ = offsets_;
  body->traces_ = traces_;
  body->active_traces_ = active_traces_;
  body->active_loads_ = active_loads_;
  body->weights_ = weights_;
  body->direction_ = direction_;
  body->load_ = load_;
  body->active_patterns_ = active_patterns_;
  body->active_stiffness_ = active_stiffness_;
  body->work_ = work_;
  body->offset_energy_ = offset_energy_;
  body->of_jumps_ = of_jumps_;
  body->jump_energy_ = jump_energy_;
  body->offset_traces_ = offset_traces_;
  body->dense_limit_ = dense_limit_;
  const Spread& spread = this->spread();
  SparseRows lower = spread.lower;
  for (std::size_t s = 0; s < stretches_.size(); ++s) {
    const Stretch& stretch = stretches_[s];
    const Vector change = factors.at(s).array() - 1.0;
    lower.coeffs() += (spread.slopes[s] * change).array();
    const Vector rows = change.transpose().replicate(stretch.components(), 1).reshaped();
    const auto weighted = rows.asDiagonal();
    if (loads() > 0) {
      const Matrix of_offset = stretch.back * (weighted * stretch.offset);
      const Matrix of_initial = stretch.back * (weighted * stretch.initial);
      body->load_ += of_initial - of_offset;
      body->active_patterns_ += of_initial.bottomRows(active_);
      if (work_.size() > 0) {
        body->work_ += of_initial + of_offset;
      }
      body->offset_energy_ += stretch.offset.transpose() * (weighted * stretch.offset);
    }
  }
  body->factorise(lower, condensed(), options_);
  body->condensed_ = condensed() && body->factor_->condenses();
  body->response_ = body->respond({});
  return body;
}

double BodyCost::operations() const { return std::pow(factor_numbers, operations_of_numbers); }

bool Body::condensed_is_less() const {
  const auto active = static_cast<double>(active_);
  return condensed_ && active * active * active / 3.0 <= cost_.operations();
}

SparseRows Body::kept_operator() const {
  if (!condensed_is_less()) {
    return lower_;
  }
  const Matrix factor = condensed_factor().triangularView<Eigen::Lower>();
  Matrix product = Matrix::Zero(active_, active_);
  for (Index first = 0; first < active_; first += columns_of_product) {
    const Index some = std::min(columns_of_product, active_ - first);
    product.block(first, first, active_ - first, some) =
        factor.bottomLeftCorner(active_ - first, first + some) *
        factor.block(first, 0, some, first + some).transpose();
  }
  return Matrix(product.triangularView<Eigen::Lower>()).sparseView();
}

SideTrace Body::trace_of_side(Index row, Index rows) const {
  const SparseRows all = active_traces_.middleRows(row, rows);
  SideTrace side;
  std::vector<int> position(static_cast<std::size_t>(active_), -1);
  Triplets entries;
  for (Index at = 0; at < rows; ++at) {
    for (SparseRows::InnerIterator it(all, at); it; ++it) {
      int& number = position[static_cast<std::size_t>(it.col())];
      if (number < 0) {
        number = static_cast<int>(side.touched.size());
        side.touched.push_back(it.col());
      }
      entries.emplace_back(static_cast<int>(at), number, it.value());
    }
  }
  side.trace.resize(rows, static_cast<Index>(side.touched.size()));
  side.trace.setFromTriplets(entries.begin(), entries.end());
  return side;
}

/// Unknowns that an active side touches go last, so that the factorisation condenses onto them.
void Body::order_active_last(const std::vector<BodySide>& sides) {
  std::vector<SparseRows> on_body;
  std::vector<int> position(static_cast<std::size_t>(size_), 0);
  for (const BodySide& side : sides) {
    SparseRows& trace =
        on_body.emplace_back(side.trace * prolongations_[static_cast<std::size_t>(side.member)]);
    trace.prune(0.0);
    for (Index k = 0; k < trace.nonZeros(); ++k) {
      position[static_cast<std::size_t>(trace.innerIndexPtr()[k])] = 1;
    }
  }
  for (const int touched : position) {
    active_ += touched;
  }
  int interior = 0;
  int trailing = static_cast<int>(size_ - active_);
  for (int& where : position) {
    where = where == 0 ? interior++ : trailing++;
  }
  traces_ = stack_rows(on_body, size_);
  active_traces_.resize(traces_.rows(), 0);  // faces that are held entirely touch no unknown
  if (active_ > 0) {
    for (SparseRows& z : prolongations_) {
      z = renumber_columns(z, position);
    }
    traces_ = renumber_columns(traces_, position);
    active_traces_ = traces_.rightCols(active_);
  }
}

/// Weights and search directions of all sides, one below the other.
void Body::stack_sides(const std::vector<BodySide>& sides) {
  weights_.resize(rows());
  direction_.resize(rows());
  Index row = 0;
  for (const BodySide& side : sides) {
    weights_.segment(row, side.trace.rows()) = side.weights;
    direction_.segment(row, side.trace.rows()) = side.direction;
    row += side.trace.rows();
  }
  active_loads_ = active_traces_.transpose() * weights_.asDiagonal();
}

/// Loads of the members and of imposed jumps. Offsets act through everything elastic: Z^T K u0.
Body::Loads Body::assemble_loads(const BodyDescription& description,
                                 const std::vector<SparseRows>& jumps) const {
  const std::vector<Member>& members = description.members;
  const Index loads = members.empty() ? 0 : members.front().load.cols();
  const bool shifted =
      std::ranges::any_of(members, [](const Member& m) { return m.offset.size() > 0; });
  Loads sum{Matrix::Zero(size_, loads),
            Matrix::Zero(shifted ? size_ : 0, loads),
            Matrix::Zero(loads, loads),
            {},
            {}};
  for (std::size_t e = 0; e < members.size(); ++e) {
    const Member& member = members[e];
    sum.load += prolongations_[e].transpose() * member.load;
    if (member.offset.size() > 0) {
      const Matrix reaction = *member.stiffness * member.offset;
      sum.of_offset += prolongations_[e].transpose() * reaction;
      sum.offset_energy += member.offset.transpose() * reaction;
    }
  }
  for (std::size_t i = 0; i < jumps.size(); ++i) {
    const Spring& spring = description.springs[i];
    Matrix of_offsets = Matrix::Zero(spring.stiffness.size(), loads);
    if (shifted) {
      for (std::size_t s = 0; s < spring.members.size(); ++s) {
        const Matrix& offset = members[static_cast<std::size_t>(spring.members[s])].offset;
        if (offset.size() > 0) {
          of_offsets += (s == 0 ? -1.0 : 1.0) * (spring.traces[s] * offset);
        }
      }
      sum.of_offset += jumps[i].transpose() * (spring.stiffness.asDiagonal() * of_offsets);
      sum.offset_energy += of_offsets.transpose() * spring.stiffness.asDiagonal() * of_offsets;
    }
    if (spring.jump.isZero(0.0)) {
      continue;
    }
    if (sum.of_jumps.size() == 0) {
      sum.of_jumps = Matrix::Zero(size_, loads);
      sum.jump_energy = Matrix::Zero(loads, loads);
    }
    const Matrix forces = spring.stiffness.asDiagonal() * spring.jump;
    const Matrix mixed = of_offsets.transpose() * forces;
    sum.of_jumps += jumps[i].transpose() * forces;
    sum.jump_energy += spring.jump.transpose() * forces - mixed - mixed.transpose();
  }
  if (sum.of_jumps.size() > 0) {
    sum.load += sum.of_jumps;
  }
  if (shifted) {
    sum.load -= sum.of_offset;
  }
  return sum;
}

/// Lower triangle of K + sum B^T kappa B + sum T^T W k T.
SparseRows Body::assemble_operator(const BodyDescription& description,
                                   const std::vector<SparseRows>& jumps) const {
  LowerSum sum(size_);
  for (std::size_t e = 0; e < description.members.size(); ++e) {
    sum.add(*description.members[e].stiffness, prolongations_[e]);
  }
  std::deque<SparseRows> diagonals;  // the sum looks at them; a deque does not move its elements
  for (std::size_t i = 0; i < jumps.size(); ++i) {
    sum.add(view_of(diagonals.emplace_back(diagonal(description.springs[i].stiffness))), jumps[i]);
  }
  sum.add(view_of(diagonals.emplace_back(diagonal(weights_.cwiseProduct(direction_)))), traces_);
  return sum.build();
}

/// The diagonal of Z^T K Z, as far as it comes from that of K.
Vector Body::stiffness_of_active(const std::vector<Member>& members) const {
  Vector sum = Vector::Zero(size_);
  for (std::size_t e = 0; e < members.size(); ++e) {
    const SparseView& matrix = *members[e].stiffness;
    Vector diagonal = Vector::Zero(matrix.rows());
    for (int row = 0; row < matrix.outerSize(); ++row) {
      for (SparseView::InnerIterator it(matrix, row); it; ++it) {
        diagonal(row) += it.col() == row ? it.value() : 0.0;
      }
    }
    for (int row = 0; row < prolongations_[e].outerSize(); ++row) {
      for (SparseRows::InnerIterator it(prolongations_[e], row); it; ++it) {
        sum(it.col()) += it.value() * it.value() * diagonal(row);
      }
    }
  }
  return sum.tail(active_);
}

bool Body::wants_condensation(const OperatorOptions& options) const {
  if (active_ == 0 || options.kind == OperatorKind::factored) {
    return false;
  }
  const double bytes = 8.0 * static_cast<double>(active_) * static_cast<double>(active_);
  return options.kind == OperatorKind::condensed ||
         (dense_is_cheaper(size_, active_) &&
          (options.memory_limit <= 0.0 || bytes <= options.memory_limit));
}

void Body::factorise(const SparseRows& lower, bool condense, const OperatorOptions& options) {
  factor_ = algebra::factorise(lower, condense ? active_ : 0, options.backend, name_);
  cost_.factor_numbers = factor_->nonzeros();
  if (condense && !factor_->condenses() && options.kind == OperatorKind::condensed) {
    throw InputError("body '" + name_ + "': backend '" + factor_->backend() +
                     "' does not condense: use operator 'factored' or backend 'cholmod'");
  }
}

/// What its operator is made of but for the sides, and how many unknowns go last.
Fingerprint Body::without_sides(const BodyDescription& description,
                                const std::vector<SparseRows>& jumps) const {
  Fingerprint found;
  found.add(static_cast<std::uint64_t>(size_));
  found.add(static_cast<std::uint64_t>(active_));
  for (std::size_t e = 0; e < description.members.size(); ++e) {
    found.add_matrix(*description.members[e].stiffness);
    found.add_matrix(prolongations_[e]);
  }
  for (std::size_t i = 0; i < jumps.size(); ++i) {
    found.add_matrix(jumps[i]);
    found.add(description.springs[i].stiffness);
  }
  return found;
}

/// Use the factor of a body of the same members and springs, in the same order: only sides differ, whose springs are
/// on the last unknowns.
bool Body::take_over(const Body& before) {
  if (before.origin_ == nullptr || before.origin_->factor == nullptr ||
      !(before.origin_->of == origin_->of)) {
    return false;
  }
  const Origin& old = *before.origin_;
  constexpr double rounded = 1e-13;  // search directions are any numbers near E / L
  SparseRows change = origin_->robin - old.robin;
  const double largest = old.robin.nonZeros() > 0 ? old.robin.coeffs().abs().maxCoeff() : 0.0;
  change.prune([&](const Index&, const Index&, double value) {
    return std::abs(value) > rounded * largest;
  });
  factor_ = change.nonZeros() == 0
                ? old.factor
                : std::make_shared<const algebra::ChangedTrailing>(old.factor, change, name_);
  cost_.factor_numbers = factor_->nonzeros();
  origin_ = before.origin_;
  return true;
}

/// What the load patterns bring, beside the interface data.
void Body::keep_loads(const Loads& loads, const std::vector<BodySide>& sides) {
  offset_traces_ = Matrix::Zero(rows(), loads.load.cols());
  Index row = 0;
  for (const BodySide& side : sides) {
    const Matrix& offset = offsets_[static_cast<std::size_t>(side.member)];
    if (offset.size() > 0) {
      offset_traces_.middleRows(row, side.trace.rows()) = side.trace * offset;
    }
    row += side.trace.rows();
  }
  const Vector robin = weights_.cwiseProduct(direction_);
  load_ = loads.load - traces_.transpose() * (robin.asDiagonal() * offset_traces_);
  active_patterns_ = loads.load.bottomRows(active_);
  if (loads.of_offset.size() > 0) {
    active_patterns_ += loads.of_offset.bottomRows(active_);
    work_ = loads.load + 2.0 * loads.of_offset;
  }
  if (loads.of_jumps.size() > 0) {
    active_patterns_ -= loads.of_jumps.bottomRows(active_);
  }
  offset_energy_ = loads.offset_energy;
  of_jumps_ = loads.of_jumps;
  jump_energy_ = loads.jump_energy;
}

LoadResponse Body::respond(Matrix extra) const {
  LoadResponse answer;
  answer.extra = std::move(extra);
  if (loads() == 0) {
    answer.traces = Matrix::Zero(rows(), 0);
    answer.work_loads = Matrix::Zero(0, 0);
    answer.work_traces = Matrix::Zero(rows(), 0);
    return answer;
  }
  Matrix load = load_;
  Matrix work = work_;
  if (answer.extra.size() > 0) {
    load += answer.extra;
    if (work.size() > 0) {
      work += answer.extra;
    }
  }
  Matrix response = factor_->solve(load);
  answer.traces = traces_ * response + offset_traces_;
  // u^T K u = q^T K_r q + 2 q^T Z^T K u0 + u0^T K u0, and K_r q = F_r + T^T W f
  const bool shifted = work.size() > 0;
  answer.work_loads = (shifted ? work : load).transpose() * response + offset_energy_;
  answer.work_traces =
      weights_.asDiagonal() * (traces_ * (shifted && rows() > 0 ? factor_->solve(work) : response));
  if (of_jumps_.size() > 0) {
    const Matrix mixed = of_jumps_.transpose() * response;
    answer.jump_loads = jump_energy_ - mixed - mixed.transpose();
    answer.jump_traces = Matrix::Zero(rows(), this->loads());
    if (rows() > 0) {
      answer.jump_traces = -2.0 * (weights_.asDiagonal() * (traces_ * factor_->solve(of_jumps_)));
    }
  }
  if (rows() == 0) {
    answer.unknowns = std::move(response);
  }
  return answer;
}

LoadResponse Body::response_with(const std::vector<Matrix>& loads) const {
  Matrix sum;
  for (std::size_t e = 0; e < loads.size(); ++e) {
    const Matrix& load = loads[e];
    if (load.size() == 0) {
      continue;
    }
    const SparseRows& prolongation = prolongations_.at(e);
    if (load.rows() != prolongation.rows() || load.cols() != this->loads()) {
      throw InputError("body '" + name_ + "': extra load " + std::to_string(load.rows()) + " x " +
                       std::to_string(load.cols()) + ", expected " +
                       std::to_string(prolongation.rows()) + " x " + std::to_string(this->loads()));
    }
    if (sum.size() == 0) {
      sum = Matrix::Zero(size_, this->loads());
    }
    sum += prolongation.transpose() * load;
  }
  return sum.size() > 0 ? respond(std::move(sum)) : response_;
}

const Matrix* Body::compliance_by_solves(Index columns) const {
  // numbers that are read: half of the product, or the sparse factor twice. At most half of the factor's memory more.
  const double block = static_cast<double>(rows()) * static_cast<double>(rows());
  if (8.0 * block > dense_limit_ || 2.0 * block > factor_->nonzeros() || measurable()) {
    return nullptr;
  }
  if (const Matrix* made = compliance_.made()) {
    return made;
  }
  // it takes as many solutions as there are rows, side by side, each an eighth of one that waits for memory
  if (static_cast<double>(applied_.add(columns)) <= 0.125 * static_cast<double>(rows())) {
    return nullptr;
  }
  return &compliance_.get([this] {
    constexpr Index side_by_side = 128;  // all unknowns of the body in each
    Matrix product(rows(), rows());
    for (Index from = 0; from < rows(); from += side_by_side) {
      const Index count = std::min(side_by_side, rows() - from);
      const Matrix unit = SparseRows(traces_.middleRows(from, count)).transpose();
      product.middleCols(from, count) = traces_ * factor_->solve(unit);
    }
    for (Index column = 1; column < rows();
         ++column) {  // symmetric but for rounding: by its lower triangle
      product.col(column).head(column) = product.row(column).head(column).transpose();
    }
    return product;
  });
}

const Matrix* Body::compliance(Index columns) const {
  if (!condensed()) {
    return compliance_by_solves(columns);
  }
  const bool of_rows = rows() < active_;
  const Index size = of_rows ? rows() : active_;
  if (!of_rows) {
    // decided by this call alone, so that an answer does not depend on those before it
    constexpr Index least_columns = 16;
    constexpr Index likely_stages = 40;
    if (columns < least_columns || size > likely_stages * columns ||
        !well_scaled(condensed_factor())) {
      return nullptr;
    }
  } else if (const Matrix* made = compliance_.made()) {
    return made;
  } else {
    // it is formed once the products so far have cost as much as forming it: a column costs active^2 numbers
    // read twice, the product about active^2 rows + active rows^2 operations in blocks, each a third of one
    // that waits for memory
    const auto applied = static_cast<double>(applied_.add(columns));
    const auto rows_on_active = static_cast<double>(size) / static_cast<double>(active_);
    if (applied <= 0.3 * static_cast<double>(size) * (1.0 + rows_on_active)) {
      return nullptr;
    }
  }
  return &compliance_.get([this, of_rows, size] {
    Matrix half = of_rows ? Matrix(active_traces_.transpose()) : Matrix::Identity(size, size);
    condensed_factor().triangularView<Eigen::Lower>().solveInPlace(half);
    Matrix product(size, size);
    product.noalias() = half.transpose() * half;
    return product;
  });
}

void Body::apply(ConstMatrixRef data, MatrixRef traces, BodyWork& work) const {
  const Matrix* const dense = compliance(data.cols());
  if (dense == nullptr && !condensed()) {
    traces = traces_ * factor_->solve(traces_.transpose() * (weights_.asDiagonal() * data));
    return;
  }
  if (dense != nullptr) {
    if (rows() < active_ || !condensed()) {
      Eigen::Map<Matrix> weighted = work.weighted.shaped(rows(), data.cols());
      weighted = weights_.asDiagonal() * data;
      multiply_symmetric(*dense, weighted, traces);
      return;
    }
    Eigen::Map<Matrix> forces = work.weighted.shaped(active_, data.cols());
    Eigen::Map<Matrix> moved = work.unknowns.shaped(active_, data.cols());
    multiply_sparse(active_loads_, data, forces);
    multiply_symmetric(*dense, forces, moved);
    multiply_sparse(active_traces_, moved, traces);
    return;
  }
  Eigen::Map<Matrix> unknowns = work.unknowns.shaped(active_, data.cols());
  multiply_sparse(active_loads_, data, unknowns);
  algebra::solve_with_triangle(condensed_factor(), unknowns);
  multiply_sparse(active_traces_, unknowns, traces);
}

void Body::apply_single(ConstMatrixRef data, MatrixRef traces, BodyWork& work) const {
  if (!condensed() || compliance(0) != nullptr) {
    apply(data, traces, work);
    return;
  }
  static_cast<void>(applied_.add(data.cols()));
  const Eigen::MatrixXf& factor = condensed_single_.get([this] {
    return Eigen::MatrixXf(condensed_factor().cast<float>().triangularView<Eigen::Lower>());
  });
  Eigen::Map<Matrix> unknowns = work.unknowns.shaped(active_, data.cols());
  multiply_sparse(active_loads_, data, unknowns);
  // scaled, because changes of the data may be far below what single precision can hold
  const double scale = unknowns.cwiseAbs().maxCoeff();
  if (!(scale > 0.0)) {
    traces.setConstant(scale);  // zero, or not a number
    return;
  }
  Eigen::Map<Eigen::MatrixXf> single = work.unknowns_single.shaped(active_, data.cols());
  single = (unknowns * (1.0 / scale)).cast<float>();
  factor.triangularView<Eigen::Lower>().solveInPlace(single);
  factor.triangularView<Eigen::Lower>().transpose().solveInPlace(single);
  unknowns = scale * single.cast<double>();
  multiply_sparse(active_traces_, unknowns, traces);
}

void Body::gather(ConstMatrixRef forces, MatrixRef on_unknowns) const {
  multiply_sparse(active_loads_, forces, on_unknowns);
}

double Body::rounding() const {
  // of many sums, which grows like a random walk
  const double sums = 2.0 * std::sqrt(static_cast<double>(size()));
  return sums * std::numeric_limits<double>::epsilon() / factor_->least_pivot();
}

Matrix Body::reduce(ConstMatrixRef forces, Matrix& partial) const {
  partial = factor_->forward(forces);
  return condensed_factor().triangularView<Eigen::Lower>() * partial.bottomRows(active_);
}

Matrix Body::expand(ConstMatrixRef active, Matrix partial) const {
  partial.bottomRows(active_) =
      condensed_factor().transpose().triangularView<Eigen::Upper>() * active;
  return factor_->backward(partial);
}

const Matrix& Body::schur() const {
  return schur_.get([this] {
    if (condensed()) {
      const Matrix lower = condensed_factor().triangularView<Eigen::Lower>();
      Matrix product = Matrix::Zero(active_, active_);
      product.selfadjointView<Eigen::Lower>().rankUpdate(lower);
      return product;
    }
    std::vector<Index> all(static_cast<std::size_t>(active_));
    std::iota(all.begin(), all.end(), Index{0});
    if (active_ == 0) {
      return Matrix(0, 0);
    }
    const Eigen::LLT<Matrix> inverse(inverse_block(all));
    if (inverse.info() != Eigen::Success) {
      throw NumericalError("body '" + name_ + "': its condensed stiffness is not definite");
    }
    return algebra::inverse_of_factored(inverse.matrixLLT());
  });
}

const Body::Spectrum& Body::spectrum() const {
  return spectrum_.get([this] {
    if (!condensed()) {
      throw InputError(
          "body '" + name_ + "': factors of its stiffness need the dense factor of its " +
          std::to_string(active_) +
          " active unknowns: use operator 'condensed' and a memory limit that it fits");
    }
    // L^-1 R L^-T
    Matrix share = Matrix(active_traces_.transpose() *
                          (weights_.cwiseProduct(direction_).asDiagonal() * active_traces_));
    const MatrixView factor = condensed_factor();
    const auto lower = factor.triangularView<Eigen::Lower>();
    lower.solveInPlace(share);
    share.transposeInPlace();
    lower.solveInPlace(share);
    Spectrum spectrum;
    const Vector shares = algebra::eigenvectors_in_place(share);
    if (shares.size() != share.rows()) {
      throw NumericalError("body '" + name_ + "': the eigenvalues of its springs did not converge");
    }
    spectrum.shares = shares.cwiseMax(0.0).cwiseMin(1.0);
    factor.transpose().triangularView<Eigen::Upper>().solveInPlace(share);
    spectrum.vectors = std::move(share);
    return spectrum;
  });
}

Matrix Body::inverse_block(const std::vector<Index>& unknowns) const {
  const auto count = static_cast<Index>(unknowns.size());
  if (count == 0) {
    return Matrix(0, 0);
  }
  if (!condensed()) {
    constexpr Index side_by_side = 256;  // all unknowns of the body in each
    Matrix inverse(count, count);
    for (Index from = 0; from < count; from += side_by_side) {
      stop_if_wanted();
      const Index columns = std::min(side_by_side, count - from);
      Matrix unit = Matrix::Zero(size_, columns);
      for (Index column = 0; column < columns; ++column) {
        unit(size_ - active_ + unknowns[static_cast<std::size_t>(from + column)], column) = 1.0;
      }
      inverse.middleCols(from, columns) = factor_->solve(unit).bottomRows(active_)(unknowns, every);
    }
    return inverse;
  }
  Matrix unit = Matrix::Zero(active_, count);
  for (Index column = 0; column < count; ++column) {
    unit(unknowns[static_cast<std::size_t>(column)], column) = 1.0;
  }
  condensed_factor().triangularView<Eigen::Lower>().solveInPlace(unit);
  return unit.transpose() * unit;
}

Matrix Body::forces_of(ConstMatrixRef data, ConstMatrixRef amplitudes,
                       const LoadResponse& loads) const {
  Matrix forces = load_ * amplitudes;
  if (loads.extra.size() > 0) {
    forces += loads.extra * amplitudes;
  }
  if (rows() > 0) {
    forces += traces_.transpose() * (weights_.asDiagonal() * data);
  }
  return forces;
}

/// Copies, for a matrix that was given may change afterwards.
void Body::keep_terms(BodyDescription& description, std::vector<SparseRows> jumps) {
  for (const Member& member : description.members) {
    terms_.stiffnesses.push_back(owning_view(SparseRows(*member.stiffness)));
  }
  for (Spring& spring : description.springs) {
    terms_.springs.push_back(std::move(spring.stiffness));
  }
  terms_.jumps = std::move(jumps);
}

Vector Body::residual(const Vector& unknowns, ConstVectorRef data, ConstVectorRef amplitudes,
                      const LoadResponse& loads) const {
  const auto longer = [](const auto& values) -> Longer {
    return values.template cast<long double>();
  };
  const Longer u = longer(unknowns);
  const Longer sizes = longer(amplitudes);
  Longer left = load_.cast<long double>() * sizes;
  if (loads.extra.size() > 0) {
    left += loads.extra.cast<long double>() * sizes;
  }
  Longer moved = Longer::Zero(rows());
  add_product(traces_, u, moved);
  const Longer pushed =
      longer(weights_).cwiseProduct(longer(data) - longer(direction_).cwiseProduct(moved));
  add_transposed(traces_, pushed, left);
  for (std::size_t e = 0; e < prolongations_.size(); ++e) {
    Longer of_member = Longer::Zero(prolongations_[e].rows());
    add_product(prolongations_[e], u, of_member);
    Longer forces = Longer::Zero(of_member.size());
    add_product(*terms_.stiffnesses[e], of_member, forces);
    add_transposed(prolongations_[e], forces, left, -1.0L);
  }
  for (std::size_t i = 0; i < terms_.jumps.size(); ++i) {
    Longer jump = Longer::Zero(terms_.jumps[i].rows());
    add_product(terms_.jumps[i], u, jump);
    add_transposed(terms_.jumps[i], longer(terms_.springs[i]).cwiseProduct(jump), left, -1.0L);
  }
  return left.cast<double>();
}

Matrix Body::residuals(const Matrix& unknowns, ConstMatrixRef data, ConstMatrixRef amplitudes,
                       const LoadResponse& loads) const {
  Matrix left(size_, data.cols());
  for (Index column = 0; column < data.cols(); ++column) {
    left.col(column) =
        residual(unknowns.col(column), data.col(column), amplitudes.col(column), loads);
  }
  return left;
}

Body::Correction Body::correction(ConstMatrixRef data, ConstMatrixRef amplitudes,
                                  const LoadResponse& loads) const {
  const Matrix unknowns = factor_->solve(forces_of(data, amplitudes, loads));
  const Matrix left = residuals(unknowns, data, amplitudes, loads);
  const Matrix change = factor_->solve(left);
  return {change.cwiseProduct(left).colwise().sum().cwiseAbs(), traces_ * change};
}

Matrix Body::defect(ConstMatrixRef data, ConstMatrixRef amplitudes,
                    const LoadResponse& loads) const {
  const Matrix unknowns = factor_->solve(forces_of(data, amplitudes, loads));
  const Matrix left = residuals(unknowns, data, amplitudes, loads);
  // the stage moves them a little otherwise than the solution that is corrected here
  Matrix of_loads = load_;
  if (loads.extra.size() > 0) {
    of_loads += loads.extra;
  }
  Matrix by_stage = active_loads_ * data;
  const Matrix* inverse = rows() < active_ ? nullptr : compliance_.made();
  if (inverse != nullptr) {
    by_stage = *inverse * by_stage;
  } else if (condensed()) {
    algebra::solve_with_triangle(condensed_factor(), by_stage);
  } else {
    Matrix all = Matrix::Zero(size_, data.cols());
    all.bottomRows(active_) = by_stage;
    by_stage = factor_->solve(all).bottomRows(active_);
  }
  if (this->loads() > 0) {
    by_stage += factor_->solve(of_loads).bottomRows(active_) * amplitudes;
  }
  const Matrix wrong =
      unknowns.bottomRows(active_) - by_stage + factor_->solve(left).bottomRows(active_);
  return active_ > 0 ? Matrix(schur().selfadjointView<Eigen::Lower>() * wrong) : wrong;
}

std::vector<Matrix> Body::displacements(ConstMatrixRef data, ConstMatrixRef amplitudes,
                                        const LoadResponse& loads) const {
  const Matrix unknowns = loads.unknowns.size() > 0
                              ? Matrix(loads.unknowns * amplitudes)
                              : factor_->solve(forces_of(data, amplitudes, loads));
  std::vector<Matrix> fields;
  fields.reserve(prolongations_.size());
  for (std::size_t e = 0; e < prolongations_.size(); ++e) {
    fields.emplace_back(prolongations_[e] * unknowns);
    if (offsets_[e].size() > 0) {
      fields.back() += offsets_[e] * amplitudes;
    }
  }
  return fields;
}

std::vector<Matrix> Body::response_to(const std::vector<Matrix>& forces) const {
  const Index columns = forces.empty() ? 0 : forces.front().cols();
  Matrix rhs = Matrix::Zero(size_, columns);
  for (std::size_t e = 0; e < prolongations_.size(); ++e) {
    const SparseRows& prolongation = prolongations_[e];
    const Matrix& force = forces.at(e);
    if (force.rows() != prolongation.rows() || force.cols() != columns) {
      throw InputError("body '" + name_ + "': forces " + shape_of(force.rows(), force.cols()) +
                       ", expected " + shape_of(prolongation.rows(), columns));
    }
    rhs += prolongation.transpose() * force;
  }
  const Matrix unknowns = factor_->solve(rhs);
  std::vector<Matrix> fields;
  fields.reserve(prolongations_.size());
  for (const SparseRows& prolongation : prolongations_) {
    fields.emplace_back(prolongation * unknowns);
  }
  return fields;
}

Vector Body::energies(ConstMatrixRef data, ConstMatrixRef traces, ConstMatrixRef forces,
                      ConstMatrixRef amplitudes, const LoadResponse& loads, BodyWork& work) const {
  Vector energies = Vector::Zero(traces.cols());
  const bool loaded = this->loads() > 0;  // BLAS does not take empty blocks
  Eigen::Map<Matrix> relative = work.relative.shaped(rows(), 1);
  Eigen::Map<Matrix> of_loads = work.of_loads.shaped(this->loads(), 1);
  for (Index column = 0; column < traces.cols(); ++column) {
    if (rows() > 0) {
      relative.col(0) = traces.col(column);
      if (loaded) {
        relative.col(0).noalias() -= offset_traces_ * amplitudes.col(column);
      }
      energies(column) += relative.col(0).cwiseProduct(forces.col(column)).dot(weights_);
    }
    if (loaded) {
      of_loads.col(0).noalias() = loads.work_loads * amplitudes.col(column);
      if (rows() > 0) {
        of_loads.col(0).noalias() += loads.work_traces.transpose() * data.col(column);
      }
      energies(column) += of_loads.col(0).dot(amplitudes.col(column));
    }
    if (loads.jump_loads.size() > 0) {
      of_loads.col(0).noalias() = loads.jump_loads * amplitudes.col(column);
      if (rows() > 0) {
        of_loads.col(0).noalias() += loads.jump_traces.transpose() * data.col(column);
      }
      // neither jumps that strain nothing nor prestress that is no answer's may be its size
      energies(column) += std::min(of_loads.col(0).dot(amplitudes.col(column)), 0.0);
    }
  }
  return energies;
}

}  // namespace latin::substructure
