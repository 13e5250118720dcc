#include "interface/interface.hpp"

#include "latin/common/error.hpp"

namespace latin::interface {

SparseRows to_local_frame(const SparseRows& trace, ConstMatrixRef frames, const std::string& name) {
  const Index dim = frames.cols();
  const Index points = dim > 0 ? trace.rows() / dim : 0;
  if (trace.rows() != dim * points || points == 0 || frames.rows() % points != 0 ||
      frames.rows() > trace.rows()) {
    throw InputError("interface '" + name + "': a trace of " + std::to_string(trace.rows()) +
                     " rows does not fit frames of shape (" + std::to_string(frames.rows()) + ", " +
                     std::to_string(dim) + ")");
  }
  const Index components = frames.rows() / points;
  SparseRows rotation(frames.rows(), trace.rows());
  rotation.reserve(Eigen::VectorXi::Constant(frames.rows(), static_cast<int>(dim)));
  for (Index point = 0; point < points; ++point) {
    for (Index a = 0; a < components; ++a) {
      for (Index b = 0; b < dim; ++b) {
        const double value = frames(components * point + a, b);
        if (value != 0.0) {
          rotation.insert(components * point + a, dim * point + b) = value;
        }
      }
    }
  }
  rotation.makeCompressed();
  SparseRows local = rotation * trace;
  local.prune(0.0);
  return local;
}

}  // namespace latin::interface
