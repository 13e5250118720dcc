#include "algebra/supernodes.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <utility>
#include <vector>

#include "algebra/lapack.hpp"
#include "common/threads.hpp"
#include "latin/common/interrupt.hpp"

namespace latin::algebra {
namespace {

using Offset = std::ptrdiff_t;

/// Columns of an update that are formed at once.
constexpr Offset chunk = 256;
/// Operations of a supernode below which threads cost more than they save.
constexpr double worth_threads = 2e7;
/// What the busiest thread may have more than its share before subtrees are divided.
constexpr double uneven = 1.1;

/// What a thread works with.
template <class Int>
struct Work {
  std::vector<Int> place;  ///< of a row in the supernode that is updated
  std::vector<double> product;
};

/// Supernodes that are waiting for a later one that they update, as a list.
constexpr std::int64_t nobody = -1;

template <class Int>
class LeftLooking {
 public:
  LeftLooking(const Supernodes<Int>& factor, const LowerColumns<Int>& matrix, std::size_t stop)
      : factor_(factor),
        matrix_(matrix),
        stop_(static_cast<Offset>(stop)),
        owner_(factor.size),
        at_(factor.count, 0),
        first_(factor.count, nobody),
        next_(factor.count, nobody) {
    for (std::size_t s = 0; s < factor.count; ++s) {
      std::fill(owner_.begin() + begin(s), owner_.begin() + begin(s + 1), static_cast<Int>(s));
    }
  }

  void run() {
    const int threads = threads_of_algebra();
    if (threads < 2) {
      std::vector<std::size_t> all(factor_.count);
      std::iota(all.begin(), all.end(), std::size_t{0});
      static_cast<void>(eliminate_tree(all, 0));
      return;
    }
    const SerialAlgebra
        one;  // its own threads would wait between its calls, and take time from these
    const Forest forest = divide(threads);
    std::vector<std::size_t> order(forest.trees.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::vector<std::vector<std::size_t>> left(order.size());
    side_by_side(order, [&](std::size_t tree) {
      left[tree] = eliminate_tree(forest.trees[tree], static_cast<Int>(tree) + 1, forest.of.data());
    });
    // those above: each is updated in stripes of its rows, so that no two threads write to one number
    std::vector<std::vector<std::size_t>> waiting(factor_.count);
    for (const std::vector<std::size_t>& each : left) {
      for (const std::size_t d : each) {
        waiting[target(d)].push_back(d);
      }
    }
    Work<Int> shared{std::vector<Int>(factor_.size), {}};
    for (const std::size_t s : forest.above) {
      assemble(s, shared.place);
      std::vector<std::size_t>& sources = waiting[s];
      std::ranges::sort(sources);
      update_by_all(s, sources, shared, threads);
      for (const std::size_t d : sources) {
        advance(d, s);
        if (at_[d] < height(d)) {
          waiting[target(d)].push_back(d);
        }
      }
      sources = {};
      eliminate_by_all(s, threads);
      at_[s] = width(s);
      if (at_[s] < height(s) && eliminated(s) > 0) {
        waiting[target(s)].push_back(s);
      }
    }
  }

 private:
  /// Subtrees for one thread each, with their supernodes in ascending order, and those above all of them.
  struct Forest {
    std::vector<std::vector<std::size_t>> trees;
    std::vector<std::size_t> above;
    std::vector<Int> of;  ///< number of its tree, from 1, of every supernode; 0: above
  };

  [[nodiscard]] Offset begin(std::size_t s) const { return factor_.first_column[s]; }
  [[nodiscard]] Offset width(std::size_t s) const { return begin(s + 1) - begin(s); }
  [[nodiscard]] Offset height(std::size_t s) const {
    return static_cast<Offset>(factor_.first_row[s + 1]) - factor_.first_row[s];
  }
  [[nodiscard]] Offset eliminated(std::size_t s) const {
    return std::clamp(stop_ - begin(s), Offset{0}, width(s));
  }
  [[nodiscard]] const Int* rows(std::size_t s) const { return factor_.rows + factor_.first_row[s]; }
  [[nodiscard]] double* values(std::size_t s) const {
    return factor_.values + factor_.first_value[s];
  }
  /// The supernode that one updates next.
  [[nodiscard]] std::size_t target(std::size_t d) const {
    return static_cast<std::size_t>(owner_[static_cast<std::size_t>(rows(d)[at_[d]])]);
  }
  void advance(std::size_t d, std::size_t s) {
    const Int* const own = rows(d);
    at_[d] = std::lower_bound(own + at_[d], own + height(d), factor_.first_column[s + 1]) - own;
  }

  /// Subtrees whose work can be shared out evenly.
  [[nodiscard]] Forest divide(int threads) const {
    const std::size_t count = factor_.count;
    std::vector<double> work(count, 0.0);
    std::vector<std::vector<std::size_t>> children(count + 1);  // the last: of nobody
    for (std::size_t d = 0; d < count; ++d) {
      const auto e = static_cast<double>(eliminated(d));
      work[d] += e * e * static_cast<double>(height(d));
      const Int* const own = rows(d);
      std::size_t parent = count;
      for (Offset at = width(d); at < height(d);) {
        const auto s = static_cast<std::size_t>(owner_[static_cast<std::size_t>(own[at])]);
        parent = std::min(parent, s);
        const Offset end =
            std::lower_bound(own + at, own + height(d), factor_.first_column[s + 1]) - own;
        work[s] += 2.0 * e * static_cast<double>(end - at) * static_cast<double>(height(d) - at);
        at = end;
      }
      children[parent].push_back(d);
    }
    for (std::size_t s = 0; s < count;
         ++s) {  // children before their parents: of the whole subtree
      for (const std::size_t child : children[s]) {
        work[s] += work[child];
      }
    }
    std::vector<std::size_t> roots = children[count];
    const auto lighter = [&work](std::size_t a, std::size_t b) {
      return std::pair(work[a], a) < std::pair(work[b], b);
    };
    std::ranges::make_heap(roots, lighter);
    const auto is_even = [&] {
      std::vector<double> sizes;
      sizes.reserve(roots.size());
      for (const std::size_t root : roots) {
        sizes.push_back(work[root]);
      }
      std::ranges::sort(sizes, std::greater<>());
      std::vector<double> of_thread(static_cast<std::size_t>(threads), 0.0);
      for (const double size : sizes) {
        *std::ranges::min_element(of_thread) += size;
      }
      const double sum = std::accumulate(sizes.begin(), sizes.end(), 0.0);
      return std::ranges::max(of_thread) * threads <= uneven * sum;
    };
    Forest forest;
    forest.of.assign(count, 0);
    std::vector<char> is_above(count, 0);
    while (!roots.empty() && work[roots.front()] > worth_threads && !is_even()) {
      std::ranges::pop_heap(roots, lighter);
      const std::size_t divided = roots.back();
      roots.pop_back();
      is_above[divided] = 1;
      for (const std::size_t child : children[divided]) {
        roots.push_back(child);
        std::ranges::push_heap(roots, lighter);
      }
    }
    std::ranges::sort(roots, std::not_fn(lighter));  // the largest first
    for (std::size_t tree = 0; tree < roots.size(); ++tree) {
      forest.of[roots[tree]] = static_cast<Int>(tree) + 1;
    }
    for (std::size_t s = count; s-- > 0;) {
      if (is_above[s] == 0) {
        for (const std::size_t child : children[s]) {
          forest.of[child] = forest.of[s];
        }
      }
    }
    forest.trees.resize(roots.size());
    for (std::size_t s = 0; s < count; ++s) {
      if (is_above[s] != 0) {
        forest.above.push_back(s);
      } else {
        forest.trees[static_cast<std::size_t>(forest.of[s]) - 1].push_back(s);
      }
    }
    return forest;
  }

  /// Supernodes of one subtree.
  /// @param of the tree of every supernode; null: there is one
  /// @return those that update others outside of it
  std::vector<std::size_t> eliminate_tree(const std::vector<std::size_t>& tree, Int number,
                                          const Int* of = nullptr) {
    Work<Int> work{std::vector<Int>(factor_.size), {}};
    std::vector<std::size_t> left;
    const auto wait = [&](std::size_t d) {
      if (at_[d] >= height(d) || eliminated(d) == 0) {
        return;
      }
      const std::size_t s = target(d);
      if (of != nullptr && of[s] != number) {
        left.push_back(d);
        return;
      }
      next_[d] = std::exchange(first_[s], static_cast<std::int64_t>(d));
    };
    for (const std::size_t s : tree) {
      stop_if_wanted();
      assemble(s, work.place);
      for (std::int64_t d = first_[s]; d != nobody;) {
        const auto source = static_cast<std::size_t>(d);
        d = next_[source];
        update(s, source, 0, height(s), work.place, work.product);
        advance(source, s);
        wait(source);
      }
      eliminate(s);
      at_[s] = width(s);
      wait(s);
    }
    return left;
  }

  /// The entries of the matrix in a supernode.
  void assemble(std::size_t s, std::vector<Int>& place) const {
    const Offset high = height(s);
    double* const out = values(s);
    const Int* const own = rows(s);
    for (Offset i = 0; i < high; ++i) {
      place[static_cast<std::size_t>(own[i])] = static_cast<Int>(i);
    }
    for (Offset column = 0; column < width(s); ++column) {
      double* const of_column = out + column * high;
      // what is above the diagonal is not touched: of large supernodes its memory is never taken
      std::fill(of_column + column, of_column + high, 0.0);
      const Offset j = begin(s) + column;
      for (Offset at = matrix_.first[j]; at < matrix_.first[j + 1]; ++at) {
        of_column[place[static_cast<std::size_t>(matrix_.rows[at])]] += matrix_.values[at];
      }
    }
  }

  /// What an earlier supernode takes from rows [low, high) of another.
  void update(std::size_t s, std::size_t source, Offset low, Offset high,
              const std::vector<Int>& place, std::vector<double>& product) const {
    const Int* const own = rows(source);
    const Offset tall = height(source);
    const Int* const end = own + tall;
    const int depth = static_cast<int>(eliminated(source));
    const Offset columns =
        std::lower_bound(own + at_[source], end, factor_.first_column[s + 1]) - own;
    const Offset from = std::lower_bound(own + at_[source], end, rows(s)[low]) - own;
    const Offset to =
        high == height(s) ? tall : std::lower_bound(own + from, end, rows(s)[high]) - own;
    const double* const of_source = values(source);
    double* const out = values(s);
    const int stride = static_cast<int>(tall);
    for (Offset column = at_[source]; column < columns && column < to; column += chunk) {
      const Offset top = std::max(from, column);
      const int m = static_cast<int>(to - top);
      const int n = static_cast<int>(std::min(chunk, columns - column));
      if (m <= 0) {
        continue;
      }
      const auto needed = static_cast<std::size_t>(m) * static_cast<std::size_t>(n);
      if (product.size() < needed) {
        product.resize(needed);
      }
      constexpr double one = 1.0;
      constexpr double zero = 0.0;
      dgemm_("N", "T", &m, &n, &depth, &one, of_source + top, &stride, of_source + column, &stride,
             &zero, product.data(), &m);
      for (Offset j = 0; j < n; ++j) {
        double* const of_column =
            out + height(s) * (static_cast<Offset>(own[column + j]) - begin(s));
        const double* const term = product.data() + j * m;
        for (Offset i = std::max(Offset{0}, column + j - top); i < m; ++i) {
          of_column[place[static_cast<std::size_t>(own[top + i])]] -= term[i];
        }
      }
    }
  }

  /// The same of all that wait for it, by all threads.
  void update_by_all(std::size_t s, const std::vector<std::size_t>& sources, Work<Int>& shared,
                     int threads) const {
    double work = 0.0;
    for (const std::size_t d : sources) {
      work += 2.0 * static_cast<double>(eliminated(d)) * static_cast<double>(height(d) - at_[d]) *
              static_cast<double>(std::min(width(s), height(d) - at_[d]));
    }
    if (work < worth_threads) {
      for (const std::size_t d : sources) {
        update(s, d, 0, height(s), shared.place, shared.product);
      }
      return;
    }
    in_stripes(height(s), width(s), threads, [&](Offset low, Offset high) {
      std::vector<double> product;
      for (const std::size_t d : sources) {
        update(s, d, low, high, shared.place, product);
      }
    });
  }

  /// Call `work` of ranges of the rows of a trapezoid, whose triangle is at the top, on all threads.
  template <class OfRows>
  static void in_stripes(Offset rows, Offset columns, int threads, const OfRows& work) {
    const auto stripes = 4 * static_cast<std::size_t>(threads);
    const auto wide = static_cast<double>(columns);
    const double all = wide * (static_cast<double>(rows) - 0.5 * wide);
    std::vector<Offset> cuts(stripes + 1, 0);
    for (std::size_t k = 1; k < stripes; ++k) {  // as many numbers in each
      const double numbers = all * static_cast<double>(k) / static_cast<double>(stripes);
      const double row = numbers <= 0.5 * wide * wide ? std::sqrt(2.0 * numbers)
                                                      : (numbers + 0.5 * wide * wide) / wide;
      cuts[k] = std::clamp(static_cast<Offset>(row), cuts[k - 1], rows);
    }
    cuts.back() = rows;
    std::vector<std::size_t> order(stripes);
    std::iota(order.rbegin(), order.rend(), std::size_t{0});
    side_by_side(order, [&](std::size_t k) {
      if (cuts[k] < cuts[k + 1]) {
        work(cuts[k], cuts[k + 1]);
      }
    });
  }

  /// As eliminate(), panel by panel.
  void eliminate_by_all(std::size_t s, int threads) const {
    const Offset own = eliminated(s);
    const Offset high = height(s);
    const double work =
        static_cast<double>(own) * static_cast<double>(own) * static_cast<double>(high);
    if (work < worth_threads) {
      eliminate(s);
      return;
    }
    constexpr double one = 1.0;
    constexpr double minus = -1.0;
    double* const out = values(s);
    const auto stride = static_cast<int>(high);
    const auto at = [out, high](Offset row, Offset column) { return out + row + column * high; };
    for (Offset column = 0; column < own; column += chunk) {
      const auto wide = static_cast<int>(std::min(chunk, own - column));
      factorise_diagonal(s, column, wide);
      const Offset next = column + wide;
      in_stripes(high - next, 1, threads, [&](Offset low, Offset end) {
        const auto m = static_cast<int>(end - low);
        dtrsm_("R", "L", "T", "N", &m, &wide, &one, at(column, column), &stride,
               at(next + low, column), &stride);
      });
      in_stripes(high - next, width(s) - next, threads, [&](Offset low, Offset end) {
        const auto m = static_cast<int>(end - low);
        const auto n = static_cast<int>(std::min(end, width(s) - next));
        if (n > 0) {
          dgemm_("N", "T", &m, &n, &wide, &minus, at(next + low, column), &stride, at(next, column),
                 &stride, &one, at(next + low, next), &stride);
        }
      });
    }
  }

  void factorise_diagonal(std::size_t s, Offset column, int wide) const {
    const auto stride = static_cast<int>(height(s));
    int info = 0;
    dpotrf_("L", &wide, values(s) + column * (height(s) + 1), &stride, &info);
    if (info != 0) {
      throw NotPositive{static_cast<std::size_t>(begin(s) + column + info - 1)};
    }
  }

  /// L of a supernode that nothing updates any more.
  void eliminate(std::size_t s) const {
    const auto own = static_cast<int>(eliminated(s));
    if (own == 0) {
      return;
    }
    double* const out = values(s);
    const auto high = static_cast<int>(height(s));
    factorise_diagonal(s, 0, own);
    constexpr double one = 1.0;
    constexpr double minus = -1.0;
    const int below = high - own;
    if (below > 0) {
      dtrsm_("R", "L", "T", "N", &below, &own, &one, out, &high, out + own, &high);
    }
    for (Offset column = own; column < width(s); column += chunk) {  // of one that is kept in part
      const auto n = static_cast<int>(std::min(chunk, width(s) - column));
      const int m = high - static_cast<int>(column);
      dgemm_("N", "T", &m, &n, &own, &minus, out + column, &high, out + column, &high, &one,
             out + column + column * static_cast<Offset>(high), &high);
    }
  }

  const Supernodes<Int>& factor_;
  const LowerColumns<Int>& matrix_;
  Offset stop_;
  std::vector<Int> owner_;           ///< supernode of a column
  std::vector<Offset> at_;           ///< row of a supernode that comes next
  std::vector<std::int64_t> first_;  ///< that waits for a supernode
  std::vector<std::int64_t> next_;   ///< that waits for the same
};

}  // namespace

void factorise_supernodes(const Supernodes<std::int32_t>& factor,
                          const LowerColumns<std::int32_t>& matrix, std::size_t stop) {
  LeftLooking<std::int32_t>(factor, matrix, stop).run();
}

void factorise_supernodes(const Supernodes<std::int64_t>& factor,
                          const LowerColumns<std::int64_t>& matrix, std::size_t stop) {
  LeftLooking<std::int64_t>(factor, matrix, stop).run();
}

}  // namespace latin::algebra
