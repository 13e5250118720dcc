#include "latin/common/communicator.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <numeric>
#include <thread>

#include "common/exchange.hpp"
#include "common/outer_lock.hpp"
#include "latin/common/error.hpp"

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
    check_mpi(MPI_Query_thread(&level), "MPI_Query_thread");
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
  const auto completed = [&requests] {
    int done = 0;
    check_mpi(
        MPI_Testall(static_cast<int>(requests.size()), requests.data(), &done, MPI_STATUSES_IGNORE),
        "MPI_Testall");
    return done != 0;
  };
  while (!completed()) {
    if (std::chrono::steady_clock::now() - began < brief) {
      std::this_thread::yield();
    } else {  // a core that is only offered stays with who offers it
      std::this_thread::sleep_for(pause);
    }
  }
}

/// What all ranks do together: begun by a call, which is given the request, and waited for.
template <typename Begin>
void complete(const char* call, Begin&& begin) {
  MPI_Request request = MPI_REQUEST_NULL;
  check_mpi(std::forward<Begin>(begin)(&request), call);
  wait({&request, 1});
}

int count_of(std::size_t size) {
  if (size > static_cast<std::size_t>(std::numeric_limits<int>::max())) {
    throw NumericalError("a message of " + std::to_string(size) +
                         " values between two ranks is too long for MPI: use more ranks");
  }
  return static_cast<int>(size);
}

/// Where the blocks of the ranks lie behind each other. Sizes are the same on all ranks: what throws here throws on all.
/// @return values of all of them
std::size_t lay_out(const std::vector<long long>& sizes, std::vector<int>& counts,
                    std::vector<int>& starts) {
  std::size_t total = 0;
  for (const long long size : sizes) {
    starts.push_back(count_of(total));
    counts.push_back(count_of(static_cast<std::size_t>(size)));
    total += static_cast<std::size_t>(size);
  }
  return total;
}

}  // namespace

void check_mpi(int code, const char* call) {
  if (code == MPI_SUCCESS) {
    return;
  }
  std::array<char, MPI_MAX_ERROR_STRING + 1> text{};
  int length = 0;
  static_cast<void>(MPI_Error_string(code, text.data(), &length));
  throw MpiError(std::string(call) + " failed on this rank: error " + std::to_string(code) + " (" +
                 text.data() + ")");
}

Communicator::Communicator(MPI_Comm comm) : comm_(comm) {
  check_mpi(MPI_Comm_rank(comm_, &rank_), "MPI_Comm_rank");
  check_mpi(MPI_Comm_size(comm_, &size_), "MPI_Comm_size");
}

void Communicator::sum(std::span<double> values) const {
  if (!alone()) {
    const MpiLock lock;
    // MPI requires an allreduce to leave identical results on all ranks
    const int count = count_of(values.size());
    complete("MPI_Iallreduce", [&](MPI_Request* request) {
      return MPI_Iallreduce(MPI_IN_PLACE, values.data(), count, MPI_DOUBLE, MPI_SUM, comm_,
                            request);
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
    complete("MPI_Ibcast", [&](MPI_Request* request) {
      return MPI_Ibcast(values.data(), count, MPI_DOUBLE, 0, comm_, request);
    });
  }
}

Index Communicator::maximum(Index value) const {
  auto largest = static_cast<long long>(value);
  if (!alone()) {
    const MpiLock lock;
    complete("MPI_Iallreduce", [&](MPI_Request* request) {
      return MPI_Iallreduce(MPI_IN_PLACE, &largest, 1, MPI_LONG_LONG, MPI_MAX, comm_, request);
    });
  }
  return static_cast<Index>(largest);
}

double Communicator::largest(double value) const {
  value = std::isnan(value) ? std::numeric_limits<double>::infinity() : value;
  if (!alone()) {
    const MpiLock lock;
    complete("MPI_Iallreduce", [&](MPI_Request* request) {
      return MPI_Iallreduce(MPI_IN_PLACE, &value, 1, MPI_DOUBLE, MPI_MAX, comm_, request);
    });
  }
  return value;
}

std::vector<long long> Communicator::lengths_of(std::size_t own) const {
  const auto length = static_cast<long long>(own);
  std::vector<long long> lengths(static_cast<std::size_t>(size_));
  complete("MPI_Iallgather", [&](MPI_Request* request) {
    return MPI_Iallgather(&length, 1, MPI_LONG_LONG, lengths.data(), 1, MPI_LONG_LONG, comm_,
                          request);
  });
  return lengths;
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
  const std::vector<long long> lengths = lengths_of(mine.size());
  std::vector<int> counts;
  std::vector<int> starts;
  const std::size_t total = lay_out(lengths, counts, starts);
  std::string all(total, '\0');
  complete("MPI_Iallgatherv", [&](MPI_Request* request) {
    return MPI_Iallgatherv(mine.data(), counts[static_cast<std::size_t>(rank_)], MPI_CHAR,
                           all.data(), counts.data(), starts.data(), MPI_CHAR, comm_, request);
  });
  std::vector<std::vector<std::string>> found(counts.size());
  for (std::size_t r = 0; r < found.size(); ++r) {
    const std::string of_rank =
        all.substr(static_cast<std::size_t>(starts[r]), static_cast<std::size_t>(counts[r]));
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
  const std::vector<long long> lengths = lengths_of(numbers.size());
  std::vector<int> counts;
  std::vector<int> starts;
  const std::size_t total = lay_out(lengths, counts, starts);
  std::vector<double> all(total);
  complete("MPI_Iallgatherv", [&](MPI_Request* request) {
    return MPI_Iallgatherv(numbers.data(), counts[static_cast<std::size_t>(rank_)], MPI_DOUBLE,
                           all.data(), counts.data(), starts.data(), MPI_DOUBLE, comm_, request);
  });
  std::vector<std::vector<double>> found;
  found.reserve(counts.size());
  for (std::size_t r = 0; r < counts.size(); ++r) {
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
  std::vector<long long> sizes(rows.size());
  std::ranges::transform(rows, sizes.begin(), [columns](Index each) { return each * columns; });
  std::vector<int> counts;
  std::vector<int> starts;
  const std::size_t total = lay_out(sizes, counts, starts);
  std::vector<double> blocks(total);
  complete("MPI_Iallgatherv", [&](MPI_Request* request) {
    return MPI_Iallgatherv(mine.data(), counts[static_cast<std::size_t>(rank_)], MPI_DOUBLE,
                           blocks.data(), counts.data(), starts.data(), MPI_DOUBLE, comm_, request);
  });
  Matrix all(std::accumulate(rows.begin(), rows.end(), Index{0}), columns);
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
    complete("MPI_Iallreduce", [&](MPI_Request* request) {
      return MPI_Iallreduce(MPI_IN_PLACE, &first, 1, MPI_INT, MPI_MIN, comm_, request);
    });
    if (first == size_) {
      return;
    }
    std::string text = first == rank_ ? message_of(failure) : std::string();
    auto length = static_cast<unsigned long>(text.size());
    complete("MPI_Ibcast", [&](MPI_Request* request) {
      return MPI_Ibcast(&length, 1, MPI_UNSIGNED_LONG, first, comm_, request);
    });
    text.resize(length);
    complete("MPI_Ibcast", [&](MPI_Request* request) {
      return MPI_Ibcast(text.data(), static_cast<int>(length), MPI_CHAR, first, comm_, request);
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
  int finalized = 1;
  // a destructor must not throw: codes are dropped
  static_cast<void>(MPI_Finalized(&finalized));
  const OuterLock lock(finalized == 0);
  for (MPI_Request& request : requests_) {
    if (finalized == 0) {
      static_cast<void>(MPI_Request_free(&request));
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
    MPI_Request request = MPI_REQUEST_NULL;
    check_mpi(MPI_Recv_init(peer.in.data(), count, MPI_DOUBLE, peer.rank, tag, comm, &request),
              "MPI_Recv_init");
    requests_.push_back(request);
    check_mpi(MPI_Send_init(peer.out.data(), count, MPI_DOUBLE, peer.rank, tag, comm, &request),
              "MPI_Send_init");
    requests_.push_back(request);
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
    check_mpi(MPI_Startall(static_cast<int>(requests_.size()), requests_.data()), "MPI_Startall");
  }
  return Transit(*this);
}

void Exchange::Transit::finish() {
  auto& requests = exchange_.requests_;
  if (!std::exchange(finished_, true) && !requests.empty()) {
    const MpiLock lock;
    wait(requests);
  }
}

Exchange::Transit::~Transit() {
  try {
    finish();
  } catch (const MpiError&) {  // a destructor must not throw: what is thrown already says more
    exchange_.requests_.clear();
  }
}

}  // namespace latin
