#pragma once

#include <array>
#include <deque>
#include <vector>

#include "equilibration/reference_cell.hpp"
#include "latin/common/types.hpp"

namespace latin::equilibration {

/// Straight simplices with a finite element solution; those that a cell of another shape was cut into, too.
struct Cells {
  Matrix vertices;             ///< (d, vertices)
  std::vector<Index> corners;  ///< (cells, d + 1), ascending in each cell
  Matrix stress;               ///< (components, (d + 1) cells) at the corners, linear in between
  Matrix force;                ///< (d, cells) per volume
  std::vector<Matrix> compliance;  ///< (components, components): engineering strains of stresses
  std::vector<Index> material;     ///< (cells,) number of the compliance
  /// (components * pieces * terms, cells) what the stress has beyond, in ReferenceCell::values(); empty: nothing
  Matrix rest;
  /// (d, nodes * cells) by how much more of each node is to be made up by tractions; empty: nothing. Nothing in the sum
  /// over a cell, as force and as moment.
  Matrix shift;
};

/// Facets that belong to one cell. Those that are not named are free of traction.
struct Boundary {
  std::vector<Index> corners;  ///< (n, d) their vertices, ascending in each
  Matrix moments;  ///< (d * facet nodes, n) of the traction with the functions of the facet
  Matrix held;  ///< (d * d, n) projector onto the directions in which a support takes any traction
};

/// A stress in balance with the loads, close to that of a finite element solution: their distance in energy is a strict
/// bound of the error (W. Prager and J. L. Synge; P. Ladeveze and D. Leguillon, SIAM J. Numer. Anal. 20 (1983) 485).
///
/// Tractions are first those of element equilibration: their moments with the functions of each node make up what its
/// cells lack, with the least change of the mean of both sides. Then the stress of each cell has the least energy that
/// its tractions leave it, and sweeps over stars (the facets of a vertex in 2D, of an edge in 3D) change tractions to
/// those of the least energy that keep force and moment of every cell. In balance after each step.
class Equilibration {
 public:
  /// @throws InputError on sizes that do not fit, or a facet of more than two cells
  Equilibration(Cells cells, const Boundary& boundary);

  [[nodiscard]] Index cells() const { return count_; }
  /// Largest residual of a node's balance, relative to the largest of its terms: what the solution itself lacks.
  [[nodiscard]] double defect() const { return defect_; }
  /// Sweep over the stars, until one takes less than a share of the energy, and the energies (cells,) of the distance in
  /// each cell.
  [[nodiscard]] const Vector& relax(int most_sweeps, double enough);
  /// The stress in balance (components, m) in a cell at points (d, m) of the unit simplex of its corners.
  [[nodiscard]] Matrix stress(Index cell, ConstMatrixRef points) const;

 private:
  /// Cells on both sides of a facet and its number in each; -1: none.
  struct Facet {
    std::array<Index, 2> cells{-1, -1};
    std::array<Index, 2> numbers{-1, -1};
    bool changes = false;  ///< whether its traction is to be found, in every direction
  };
  /// Stars that are swept together, with the energies of their cells.
  struct Patch {
    std::size_t begin = 0;
    std::size_t end = 0;
    std::vector<Index> cells;
    std::vector<Matrix> energies;
    std::vector<Index> place;  ///< (all cells,) in these; -1: none
  };
  struct NodeSystem;
  struct Star;
  [[nodiscard]] Matrix edges(Index cell) const;
  [[nodiscard]] Matrix gradients(Index cell) const;
  [[nodiscard]] Matrix own_moments(Index cell, Index facet) const;
  [[nodiscard]] Matrix lacking(Index cell) const;
  [[nodiscard]] Vector data(Index cell) const;
  [[nodiscard]] Vector rest(Index cell) const;
  [[nodiscard]] Matrix reference_compliance(Index cell) const;
  [[nodiscard]] double sign(Index cell, Index number) const {
    return facets_[facet_of_[cell * corners_ + number]].cells[0] == cell ? 1.0 : -1.0;
  }
  [[nodiscard]] Vector softness_of_facets() const;
  void find_facets();
  [[nodiscard]] std::vector<Index> corners_of(const Facet& facet) const;
  [[nodiscard]] std::vector<Index> named_facets(const Boundary& boundary) const;
  void find_nodes();
  void start(const Boundary& boundary, const std::vector<Index>& named);
  void balance(const Boundary& boundary, const std::vector<Index>& named);
  void find_stars();
  void condense(const std::vector<Index>& cells, std::vector<Matrix>& energies);
  struct Condensed;
  [[nodiscard]] Condensed condensed(Index cell, ConstMatrixRef sum) const;
  void take(Index cell, const Condensed& own, Matrix& by_moments);
  void sweep(Patch& patch, int most_sweeps, double enough);
  [[nodiscard]] std::vector<std::vector<std::size_t>> coloured(const std::deque<Star>& stars) const;
  void relax_star(const Star& star, const Patch& patch);

  Cells cells_;
  const ReferenceCell& reference_;
  Index dim_;
  Index corners_;  ///< of a cell, and its facets
  Index count_;
  Index of_facet_;  ///< moments of a facet: d * facet nodes
  std::vector<Facet> facets_;
  std::vector<Index> facet_of_;  ///< (cells, d + 1)
  std::vector<Index> node_of_;   ///< (cells, nodes)
  Index nodes_ = 0;
  Matrix moments_;  ///< (d * facet nodes, facets) out of the first cell
  Matrix places_;   ///< (d * facet nodes, facets) of the nodes, in lengths of a cell
  std::vector<std::vector<Index>> stars_;
  Matrix slopes_;  ///< (facets * d * facet nodes, cells) of half the energy by the moments
  Vector energies_;
  std::vector<char> condensed_;  ///< no bits: several threads write
  double defect_ = 0.0;
};

}  // namespace latin::equilibration
