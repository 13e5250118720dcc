#include "stochastic/quadrature.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "latin/common/error.hpp"
#include "stochastic/multi_index.hpp"

namespace latin::stochastic {

namespace {

void check_size(double points, Index dimension, double limit, const std::string& what) {
  const double bytes = points * (static_cast<double>(dimension) + 1.0) * sizeof(double);
  if ((limit > 0.0 && bytes > limit) || points > 2147483647.0) {
    throw MemoryLimitError(what + " would have " + std::to_string(points) + " points and take " +
                           std::to_string(bytes / 1e9) + " GB, against a limit of " +
                           std::to_string(limit / 1e9) +
                           " GB: take fewer points, or a sparse rule");
  }
}

}  // namespace

Rule tensor_gauss(const std::vector<Germ>& germs, const std::vector<Index>& counts,
                  double memory_limit) {
  const auto dimension = static_cast<Index>(germs.size());
  if (counts.size() != germs.size()) {
    throw InputError("a tensor rule in " + std::to_string(germs.size()) +
                     " variables needs as many numbers of points; got " +
                     std::to_string(counts.size()));
  }
  double points = 1.0;
  for (const Index count : counts) {
    points *= static_cast<double>(std::max<Index>(count, 1));  // a count < 1 is refused below
  }
  check_size(points, dimension, memory_limit, "a tensor Gauss rule");
  Rule rule{Matrix(static_cast<Index>(points), dimension),
            Vector::Ones(static_cast<Index>(points))};
  Index repeat = rule.weights.size();
  for (Index l = 0; l < dimension; ++l) {
    const Index count = counts[static_cast<std::size_t>(l)];
    const Rule line = germs[static_cast<std::size_t>(l)].gauss(count);
    repeat /= count;
    for (Index s = 0; s < rule.weights.size(); ++s) {
      const Index k = (s / repeat) % count;
      rule.points(s, l) = line.points(k, 0);
      rule.weights(s) *= line.weights(k);
    }
  }
  return rule;
}

Rule smolyak(const std::vector<Germ>& germs, Index level, double memory_limit) {
  if (level < 0) {
    throw InputError("sparse quadrature: level " + std::to_string(level) + " must be >= 0");
  }
  const auto dimension = static_cast<Index>(germs.size());
  // lines[l][k]: rule of level k; a germ with few atoms is integrated exactly by all of them
  std::vector<std::vector<Rule>> lines;
  for (const Germ& germ : germs) {
    std::vector<Rule> rules;
    for (Index k = 0; k <= level; ++k) {
      rules.push_back(germ.gauss_exact(2 * k + 1));
      Matrix& x = rules.back().points;
      // symmetric germs share their centre exactly, so that it can be merged
      const double spread = std::max(x.maxCoeff() - x.minCoeff(), 1e-300);
      x = (x.array().abs() < 1e-14 * spread).select(0.0, x);
    }
    lines.push_back(std::move(rules));
  }
  IndexRequest request{IndexShape::total, dimension, level, 1.0, {}, 0, {}, 0.0, memory_limit};
  const MultiIndexSet levels(request);
  std::map<std::vector<double>, double> merged;
  std::vector<double> point(static_cast<std::size_t>(dimension));
  for (Index i = 0; i < levels.size(); ++i) {
    const auto index = levels[i];
    Index sum = 0;
    for (const int k : index) {
      sum += k;
    }
    const Index missing = level - sum;
    if (missing > dimension - 1 && !(dimension == 0)) {
      continue;
    }
    double factor = missing % 2 == 0 ? 1.0 : -1.0;
    for (Index k = 0; k < missing; ++k) {  // binomial(dimension - 1, missing)
      factor *= static_cast<double>(dimension - 1 - k) / static_cast<double>(k + 1);
    }
    Index points = 1;
    for (std::size_t l = 0; l < germs.size(); ++l) {
      points *= lines[l][static_cast<std::size_t>(index[l])].weights.size();
    }
    check_size(static_cast<double>(merged.size()) + static_cast<double>(points), dimension,
               memory_limit, "a sparse rule");
    for (Index s = 0; s < points; ++s) {
      Index rest = s;
      double weight = factor;
      for (std::size_t l = 0; l < germs.size(); ++l) {
        const Rule& line = lines[l][static_cast<std::size_t>(index[l])];
        const Index k = rest % line.weights.size();
        rest /= line.weights.size();
        point[l] = line.points(k, 0);
        weight *= line.weights(k);
      }
      merged[point] += weight;
    }
  }
  Rule rule{Matrix(static_cast<Index>(merged.size()), dimension),
            Vector(static_cast<Index>(merged.size()))};
  Index row = 0;
  for (const auto& [where, weight] : merged) {
    for (Index l = 0; l < dimension; ++l) {
      rule.points(row, l) = where[static_cast<std::size_t>(l)];
    }
    rule.weights(row++) = weight;
  }
  return rule;
}

}  // namespace latin::stochastic
