#pragma once

#include <mpi.h>

#include <exception>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "latin/common/error.hpp"
#include "latin/common/types.hpp"

namespace latin {

/// Another rank failed; the message is that of the first one, with its rank.
class RemoteError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// MPI could not do what was asked of it: nothing is known of what the other ranks have got.
class MpiError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Every return code of MPI comes through here. @param call the function @throws MpiError
void check_mpi(int code, const char* call);

/// The ranks that share a problem. A rank alone is the same code with trivial operations.
///
/// Borrowed: the MPI communicator must outlive this object. Every member is collective unless it says
/// otherwise, and ranks must come in the same order of calls.
class Communicator {
 public:
  /// One rank alone; MPI need not be initialised.
  Communicator() = default;
  explicit Communicator(MPI_Comm comm);

  [[nodiscard]] int rank() const { return rank_; }  ///< not collective
  [[nodiscard]] int size() const { return size_; }  ///< not collective
  [[nodiscard]] bool alone() const { return size_ == 1; }
  [[nodiscard]] MPI_Comm mpi() const { return comm_; }

  /// Sum over the ranks, in place; the result is the same bit by bit on all of them.
  void sum(std::span<double> values) const;
  [[nodiscard]] double sum(double value) const;
  [[nodiscard]] Index maximum(Index value) const;
  /// Replace numbers by those of the first rank, so that what all compute alike is the same bit by bit.
  void follow_first(std::span<double> values) const;
  /// NaN counts as infinity.
  [[nodiscard]] double largest(double value) const;
  /// What every rank gives, in the order of ranks. No text may contain a NUL.
  [[nodiscard]] std::vector<std::vector<std::string>> gather(
      const std::vector<std::string>& texts) const;
  [[nodiscard]] std::vector<std::vector<double>> gather(const std::vector<double>& numbers) const;
  /// Blocks of all ranks, of the same number of columns, one under the other.
  /// @param rows of the blocks of all ranks
  /// @throws NumericalError on all ranks if they are too large for one message
  [[nodiscard]] Matrix stacked(ConstMatrixRef own, const std::vector<Index>& rows) const;

  /// Whether something holds on all ranks.
  [[nodiscard]] bool everywhere(bool holds) const { return maximum(holds ? 0 : 1) == 0; }

  /// Throw on all ranks if any of them failed: on that rank what it threw, on the others RemoteError.
  void agree(const std::exception_ptr& failure) const;
  /// Whether none has failed; false on all ranks if some have, of which all say that there is no answer.
  /// @throws as agree() if something else has failed
  [[nodiscard]] bool none_failed(const std::exception_ptr& failure) const;
  /// Run something that does not communicate, and agree on how it ended.
  template <typename Work>
  void together(Work&& work) const {
    std::exception_ptr failure;
    try {
      std::forward<Work>(work)();
    } catch (...) {
      failure = std::current_exception();
    }
    agree(failure);
  }
  /// The same of what may have no answer on some ranks: then it has none on any.
  /// @throws NumericalError on all ranks then, with the words given; whatever else a rank throws as agree()
  template <typename Work>
  void answer_together(const char* none, Work&& work) const {
    std::exception_ptr failure;
    try {
      std::forward<Work>(work)();
    } catch (...) {
      if (alone()) {
        throw;
      }
      failure = std::current_exception();
    }
    if (!none_failed(failure)) {
      throw NumericalError(none);
    }
  }
  /// A number that all ranks compute alike and decide by, as the first rank has it: processors round differently.
  [[nodiscard]] double agreed(double value) const {
    follow_first({&value, 1});
    return value;
  }

 private:
  /// Values that every rank gives.
  [[nodiscard]] std::vector<long long> lengths_of(std::size_t own) const;

  MPI_Comm comm_ = MPI_COMM_NULL;
  int rank_ = 0;
  int size_ = 1;
};

}  // namespace latin
