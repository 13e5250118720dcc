#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <thread>
#include <vector>

#include "common/lazy.hpp"

TEST(Lazy, IsMadeOnceWhoeverAsks) {
  const latin::Lazy<int> value;
  std::atomic<int> made{0};
  EXPECT_EQ(value.made(), nullptr);
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back([&] { EXPECT_EQ(value.get([&] { return 40 + ++made; }), 41); });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(made, 1);
  EXPECT_EQ(*value.made(), 41);
}

TEST(Lazy, IsTriedAgainAfterAFailure) {
  const latin::Lazy<int> value;
  const auto fail = [&] { return value.get([]() -> int { throw std::runtime_error("not yet"); }); };
  EXPECT_THROW(fail(), std::runtime_error);
  EXPECT_EQ(value.made(), nullptr);
  EXPECT_EQ(value.get([] { return 3; }), 3);
}

TEST(Counter, AddsUpFromSeveralThreads) {
  latin::Counter counter;
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&counter] {
      for (int n = 0; n < 1000; ++n) {
        static_cast<void>(counter.add(2));
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(counter.add(1), 8001);
}
