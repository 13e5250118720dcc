#pragma once

#include <vector>

#include "latin/common/types.hpp"
#include "mortar/face.hpp"

namespace latin::mortar {

/// Points (q, 1 or 2) and weights (q) of a rule on the reference interval or triangle.
struct Rule {
  Matrix points;
  Vector weights;
  bool around = false;  ///< the faces are turned about the axis x = 0: integrals over 2 pi x ds
};

/// Which facets count as opposite each other.
struct Nearness {
  Vector first;    ///< largest distance from each facet of side 1, length
  Vector second;   ///< the same of side 2; of a pair the larger one holds
  double opposed;  ///< the product of the unit normals is below this
};

/// Integrals over what is common to the facets of two faces, by facets of side 1.
///
/// chi: multiplier functions on the facets of side 1; N_1, N_2: shape functions. All arrays are row-major.
struct Overlap {
  std::vector<double> whole;       ///< (n1) area of the polygons of the facets
  std::vector<double> covered;     ///< (n1) how much of it is covered
  std::vector<double> mean;        ///< (n1, chi) int chi
  std::vector<double> mass;        ///< (n1, chi, chi) int chi chi
  std::vector<double> own;         ///< (n1, chi, N_1) int chi N_1
  std::vector<double> own_normal;  ///< (n1, chi, N_1, 3) int chi N_1 n_1; empty if side 1 is plane
  std::vector<double> place;       ///< (n1, chi, 3) int chi x_1
  std::vector<double> normal;      ///< (n1, chi, 3) int chi n_1
  std::vector<double> offset;      ///< (n1, chi, 3) int chi (x_2 - x_1)
  std::vector<double> gap;         ///< (n1, chi) int chi (x_2 - x_1) . n_1
  std::vector<Index> first;        ///< (pairs) facets of side 1
  std::vector<Index> second;       ///< (pairs) facets of side 2
  std::vector<double> area;        ///< (pairs) area of the polygons
  std::vector<double> other;       ///< (pairs, chi, N_2) int chi N_2
  std::vector<double>
      other_normal;              ///< (pairs, chi, N_2, 3) int chi N_2 n_1; empty if side 1 is plane
  std::vector<double> distance;  ///< (pairs) largest |x_2 - x_1|
  double farthest =
      0.0;  ///< largest distance of pairs that were left out for it; 0: there are none
};

/// Integrate over the intersections of two faces.
///
/// Facets meet in the plane of those of side 1, as flat polygons; curved facets are cut into flat ones first.
/// Points of the intersections are put back onto both facets: by its map on side 1, along the plane's normal
/// on side 2. Exact for plane faces if the rule is.
/// @param multipliers chi; one set of coefficients, the same for all facets
/// Several threads share the work as in in_lanes(); the result does not depend on their number.
/// @throws InputError on shapes that do not fit
[[nodiscard]] Overlap integrate(const Face& first, const Face& second, const Functions& multipliers,
                                const Rule& rule, const Nearness& near);

}  // namespace latin::mortar
