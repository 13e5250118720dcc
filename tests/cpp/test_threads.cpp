#include "common/threads.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "latin/common/interrupt.hpp"
#include "threads.hpp"

namespace {

constexpr double large = std::numeric_limits<double>::infinity();

/// Use of a working block, which must not be shared.
struct Block {
  std::atomic<int> users{0};
  std::vector<std::size_t> pieces;
};

TEST(Threads, EveryPieceIsDoneOnceByOneThreadAtATime) {
  for (const int threads : {1, 2, 5}) {
    const Threads some(threads);
    latin::PerLane<Block> blocks;
    std::vector<int> done(500, 0);
    std::atomic<bool> shared{false};
    for (int round = 0; round < 20; ++round) {  // who wakes up late takes no part in the next
      latin::in_lanes(done.size(), large, blocks, [&](std::size_t piece, Block& own) {
        shared = shared || own.users++ > 0;
        own.pieces.push_back(piece);
        ++done[piece];
        --own.users;
      });
    }
    EXPECT_FALSE(shared);
    EXPECT_EQ(done, std::vector<int>(500, 20));
  }
}

/// Piece 0 is over at once, the others when they are told.
TEST(Threads, LongWorkEndsInAllLanes) {
  for (const int threads : {1, 3}) {
    const Threads some(threads);
    std::atomic<int> ended{0};
    const auto asking = std::this_thread::get_id();
    latin::Interruptible ending([&] {
      EXPECT_EQ(std::this_thread::get_id(), asking);
      return true;
    });
    EXPECT_THROW(latin::in_lanes(3, large,
                                 [&](std::size_t piece) {
                                   while (piece > 0) {
                                     try {
                                       latin::stop_if_wanted();
                                     } catch (const latin::Interrupted&) {
                                       ++ended;
                                       throw;
                                     }
                                   }
                                 }),
                 latin::Interrupted);
    EXPECT_EQ(ended, threads == 1 ? 1 : 2);  // one thread stops at the first
  }
  latin::stop_if_wanted();  // nobody is asked any more
}

TEST(Threads, WhatTheQuestionThrowsIsPassedOn) {
  latin::Interruptible ending([]() -> bool { throw std::runtime_error("pressed twice"); });
  ending.pass_on();
  EXPECT_THROW(for (;;) { latin::stop_if_wanted(); }, latin::Interrupted);
  EXPECT_THROW(ending.pass_on(), std::runtime_error);
}

TEST(Threads, LittleWorkStaysWithTheCaller) {
  const Threads some(2);
  const auto caller = std::this_thread::get_id();
  latin::in_lanes(8, 100.0, [&](std::size_t) { EXPECT_EQ(std::this_thread::get_id(), caller); });
  latin::in_lanes(1, large, [&](std::size_t) { EXPECT_EQ(std::this_thread::get_id(), caller); });
  latin::in_lanes(0, large, [](std::size_t) { FAIL(); });
}

TEST(Threads, PiecesWithinPiecesAreOnTheirThread) {
  const Threads some(3);
  latin::in_lanes(6, large, [](std::size_t) {
    const auto outer = std::this_thread::get_id();
    latin::in_lanes(4, large, [&](std::size_t) { EXPECT_EQ(std::this_thread::get_id(), outer); });
  });
}

TEST(Threads, TheSmallestFailureIsThrown) {
  for (const int threads : {1, 3}) {
    const Threads some(threads);
    const auto message = [](const auto& call) -> std::string {
      try {
        call();
      } catch (const std::runtime_error& error) {
        return error.what();
      }
      return {};
    };
    const auto fail = [](std::size_t piece) {
      if (piece % 10 == 7) {
        throw std::runtime_error(std::to_string(piece));
      }
    };
    for (int round = 0; round < 20; ++round) {
      EXPECT_EQ(message([&] { latin::in_lanes(100, large, fail); }), "7");
      EXPECT_EQ(message([&] { latin::side_by_side({37, 5, 17, 27}, fail); }), "17");
    }
    int done = 0;  // and the threads are there again
    std::vector<int> each(50, 0);
    latin::in_lanes(each.size(), large, [&](std::size_t piece) { each[piece] = 1; });
    done = std::accumulate(each.begin(), each.end(), 0);
    EXPECT_EQ(done, 50);
  }
}

TEST(Threads, SeveralCallersMayHavePieces) {
  const Threads some(2);
  std::vector<std::vector<int>> done(3, std::vector<int>(200, 0));
  {
    std::vector<std::jthread> callers;
    for (std::vector<int>& own : done) {
      callers.emplace_back([&own] {
        for (int round = 0; round < 50; ++round) {
          latin::in_lanes(own.size(), large, [&](std::size_t piece) { ++own[piece]; });
        }
      });
    }
  }
  for (const std::vector<int>& own : done) {
    EXPECT_EQ(own, std::vector<int>(200, 50));
  }
}

TEST(Threads, TheAlgebraHasItsThreadsBack) {
  if (openblas_get_num_threads == nullptr) {
    GTEST_SKIP() << "not OpenBLAS";
  }
  const Threads some(2);
  {
    const latin::SerialAlgebra first;
    EXPECT_EQ(openblas_get_num_threads(), 1);
    {
      const latin::SerialAlgebra second;
      // pieces have the threads that the algebra does not use
      std::atomic<int> others{0};
      const auto caller = std::this_thread::get_id();
      latin::in_lanes(2, large, [&](std::size_t) {
        others += std::this_thread::get_id() == caller ? 0 : 1;
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
      });
      EXPECT_EQ(others, 1);
    }
    EXPECT_EQ(openblas_get_num_threads(), 1);
  }
  EXPECT_EQ(openblas_get_num_threads(), 2);
}

}  // namespace
