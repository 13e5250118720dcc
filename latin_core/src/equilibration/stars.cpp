#include "equilibration/equilibration.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <utility>

#include "algebra/lapack.hpp"
#include "common/threads.hpp"
#include "latin/common/interrupt.hpp"

namespace latin::equilibration {
namespace {

/// Bytes of the energies of cells and of factors of stars that are kept at once.
constexpr double most_bytes = 5e8;
/// Cells whose energies are made by one product, stars that one thread relaxes at once.
constexpr std::size_t together = 16;

/// About how many numbers cells or stars take, as in_lanes() counts.
double work_of(std::size_t count) { return 1e4 * static_cast<double>(count); }

}  // namespace

/// Facets around each vertex in 2D, each edge in 3D, in the order of their cells.
void Equilibration::find_stars() {
  std::map<std::pair<Index, Index>, std::vector<Index>> found;
  for (std::size_t f = 0; f < facets_.size(); ++f) {
    if (!facets_[f].changes) {
      continue;
    }
    const std::vector<Index> on = corners_of(facets_[f]);
    for (std::size_t i = 0; i < on.size(); ++i) {
      if (dim_ == 2) {
        found[{on[i], -1}].push_back(static_cast<Index>(f));
      }
      for (std::size_t j = i + 1; dim_ == 3 && j < on.size(); ++j) {
        found[{on[i], on[j]}].push_back(static_cast<Index>(f));
      }
    }
  }
  for (auto& [at, facets] : found) {
    stars_.push_back(std::move(facets));
  }
  std::ranges::stable_sort(stars_, {}, [this](const auto& star) {
    Index first = count_;
    for (const Index f : star) {
      first = std::min(first, facets_[f].cells[0]);
    }
    return first;
  });
}

/// data . energy data - 2 right . data + least of a cell, by data on the reference cell.
struct Equilibration::Condensed {
  Matrix energy;
  Vector right;
  double least;
};

/// Energies of cells by the moments of their facets, out of the first cell of each, where stresses have the least
/// energy; and those of the distance, when it is first asked for.
void Equilibration::condense(const std::vector<Index>& cells, std::vector<Matrix>& energies) {
  energies.resize(cells.size());
  struct Own {
    Matrix compliances;
    Matrix sums;
  };
  PerLane<Own> lanes;
  const Index columns = reference_.basis().cols();
  const Index n = reference_.components();
  const Matrix& products = reference_.products();
  in_lanes((cells.size() + together - 1) / together, work_of(cells.size()), lanes,
           [&](std::size_t piece, Own& own) {
             const std::size_t first = piece * together;
             const std::size_t some = std::min<std::size_t>(together, cells.size() - first);
             own.compliances.resize(products.cols(), together);
             own.sums.resize(columns * columns, together);
             for (std::size_t k = 0; k < some; ++k) {
               const Matrix compliance = reference_compliance(cells[first + k]);
               Index pair = 0;
               for (Index a = 0; a < n; ++a) {
                 for (Index b = a; b < n; ++b) {
                   own.compliances(pair++, static_cast<Index>(k)) = compliance(a, b);
                 }
               }
             }
             const auto width = static_cast<Index>(some);
             own.sums.leftCols(width).noalias() = products * own.compliances.leftCols(width);
             for (std::size_t k = 0; k < some; ++k) {
               const Eigen::Map<const Matrix> sum(own.sums.col(static_cast<Index>(k)).data(),
                                                  columns, columns);
               const Index cell = cells[first + k];
               take(cell, condensed(cell, sum), energies[first + k]);
             }
           });
}

/// The least energy of a cell of that of self-stresses and of stresses in balance with its data.
Equilibration::Condensed Equilibration::condensed(Index cell, ConstMatrixRef sum) const {
  const Index free = reference_.self_stresses();
  const Index given = reference_.data();
  Condensed own{sum.bottomRightCorner(given, given), Vector::Zero(given), 0.0};
  Vector along = Vector::Zero(sum.cols());
  if (cells_.rest.size() > 0 && condensed_[cell] == 0) {
    const Index n = reference_.components();
    const Matrix beyond = rest(cell).reshaped(reference_.basis().rows() / n, n);
    const Vector strain = (beyond * reference_compliance(cell)).reshaped();
    along = reference_.basis().transpose() * strain;
    own.right = along.tail(given);
    own.least = strain.dot(beyond.reshaped());
  }
  if (free > 0) {
    const Eigen::LLT<Matrix> factor(sum.topLeftCorner(free, free));
    const Matrix coupled = factor.matrixL().solve(sum.topRightCorner(free, given));
    const Vector best = factor.matrixL().solve(along.head(free));
    own.energy.noalias() -= coupled.transpose() * coupled;
    own.right -= coupled.transpose() * best;
    own.least -= best.squaredNorm();
  }
  return own;
}

/// An energy by data on the reference cell as one by moments of facets; and of the distance, the first time.
void Equilibration::take(Index cell, const Condensed& own, Matrix& by_moments) {
  const Matrix& energy = own.energy;
  const Index nodes = corners_ * of_facet_ / dim_;
  const Matrix inverse = edges(cell).inverse();
  Matrix turned(energy.rows(), corners_ * of_facet_);
  for (Index node = 0; node < nodes; ++node) {
    const double eta = sign(cell, node * dim_ / of_facet_);
    turned.middleCols(node * dim_, dim_).noalias() =
        eta * energy.middleCols(node * dim_, dim_) * inverse;
  }
  if (condensed_[cell] == 0) {
    const Vector known = data(cell);
    energies_(cell) = known.dot(energy * known - 2.0 * own.right) + own.least;
    slopes_.col(cell) = turned.transpose() * known;
    for (Index node = 0; node < nodes; ++node) {
      slopes_.col(cell).segment(node * dim_, dim_) -= sign(cell, node * dim_ / of_facet_) *
                                                      inverse.transpose() *
                                                      own.right.segment(node * dim_, dim_);
    }
    condensed_[cell] = 1;
  }
  by_moments.resize(corners_ * of_facet_, corners_ * of_facet_);
  for (Index node = 0; node < nodes; ++node) {
    const double eta = sign(cell, node * dim_ / of_facet_);
    by_moments.middleRows(node * dim_, dim_).noalias() =
        eta * inverse.transpose() * turned.middleRows(node * dim_, dim_);
  }
}

/// The facets of a star with their cells, and what finds the change of their tractions that takes most of the energy
/// and keeps force and moment of every cell.
struct Equilibration::Star {
  Star(const Equilibration& whole, const std::vector<Index>& changing)
      : of(whole), facets(changing) {
    for (const Index f : facets) {
      for (const Index cell : of.facets_[f].cells) {
        grounded = grounded || cell < 0;
        if (cell >= 0 && std::ranges::find(cells, cell) == cells.end()) {
          cells.push_back(cell);
        }
      }
    }
  }

  [[nodiscard]] Index size() const { return static_cast<Index>(facets.size()) * of.of_facet_; }
  [[nodiscard]] Index motions() const { return of.dim_ == 2 ? 3 : 6; }
  /// Forces and moments that are kept: of the last cell they follow where no support takes a part in them.
  [[nodiscard]] Index kept() const {
    return (static_cast<Index>(cells.size()) - (grounded ? 0 : 1)) * motions();
  }
  /// Number of a facet in a cell; -1: it is none of it.
  [[nodiscard]] Index number(Index f, Index cell) const {
    const Facet& facet = of.facets_[f];
    return facet.cells[0] == cell   ? facet.numbers[0]
           : facet.cells[1] == cell ? facet.numbers[1]
                                    : Index{-1};
  }

  [[nodiscard]] auto lower() const { return root.triangularView<Eigen::Lower>(); }

  /// Force and moment (motions, moments of a facet) of a facet on its first cell.
  [[nodiscard]] Matrix resultants(Index f) const {
    const Vector origin = of.places_.col(facets.front()).head(of.dim_);
    Matrix out = Matrix::Zero(motions(), of.of_facet_);
    for (Index node = 0; node < of.of_facet_ / of.dim_; ++node) {
      const Vector arm = of.places_.col(f).segment(node * of.dim_, of.dim_) - origin;
      auto block = out.middleCols(node * of.dim_, of.dim_);
      block.topRows(of.dim_).setIdentity();
      Index turn = of.dim_;
      for (Index a = 0; a < of.dim_; ++a) {
        for (Index b = a + 1; b < of.dim_; ++b, ++turn) {
          block(turn, a) = -arm(b);
          block(turn, b) = arm(a);
        }
      }
    }
    return out;
  }

  void factorise(const Patch& patch) {
    const Index width = of.of_facet_;
    Matrix matrix = Matrix::Zero(size(), size());
    Matrix balance = Matrix::Zero(kept(), size());
    for (std::size_t i = 0; i < facets.size(); ++i) {
      const auto at = static_cast<Index>(i) * width;
      const Matrix own = resultants(facets[i]);
      for (std::size_t q = 0; q < cells.size(); ++q) {
        const Index one = number(facets[i], cells[q]);
        if (one < 0) {
          continue;
        }
        const Matrix& energy = patch.energies[patch.place[cells[q]]];
        for (std::size_t j = 0; j <= i; ++j) {
          if (const Index other = number(facets[j], cells[q]); other >= 0) {
            matrix.block(at, static_cast<Index>(j) * width, width, width) +=
                energy.block(one * width, other * width, width, width);
          }
        }
        if (const Index row = static_cast<Index>(q) * motions(); row < kept()) {
          balance.block(row, at, motions(), width) =
              of.facets_[facets[i]].cells[0] == cells[q] ? own : Matrix(-own);
        }
      }
    }
    matrix.selfadjointView<Eigen::Lower>().rankUpdate(balance.transpose(),
                                                      matrix.trace() / balance.squaredNorm());
    root = std::move(matrix);
    const auto rows = static_cast<int>(root.rows());
    int info = 0;
    dpotrf_("L", &rows, root.data(), &rows, &info);
    usable = info == 0;
    through = lower().solve(balance.transpose());
    forces.compute(through.transpose() * through);
  }

  /// The change (moments of all facets) of the slopes of now.
  [[nodiscard]] Vector change() const {
    const Index width = of.of_facet_;
    Vector step = Vector::Zero(size());
    for (std::size_t i = 0; i < facets.size(); ++i) {
      for (const Index cell : of.facets_[facets[i]].cells) {
        if (cell >= 0) {
          step.segment(static_cast<Index>(i) * width, width) -=
              of.slopes_.col(cell).segment(number(facets[i], cell) * width, width);
        }
      }
    }
    lower().solveInPlace(step);
    for (int round = 0; round < 2; ++round) {  // the second one takes the rounding of the first
      step -= through * forces.solve(through.transpose() * step);
    }
    lower().adjoint().solveInPlace(step);
    return step;
  }

  const Equilibration& of;
  const std::vector<Index>& facets;
  std::vector<Index> cells;
  bool grounded = false;
  bool usable = false;  ///< a sliver's energies may be rounding
  Matrix root;
  Matrix through;
  Eigen::LDLT<Matrix> forces;
};

const Vector& Equilibration::relax(int most_sweeps, double enough) {
  const SerialAlgebra serial;  // cells and stars are small
  Patch patch;
  patch.place.assign(static_cast<std::size_t>(count_), -1);
  const auto square = [](Index size) { return 8.0 * static_cast<double>(size * size); };
  double bytes = 0.0;
  for (std::size_t star = 0; star < stars_.size(); ++star) {
    bytes += square(static_cast<Index>(stars_[star].size()) * of_facet_);
    for (const Index f : stars_[star]) {
      for (const Index cell : facets_[f].cells) {
        if (cell >= 0 && patch.place[cell] < 0) {
          patch.place[cell] = static_cast<Index>(patch.cells.size());
          patch.cells.push_back(cell);
          bytes += square(corners_ * of_facet_);
        }
      }
    }
    if (bytes > most_bytes || star + 1 == stars_.size()) {
      patch.end = star + 1;
      sweep(patch, most_sweeps, enough);
      bytes = 0.0;
    }
  }
  for (Index cell = 0; cell < count_; ++cell) {  // whose facets all have given tractions
    if (condensed_[cell] == 0) {
      patch.cells.push_back(cell);
    }
  }
  condense(patch.cells, patch.energies);
  return energies_;
}

/// Stars that have no cell in common, so that they may be relaxed side by side, by colours.
std::vector<std::vector<std::size_t>> Equilibration::coloured(const std::deque<Star>& stars) const {
  std::vector<std::vector<std::size_t>> colours;
  std::vector<std::vector<std::size_t>> of_cell(static_cast<std::size_t>(count_));
  for (std::size_t k = 0; k < stars.size(); ++k) {
    std::vector<bool> taken(colours.size() + 1, false);
    for (const Index cell : stars[k].cells) {
      for (const std::size_t colour : of_cell[cell]) {
        taken[colour] = true;
      }
    }
    const auto colour = static_cast<std::size_t>(std::ranges::find(taken, false) - taken.begin());
    if (colour == colours.size()) {
      colours.emplace_back();
    }
    colours[colour].push_back(k);
    for (const Index cell : stars[k].cells) {
      of_cell[cell].push_back(colour);
    }
  }
  return colours;
}

void Equilibration::sweep(Patch& patch, int most_sweeps, double enough) {
  condense(patch.cells, patch.energies);
  std::deque<Star> stars;
  for (std::size_t k = patch.begin; k < patch.end; ++k) {
    stars.emplace_back(*this, stars_[k]);
    if (stars.back().size() <= stars.back().kept()) {
      stars.pop_back();
    }
  }
  in_lanes((stars.size() + together - 1) / together, work_of(stars.size()), [&](std::size_t piece) {
    stop_if_wanted();
    for (std::size_t k = piece * together; k < std::min((piece + 1) * together, stars.size());
         ++k) {
      stars[k].factorise(patch);
    }
  });
  auto colours = coloured(stars);
  const auto left = [&] {
    double sum = 0.0;
    for (const Index cell : patch.cells) {
      sum += energies_(cell);
    }
    return sum;
  };
  double before = left();
  for (int round = 0; round < most_sweeps; ++round) {
    for (const auto& alike : colours) {
      stop_if_wanted();
      in_lanes((alike.size() + together - 1) / together, work_of(alike.size()),
               [&](std::size_t piece) {
                 const std::size_t end = std::min((piece + 1) * together, alike.size());
                 for (std::size_t k = piece * together; k < end; ++k) {
                   relax_star(stars[alike[k]], patch);
                 }
               });
    }
    std::ranges::reverse(colours);
    const double now = left();
    if (now > (1.0 - enough) * before) {
      break;
    }
    before = now;
  }
  for (const Index cell : patch.cells) {
    patch.place[cell] = -1;
  }
  patch.cells.clear();
  patch.begin = patch.end;
}

/// Change the tractions of a star.
void Equilibration::relax_star(const Star& star, const Patch& patch) {
  const Vector change = star.usable ? star.change() : Vector();
  if (change.size() == 0 || !change.allFinite()) {
    return;  // its tractions stay as they are, which are in balance, too
  }
  const auto of_facet = [&](std::size_t i) {
    return change.segment(static_cast<Index>(i) * of_facet_, of_facet_);
  };
  for (std::size_t i = 0; i < star.facets.size(); ++i) {
    moments_.col(star.facets[i]) += of_facet(i);
  }
  Vector both(corners_ * of_facet_);  // slopes before and after
  for (const Index cell : star.cells) {
    const Matrix& energy = patch.energies[patch.place[cell]];
    both = slopes_.col(cell);
    for (std::size_t i = 0; i < star.facets.size(); ++i) {
      if (const Index number = star.number(star.facets[i], cell); number >= 0) {
        slopes_.col(cell).noalias() +=
            energy.middleCols(number * of_facet_, of_facet_) * of_facet(i);
      }
    }
    both += slopes_.col(cell);
    for (std::size_t i = 0; i < star.facets.size(); ++i) {
      if (const Index number = star.number(star.facets[i], cell); number >= 0) {
        energies_(cell) += both.segment(number * of_facet_, of_facet_).dot(of_facet(i));
      }
    }
  }
}

}  // namespace latin::equilibration
