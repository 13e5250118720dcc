#include "latin/common/communicator.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <thread>

#include "latin/common/error.hpp"
#include "latin/common/outer_lock.hpp"

namespace latin {
namespace {

/// Of this project's messages: the communicator is shared with the caller.
constexpr int tag = 20040;

std::string message_of(const std::exception_ptr& failure) {
  try {
    std::rethrow_exception(failure);
  } catch (const std::exception& error) {
    return error.what();
  } catch (...) {
    return "unknown error";
  }
}

/// Held around MPI calls. Where MPI was not asked for several threads it takes one at a time, of the whole
/// process: then nobody else may call it meanwhile.
class MpiLock {
 public:
  MpiLock() : lock_(!several()) {}

 private:
  static bool several() {
    int level = MPI_THREAD_SINGLE;
    MPI_Query_thread(&level);
    return level == MPI_THREAD_MULTIPLE;
  }
  OuterLock lock_;
};

/// Wait for messages, and leave the core to others meanwhile. MPI's own waiting keeps it by default: where ranks
/// and other programs share cores, what is waited for may itself wait for a core, a slice of time each time.
void wait(std::span<MPI_Request> requests) {
  constexpr auto brief = std::chrono::microseconds(200);
  constexpr auto pause = std::chrono::microseconds(50);
  const auto began = std::chrono::steady_clock::now();
  int done = 0;
  while (MPI_Testall(static_cast<int>(requests.size()), requests.data(), &done,
                     MPI_STATUSES_IGNORE) == MPI_SUCCESS &&
         done == 0) {
    if (std::chrono::steady_clock::now() - began < brief) {
      std::this_thread::yield();
    } else {  // a core that is only offered stays with who offers it
      std::this_thread::sleep_for(pause);
    }
  }
}

/// What all ranks do together: begun by a call, which is given the request, and waited for.
template <typename Begin>
void complete(Begin&& begin) {
  MPI_Request request = MPI_REQUEST_NULL;
  std::forward<Begin>(begin)(&request);
  wait({&request, 1});
}

int count_of(std::size_t size) {
  if (size > static_cast<std::size_t>(std::numeric_limits<int>::max())) {
    throw NumericalError("a message of " + std::to_string(size) +
                         " values between two ranks is too long for MPI: use more ranks");
  }
  return static_cast<int>(size);
}

}  // namespace

Communicator::Communicator(MPI_Comm comm) : comm_(comm) {
  MPI_Comm_rank(comm_, &rank_);
  MPI_Comm_size(comm_, &size_);
}

void Communicator::sum(std::span<double> values) const {
  if (!alone()) {
    const MpiLock lock;
    // MPI requires an allreduce to leave identical results on all ranks
    const int count = count_of(values.size());
    complete([&](MPI_Request* request) {
      MPI_Iallreduce(MPI_IN_PLACE, values.data(), count, MPI_DOUBLE, MPI_SUM, comm_, request);
    });
  }
}

double Communicator::sum(double value) const {
  sum(std::span(&value, 1));
  return value;
}

void Communicator::follow_first(std::span<double> values) const {
  if (!alone()) {
    const MpiLock lock;
    const int count = count_of(values.size());
    complete([&](MPI_Request* request) {
      MPI_Ibcast(values.data(), count, MPI_DOUBLE, 0, comm_, request);
    });
  }
}

Index Communicator::maximum(Index value) const {
  auto largest = static_cast<long long>(value);
  if (!alone()) {
    const MpiLock lock;
    complete([&](MPI_Request* request) {
      MPI_Iallreduce(MPI_IN_PLACE, &largest, 1, MPI_LONG_LONG, MPI_MAX, comm_, request);
    });
  }
  return static_cast<Index>(largest);
}

double Communicator::largest(double value) const {
  if (!alone()) {
    value = std::isnan(value) ? std::numeric_limits<double>::infinity() : value;
    const MpiLock lock;
    complete([&](MPI_Request* request) {
      MPI_Iallreduce(MPI_IN_PLACE, &value, 1, MPI_DOUBLE, MPI_MAX, comm_, request);
    });
  }
  return value;
}

std::vector<std::vector<std::string>> Communicator::gather(
    const std::vector<std::string>& texts) const {
  if (alone()) {
    return {texts};
  }
  const MpiLock lock;
  std::string mine;
  for (const std::string& text : texts) {
    mine += text + '\0';
  }
  const auto ranks = static_cast<std::size_t>(size_);
  const int length = count_of(mine.size());
  std::vector<int> lengths(ranks);
  complete([&](MPI_Request* request) {
    MPI_Iallgather(&length, 1, MPI_INT, lengths.data(), 1, MPI_INT, comm_, request);
  });
  std::vector<int> starts(ranks, 0);
  std::size_t total = 0;
  for (std::size_t r = 0; r < ranks; ++r) {
    starts[r] = count_of(total);
    total += static_cast<std::size_t>(lengths[r]);
  }
  std::string all(total, '\0');
  complete([&](MPI_Request* request) {
    MPI_Iallgatherv(mine.data(), length, MPI_CHAR, all.data(), lengths.data(), starts.data(),
                    MPI_CHAR, comm_, request);
  });
  std::vector<std::vector<std::string>> found(ranks);
  for (std::size_t r = 0; r < ranks; ++r) {
    const std::string of_rank =
        all.substr(static_cast<std::size_t>(starts[r]), static_cast<std::size_t>(lengths[r]));
    for (std::size_t begin = 0; begin < of_rank.size();) {
      const std::size_t end = of_rank.find('\0', begin);
      found[r].push_back(of_rank.substr(begin, end - begin));
      begin = end + 1;
    }
  }
  return found;
}

std::vector<std::vector<double>> Communicator::gather(const std::vector<double>& numbers) const {
  if (alone()) {
    return {numbers};
  }
  const MpiLock lock;
  const auto ranks = static_cast<std::size_t>(size_);
  const auto length = static_cast<long long>(numbers.size());
  std::vector<long long> lengths(ranks);
  complete([&](MPI_Request* request) {
    MPI_Iallgather(&length, 1, MPI_LONG_LONG, lengths.data(), 1, MPI_LONG_LONG, comm_, request);
  });
  std::vector<int> counts(ranks);
  std::vector<int> starts(ranks);
  std::size_t total = 0;
  for (std::size_t r = 0; r < ranks; ++r) {
    // the same numbers on all ranks: what throws here throws on all
    starts[r] = count_of(total);
    counts[r] = count_of(static_cast<std::size_t>(lengths[r]));
    total += static_cast<std::size_t>(lengths[r]);
  }
  std::vector<double> all(total);
  complete([&](MPI_Request* request) {
    MPI_Iallgatherv(numbers.data(), counts[static_cast<std::size_t>(rank_)], MPI_DOUBLE, all.data(),
                    counts.data(), starts.data(), MPI_DOUBLE, comm_, request);
  });
  std::vector<std::vector<double>> found;
  found.reserve(ranks);
  for (std::size_t r = 0; r < ranks; ++r) {
    found.emplace_back(all.begin() + starts[r], all.begin() + starts[r] + counts[r]);
  }
  return found;
}

Matrix Communicator::stacked(ConstMatrixRef own, const std::vector<Index>& rows) const {
  if (alone()) {
    return own;
  }
  const MpiLock lock;
  const Index columns = own.cols();
  const Matrix mine = own;
  std::vector<int> counts;
  std::vector<int> starts;
  counts.reserve(rows.size());
  starts.reserve(rows.size());
  Index total = 0;
  for (const Index each : rows) {
    // the same numbers on all ranks: what throws here throws on all
    starts.push_back(count_of(static_cast<std::size_t>(total * columns)));
    counts.push_back(count_of(static_cast<std::size_t>(each * columns)));
    total += each;
  }
  std::vector<double> blocks(static_cast<std::size_t>(total * columns));
  complete([&](MPI_Request* request) {
    MPI_Iallgatherv(mine.data(), counts[static_cast<std::size_t>(rank_)], MPI_DOUBLE, blocks.data(),
                    counts.data(), starts.data(), MPI_DOUBLE, comm_, request);
  });
  Matrix all(total, columns);
  Index first = 0;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    all.middleRows(first, rows[r]) =
        Eigen::Map<const Matrix>(blocks.data() + starts[r], rows[r], columns);
    first += rows[r];
  }
  return all;
}

bool Communicator::none_failed(const std::exception_ptr& failure) const {
  enum Kind : Index { none, no_answer, other };
  Index own = none;
  try {
    if (failure) {
      std::rethrow_exception(failure);
    }
  } catch (const NumericalError&) {
    own = no_answer;
  } catch (...) {
    own = other;
  }
  const Index worst = maximum(own);
  if (worst == other) {
    agree(own == other ? failure : nullptr);
  }
  return worst == none;
}

void Communicator::agree(const std::exception_ptr& failure) const {
  if (!alone()) {
    const MpiLock lock;
    int first = failure ? rank_ : size_;
    complete([&](MPI_Request* request) {
      MPI_Iallreduce(MPI_IN_PLACE, &first, 1, MPI_INT, MPI_MIN, comm_, request);
    });
    if (first == size_) {
      return;
    }
    std::string text = first == rank_ ? message_of(failure) : std::string();
    auto length = static_cast<unsigned long>(text.size());
    complete([&](MPI_Request* request) {
      MPI_Ibcast(&length, 1, MPI_UNSIGNED_LONG, first, comm_, request);
    });
    text.resize(length);
    complete([&](MPI_Request* request) {
      MPI_Ibcast(text.data(), static_cast<int>(length), MPI_CHAR, first, comm_, request);
    });
    if (!failure) {
      throw RemoteError("rank " + std::to_string(first) + ": " + text);
    }
  }
  if (failure) {
    std::rethrow_exception(failure);
  }
}

Exchange::~Exchange() { release(); }

void Exchange::release() {
  if (requests_.empty()) {
    return;
  }
  int finalized = 0;
  MPI_Finalized(&finalized);
  const OuterLock lock(finalized == 0);
  for (MPI_Request& request : requests_) {
    if (finalized == 0) {
      MPI_Request_free(&request);
    }
  }
  requests_.clear();
}

std::size_t Exchange::add(int rank, Index rows) {
  auto peer = std::ranges::find(peers_, rank, &Peer::rank);
  if (peer == peers_.end()) {
    peer = peers_.insert(peer, Peer{rank, 0, {}, {}});
  }
  slots_.push_back({static_cast<std::size_t>(peer - peers_.begin()), peer->rows, rows});
  peer->rows += rows;
  columns_ = -1;
  return slots_.size() - 1;
}

void Exchange::prepare(Index columns) {
  if (columns == columns_ || peers_.empty()) {
    return;
  }
  release();
  const MpiLock lock;
  for (Peer& peer : peers_) {
    peer.out.resize(peer.rows, columns);
    peer.in.resize(peer.rows, columns);
    const int count = count_of(static_cast<std::size_t>(peer.out.size()));
    const MPI_Comm comm = communicator_.mpi();
    MPI_Recv_init(peer.in.data(), count, MPI_DOUBLE, peer.rank, tag, comm,
                  &requests_.emplace_back());
    MPI_Send_init(peer.out.data(), count, MPI_DOUBLE, peer.rank, tag, comm,
                  &requests_.emplace_back());
  }
  columns_ = columns;
}

Eigen::Block<Matrix> Exchange::outgoing(std::size_t slot) {
  const Slot& at = slots_.at(slot);
  Matrix& block = peers_[at.peer].out;
  return block.block(at.row, 0, at.rows, block.cols());
}

Eigen::Block<Matrix> Exchange::incoming(std::size_t slot) {
  const Slot& at = slots_.at(slot);
  Matrix& block = peers_[at.peer].in;
  return block.block(at.row, 0, at.rows, block.cols());
}

Exchange::Transit Exchange::start() {
  if (!requests_.empty()) {
    const MpiLock lock;
    MPI_Startall(static_cast<int>(requests_.size()), requests_.data());
  }
  return Transit(*this);
}

void Exchange::Transit::finish() {
  auto& requests = exchange_.requests_;
  if (!finished_ && !requests.empty()) {
    const MpiLock lock;
    wait(requests);
  }
  finished_ = true;
}

Exchange::Transit::~Transit() { finish(); }

}  // namespace latin
