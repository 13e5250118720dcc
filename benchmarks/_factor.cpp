// Numbers of a Cholesky factor by CHOLMOD and by the kernel, after the same analysis: for threads.py.
#include <cholmod.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <numeric>
#include <string>
#include <vector>

#include "latin/algebra/supernodes.hpp"

namespace {

/// Lower triangle by columns: the size, the first place of each column, rows and values in a file.
struct Lower {
  std::vector<std::int32_t> first;
  std::vector<std::int32_t> rows;
  std::vector<double> values;
  [[nodiscard]] std::size_t size() const { return first.size() - 1; }
};

template <class Number>
void read(std::ifstream& file, std::vector<Number>& into, std::size_t count) {
  into.resize(count);
  file.read(reinterpret_cast<char*>(into.data()),
            static_cast<std::streamsize>(count * sizeof(Number)));
}

Lower from_file(const char* path) {
  std::ifstream file(path, std::ios::binary);
  std::vector<std::int64_t> size;
  read(file, size, 1);
  Lower matrix;
  read(file, matrix.first, static_cast<std::size_t>(size[0]) + 1);
  read(file, matrix.rows, static_cast<std::size_t>(matrix.first.back()));
  read(file, matrix.values, matrix.rows.size());
  return matrix;
}

cholmod_sparse view(Lower& matrix) {
  cholmod_sparse seen{};
  seen.nrow = seen.ncol = matrix.size();
  seen.nzmax = matrix.rows.size();
  seen.p = matrix.first.data();
  seen.i = matrix.rows.data();
  seen.x = matrix.values.data();
  seen.stype = -1;
  seen.itype = CHOLMOD_INT;
  seen.xtype = CHOLMOD_REAL;
  seen.dtype = CHOLMOD_DOUBLE;
  seen.packed = 1;
  return seen;
}

Lower in_order(const Lower& matrix, const std::int32_t* order) {
  const std::size_t size = matrix.size();
  std::vector<std::int32_t> place(size);
  for (std::size_t i = 0; i < size; ++i) {
    place[static_cast<std::size_t>(order[i])] = static_cast<std::int32_t>(i);
  }
  Lower moved{std::vector<std::int32_t>(size + 1, 0), matrix.rows, matrix.values};
  const auto each = [&](const auto& visit) {
    for (std::size_t column = 0; column < size; ++column) {
      for (std::int32_t at = matrix.first[column]; at < matrix.first[column + 1]; ++at) {
        const std::int32_t i = place[static_cast<std::size_t>(matrix.rows[at])];
        const std::int32_t j = place[column];
        visit(std::max(i, j), static_cast<std::size_t>(std::min(i, j)), matrix.values[at]);
      }
    }
  };
  each([&](std::int32_t, std::size_t column, double) { ++moved.first[column + 1]; });
  std::partial_sum(moved.first.begin(), moved.first.end(), moved.first.begin());
  std::vector<std::int32_t> next(moved.first.begin(), moved.first.end() - 1);
  each([&](std::int32_t row, std::size_t column, double value) {
    const auto at = static_cast<std::size_t>(next[column]++);
    moved.rows[at] = row;
    moved.values[at] = value;
  });
  return moved;
}

double status(const char* key) {
  std::ifstream file("/proc/self/status");
  for (std::string word; file >> word;) {
    if (word == key) {
      double kilobytes = 0.0;
      file >> kilobytes;
      return 1e-6 * kilobytes;
    }
  }
  return 0.0;
}

double processor_time() {
  rusage used{};
  getrusage(RUSAGE_SELF, &used);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

/// Largest |b - A x| over (|A| |x| + |b|), row by row.
double backward_error(const Lower& matrix, cholmod_factor* factor, cholmod_common* common) {
  const std::size_t size = matrix.size();
  cholmod_dense* b = cholmod_ones(size, 1, CHOLMOD_REAL, common);
  auto* const right = static_cast<double*>(b->x);
  for (std::size_t i = 0; i < size; ++i) {
    right[i] = std::sin(1.0 + 1.234567 * static_cast<double>(i));
  }
  cholmod_dense* found = cholmod_solve(CHOLMOD_A, factor, b, common);
  const auto* const x = static_cast<const double*>(found->x);
  std::vector<long double> left(right, right + size);
  std::vector<long double> sums(size);
  for (std::size_t i = 0; i < size; ++i) {
    sums[i] = std::abs(left[i]);
  }
  const auto take = [&](std::size_t i, std::size_t j, long double value) {
    left[i] -= value * x[j];
    sums[i] += std::abs(value * x[j]);
  };
  for (std::size_t column = 0; column < size; ++column) {
    for (std::int32_t at = matrix.first[column]; at < matrix.first[column + 1]; ++at) {
      const auto row = static_cast<std::size_t>(matrix.rows[at]);
      take(row, column, matrix.values[at]);
      if (row != column) {
        take(column, row, matrix.values[at]);
      }
    }
  }
  long double worst = 0.0L;
  for (std::size_t i = 0; i < size; ++i) {
    worst = std::max(worst, sums[i] > 0.0L ? std::abs(left[i]) / sums[i] : 0.0L);
  }
  cholmod_free_dense(&b, common);
  cholmod_free_dense(&found, common);
  return static_cast<double>(worst);
}

}  // namespace

int main(int count, char** arguments) {
  const Lower given = from_file(arguments[1]);
  const int repeats = count > 2 ? std::stoi(arguments[2]) : 1;
  cholmod_common common{};
  cholmod_start(&common);
  common.print = 0;
  common.supernodal = CHOLMOD_SUPERNODAL;
  common.final_ll = 1;
  std::vector<std::int32_t> order;
  {
    Lower copy = given;
    cholmod_sparse matrix = view(copy);
    cholmod_factor* factor = cholmod_analyze(&matrix, &common);
    const auto* const found = static_cast<const std::int32_t*>(factor->Perm);
    order.assign(found, found + factor->n);
    cholmod_free_factor(&factor, &common);
  }
  Lower moved = in_order(given, order.data());
  cholmod_sparse matrix = view(moved);
  common.nmethods = 1;
  common.method[0].ordering = CHOLMOD_NATURAL;
  common.postorder = 0;
  std::vector<double> numbers[2];
  std::printf("{\"unknowns\": %zu", moved.size());
  for (int way = 0; way < 2; ++way) {  // CHOLMOD, kernel
    double best = 1e300;
    double peak = 0.0;
    double error = 0.0;
    long failed = -1;
    for (int repeat = 0; repeat < repeats; ++repeat) {
      std::ofstream("/proc/self/clear_refs") << "5";
      const double before = status("VmRSS:");
      cholmod_factor* factor = cholmod_analyze(&matrix, &common);
      const double began = processor_time();
      if (way == 0) {
        cholmod_factorize(&matrix, factor, &common);
        failed = common.status == CHOLMOD_NOT_POSDEF ? static_cast<long>(factor->minor) : -1;
      } else {
        cholmod_change_factor(CHOLMOD_REAL, 1, 1, 1, 1, factor, &common);
        const latin::algebra::Supernodes<std::int32_t> nodes{
            factor->n,
            factor->nsuper,
            static_cast<const std::int32_t*>(factor->super),
            static_cast<const std::int32_t*>(factor->pi),
            static_cast<const std::int32_t*>(factor->px),
            static_cast<const std::int32_t*>(factor->s),
            static_cast<double*>(factor->x)};
        try {
          latin::algebra::factorise_supernodes(
              nodes, {moved.first.data(), moved.rows.data(), moved.values.data()}, moved.size());
        } catch (const latin::algebra::NotPositive& pivot) {
          failed = static_cast<long>(pivot.column);
        }
      }
      best = std::min(best, processor_time() - began);
      peak = status("VmHWM:") - before;
      if (repeat + 1 == repeats && failed < 0) {
        error = backward_error(moved, factor, &common);
        const auto* const x = static_cast<const double*>(factor->x);
        numbers[way].assign(x, x + factor->xsize);
        // above the diagonals of the dense blocks there is no factor
        const auto* const super = static_cast<const std::int32_t*>(factor->super);
        const auto* const pi = static_cast<const std::int32_t*>(factor->pi);
        const auto* const px = static_cast<const std::int32_t*>(factor->px);
        for (std::size_t s = 0; s < factor->nsuper; ++s) {
          const std::ptrdiff_t high = pi[s + 1] - pi[s];
          for (std::ptrdiff_t column = 0; column < super[s + 1] - super[s]; ++column) {
            std::fill_n(numbers[way].begin() + px[s] + column * high, column, 0.0);
          }
        }
      }
      cholmod_free_factor(&factor, &common);
    }
    const char* const name = way == 0 ? "cholmod" : "kernel";
    std::printf(", \"%s_s\": %.4g, \"%s_gb\": %.4g, \"%s_backward\": %.3g, \"%s_failed\": %ld",
                name, best, name, peak, name, error, name, failed);
  }
  double difference = 0.0;
  double largest = 0.0;
  if (numbers[0].size() == numbers[1].size()) {
    for (std::size_t i = 0; i < numbers[0].size(); ++i) {
      difference = std::max(difference, std::abs(numbers[0][i] - numbers[1][i]));
      largest = std::max(largest, std::abs(numbers[0][i]));
    }
  }
  std::printf(", \"gflop\": %.4g, \"numbers\": %.4g, \"difference\": %.3g}\n", 1e-9 * common.fl,
              common.lnz, largest > 0.0 ? difference / largest : 0.0);
  cholmod_finish(&common);
  return 0;
}
