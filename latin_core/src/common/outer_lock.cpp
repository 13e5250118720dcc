#include "common/outer_lock.hpp"

namespace latin {
namespace {

OuterLock::Functions& known() {
  static OuterLock::Functions functions;
  return functions;
}

}  // namespace

void OuterLock::set(Functions functions) { known() = functions; }

OuterLock::OuterLock(bool wanted) {
  const Functions& functions = known();
  if (wanted && functions.enter != nullptr) {
    entered_ = functions.enter();
    leave_ = functions.leave;
  }
}

OuterLock::~OuterLock() {
  if (leave_ != nullptr) {
    leave_(entered_);
  }
}

}  // namespace latin
