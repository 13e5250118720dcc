#include <gtest/gtest.h>

#include "stochastic/multi_index.hpp"
#include "stochastic_sample.hpp"

namespace latin::stochastic {

TEST(MultiIndexSet, TotalDegreeInGradedOrder) {
  const MultiIndexSet set(total(2, 2));
  IndexTable expected(6, 2);
  expected << 0, 0, 1, 0, 0, 1, 2, 0, 1, 1, 0, 2;
  EXPECT_EQ(set.table(), expected);
  for (Index row = 0; row < set.size(); ++row) {
    EXPECT_EQ(set.find(set[row]), row);
  }
  EXPECT_FALSE(set.find(std::vector{2, 1}).has_value());
}

TEST(MultiIndexSet, CountsAgreeWithEnumeration) {
  for (const Index dimension : {0, 1, 3, 5}) {
    for (const Index order : {0, 1, 4}) {
      for (const IndexShape shape :
           {IndexShape::total, IndexShape::tensor, IndexShape::hyperbolic}) {
        for (const Index interaction : {0, 1, 2}) {
          const IndexRequest request{shape, dimension, order, 0.5, {}, interaction, {}, 0.0, 0.0};
          const MultiIndexSet set(request);
          EXPECT_EQ(static_cast<double>(set.size()), MultiIndexSet::count(request, 1e9));
          // by the definition, over the whole box
          const auto box = static_cast<Index>(
              std::pow(static_cast<double>(order + 1), static_cast<double>(dimension)));
          Index members = 0;
          for (Index code = 0; code < box; ++code) {
            Index rest = code;
            Index sum = 0;
            Index active = 0;
            double norm = 0.0;
            for (Index l = 0; l < dimension; ++l) {
              const Index degree = rest % (order + 1);
              rest /= order + 1;
              sum += degree;
              active += degree > 0 ? 1 : 0;
              norm += std::sqrt(static_cast<double>(degree));
            }
            const bool in = shape == IndexShape::total ? sum <= order
                            : shape == IndexShape::tensor
                                ? true
                                : norm * norm <= static_cast<double>(order) + 1e-9;
            members += in && (interaction == 0 || active <= interaction) ? 1 : 0;
          }
          EXPECT_EQ(set.size(), members) << dimension << " " << order;
        }
      }
    }
  }
  EXPECT_EQ(MultiIndexSet(total(10, 3)).size(), 286);
}

TEST(MultiIndexSet, WeightsAndCapsLimitDegrees) {
  IndexRequest request = total(2, 4);
  request.weights = {1.0, 2.0};
  const MultiIndexSet weighted(request);
  EXPECT_EQ(weighted.degree(0), 4);
  EXPECT_EQ(weighted.degree(1), 2);
  EXPECT_EQ(weighted.size(), 9);
  request.weights.clear();
  request.caps = {4, 1};
  EXPECT_EQ(MultiIndexSet(request).size(), 9);
}

TEST(MultiIndexSet, SizeIsRefusedBeforeAllocation) {
  IndexRequest request = total(20, 30);
  request.memory_limit = 1e9;
  request.bytes_per_index = 8.0;
  expect_mentions([&] { const MultiIndexSet set(request); },
                  {"order 30", "20 variables", "4.71292e+13", "GB", "limit of 1 GB"});
  request.shape = IndexShape::hyperbolic;
  request.q = 0.9;
  request.memory_limit = 1e6;
  expect_mentions([&] { const MultiIndexSet set(request); }, {"or more", "limit of 1 MB"});
  request = total(2000, 1000);  // more than a double can count
  expect_mentions([&] { const MultiIndexSet set(request); }, {"inf"});
}

TEST(MultiIndexSet, BadInputIsNamed) {
  expect_mentions([] { const MultiIndexSet set(total(2, -1)); }, {"-1", ">= 0"});
  expect_mentions([] { static_cast<void>(index_shape("totl")); }, {"'totl'", "total"});
  IndexRequest request = total(2, 2);
  request.weights = {1.0};
  EXPECT_THROW(const MultiIndexSet set(request), InputError);
  request.weights = {1.0, 0.0};
  EXPECT_THROW(const MultiIndexSet set(request), InputError);
  request = {IndexShape::hyperbolic, 2, 2, 1.5, {}, 0, {}, 0.0, 0.0};
  EXPECT_THROW(const MultiIndexSet set(request), InputError);
  IndexTable rows(2, 1);
  rows << 0, 0;
  EXPECT_THROW(const MultiIndexSet set(rows), InputError);
  rows << 1, 2;
  EXPECT_THROW(const MultiIndexSet set(rows), InputError);
  rows << 0, -1;
  EXPECT_THROW(const MultiIndexSet set(rows), InputError);
}

}  // namespace latin::stochastic
