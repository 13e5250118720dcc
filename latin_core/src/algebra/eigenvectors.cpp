#include "algebra/eigenvectors.hpp"

#include <cstddef>
#include <vector>

#include "algebra/lapack.hpp"

namespace latin::algebra {

Vector eigenvectors_in_place(Matrix& matrix) {
  const int n = static_cast<int>(matrix.rows());
  Vector values(n);
  if (n == 0) {
    return values;
  }
  int info = 0;
  int most = -1;
  int most_integers = -1;
  double wanted = 0.0;
  int wanted_integers = 0;
  dsyevd_("V", "L", &n, matrix.data(), &n, values.data(), &wanted, &most, &wanted_integers,
          &most_integers, &info);
  most = static_cast<int>(wanted);
  most_integers = wanted_integers;
  std::vector<double> work(static_cast<std::size_t>(most));
  std::vector<int> integers(static_cast<std::size_t>(most_integers));
  dsyevd_("V", "L", &n, matrix.data(), &n, values.data(), work.data(), &most, integers.data(),
          &most_integers, &info);
  return info == 0 ? values : Vector();
}

}  // namespace latin::algebra
