#include <gtest/gtest.h>
#include <mpi.h>

#include <functional>
#include <string>
#include <vector>

#include "latin/common/communicator.hpp"

using latin::Communicator;
using latin::Index;
using latin::Matrix;

namespace {

/// The function of MPI that fails; empty: none does.
std::string broken;  // NOLINT(cppcoreguidelines-avoid-non-const-global-variables)
/// One rank takes itself for the first one of two, so that it asks MPI.
bool doubled = false;  // NOLINT(cppcoreguidelines-avoid-non-const-global-variables)

int code_of(const char* call) { return broken == call ? MPI_ERR_OTHER : MPI_SUCCESS; }

}  // namespace

// MPI's profiling interface: a program may put its own functions in front of those of MPI
extern "C" {
int MPI_Comm_size(MPI_Comm comm, int* size) {
  const int code = PMPI_Comm_size(comm, size);
  *size = doubled ? 2 * *size : *size;
  return broken == "MPI_Comm_size" ? MPI_ERR_OTHER : code;
}
int MPI_Iallreduce(const void* send, void* receive, int count, MPI_Datatype type, MPI_Op op,
                   MPI_Comm comm, MPI_Request* request) {
  const int code = code_of("MPI_Iallreduce");
  return code == MPI_SUCCESS ? PMPI_Iallreduce(send, receive, count, type, op, comm, request)
                             : code;
}
int MPI_Ibcast(void* values, int count, MPI_Datatype type, int root, MPI_Comm comm,
               MPI_Request* request) {
  const int code = code_of("MPI_Ibcast");
  return code == MPI_SUCCESS ? PMPI_Ibcast(values, count, type, root, comm, request) : code;
}
int MPI_Iallgather(const void* /*send*/, int /*count*/, MPI_Datatype /*type*/, void* /*receive*/,
                   int /*each*/, MPI_Datatype /*received*/, MPI_Comm /*comm*/,
                   MPI_Request* /*request*/) {
  return MPI_ERR_OTHER;
}
int MPI_Iallgatherv(const void* /*send*/, int /*count*/, MPI_Datatype /*type*/, void* /*receive*/,
                    const int* /*counts*/, const int* /*starts*/, MPI_Datatype /*received*/,
                    MPI_Comm /*comm*/, MPI_Request* /*request*/) {
  return MPI_ERR_OTHER;
}
int MPI_Testall(int count, MPI_Request* requests, int* done, MPI_Status* statuses) {
  const int code = code_of("MPI_Testall");
  return code == MPI_SUCCESS ? PMPI_Testall(count, requests, done, statuses) : code;
}
}

namespace {

/// What an error of MPI says while a function of it fails.
std::string said(const std::string& call, const std::function<void()>& work) {
  broken = call;
  std::string words = "no error";
  try {
    work();
  } catch (const latin::MpiError& error) {
    words = error.what();
  }
  broken.clear();
  return words;
}

}  // namespace

TEST(Communicator, NoErrorOfMpiIsTakenForAnAnswer) {
  doubled = true;
  const Communicator both(MPI_COMM_SELF);
  doubled = false;
  ASSERT_EQ(both.size(), 2);
  const auto sum = [&both] { static_cast<void>(both.sum(1.0)); };
  std::vector<double> values{1.0};
  const std::vector<std::pair<std::string, std::function<void()>>> calls{
      {"MPI_Comm_size", [] { static_cast<void>(Communicator(MPI_COMM_SELF)); }},
      {"MPI_Iallreduce", sum},
      {"MPI_Testall", sum},
      {"MPI_Iallreduce", [&both] { static_cast<void>(both.maximum(1)); }},
      {"MPI_Iallreduce", [&both] { static_cast<void>(both.largest(1.0)); }},
      {"MPI_Iallreduce", [&both] { both.agree(nullptr); }},
      {"MPI_Ibcast", [&] { both.follow_first(values); }},
      {"MPI_Iallgather", [&] { static_cast<void>(both.gather(values)); }},
      {"MPI_Iallgather", [&] { static_cast<void>(both.gather(std::vector<std::string>{"a"})); }},
      {"MPI_Iallgatherv",
       [&] { static_cast<void>(both.stacked(Matrix::Ones(1, 1), std::vector<Index>{1, 1})); }},
  };
  for (const auto& [call, work] : calls) {
    EXPECT_NE(said(call, work).find(call + " failed on this rank: error "), std::string::npos)
        << call << ": " << said(call, work);
  }
}
