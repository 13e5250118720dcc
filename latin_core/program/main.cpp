// latin_run: solves a problem that was exported to a folder, without Python. folder.cpp describes the folder,
// answer.cpp the file of the answer.

#include <petscsys.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <limits>
#include <new>
#include <optional>
#include <string>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "answer.hpp"
#include "common/threads.hpp"
#include "folder.hpp"
#include "latin/common/communicator.hpp"
#include "latin/common/error.hpp"

namespace {

constexpr const char* usage =
    R"(usage: [mpirun -n RANKS] latin_run FOLDER [--output FILE] [--sweep INTERFACE.PARAMETER=VALUE,VALUE,...] ...
                                    [--displacements] [--max-seconds S]

Solves the problem that problem.export(FOLDER) wrote, as it was exported: once, a history, a chaos, or a sweep.

  --output FILE   where the answer is written, which the frontend reads (load); FOLDER/result.h5 by default
  --sweep AXIS    instead: a grid of values of kernel parameters of interface laws, one option for each axis
  --displacements of a sweep: write the displacements at all points, too
  --max-seconds S end the iteration then, and write what is known

Exit codes: 0 converged; 2 wrong input; 3 no equilibrium, or undecided; 4 not converged, or not solved; 5 out of time or memory;
130 interrupted (SIGINT, SIGTERM: the answer so far is written; a second one ends at once).
)";

/// As those of the command `latin` (docs/command.md).
enum Code : int {
  done = 0,
  wrong_input = 2,
  no_balance = 3,
  not_solved = 4,
  out_of_limits = 5,
  ended_by_user = 130
};

struct Request {
  std::filesystem::path folder;
  std::filesystem::path output;
  std::vector<std::string> axes;
  bool displacements = false;
  double max_seconds = std::numeric_limits<double>::infinity();
};

volatile std::sig_atomic_t signalled = 0;

/// SIGINT and SIGTERM are noted once, and asked for at every iteration; the next one ends the process.
void note_signals() {
  for (const int number : {SIGINT, SIGTERM}) {
    struct sigaction before{};
    struct sigaction ours{};
    ours.sa_handler = [](int) { signalled = 1; };
    ours.sa_flags = static_cast<int>(SA_RESETHAND | SA_RESTART);
    sigaction(number, nullptr, &before);
    if (before.sa_handler != SIG_IGN) {
      sigaction(number, &ours, nullptr);
    }
  }
}

double seconds_since(std::chrono::steady_clock::time_point began) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
}

Code code_of(latin::iteration::Status status) {
  using latin::iteration::Status;
  switch (status) {
    case Status::converged:
    case Status::undetermined:
      return done;
    case Status::inexact:
    case Status::max_iterations:
      return not_solved;
    case Status::undecided:
    case Status::slides:
    case Status::no_equilibrium:
      return no_balance;
    case Status::time_limit:
      return out_of_limits;
    case Status::interrupted:
      return ended_by_user;
  }
  return not_solved;
}

/// The file that a link leads to: a link that is named stays one.
/// @throws InputError if it leads nowhere
std::filesystem::path file_of(std::filesystem::path path) {
  constexpr int most_links = 40;
  const std::filesystem::path given = path;
  std::error_code failed;
  for (int i = 0; i < most_links; ++i) {
    if (!std::filesystem::is_symlink(path, failed)) {
      return path;
    }
    path = path.parent_path() / std::filesystem::read_symlink(path, failed);
  }
  throw latin::InputError(
      given.string() +
      " cannot be written: it is a link that leads back to itself: give another file");
}

/// A message in one line: names in a file may have several.
std::string one_line(std::string text) {
  std::ranges::replace_if(text, [](unsigned char each) { return std::iscntrl(each) != 0; }, ' ');
  return text;
}

/// @throws InputError
double seconds_of(const std::string& text) {
  char* end = nullptr;
  const double seconds = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0' || !(seconds > 0.0)) {
    throw latin::InputError("--max-seconds '" + text + "': give a number > 0");
  }
  return seconds;
}

/// @return nothing if help is wanted  @throws InputError
std::optional<Request> request_of(const std::vector<std::string>& arguments) {
  Request request;
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    const std::string& each = arguments[i];
    if (each == "-h" || each == "--help") {
      return std::nullopt;
    }
    if (each == "--output" || each == "--sweep" || each == "--max-seconds") {
      if (i + 1 == arguments.size()) {
        throw latin::InputError(each + ": a value is wanted behind it");
      }
      ++i;
      if (each == "--output") {
        request.output = arguments[i];
      } else if (each == "--max-seconds") {
        request.max_seconds = seconds_of(arguments[i]);
      } else {
        request.axes.push_back(arguments[i]);
      }
    } else if (each == "--displacements") {
      request.displacements = true;
    } else if (each.rfind("--", 0) == 0) {
      throw latin::InputError("there is no option " + each + ": latin_run --help lists them");
    } else if (!request.folder.empty()) {
      throw latin::InputError("one folder is wanted, got " + request.folder.string() + " and " +
                              each);
    } else {
      request.folder = each;
    }
  }
  if (request.folder.empty()) {
    throw latin::InputError("give the folder that problem.export has made: latin_run FOLDER");
  }
  if (request.output.empty()) {
    request.output =
        request.folder / "result.h5";  // a link there may be a stranger's: it is replaced
  } else {
    request.output = file_of(request.output);
  }
  return request;
}

Code run(const std::vector<std::string>& arguments, const latin::Communicator& communicator) {
  const auto began = std::chrono::steady_clock::now();
  const auto request = request_of(arguments);
  if (!request) {
    if (communicator.rank() == 0) {
      std::fputs(usage, stdout);
    }
    return done;
  }
  const auto watch = [](const latin::iteration::Iteration&) {
    if (signalled != 0) {
      throw latin::Interrupted();
    }
  };
  if (!communicator.alone()) {
    latin::bound_threads(communicator);
  }
  const latin::program::Folder folder(request->folder, communicator);
  communicator.together([&] {
    if (communicator.rank() == 0) {
      folder.check_target(request->output);
    }
  });
  const bool sweeps = !request->axes.empty() || folder.has_sweep();
  const double seconds = std::max(request->max_seconds - seconds_since(began), 0.0);
  const latin::program::Outcome outcome =
      !sweeps ? latin::program::solve_once(folder, request->output, seconds, watch)
              : latin::program::solve_sweep(
                    folder,
                    request->axes.empty() ? folder.sweep() : latin::program::grid(request->axes),
                    request->output, request->displacements, seconds, watch);
  if (communicator.rank() == 0) {
    const std::string points =
        sweeps ? " at " + std::to_string(outcome.points) + " points" : std::string();
    std::printf("%s after %td iterations%s, estimated error %.2g, %.2f s: %s\n",
                to_string(outcome.status).c_str(), outcome.iterations, points.c_str(),
                outcome.error, seconds_since(began), request->output.c_str());
  }
  return code_of(outcome.status);
}

/// Code and sentence of what a run threw.
std::pair<Code, std::string> failure_of(const std::exception_ptr& thrown) {
  try {
    std::rethrow_exception(thrown);
  } catch (const std::bad_alloc&) {
    return {out_of_limits,
            "there is not enough memory: run it on more ranks, or make the problem smaller"};
  } catch (const latin::Interrupted&) {
    return signalled != 0
               ? std::pair{ended_by_user, std::string("interrupted before there was an answer")}
               : std::pair{out_of_limits,
                           std::string("the time was over before there was an answer")};
  } catch (const latin::RemoteError& error) {
    return {done, error.what()};  // the rank that failed knows
  } catch (const latin::MemoryLimitError& error) {
    return {out_of_limits, error.what()};
  } catch (const latin::OutOfMemoryError& error) {
    return {out_of_limits, error.what()};
  } catch (const latin::InputError& error) {
    return {wrong_input, error.what()};
  } catch (const std::filesystem::filesystem_error& error) {
    return {wrong_input, error.what()};
  } catch (const std::exception& error) {
    return {not_solved, error.what()};
  }
}

/// The same code on all ranks, the largest.
int agreed(int code, MPI_Comm own) {
  latin::check_mpi(MPI_Allreduce(MPI_IN_PLACE, &code, 1, MPI_INT, MPI_MAX, own), "MPI_Allreduce");
  return code;
}

/// The options are this program's, and none of PETSc's: those of a file in the current folder may load a library.
PetscErrorCode initialise_petsc() {
  unsetenv("PETSC_OPTIONS");
  unsetenv("PETSC_OPTIONS_YAML");
  std::array<std::string, 2> given{"latin_run", "-skip_petscrc"};
  std::array<char*, 3> arguments{given[0].data(), given[1].data(), nullptr};
  int count = static_cast<int>(given.size());
  char** passed = arguments.data();
  return PetscInitialize(&count, &passed, nullptr, nullptr);
}

/// Wait for all ranks. @return whether they have come; with a failure nobody waits for long: ranks that do not know of
/// it wait for this one
bool all_end(MPI_Comm own, bool failed) {
  constexpr auto patience = std::chrono::seconds(5);
  constexpr auto pause = std::chrono::milliseconds(5);
  const auto until = std::chrono::steady_clock::now() + patience;
  MPI_Request request = MPI_REQUEST_NULL;
  latin::check_mpi(MPI_Ibarrier(own, &request), "MPI_Ibarrier");
  for (int done = 0;;) {
    latin::check_mpi(MPI_Test(&request, &done, MPI_STATUS_IGNORE), "MPI_Test");
    if (done != 0 || (failed && std::chrono::steady_clock::now() > until)) {
      return done != 0;
    }
    std::this_thread::sleep_for(pause);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  if (initialise_petsc() != PETSC_SUCCESS) {
    return not_solved;
  }
  note_signals();
  int code = not_solved;
  {
    const latin::Communicator communicator(PETSC_COMM_WORLD);
    MPI_Comm own =
        MPI_COMM_NULL;  // the messages of a run that was left are not taken for this one's
    std::string failure;
    try {
      latin::check_mpi(MPI_Comm_dup(PETSC_COMM_WORLD, &own), "MPI_Comm_dup");
      code = run(arguments, communicator);
    } catch (...) {
      std::tie(code, failure) = failure_of(std::current_exception());
      failure = one_line(failure);
    }
    // what fails, fails on all ranks, and the first says what it was
    const bool known = all_end(own, !failure.empty());
    if (!failure.empty() && (communicator.rank() == 0 || !known)) {
      std::fprintf(stderr, "latin_run: %s\n", failure.c_str());
    }
    if (!known) {
      MPI_Abort(PETSC_COMM_WORLD, code == done ? not_solved : code);
    }
    code = agreed(code, own);
    MPI_Comm_free(&own);
  }
  return PetscFinalize() == PETSC_SUCCESS ? code : not_solved;
}
