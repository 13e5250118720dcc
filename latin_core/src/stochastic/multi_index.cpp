#include "stochastic/multi_index.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>

#include "latin/common/error.hpp"

namespace latin::stochastic {

namespace {

/// Slack of the comparison with p: degrees are integers, weights and roots are rounded.
constexpr double slack = 1e-10;

/// Whether a stands before b.
bool graded_less(std::span<const int> a, std::span<const int> b) {
  const int sum_a = std::accumulate(a.begin(), a.end(), 0);
  const int sum_b = std::accumulate(b.begin(), b.end(), 0);
  if (sum_a != sum_b) {
    return sum_a < sum_b;
  }
  return std::lexicographical_compare(b.begin(), b.end(), a.begin(), a.end());
}

void check(const IndexRequest& r) {
  if (r.order < 0) {
    throw InputError("chaos order " + std::to_string(r.order) + ": an order is >= 0");
  }
  if (r.dimension < 0 || r.interaction < 0) {
    throw InputError("number of variables " + std::to_string(r.dimension) +
                     " and interaction limit " + std::to_string(r.interaction) + " must be >= 0");
  }
  if (r.shape == IndexShape::hyperbolic && !(r.q > 0.0 && r.q <= 1.0)) {
    throw InputError("hyperbolic index set: q = " + std::to_string(r.q) + " must be in (0, 1]");
  }
  const auto size = static_cast<std::size_t>(r.dimension);
  if (!r.weights.empty() && r.weights.size() != size) {
    throw InputError("index set of " + std::to_string(r.dimension) + " variables: got " +
                     std::to_string(r.weights.size()) + " weights");
  }
  if (!r.caps.empty() && r.caps.size() != size) {
    throw InputError("index set of " + std::to_string(r.dimension) + " variables: got " +
                     std::to_string(r.caps.size()) + " degree limits");
  }
  for (const double weight : r.weights) {
    if (!(weight > 0.0) || !std::isfinite(weight)) {
      throw InputError("index set: weight " + std::to_string(weight) +
                       " must be positive and finite");
    }
  }
}

/// Walks the set by its active variables, so that the cost is that of the set and not of the box.
class Walker {
 public:
  explicit Walker(const IndexRequest& request)
      : request_(request),
        exponent_(request.shape == IndexShape::hyperbolic ? request.q : 1.0),
        budget_(std::pow(static_cast<double>(request.order), exponent_) * (1.0 + slack)),
        depth_(request.interaction == 0 ? request.dimension : request.interaction),
        index_(static_cast<std::size_t>(request.dimension), 0) {}

  /// Calls visit(index) for each index until it returns false.
  template <typename Visit>
  bool walk(Visit&& visit) {
    return visit(std::span<const int>(index_)) && extend(0, 0.0, 0, visit);
  }

 private:
  template <typename Visit>
  bool extend(std::size_t start, double spent, Index active, Visit&& visit) {
    if (active == depth_) {
      return true;
    }
    for (std::size_t l = start; l < index_.size(); ++l) {
      const double weight = request_.weights.empty() ? 1.0 : request_.weights[l];
      const Index cap = request_.caps.empty() ? request_.order * 1'000'000 : request_.caps[l];
      bool going = true;
      for (Index degree = 1; going && degree <= cap; ++degree) {
        const double cost = std::pow(weight * static_cast<double>(degree), exponent_);
        const double total = request_.shape == IndexShape::tensor ? cost : spent + cost;
        if (total > budget_) {
          break;
        }
        index_[l] = static_cast<int>(degree);
        const double carried = request_.shape == IndexShape::tensor ? 0.0 : total;
        going = visit(std::span<const int>(index_)) && extend(l + 1, carried, active + 1, visit);
      }
      index_[l] = 0;
      if (!going) {
        return false;
      }
    }
    return true;
  }

  const IndexRequest& request_;
  double exponent_;
  double budget_;
  Index depth_;
  std::vector<int> index_;
};

/// Exact below 2^53: every partial product is an integer.
double binomial(double n, double k) {
  double result = k > n ? 0.0 : 1.0;
  const double steps = std::min(k, n - k);
  for (double i = 1.0; i <= steps && std::isfinite(result); ++i) {
    result = result * (n - steps + i) / i;
  }
  return result;
}

std::string bytes_text(double bytes) {
  char text[32];
  const bool large = bytes >= 1e9;
  static_cast<void>(std::snprintf(text, sizeof text, "%.3g %s", bytes / (large ? 1e9 : 1e6),
                                  large ? "GB" : "MB"));
  return text;
}

}  // namespace

IndexShape index_shape(const std::string& name) {
  if (name == "total") {
    return IndexShape::total;
  }
  if (name == "tensor") {
    return IndexShape::tensor;
  }
  if (name == "hyperbolic") {
    return IndexShape::hyperbolic;
  }
  throw InputError("unknown index set '" + name + "'; known: hyperbolic, tensor, total");
}

double MultiIndexSet::count(const IndexRequest& request, double stop) {
  check(request);
  if (request.weights.empty() && request.caps.empty() && request.shape != IndexShape::hyperbolic) {
    const auto variables = static_cast<double>(request.dimension);
    const auto order = static_cast<double>(request.order);
    const double depth = request.interaction == 0
                             ? variables
                             : std::min(variables, static_cast<double>(request.interaction));
    if (request.shape == IndexShape::total && depth == variables) {
      return binomial(variables + order, order);
    }
    double sum = 0.0;
    for (double active = 0.0; active <= depth; ++active) {
      sum +=
          binomial(variables, active) *
          (request.shape == IndexShape::total ? binomial(order, active) : std::pow(order, active));
    }
    return sum;
  }
  double number = 0.0;
  Walker(request).walk([&](std::span<const int>) { return ++number <= stop; });
  return number;
}

MultiIndexSet::MultiIndexSet(const IndexRequest& request) {
  const double each = request.bytes_per_index +
                      static_cast<double>(sizeof(int)) * static_cast<double>(request.dimension);
  const double limit = request.memory_limit > 0.0 ? request.memory_limit : HUGE_VAL;
  // a set beyond 2^31 columns could not be a matrix index, whatever the memory
  const double most = std::min(each > 0.0 ? limit / each : HUGE_VAL, 2147483647.0);
  const double number = count(request, most);
  if (number > most) {
    char text[32];
    static_cast<void>(std::snprintf(text, sizeof text, "%.6g", number));
    throw MemoryLimitError("a chaos of order " + std::to_string(request.order) + " in " +
                           std::to_string(request.dimension) + " variables has " + text +
                           " modes or more and needs " + bytes_text(number * each) +
                           " or more, against a "
                           "limit of " +
                           bytes_text(std::min(limit, most * each)) +
                           ": lower the order, limit the interaction, or take a hyperbolic set");
  }
  table_.resize(static_cast<Index>(number), request.dimension);
  Index row = 0;
  Walker(request).walk([&](std::span<const int> index) {
    std::copy(index.begin(), index.end(), table_.data() + row * request.dimension);
    ++row;
    return true;
  });
  *this = MultiIndexSet(std::move(table_));
}

MultiIndexSet::MultiIndexSet(IndexTable rows) {
  if (rows.size() > 0 && rows.minCoeff() < 0) {
    throw InputError("a multi-index has degrees >= 0; the table holds " +
                     std::to_string(rows.minCoeff()));
  }
  std::vector<Index> order(static_cast<std::size_t>(rows.rows()));
  std::iota(order.begin(), order.end(), Index{0});
  const auto width = static_cast<std::size_t>(rows.cols());
  const auto row = [&](Index i) {
    return std::span<const int>(rows.data() + i * rows.cols(), width);
  };
  std::sort(order.begin(), order.end(),
            [&](Index a, Index b) { return graded_less(row(a), row(b)); });
  table_.resize(rows.rows(), rows.cols());
  for (Index i = 0; i < rows.rows(); ++i) {
    table_.row(i) = rows.row(order[static_cast<std::size_t>(i)]);
  }
  if (size() == 0 || (dimension() > 0 && table_.row(0).maxCoeff() != 0)) {
    throw InputError("a set of multi-indices must hold the zero index (the mean)");
  }
  for (Index i = 1; i < size(); ++i) {
    if (!graded_less((*this)[i - 1], (*this)[i])) {
      throw InputError("a set of multi-indices holds one row twice");
    }
  }
}

std::optional<Index> MultiIndexSet::find(std::span<const int> index) const {
  if (static_cast<Index>(index.size()) != dimension()) {
    throw InputError("a multi-index of " + std::to_string(index.size()) +
                     " degrees was looked for in a set of " + std::to_string(dimension()) +
                     " variables");
  }
  Index low = 0;
  Index high = size();
  while (low < high) {
    const Index middle = low + (high - low) / 2;
    if (graded_less((*this)[middle], index)) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  if (low < size() && std::equal(index.begin(), index.end(), (*this)[low].begin())) {
    return low;
  }
  return std::nullopt;
}

}  // namespace latin::stochastic
