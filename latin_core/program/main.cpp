// latin_run: solves a problem that was exported to a folder, without Python. docs/kernel.md describes the folder
// and the file of the answer.

#include <petscsys.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <new>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "answer.hpp"
#include "folder.hpp"
#include "latin/common/communicator.hpp"
#include "latin/common/error.hpp"
#include "latin/common/threads.hpp"

namespace {

constexpr const char* usage =
    R"(usage: [mpirun -n RANKS] latin_run FOLDER [--output FILE] [--sweep INTERFACE.PARAMETER=VALUE,VALUE,...] ...
                                    [--displacements]

Solves the problem that problem.export(FOLDER) wrote, as it was exported: once, a history, a chaos, or a sweep.

  --output FILE   where the answer is written, which the frontend reads (load); FOLDER/result.h5 by default
  --sweep AXIS    instead: a grid of values of kernel parameters of interface laws, one option for each axis
  --displacements of a sweep: write the displacements at all points, too

Exit code 0: converged; 2: the answer is written, but did not converge; 1: an error, which is named.
)";

struct Request {
  std::filesystem::path folder;
  std::filesystem::path output;
  std::vector<std::string> axes;
  bool displacements = false;
};

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

/// @return nothing if help is wanted  @throws InputError
std::optional<Request> request_of(const std::vector<std::string>& arguments) {
  Request request;
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    const std::string& each = arguments[i];
    if (each == "-h" || each == "--help") {
      return std::nullopt;
    }
    if (each == "--output" || each == "--sweep") {
      if (i + 1 == arguments.size()) {
        throw latin::InputError(each + ": a value is wanted behind it");
      }
      ++i;
      if (each == "--output") {
        request.output = arguments[i];
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

int run(const std::vector<std::string>& arguments, const latin::Communicator& communicator) {
  const auto request = request_of(arguments);
  if (!request) {
    if (communicator.rank() == 0) {
      std::fputs(usage, stdout);
    }
    return 0;
  }
  const auto began = std::chrono::steady_clock::now();
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
  const latin::program::Outcome outcome =
      !sweeps ? latin::program::solve_once(folder, request->output)
              : latin::program::solve_sweep(
                    folder,
                    request->axes.empty() ? folder.sweep() : latin::program::grid(request->axes),
                    request->output, request->displacements);
  if (communicator.rank() == 0) {
    const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - began;
    const std::string points =
        sweeps ? " at " + std::to_string(outcome.points) + " points" : std::string();
    std::printf("%s after %td iterations%s, estimated error %.2g, %.2f s: %s\n",
                outcome.status.c_str(), outcome.iterations, points.c_str(), outcome.error,
                spent.count(), request->output.c_str());
  }
  return outcome.status == "converged" ? 0 : 2;
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
    return 1;
  }
  int code = 1;
  {
    const latin::Communicator communicator(PETSC_COMM_WORLD);
    MPI_Comm own =
        MPI_COMM_NULL;  // the messages of a run that was left are not taken for this one's
    std::string failure;
    try {
      latin::check_mpi(MPI_Comm_dup(PETSC_COMM_WORLD, &own), "MPI_Comm_dup");
      code = run(arguments, communicator);
    } catch (const std::bad_alloc&) {
      failure = "there is not enough memory: run it on more ranks, or make the problem smaller";
    } catch (const std::exception& error) {
      failure = one_line(error.what());
    }
    // what fails, fails on all ranks, and the first says what it was
    const bool known = all_end(own, !failure.empty());
    if (!failure.empty() && (communicator.rank() == 0 || !known)) {
      std::fprintf(stderr, "latin_run: %s\n", failure.c_str());
    }
    if (!known) {
      MPI_Abort(PETSC_COMM_WORLD, 1);
    }
    MPI_Comm_free(&own);
  }
  return PetscFinalize() == PETSC_SUCCESS ? code : 1;
}
