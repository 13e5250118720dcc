#include "answer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "latin/common/error.hpp"
#include "latin/study.hpp"

// The file of the answer.
//
// It has the form of that of the folder (folder.cpp): `latin-run`, version 1. Beside what it copies from `face` it has
//
// `run/status`, `iterations`, `error`
//     text, integer, number; of a sweep the worst, the sum, the largest
// `run/indicator`, `energy`
//     number; the paper's indicator; u^T K u of all columns; not of a sweep
// `run/errors`
//     (groups, bodies); estimated errors by time step (of a chaos its mean and its fluctuation) and body
// `run/interfaces/I/name`, `force`, `jump`
//     text, (k m, c); force on side 1 per area, and jump; of a sweep (points, c, k m), NaN where it was not
//     reached
// `run/parts/P/name`, `displacement`
//     text, (n, c); of every member; of a sweep (points, c, n), and only with `--displacements`
// `run/points/status`, `iterations`, `error`
//     (points); of a sweep
// `run/axes/names`, `run/axes/A/values`
//     texts, numbers; of a sweep that the command line asked for

namespace latin::program {
namespace {

/// Fields of all ranks on rank 0, by name; each is on one rank.
class Gathered {
 public:
  explicit Gathered(const Communicator& communicator) : communicator_(communicator) {}

  struct Field {
    std::string name;
    std::vector<Index> shape;  ///< row-major
    std::vector<double> values;
  };

  /// Collective. @param fields of this rank
  void add(const std::vector<Field>& fields) {
    std::vector<std::string> names;
    std::vector<double> numbers;
    for (const Field& each : fields) {
      names.push_back(each.name);
      numbers.push_back(static_cast<double>(each.shape.size()));
      numbers.insert(numbers.end(), each.shape.begin(), each.shape.end());
      numbers.insert(numbers.end(), each.values.begin(), each.values.end());
    }
    const auto all_names = communicator_.gather(names);
    const auto all_numbers = communicator_.gather(numbers);
    if (communicator_.rank() != 0) {
      return;
    }
    for (std::size_t rank = 0; rank < all_names.size(); ++rank) {
      auto at = all_numbers[rank].begin();
      for (const std::string& name : all_names[rank]) {
        Field& field = fields_.emplace_back();
        field.name = name;
        Index size = 1;
        for (auto left = static_cast<Index>(*at++); left > 0; --left) {
          field.shape.push_back(static_cast<Index>(*at++));
          size *= field.shape.back();
        }
        field.values.assign(at, at + size);
        at += size;
      }
    }
  }
  [[nodiscard]] const std::vector<Field>& fields() const { return fields_; }

 private:
  const Communicator& communicator_;
  std::vector<Field> fields_;
};

std::vector<double> by_rows(ConstMatrixRef block) {
  std::vector<double> values;
  values.reserve(static_cast<std::size_t>(block.size()));
  for (Index row = 0; row < block.rows(); ++row) {
    for (Index column = 0; column < block.cols(); ++column) {
      values.push_back(block(row, column));
    }
  }
  return values;
}

Gathered::Field whole(const std::string& name, ConstMatrixRef block) {
  return {name, {block.rows(), block.cols()}, by_rows(block)};
}

/// A file with what the frontend has put into the folder, and the numbers of a run.
class Answer {
 public:
  Answer(const Folder& folder, const std::filesystem::path& target)
      : writer_(target, answer_format, answer_version) {
    if (folder.root().has("face")) {
      const Node face = folder.root().group("face");
      for (const std::string& name : face.names()) {
        writer_.copy(face, name);
      }
    }
  }
  [[nodiscard]] Writer& writer() { return writer_; }
  void fields(const std::string& where, const std::vector<Gathered::Field>& fields) {
    Index number = 0;
    std::string last;
    for (const Gathered::Field& each : fields) {
      // "name\nforce" and "name\njump" follow each other
      const std::size_t cut = each.name.find('\n');
      const std::string name = each.name.substr(0, cut);
      if (number == 0 || name != last) {
        last = name;
        writer_.text(group(where, number++), "name", name);
      }
      writer_.numbers(group(where, number - 1), each.name.substr(cut + 1), each.shape, each.values);
    }
  }
  void outcome(const Outcome& outcome) {
    writer_.text("run", "status", to_string(outcome.status));
    writer_.integer("run", "iterations", outcome.iterations);
    writer_.number("run", "error", outcome.error);
  }

 private:
  static std::string group(const std::string& where, Index number) {
    return where + "/" + std::to_string(number);
  }
  Writer writer_;
};

/// Force and jump of every interface of which this rank has the first side: it speaks for it. Collective.
std::vector<Gathered::Field> interface_fields(const Study& study, const Solution& solution) {
  std::vector<Gathered::Field> found;
  for (const std::string& name : study.interfaces()) {
    const Matrix& force = solution.force(name).values();
    if (study.has_first_side(name)) {
      found.push_back(whole(name + "\nforce", force));
      found.push_back(whole(name + "\njump", solution.jump(name).values()));
    }
  }
  return found;
}

/// Displacements of the parts of this rank.
std::vector<Gathered::Field> part_fields(const Solution& solution) {
  std::vector<Gathered::Field> found;
  for (const auto& [name, values] : solution.displacements()) {
    found.push_back(whole(name + "\ndisplacement", values));
  }
  return found;
}

double known(double error) {
  return std::isfinite(error) ? error : std::numeric_limits<double>::quiet_NaN();
}

/// What a sweep leaves on this rank.
struct Found {
  std::vector<std::string> status;
  std::vector<Index> iterations;
  std::vector<double> error;
  std::vector<Gathered::Field> fields;  ///< of interfaces, (points, columns, rows)
  std::vector<Gathered::Field>
      parts;  ///< of parts, if they are wanted, (points, columns, unknowns)
  Outcome outcome;

  explicit Found(Index points)
      : status(static_cast<std::size_t>(points)),
        iterations(static_cast<std::size_t>(points), -1),
        error(static_cast<std::size_t>(points), std::numeric_limits<double>::quiet_NaN()),
        outcome{Status::converged, 0, 0.0, points} {}

  void add(Index point, const Summary& summary, const std::vector<Gathered::Field>& of_interfaces,
           const std::vector<Gathered::Field>& of_parts) {
    const auto p = static_cast<std::size_t>(point);
    status[p] = to_string(summary.status);
    iterations[p] = summary.iterations;
    error[p] = known(summary.error);
    outcome.status = std::max(outcome.status, summary.status);
    outcome.iterations += summary.iterations;
    outcome.error = error[p] > outcome.error || std::isnan(error[p]) ? error[p] : outcome.error;
    keep(p, of_interfaces, fields);
    keep(p, of_parts, parts);
    ++finished_;
  }
  /// Points that are asked for and were not reached ended as the walk did.
  void leave(const std::vector<Index>& order, Status ended) {
    if (ended == Status::converged) {
      return;
    }
    if (finished_ == 0) {
      throw Interrupted();
    }
    outcome.status = std::max(outcome.status, ended);
    for (const Index point : order) {
      std::string& own = status[static_cast<std::size_t>(point)];
      own = own.empty() ? to_string(ended) : own;
    }
  }

 private:
  Index finished_ = 0;

  void keep(std::size_t p, const std::vector<Gathered::Field>& found,
            std::vector<Gathered::Field>& into) const {
    if (into.empty()) {
      for (const Gathered::Field& each : found) {
        into.push_back({each.name, {outcome.points, each.shape[1], each.shape[0]}, {}});
        into.back().values.assign(each.values.size() * status.size(),
                                  std::numeric_limits<double>::quiet_NaN());
      }
    }
    for (std::size_t i = 0; i < found.size(); ++i) {
      const auto rows = static_cast<std::size_t>(found[i].shape[0]);
      const auto columns = static_cast<std::size_t>(found[i].shape[1]);
      double* const to = into[i].values.data() + p * rows * columns;
      for (std::size_t row = 0; row < rows; ++row) {
        for (std::size_t column = 0; column < columns; ++column) {
          to[column * rows + row] = found[i].values[row * columns + column];
        }
      }
    }
  }
};

}  // namespace

Outcome solve_once(const Folder& folder, const std::filesystem::path& target, double max_seconds,
                   const iteration::Callback& watch) {
  const Study study = folder.named([&] { return folder.study(); });
  SolveOptions options{folder.named([&] { return folder.options(); }), {}, watch};
  options.max_seconds = std::min(options.max_seconds, max_seconds);
  const Solution solution = folder.named([&] { return study.solve(options); });
  const Summary& summary = solution.summary();

  const Communicator& communicator = folder.communicator();
  Gathered interfaces(communicator);
  interfaces.add(interface_fields(study, solution));
  Gathered parts(communicator);
  parts.add(part_fields(solution));
  Gathered errors(communicator);
  errors.add({whole("errors", summary.errors)});

  const Outcome outcome{summary.status, summary.iterations, known(summary.error), 1};
  communicator.together([&] {
    if (communicator.rank() != 0) {
      return;
    }
    Answer answer(folder, target);
    answer.outcome(outcome);
    answer.writer().number("run", "indicator", summary.indicator);
    answer.writer().number("run", "energy", summary.energy);
    // groups x bodies: the bodies of the ranks one after the other
    Matrix all(0, 0);
    for (const Gathered::Field& each : errors.fields()) {
      const Matrix block = Eigen::Map<const Eigen::Matrix<double, -1, -1, Eigen::RowMajor>>(
          each.values.data(), each.shape[0], each.shape[1]);
      const Index before = all.cols();
      all.conservativeResize(block.rows(), before + block.cols());
      all.rightCols(block.cols()) = block;
    }
    answer.writer().matrix("run", "errors", all);
    answer.fields("run/interfaces", interfaces.fields());
    answer.fields("run/parts", parts.fields());
    answer.writer().finish();
  });
  return outcome;
}

Outcome solve_sweep(const Folder& folder, const SweepRequest& request,
                    const std::filesystem::path& target, bool displacements, double max_seconds,
                    const iteration::Callback& watch) {
  const Study study = folder.named([&] { return folder.study(); });
  SweepOptions options{folder.named([&] { return folder.options(); }), {}, watch};
  options.max_seconds = std::min(options.max_seconds, max_seconds);
  Found found(request.count);
  const Status ended = folder.named([&] {
    return study.sweep(request.points, options, [&](Index point, const Solution& solution) {
      std::vector<Gathered::Field> of_parts;
      if (displacements) {
        of_parts = part_fields(solution);
      }
      found.add(point, solution.summary(), interface_fields(study, solution), of_parts);
    });
  });
  found.leave(request.points.order, ended);

  const Communicator& communicator = folder.communicator();
  Gathered interfaces(communicator);
  interfaces.add(found.fields);
  Gathered parts(communicator);
  parts.add(found.parts);
  communicator.together([&] {
    if (communicator.rank() != 0) {
      return;
    }
    Answer answer(folder, target);
    answer.outcome(found.outcome);
    Writer& writer = answer.writer();
    writer.texts("run/points", "status", found.status);
    writer.integers("run/points", "iterations", found.iterations);
    writer.numbers("run/points", "error", {request.count}, found.error);
    std::vector<std::string> names;
    for (const auto& [name, values] : request.axes) {
      writer.numbers("run/axes/" + std::to_string(names.size()), "values",
                     {static_cast<Index>(values.size())}, values);
      names.push_back(name);
    }
    if (!names.empty()) {
      writer.texts("run/axes", "names", names);
    }
    answer.fields("run/interfaces", interfaces.fields());
    answer.fields("run/parts", parts.fields());
    writer.finish();
  });
  return found.outcome;
}

}  // namespace latin::program
