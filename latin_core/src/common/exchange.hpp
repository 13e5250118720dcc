#pragma once

#include <mpi.h>

#include <cstddef>
#include <utility>
#include <vector>

#include "latin/common/communicator.hpp"
#include "latin/common/types.hpp"

namespace latin {

/// Blocks that neighbours swap: one message each way between two ranks, whatever their number of slots.
///
/// Requests are persistent; their buffers are made again when the number of columns changes.
class Exchange {
 public:
  explicit Exchange(const Communicator& communicator) : communicator_(communicator) {}
  ~Exchange();
  Exchange(const Exchange&) = delete;
  Exchange& operator=(const Exchange&) = delete;
  Exchange(Exchange&&) = delete;
  Exchange& operator=(Exchange&&) = delete;

  /// A block of `rows` rows each way between this rank and another. Both must add their common slots in
  /// the same order. @return its number
  std::size_t add(int rank, Index rows);

  /// Make room for blocks of this many columns.
  void prepare(Index columns);
  [[nodiscard]] Eigen::Block<Matrix> outgoing(std::size_t slot);
  [[nodiscard]] Eigen::Block<Matrix> incoming(std::size_t slot);

  /// Blocks on their way: whatever happens in between, the neighbours get what they wait for.
  class Transit {
   public:
    explicit Transit(Exchange& exchange) : exchange_(exchange) {}
    ~Transit();
    Transit(const Transit&) = delete;
    Transit& operator=(const Transit&) = delete;
    Transit(Transit&&) = delete;
    Transit& operator=(Transit&&) = delete;
    /// Wait until everything has come in.
    void finish();

   private:
    Exchange& exchange_;
    bool finished_ = false;
  };
  /// Send the outgoing blocks, let the incoming ones in. Not collective: neighbours only.
  [[nodiscard]] Transit start();

 private:
  struct Peer {
    int rank;
    Index rows;
    Matrix out;
    Matrix in;
  };
  struct Slot {
    std::size_t peer;
    Index row;
    Index rows;
  };
  void release();

  Communicator communicator_;
  Index columns_ = -1;
  std::vector<Peer> peers_;
  std::vector<Slot> slots_;
  std::vector<MPI_Request> requests_;
};

}  // namespace latin
